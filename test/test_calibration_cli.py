"""The calibration jobs from file to number, chart and YAML, and one sentence for each bad input."""

import gzip

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import GpsPosition, ImuBlock, MagneticField
from lowcostnav_ros.catalogue.config_files import load_settings
from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.messages.bag import BagWriter
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.navigators.ahrs.navigator import AhrsSettings
from lowcostnav_ros.physics.geomagnetism import field_n
from lowcostnav_ros.sensors.imu_profile import imu_profile_from_text

RATE = 50.0


def write_table(path, names, rows):
    with gzip.open(path, "wt") if path.suffix == ".gz" else open(path, "w") as file:
        file.write(",".join(names) + "\n")
        np.savetxt(file, rows, delimiter=",", fmt="%.9g")
    return str(path)


@pytest.fixture(scope="module")
def gyro_table(tmp_path_factory):
    rows = np.random.default_rng(1).standard_normal((20_000, 3)) * [0.05, 0.06, 0.07] + [0.01, 0.0, -0.02]
    path = tmp_path_factory.mktemp("still") / "gyro.csv.gz"
    return write_table(path, ["t_s", "gx", "gy", "gz"], np.column_stack([np.arange(20_000) / RATE, rows]))


@pytest.mark.parametrize("job", ["allan", "identify"])
def test_a_table_at_rest_becomes_a_profile_that_loads(job, gyro_table, tmp_path, capsys):
    assert cli.main([job, gyro_table, "--unit", "deg/s", "-o", str(tmp_path)]) == 0
    profile = imu_profile_from_text((tmp_path / "profile.yaml").read_text())
    density_deg_s = np.array(profile.gyro.noise_density_deg_per_h_per_rt_hz) / 3600.0
    np.testing.assert_allclose(density_deg_s, np.array([0.05, 0.06, 0.07]) / np.sqrt(RATE), rtol=0.03)
    assert profile.gyro.bias_drift_deg_per_h == [0.0, 0.0, 0.0]
    assert profile.rate_hz == pytest.approx(RATE, rel=1e-3)
    assert (tmp_path / f"{job}_gyro.png").stat().st_size > 5000
    assert job != "allan" or "<svg" in (tmp_path / "allan.html").read_text()
    assert (tmp_path / f"{job}.csv").read_text().count("\n") == 4
    assert "gz" in capsys.readouterr().out


def imu_samples(rng):
    stamps_ns = 1_700_000_000_000_000_000 + (np.arange(3000) * 1e9 / RATE).astype(np.int64)
    force = [0.0, 0.0, -9.81] + 0.02 * rng.standard_normal((3000, 3))
    return ImuBlock.of("imu/data_raw", stamps_ns, force, 0.001 * rng.standard_normal((3000, 3)))


def test_a_bag_at_rest_gives_gyros_and_accelerometers(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for stamp_ns, topic, msgtype, cdr in encode_cdr(imu_samples(np.random.default_rng(2))):
            writer.write(topic, msgtype, stamp_ns, cdr)
    assert cli.main(["allan", str(tmp_path / "bag"), "-o", str(tmp_path / "out")]) == 0
    noise = imu_profile_from_text((tmp_path / "out" / "profile.yaml").read_text()).filter_noise()
    np.testing.assert_allclose(noise.gyro_noise_density, 0.001 / np.sqrt(RATE), rtol=0.06)
    np.testing.assert_allclose(noise.accel_noise_density, 0.02 / np.sqrt(RATE), rtol=0.06)


@pytest.mark.parametrize(
    ("names", "rows", "options", "word"),
    [
        (["t", "x"], np.zeros((0, 2)), [], "no rows"),
        (["t", "x"], np.column_stack([np.arange(200.0), np.full(200, 1.0)]), [], "frozen"),
        (["t", "x"], np.column_stack([np.arange(200.0), np.where(np.arange(200) == 9, np.nan, np.arange(200.0))]), [], "not finite"),
        (["t", "x"], np.column_stack([np.cumsum(1.0 + (np.arange(200) % 10 == 0)), np.arange(200.0)]), [], "usual"),
        (["t", "x"], np.column_stack([np.arange(20.0), np.arange(20.0)]), [], "only 20 samples"),
        (["x"], np.arange(200.0)[:, None], [], "--rate"),
        (["t", "rate"], np.column_stack([np.arange(200.0)] * 2), ["--column", "rote"], "did you mean 'rate'"),
    ],
)
@pytest.mark.parametrize("job", ["allan", "identify"])
def test_bad_tables_get_one_sentence(job, names, rows, options, word, tmp_path, capsys):
    assert cli.main([job, write_table(tmp_path / "bad.csv", names, rows), *options]) == 2
    message = capsys.readouterr().err.strip()
    assert word in message
    assert message.endswith(".")
    assert "\n" not in message


def test_a_table_without_header_or_with_words_and_a_profile_without_unit_are_refused(tmp_path, capsys, gyro_table):
    (tmp_path / "bare.csv").write_text("1,2\n3,4\n")
    assert cli.main(["allan", str(tmp_path / "bare.csv")]) == 2
    assert "header line" in capsys.readouterr().err
    (tmp_path / "words.csv").write_text("t,x\n0,one\n")
    assert cli.main(["allan", str(tmp_path / "words.csv")]) == 2
    assert "not a number" in capsys.readouterr().err
    assert cli.main(["allan", gyro_table, "-o", str(tmp_path)]) == 2
    assert "give --unit" in capsys.readouterr().err
    assert cli.main(["allan", str(tmp_path / "missing.csv")]) == 2
    assert "missing.csv" in capsys.readouterr().err


PLACE = (np.radians(37.4), np.radians(-122.1), 100.0)
IRON_UT, SCALE = np.array([6.0, -4.0, 3.0]), np.array([1.02, 0.985, 1.01])


def turns(n=2000, tilt=1.0, noise_ut=0.1):
    """Measured field, microtesla, of a flight with bank and pitch at Palo Alto in 2026."""
    from lowcostnav_ros.physics.rotation import euler_to_dcm

    rng, field = np.random.default_rng(3), field_n(*PLACE, 2026.0) * 1e6
    t = np.arange(n) * 0.05
    angles = np.column_stack([tilt * 0.7 * np.sin(0.9 * t), tilt * 0.3 * np.sin(0.37 * t), 0.25 * t])
    return np.array([euler_to_dcm(*a).T @ field for a in angles]) * SCALE + IRON_UT + noise_ut * rng.standard_normal((n, 3))


@pytest.mark.parametrize(("unit", "per_ut"), [("uT", 1.0), ("nT", 1e3), ("mG", 10.0), ("G", 0.01), ("T", 1e-6)])
def test_magcal_of_a_table_in_any_unit(unit, per_ut, tmp_path, capsys):
    table, out = write_table(tmp_path / "turns.csv", ["x", "y", "z"], turns() * per_ut), tmp_path / "mag.yaml"
    assert cli.main(["magcal", table, "--place", "37.4,-122.1,100", "--date", "2026.0", "-o", str(out)]) == 0
    text = capsys.readouterr().out
    assert f"samples in {unit} (found from the magnitude)" in text
    loaded = load_settings(AhrsSettings, out).magnetometer
    np.testing.assert_allclose(loaded.hard_iron_ut, IRON_UT, atol=0.3)
    np.testing.assert_allclose(np.diag(np.reshape(loaded.matrix, (3, 3))), 1.0 / SCALE, rtol=0.01)
    assert out.with_suffix(".png").stat().st_size > 5000 and "<svg" in out.with_suffix(".html").read_text()


@pytest.mark.parametrize("method", ["batch", "known-strength"])
def test_magcal_methods_agree(method, tmp_path):
    table, out = write_table(tmp_path / "turns.csv", ["x", "y", "z"], turns()), tmp_path / "mag.yaml"
    strength = f"{np.linalg.norm(field_n(*PLACE, 2026.0)) * 1e6:.4f}"
    assert cli.main(["magcal", table, "--strength", strength, "--method", method, "-o", str(out)]) == 0
    np.testing.assert_allclose(load_settings(AhrsSettings, out).magnetometer.hard_iron_ut, IRON_UT, atol=0.4)


def test_magcal_of_a_bag_takes_place_and_date_from_it(tmp_path, capsys):
    start = 1_767_225_600_000_000_000  # 2026-01-01
    with BagWriter(tmp_path / "bag") as writer:
        fix = GpsPosition(start, "gps/fix", *PLACE, np.eye(3))
        samples = [MagneticField(start + k * 50_000_000, "imu/mag", row * 1e-6, np.eye(3) * 1e-14) for k, row in enumerate(turns())]
        for measurement in [fix, *samples]:
            for stamp_ns, topic, msgtype, cdr in encode_cdr(measurement):
                writer.write(topic, msgtype, stamp_ns, cdr)
    assert cli.main(["magcal", str(tmp_path / "bag"), "-o", str(tmp_path / "mag.yaml")]) == 0
    assert f"field {np.linalg.norm(field_n(*PLACE, 2026.0)) * 1e6:.2f} uT" in capsys.readouterr().out
    np.testing.assert_allclose(load_settings(AhrsSettings, tmp_path / "mag.yaml").magnetometer.hard_iron_ut, IRON_UT, atol=0.3)


def test_magcal_refusals(tmp_path, capsys):
    table = write_table(tmp_path / "level.csv", ["x", "y", "z"], turns(tilt=0.02))
    place = ["--place", "37.4,-122.1", "--date", "2026"]
    assert cli.main(["magcal", table]) == 2
    assert "--strength" in capsys.readouterr().err
    assert cli.main(["magcal", table, *place]) == 2
    assert "known" in capsys.readouterr().err
    assert cli.main(["magcal", table, "--place", "Palo Alto", "--date", "2026"]) == 2
    assert "is not a place" in capsys.readouterr().err
    assert cli.main(["magcal", table, "--place", "37.4,-122.1", "--date", "1990"]) == 2
    assert "No magnetic model" in capsys.readouterr().err
    assert cli.main(["magcal", table, *place, "--column", "x,y"]) == 2
    assert "three columns" in capsys.readouterr().err
    assert cli.main(["magcal", table, *place, "--method", "level-turn"]) == 0
    assert "z was not calibrated" in capsys.readouterr().out
