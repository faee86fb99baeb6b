"""A recorded flight as truth: near the recording, and exact motion."""

import math

import numpy as np
import pymap3d
import pytest

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.physics.rotation import quats_to_euler
from lowcostnav_ros.trajectory import TruthSettings, build

HEADER = "t,lat_deg,lon_deg,height_m,vn,ve,vd"


@pytest.fixture(scope="module")
def flown():
    mission = ["straight duration_s=20", "turn by_deg=270 bank_deg=25", "climb to_height_m=700 rate_mps=3"]
    return build(TruthSettings(mission=mission, incidence_deg=0.0)).table()


def record(path, truth, every: int, noise: float, attitude: bool = False):
    """Write every so many rows as a receiver would have recorded them: ``noise`` metres, a twentieth of it in velocity."""
    rng = np.random.default_rng(3)
    angles = np.degrees(quats_to_euler(truth.q_nb))
    lines = [HEADER + (",roll_deg,pitch_deg,heading_deg" if attitude else "")]
    for k in range(0, len(truth), every):
        n, e, d = noise * rng.standard_normal(3)
        lat, lon, height = pymap3d.enu2geodetic(e, n, -d, math.degrees(truth.lat[k]), math.degrees(truth.lon[k]), truth.height[k])
        velocity = truth.vel_n[k] + 0.05 * noise * rng.standard_normal(3)
        row = [k * 0.01, lat, lon, height, *velocity, *(angles[k] if attitude else ())]
        lines.append(",".join(f"{x:.10f}" for x in row))
    path.write_text("\n".join(lines) + "\n")
    return TruthSettings(kind="recorded", recording=str(path))


def distances(truth, flown) -> np.ndarray:
    """North, east, down from the flown to the truth made of its recording; row k of the truth is row k + 1 of the flight."""
    there = flown[1 : len(truth) + 1]
    east, north, up = pymap3d.geodetic2enu(truth.lat, truth.lon, truth.height, there.lat, there.lon, there.height, deg=False)
    return np.column_stack((north, east, -up))


def test_perfect_recording_gives_the_flight_back(tmp_path, flown):
    truth = build(record(tmp_path / "r.csv", flown, 10, 0.0, attitude=True)).table()
    there = flown[1 : len(truth) + 1]
    assert np.abs(distances(truth, flown)).max() < 0.1
    assert np.abs(truth.vel_n - there.vel_n).max() < 0.15
    turn = np.degrees(quats_to_euler(truth.q_nb) - quats_to_euler(there.q_nb))
    assert np.abs((turn + 180.0) % 360.0 - 180.0).max() < 0.05


def test_noisy_recording_is_smoothed_and_attitude_made_up(tmp_path, flown):
    truth = build(record(tmp_path / "r.csv", flown, 20, 1.5)).table()
    there = flown[1 : len(truth) + 1]
    assert np.sqrt(np.mean(distances(truth, flown) ** 2)) < 0.75
    bank = np.degrees(quats_to_euler(truth.q_nb)[:, 0] - quats_to_euler(there.q_nb)[:, 0])
    assert np.sqrt(np.mean(bank**2)) < 1.5
    assert np.abs(truth.specific_force_b).max() < 15.0  # receiver noise must not turn into acceleration


def test_velocity_is_the_derivative_of_position(tmp_path, flown):
    truth = build(record(tmp_path / "r.csv", flown, 20, 1.5)).table()
    after, before = ((truth.lat[rows], truth.lon[rows], truth.height[rows]) for rows in (slice(2, None), slice(None, -2)))
    east, north, up = pymap3d.geodetic2enu(*after, *before, deg=False)
    assert np.abs(np.column_stack((north, east, -up)) / 0.02 - truth.vel_n[1:-1]).max() < 1e-3


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda rows: [r.replace("lat_deg", "latdeg") for r in rows], r"no column 'lat_deg' \(did you mean 'latdeg'"),
        (lambda rows: rows[:5], "at least 8"),
        (lambda rows: [*rows[:4], "1,x,0,0,0,0,0", *rows[4:]], "line 5: 'lat_deg' is 'x'"),
        (lambda rows: [*rows[:4], "1,2", *rows[4:]], "line 5: 'lon_deg' is None"),
        (lambda rows: [*rows[:6], rows[5], *rows[6:]], "line 7: time does not increase"),
        (lambda rows: [*rows[:10], *rows[60:]], "line 11: a gap of"),
    ],
)
def test_bad_recording_is_refused_by_line(tmp_path, flown, edit, says):
    settings = record(tmp_path / "r.csv", flown, 20, 0.0)
    path = tmp_path / "r.csv"
    path.write_text("\n".join(edit(path.read_text().splitlines())) + "\n")
    with pytest.raises(SettingsError, match=says):
        build(settings)


def test_missing_file_and_too_long_a_flight_are_refused(tmp_path, flown):
    with pytest.raises(SettingsError, match="cannot be read"):
        build(TruthSettings(kind="recorded", recording=str(tmp_path / "none.csv")))
    settings = record(tmp_path / "r.csv", flown, 20, 0.0)
    with pytest.raises(SettingsError, match="ask for that or less"):
        build(TruthSettings(kind="recorded", recording=settings.recording, duration_s=1.0e4))
