"""The mission language, and closed-form flights against kinematics written out by hand."""

import dataclasses
import math

import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.catalogue.config_files import find_config, load_settings
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_rotate, quats_to_euler
from lowcostnav_ros.physics.strapdown import strapdown_step
from lowcostnav_ros.trajectory import MISSIONS, StartSettings, TruthSettings, WindSettings, build, parse_mission, standard
from lowcostnav_ros.trajectory.manoeuvres import Hold, Turn
from lowcostnav_ros.trajectory.profile import (
    plateau,
    plateau_integral,
    plateau_length,
    smooth_step,
    smooth_step_curvature,
    smooth_step_rate,
)
from lowcostnav_ros.trajectory.trajectory import integrate_position
from lowcostnav_ros.trajectory.wind import SmoothGaussMarkov

WINDY = WindSettings(north_mps=-4.0, east_mps=6.0, variation_sigma_mps=5.0, shear_east_per_s=0.005, turbulence_sigma_mps=1.0)
COLUMNS = ("stamps_ns", "lat", "lon", "height", "vel_n", "q_nb", "specific_force_b", "angular_rate_b", "wind_n")


def fly(*mission: str, wind: WindSettings = WindSettings(), seed: int = 0, **start: float):  # noqa: B008 - frozen
    start = {"lat_deg": 40.0, "lon_deg": -100.0, "height_m": 1000.0, "heading_deg": 0.0, "airspeed_mps": 50.0} | start
    return build(TruthSettings(mission=list(mission), wind=wind, start=StartSettings(**start), incidence_deg=0.0), seed).table()


def reintegrated(truth) -> np.ndarray:
    """Largest north, east, down distance between the truth and an ideal IMU re-integrated from its first row."""
    nav = np.concatenate(([truth.lat[0], truth.lon[0], truth.height[0]], truth.vel_n[0], truth.q_nb[0]))
    dt = np.diff(truth.stamps_ns) * 1e-9
    dv, dtheta = truth.specific_force_b[0] * dt[0], truth.angular_rate_b[0] * dt[0]
    track = np.empty((len(truth), 3))
    track[0] = nav[:3]
    for k in range(1, len(truth)):
        before = dv, dtheta
        dv, dtheta = truth.specific_force_b[k] * dt[k - 1], truth.angular_rate_b[k] * dt[k - 1]
        strapdown_step(nav, dv, dtheta, *before, dt[k - 1])
        track[k] = nav[:3]
    east, north, up = pymap3d.geodetic2enu(*track.T, *(truth.lat, truth.lon, truth.height), deg=False)
    return np.abs([north, east, up]).max(axis=1)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("trun by_deg=90", "did you mean 'turn'"),
        ("turn by=90", "did you mean 'by_deg'"),
        ("turn by_deg", "write name=value"),
        ("turn by_deg=ninety", "needs a number"),
        ("turn by_deg=90 by_deg=80", "twice"),
        ("turn bank_deg=80", "at most 60"),
        ("hold side=up", "one of right, left"),
        ("", "unknown manoeuvre"),
        ({"turn": {}, "hold": {}}, "expected one manoeuvre"),
        (7, "expected one manoeuvre"),
    ],
)
def test_a_wrong_mission_line_is_refused_by_number(line, says):
    with pytest.raises(SettingsError, match=says) as refusal:
        parse_mission(["straight duration_s=5", line])
    assert "line 2" in str(refusal.value)


def test_text_and_mapping_mean_the_same():
    assert parse_mission(["turn by_deg=-45 bank_deg=30", "hold side=left"]) == [Turn(-45.0, 30.0), Hold(side="left")]
    assert parse_mission([{"turn": {"by_deg": -45, "bank_deg": 30}}, {"hold": {"side": "left"}}]) == [Turn(-45.0, 30.0), Hold(side="left")]


@given(st.text(max_size=40))
def test_any_text_is_read_or_refused(text):
    try:
        assert len(parse_mission([text])) == 1
    except SettingsError as refusal:
        assert str(refusal).endswith((".", "?")) or "known:" in str(refusal)


def test_settings_refuse_what_cannot_be_flown():
    with pytest.raises(SettingsError, match="recording"):
        TruthSettings(kind="recorded")
    with pytest.raises(SettingsError, match="flies no manoeuvres"):
        TruthSettings(kind="dataset", name="LD", mission=["straight"])
    with pytest.raises(SettingsError, match="did you mean 'demo'"):
        build(TruthSettings(name="demmo"))
    with pytest.raises(SettingsError, match="too steep"):
        fly("climb to_height_m=2000 rate_mps=15", airspeed_mps=25.0)
    with pytest.raises(SettingsError, match="too high for its glide"):
        fly("approach lat_deg=40.01 lon_deg=-100 height_m=0", height_m=9000.0)
    with pytest.raises(SettingsError, match="at most 6 "):
        from_mapping(TruthSettings, {"wind.turbulence_sigma_mps": 60})


@given(st.floats(-1.0, 2.0))
def test_smooth_step_derivatives(x):
    h = 1e-6
    assert smooth_step_rate(x) == pytest.approx((smooth_step(x + h) - smooth_step(x - h)) / (2 * h), abs=1e-6)
    assert smooth_step_curvature(x) == pytest.approx((smooth_step_rate(x + h) - smooth_step_rate(x - h)) / (2 * h), abs=2e-4)


@given(st.floats(0.01, 20.0), st.floats(0.05, 3.0), st.floats(0.5, 6.0))
def test_plateau_integrates_to_what_was_asked(total, rate, entry):
    length, height = plateau_length(total, rate, entry)
    area, _ = quad(lambda t: height * plateau(t, length, entry), 0.0, length, points=[entry, length - entry], limit=200)
    assert area == pytest.approx(total, rel=1e-7)
    assert height * plateau_integral(length, length, entry) == pytest.approx(total, rel=1e-12)
    assert height <= rate * (1 + 1e-12)


def test_position_integrates_a_meridian_and_a_parallel():
    """One degree along the meridian at constant height against the published arc length, 45 N; a parallel in closed form."""
    arc = 6367449.1458 * math.radians(1.0) - 32076.8572 / 2 * (math.sin(2 * math.radians(45.5)) - math.sin(2 * math.radians(44.5)))
    steps, speed = 2000, 50.0
    vel = np.tile([speed, 0.0, 0.0], (2 * steps + 1, 1))
    track = integrate_position(math.radians(44.5), 0.0, 0.0, vel, np.full(steps, arc / speed / steps))
    assert math.degrees(track[-1, 0]) == pytest.approx(45.5, abs=2e-5)
    across = pymap3d.geodetic2ecef(44.5, 0.0, 800.0)[0]
    track = integrate_position(math.radians(44.5), 0.0, 800.0, vel[:, [1, 0, 2]], np.full(steps, 0.5))
    assert track[-1, 1] == pytest.approx(speed * 0.5 * steps / across, rel=1e-12)
    assert track[-1, 0] == math.radians(44.5)


def test_level_turn_is_a_circle_of_the_radius_bank_gives():
    truth = fly("straight duration_s=5", "turn by_deg=720 bank_deg=30", "straight duration_s=5")
    steady = truth[3000:6000]  # the middle of the turn: constant rate
    rate = 9.80665 * math.tan(math.radians(30.0)) / 50.0
    np.testing.assert_allclose(quats_to_euler(steady.q_nb)[:, 0], math.radians(30.0), atol=1e-9)
    east, north, _ = pymap3d.geodetic2enu(np.degrees(steady.lat), np.degrees(steady.lon), steady.height, 40.0, -100.0, 1000.0)
    a = np.column_stack((2 * east, 2 * north, np.ones(len(east))))
    centre_e, centre_n, c = np.linalg.lstsq(a, east**2 + north**2, rcond=None)[0]
    assert math.sqrt(c + centre_e**2 + centre_n**2) == pytest.approx(50.0 / rate, rel=1e-4)
    # Coordinated: no specific force along the wing but the earth's rotation, and 1/cos(bank) along the body z axis.
    assert np.abs(steady.specific_force_b[:, 1]).max() < 0.02
    np.testing.assert_allclose(-steady.specific_force_b[:, 2], 9.797 / math.cos(math.radians(30.0)), atol=0.03)
    body_rate = rate * np.array([0.0, math.sin(math.radians(30.0)), math.cos(math.radians(30.0))])
    np.testing.assert_allclose(steady.angular_rate_b, np.tile(body_rate, (len(steady), 1)), atol=9e-5)
    assert math.sin(quats_to_euler(truth.q_nb)[-1, 2]) == pytest.approx(0.0, abs=1e-8)


def test_climb_speed_and_heading_arrive():
    up, down = "climb to_height_m=1200 rate_mps=3", "descend to_height_m=1100 rate_mps=4"
    truth = fly(up, "speed to_mps=60", "heading to_deg=200 bank_deg=25", down)
    assert truth.height[-1] == pytest.approx(1100.0, abs=1e-6)
    assert truth.height.max() == pytest.approx(1200.0, abs=1e-6)
    assert np.linalg.norm(truth.vel_n[-1]) == pytest.approx(60.0, abs=1e-9)
    assert math.degrees(quats_to_euler(truth.q_nb[-1:])[0, 2]) == pytest.approx(200.0, abs=1e-6)
    assert truth.vel_n[:, 2].min() == pytest.approx(-3.0, abs=1e-6)
    assert truth.vel_n[:, 2].max() == pytest.approx(4.0, abs=1e-6)


def test_s_turns_and_hold_end_on_their_heading():
    for line, heading in (("s_turns count=4 by_deg=60", 0.0), ("s_turns count=5 by_deg=40", 0.0), ("hold inbound_deg=70 side=left", 70.0)):
        truth = fly(line)
        assert math.sin(quats_to_euler(truth.q_nb[-1:])[0, 2] - math.radians(heading)) == pytest.approx(0.0, abs=1e-8)


def test_goto_arrives_in_a_changing_wind():
    truth = fly("goto lat_deg=40.2 lon_deg=-99.9 within_m=100", wind=WINDY, seed=4)
    distance, _, _ = pymap3d.geodetic2aer(40.2, -99.9, 0.0, math.degrees(truth.lat[-1]), math.degrees(truth.lon[-1]), 0.0)[::-1]
    assert distance < 500.0  # 40 s of a few m/s of wind that changed since the last correction


def test_approach_ends_on_the_glide_path():
    truth = fly("approach lat_deg=40.4 lon_deg=-100.1 height_m=500 glide_deg=3 end_above_m=50")
    distance, _, _ = pymap3d.geodetic2aer(40.4, -100.1, 0.0, math.degrees(truth.lat[-1]), math.degrees(truth.lon[-1]), 0.0)[::-1]
    assert truth.height[-1] - 500.0 == pytest.approx(distance * math.tan(math.radians(3.0)), abs=15.0)
    assert truth.vel_n[:, 2].max() == pytest.approx(50.0 * math.tan(math.radians(3.0)), abs=0.01)


def test_air_relative_velocity_is_in_the_plane_of_symmetry():
    truth = build(dataclasses.replace(standard("demo"), wind=WINDY, duration_s=250.0, incidence_deg=2.0), 3).table()
    for row in range(0, len(truth), 500):
        air_b = quat_rotate(quat_conjugate(truth.q_nb[row]), truth.vel_n[row] - truth.wind_n[row])
        assert air_b[1] == pytest.approx(0.0, abs=1e-9)
        assert math.degrees(math.atan2(air_b[2], air_b[0])) == pytest.approx(2.0, abs=1e-9)


def test_velocity_is_the_derivative_of_position_in_wind():
    truth = fly("turn by_deg=400 bank_deg=30", wind=WINDY, seed=2)
    after, before = ((truth.lat[rows], truth.lon[rows], truth.height[rows]) for rows in (slice(2, None), slice(None, -2)))
    east, north, up = pymap3d.geodetic2enu(*after, *before, deg=False)
    slope = np.column_stack((north, east, -up)) / 0.02
    assert np.abs(slope - truth.vel_n[1:-1]).max() < 2e-3


def test_ideal_imu_reintegrates_to_the_truth_over_ten_minutes():
    truth = build(dataclasses.replace(standard("demo"), wind=WINDY, duration_s=600.0), 5).table()
    assert reintegrated(truth).max() < 0.01


def test_imu_is_continuous_across_manoeuvres():
    truth = fly("straight duration_s=3", "turn by_deg=60 bank_deg=30", "climb to_height_m=1050 rate_mps=4", "speed to_mps=55")
    assert np.abs(np.diff(truth.specific_force_b, axis=0)).max() < 0.02
    assert np.abs(np.diff(np.degrees(truth.angular_rate_b), axis=0)).max() < 0.3


@pytest.mark.parametrize("block_s", [0.01, 0.37, 1.0, 7.0])
def test_blocks_hold_the_same_bits_whatever_their_length(block_s):
    trajectory = build(TruthSettings(mission=["turn by_deg=90"], wind=WINDY), 9)
    whole = trajectory.table()
    first = 0
    for block in trajectory.blocks(block_s):
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(block, name), getattr(whole, name)[first : first + len(block)])
        first += len(block)
    assert first == len(whole)


def test_seed_moves_only_the_air():
    one, again, other = (build(TruthSettings(mission=["straight duration_s=20"], wind=WINDY), seed).table() for seed in (1, 1, 2))
    assert np.array_equal(one.vel_n, again.vel_n) and not np.array_equal(one.vel_n, other.vel_n)
    np.testing.assert_array_equal(one.q_nb, other.q_nb)


def test_stamps_are_exact_at_any_rate():
    for rate_hz in (60, 100, 128):
        stamps_ns = build(TruthSettings(mission=["straight duration_s=10"], rate_hz=rate_hz, start_stamp_s=12.5)).table().stamps_ns
        assert [int(s) for s in stamps_ns] == [12_500_000_000 + k * 10**9 // rate_hz for k in range(1, 10 * rate_hz + 1)]


def test_gauss_markov_wind_has_its_sigma_and_correlation_time():
    process = SmoothGaussMarkov(5.0, 40.0, np.random.default_rng(1))
    x = process.at(np.arange(0.0, 200_000.0, 2.0))
    assert x.std() == pytest.approx(5.0, rel=0.06)
    assert np.mean(x[20:] * x[:-20]) / x.var() == pytest.approx(math.exp(-1.0), abs=0.04)
    h = 1e-4
    knot = 3 * process.knot_s  # the curve and its first two derivatives do not jump at a knot
    before, after = (process.at(knot + np.array([-2, -1, 0]) * h), process.at(knot + np.array([0, 1, 2]) * h))
    assert np.diff(before, 2)[0] / h**2 == pytest.approx(np.diff(after, 2)[0] / h**2, abs=0.05)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**31), name=st.sampled_from(sorted(MISSIONS)))
def test_standard_missions_plan_in_the_wind_of_the_thesis(seed, name):
    wind = WindSettings(north_mps=-4.0, east_mps=6.0, variation_sigma_mps=3.0)
    block = next(build(dataclasses.replace(standard(name), wind=wind), seed).blocks())
    assert np.linalg.norm(block.vel_n[0] - block.wind_n[0]) == pytest.approx(standard(name).start.airspeed_mps, abs=1e-6)


@pytest.mark.parametrize(("name", "minutes"), [("demo", 12.0), ("turns_then_approach", 27.0), ("banked_turns", 20.0)])
def test_standard_missions_last_as_long_as_they_should(name, minutes):
    truth = build(dataclasses.replace(standard(name), rate_hz=10)).table()
    assert len(truth) / 600.0 == pytest.approx(minutes, abs=1.6)


def test_shipped_configuration_is_the_declared_one():
    assert load_settings(TruthSettings, find_config("truth_source.yaml")) == TruthSettings()
