"""The calibration jobs from file to number, chart and YAML, and one sentence for each bad input."""

import gzip

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import Attitude, GpsPosition, ImuBlock, MagneticField
from lowcostnav_ros.calibration.magnetometer_swing import level_field
from lowcostnav_ros.catalogue.config_files import load_settings
from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.navigators.ahrs.navigator import AhrsSettings
from lowcostnav_ros.physics.geomagnetism import field_n
from lowcostnav_ros.physics.rotation import euler_to_dcm, euler_to_quat, quat_to_dcm, wrap
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
    page = (tmp_path / f"{job}.html").read_text()
    assert page.count('class="chart') == {"allan": 4, "identify": 2}[job]
    assert all(f'data-label="{name}"' in page for name in ("gx", "gy", "gz"))
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
    assert out.with_suffix(".html").read_text().count('class="chart half"') == 2


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


DEVIATING = (np.array([3.0, -2.0]), np.array([[0.06, 0.02], [-0.01, -0.04]]))


def rose_fields(headings_deg, strength_ut=25.0):
    return level_field(np.radians(headings_deg), tuple(DEVIATING[0]), DEVIATING[1], strength_ut)


@pytest.mark.parametrize("columns", ["heading,measured", "heading,x,y,z", "turned,measured"])
def test_magcal_of_a_swing_gives_a_calibration_that_shows_the_headings(columns, tmp_path, capsys):
    heading, out = np.arange(0.0, 360.0, 30.0), tmp_path / "mag.yaml"
    field = np.column_stack([rose_fields(heading), np.full(len(heading), 40.0)])
    measured = np.degrees(np.arctan2(-field[:, 1], field[:, 0])) % 360.0
    known = heading - 77.0 if columns.startswith("turned") else heading
    rows = np.column_stack([known, measured] if columns.endswith("measured") else [known, field])
    table = write_table(tmp_path / "rose.csv", columns.split(","), rows)
    last = ["--last-heading", "330"] if columns.startswith("turned") else []
    assert cli.main(["magcal", table, "--method", "swing", "--column", columns, "--strength", "25", *last, "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "by the iron 0.000 deg RMS" in said
    assert "left by the curve 0.283" in said
    between = np.arange(5.0, 360.0, 10.0)
    seen = load_settings(AhrsSettings, out).magnetometer.apply(np.column_stack([rose_fields(between), np.zeros(36)]) * 1e-6)
    shown = np.arctan2(-seen[:, 1], seen[:, 0])
    error_deg = np.degrees(np.abs(wrap(shown - np.radians(between)))).max()
    assert error_deg < 0.1  # 1 % of iron: the factor common to both axes, which headings do not show; the curve leaves 0.28 deg
    assert "Deviation [deg]" in out.with_suffix(".html").read_text()


def swung_bag(path):
    """A bag of twelve headings, twenty seconds each, with 3 and -2 uT of hard iron."""
    start, field, rng = 1_767_225_600_000_000_000, field_n(*PLACE, 2026.0), np.random.default_rng(4)
    with BagWriter(path) as writer:
        sent = [GpsPosition(start, "gps/fix", *PLACE, np.eye(3))]
        for k in range(480):
            stamp, q_nb = start + k * 500_000_000, euler_to_quat(0.02, -0.03, np.radians(30.0) * (k // 40))
            iron = 1e-6 * np.array([3.0, -2.0, 0.0]) + 2e-8 * rng.standard_normal(3)
            sent.append(Attitude(stamp, "gps/attitude", q_nb, np.eye(3) * 1e-6, np.zeros(3), np.array([0.0, 0.0, -9.8])))
            sent.append(MagneticField(stamp, "imu/mag", quat_to_dcm(q_nb).T @ field + iron, np.eye(3) * 1e-16))
        for measurement in sent:
            for stamp_ns, topic, msgtype, cdr in encode_cdr(measurement):
                writer.write(topic, msgtype, stamp_ns, cdr)
    return str(path)


def test_magcal_of_a_swing_in_a_bag_takes_off_the_declination(tmp_path):
    bag = swung_bag(tmp_path / "bag")
    assert cli.main(["magcal", bag, "--method", "swing", "-o", str(tmp_path / "mag.yaml")]) == 0
    loaded = load_settings(AhrsSettings, tmp_path / "mag.yaml").magnetometer
    np.testing.assert_allclose(loaded.hard_iron_ut, [3.0, -2.0, 0.0], atol=0.1)
    np.testing.assert_allclose(loaded.matrix, np.eye(3).ravel(), atol=0.004)


def test_magcal_of_a_swing_refuses_in_a_sentence(tmp_path, capsys):
    table = write_table(tmp_path / "rose.csv", ["heading", "measured"], np.column_stack([np.arange(0.0, 180.0, 30.0)] * 2))
    assert cli.main(["magcal", table, "--method", "swing", "--strength", "25"]) == 2
    assert "gap of 210 deg" in capsys.readouterr().err
    assert cli.main(["magcal", table, "--method", "swing", "--strength", "25", "--column", "heading"]) == 2
    assert "heading,measured or heading,x,y,z" in capsys.readouterr().err
    assert cli.main(["magcal", table, "--method", "swing"]) == 2
    assert "--strength" in capsys.readouterr().err


def test_calibrate_temperature_gives_the_slope_that_a_profile_takes(tmp_path, capsys):
    temperature_c = np.arange(0.0, 61.0, 10.0)
    output = 60.0 * (1.0 + 430e-6 * (temperature_c - 30.0)) + 0.001 * np.array([1.0, -1.0, 0.0, 1.0, 0.0, -1.0, 0.0])
    table = write_table(tmp_path / "runs.csv", ["temperature_c", "output"], np.column_stack([temperature_c, output]))
    assert cli.main(["calibrate", "temperature", table, "--input", "60"]) == 0
    said = capsys.readouterr().out
    assert "scale factor: 42" in said or "scale factor: 43" in said
    assert "from 0 to 60 degC" in said
    assert imu_profile_from_text("gyro: {" + said.split("gyro.")[1].split("  and")[0] + "}").gyro.scale_factor_ppm_per_k[0] > 420.0
    assert cli.main(["calibrate", "temperature", table, "--input", "0"]) == 2
    assert "not zero" in capsys.readouterr().err


def test_calibrate_warm_up_gives_the_transient_that_a_profile_takes(tmp_path, capsys):
    t_s = np.arange(0.0, 10800.0, 60.0)
    table = write_table(tmp_path / "start.csv", ["t_s", "output"], np.column_stack([t_s, 0.01 + 0.05 * np.exp(-t_s / 1800.0)]))
    assert cli.main(["calibrate", "warm-up", table]) == 0
    assert "0.01 deg/s settled, +0.05 deg/s at power-up, gone with 1800 s" in capsys.readouterr().out


def test_calibrate_heading_gives_the_settings_of_the_magnetic_aid(tmp_path, capsys):
    rng, slow, decay = np.random.default_rng(6), np.zeros(28_800), np.exp(-0.5 / 120.0)
    for k in range(1, len(slow)):
        slow[k] = decay * slow[k - 1] + 2.5 * np.sqrt(1.0 - decay**2) * rng.standard_normal()
    error = slow + 0.8 * rng.standard_normal(len(slow)) + 1.0
    table = write_table(tmp_path / "error.csv", ["t_s", "error"], np.column_stack([0.5 * np.arange(len(slow)), error]))
    assert cli.main(["calibrate", "heading", table, "-o", str(tmp_path / "heading.yaml")]) == 0
    assert "mean +" in capsys.readouterr().out
    loaded = load_settings(AhrsSettings, tmp_path / "heading.yaml").magnetic
    assert loaded.noise_deg == pytest.approx(0.8, rel=0.05)
    assert loaded.bias_deg == pytest.approx(np.hypot(2.5, error.mean()), rel=0.2)
    assert loaded.bias_tau_s == pytest.approx(120.0, rel=0.4)  # 120 correlation times: 13 % one sigma of sigma, twice that of tau


def test_calibrate_heading_of_a_bag_applies_the_calibration(tmp_path, capsys):
    bag = swung_bag(tmp_path / "bag")
    assert cli.main(["magcal", bag, "--method", "swing", "-o", str(tmp_path / "mag.yaml")]) == 0
    left = []
    for more in ([], ["--calibration", str(tmp_path / "mag.yaml")]):
        capsys.readouterr()
        out = tmp_path / "heading.yaml"
        assert cli.main(["calibrate", "heading", bag, *more, "-o", str(out)]) == 0
        own = load_settings(AhrsSettings, out).magnetic
        left.append(own.bias_deg)
    assert left[0] > 3.0
    assert left[1] < 0.1


def test_the_page_of_an_identification_says_what_the_terminal_says_and_in_which_unit(tmp_path, capsys):
    table = "\n".join(["gyro_x", *(f"{value:.6f}" for value in np.random.default_rng(2).normal(0.001, 0.002, 12_000))])
    (tmp_path / "rest.csv").write_text(table)
    for job in ("identify", "allan"):
        cli.main([job, str(tmp_path / "rest.csv"), "--rate", "100", "--unit", "rad/s", "-o", str(tmp_path / job)])
        said = [line for line in capsys.readouterr().out.splitlines() if line.startswith(("verdict", "gyro drift"))]
        page = (tmp_path / job / f"{job}.html").read_text()
        assert len(said) >= 1 and all(line in page for line in said) and "drift sigma [rad/s]" in page and "[u]" not in page
