"""The attitude reference against closed-form turns and simulated flights: accuracy, honesty, repeatability, modes and reasons."""

import dataclasses
import math

import numpy as np
import pytest
from ahrs_flights import DEG, T0, Turn, settings

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, GpsPosition, GpsVelocity, ImuBlock, MagneticField
from lowcostnav_ros.base.settings import SettingsError, from_mapping, to_mapping
from lowcostnav_ros.catalogue.config_files import config_dir, load_settings, yaml_of
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs, AhrsSettings
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.physics.rotation import quat_to_euler, wrap


def attitude_error_deg(turn: Turn, solution) -> np.ndarray:
    """Roll, pitch, heading: true minus estimated."""
    t = (solution.stamp_ns - T0) * 1e-9
    truth = np.array([turn.bank, turn.pitch, turn.heading(t)])
    return wrap(truth - np.array(quat_to_euler(solution.q_nb))) / DEG


def test_registered_and_settings_file_is_the_declaration():
    assert NAVIGATORS["ahrs"] is Ahrs and Ahrs.Settings is AhrsSettings
    path = config_dir() / "ahrs.yaml"
    assert to_mapping(load_settings(AhrsSettings, path, "ahrs")) == to_mapping(AhrsSettings())
    assert path.read_text(encoding="utf-8") == yaml_of(AhrsSettings)


@pytest.mark.parametrize("sources", [("gps", "mag"), ("air", "mag"), ("gps", "mag", "air")])
@pytest.mark.parametrize("bank_deg", [-30.0, 0.0, 20.0])
def test_aligns_and_stays_true_in_a_turn(bank_deg, sources):
    pitch_deg = 3.0 if "gps" not in sources else 0.0  # without GPS the usual incidence has to be the one flown
    turn = Turn(bank_deg, pitch_deg=pitch_deg)
    solutions = Ahrs(settings(airdata__incidence_deg=pitch_deg)).feed_all(turn.measurements(0.0, 30.0, sources))
    errors = np.array([attitude_error_deg(turn, s) for s in solutions])
    assert (solutions[0].stamp_ns - T0) * 1e-9 < 4.0
    tilt = 0.25 if "gps" in sources else 1.0
    assert np.abs(errors[:, :2]).max() < tilt
    assert np.abs(errors[:, 2]).max() < 0.6


def test_plain_levelling_in_a_turn_would_be_wrong_by_the_bank():
    # what the aid prevents: without velocities, the switch must not let the turn be called level
    turn, straight = Turn(20.0), Turn(0.0)
    navigator = Ahrs(settings(airdata__enabled=False))
    navigator.feed_all(straight.measurements(0.0, 10.0, ("mag",)))
    assert navigator.mode == "coasting"
    assert "steady flight" in navigator.reason
    fused = navigator.aid("accelerometer_level").status.fused
    assert fused >= 3
    for second in range(10, 25):
        navigator.feed(turn.imu(second, second + 1.0))
    assert navigator.aid("accelerometer_level").status.fused <= fused + 2
    assert navigator.aid("accelerometer_level").status.reason == "manoeuvring"
    assert navigator.mode == "gyro_only"
    assert "manoeuvring without" in navigator.reason


def test_gyro_bias_is_found_while_calibrating_and_sigma_covers_it():
    bias = np.array([0.1, -0.15, 0.08]) * DEG
    turn = Turn(15.0)
    solution = Ahrs(settings()).feed_all(turn.measurements(0.0, 90.0, ("gps", "mag"), gyro_bias=bias))[-1]
    assert solution.mode == "calibrating"
    for axis, true in zip("xyz", bias, strict=True):
        value, sigma = solution.states[f"gyro_bias_{axis}_radps"]
        assert abs(value - true) < 3.0 * sigma
        assert sigma < 0.06 * DEG
    assert np.abs(solution.angular_rate_b - turn.imu(0.0, 0.1).angular_rate_b[0]).max() < 0.05 * DEG


def test_fused_solution_does_not_depend_on_arrival_or_block_cut():
    turn = Turn(25.0)
    whole = turn.measurements(0.0, 12.0)
    rng = np.random.default_rng(5)
    noisy = [_with_noise(m, rng) if isinstance(m, ImuBlock) else m for m in whole]
    samples = [m for block in noisy for m in _cut(block, rng)]
    late = sorted(samples, key=lambda m: m.stamp_ns + rng.integers(0, 20_000_000))  # blocks of 30 ms: inside the lag of 50 ms
    first, second = (Ahrs(settings()).feed_all(feed) for feed in (noisy, late))
    known = {s.stamp_ns: s for s in second}
    compared = [s for s in first if s.stamp_ns in known]
    assert len(compared) > 80
    for s in compared:
        assert s.q_nb.tobytes() == known[s.stamp_ns].q_nb.tobytes()
        assert s.cov_att.tobytes() == known[s.stamp_ns].cov_att.tobytes()
        assert s.states == known[s.stamp_ns].states
        assert s.mode == known[s.stamp_ns].mode


def _with_noise(block: ImuBlock, rng) -> ImuBlock:
    noise = rng.standard_normal((2, len(block), 3))
    return ImuBlock.of(block.source, block.stamps_ns, block.specific_force_b + 0.05 * noise[0], block.angular_rate_b + 0.002 * noise[1])


def _cut(m, rng):
    if not isinstance(m, ImuBlock):
        return [m]
    cuts = [0, *np.cumsum(rng.integers(1, 4, len(m)))]
    cuts = [c for c in cuts if c < len(m)] + [len(m)]
    parts = [slice(a, b) for a, b in zip(cuts, cuts[1:], strict=False)]
    return [ImuBlock.of(m.source, m.stamps_ns[p], m.specific_force_b[p], m.angular_rate_b[p]) for p in parts]


def test_output_runs_ahead_of_the_fused_solution():
    turn = Turn(20.0)
    navigator = Ahrs(settings())
    assert navigator.output() is None
    fused = navigator.feed_all(turn.measurements(0.0, 10.0))[-1]
    ahead = navigator.output()
    assert ahead.stamp_ns == T0 + 10_000_000_000 > fused.stamp_ns
    assert np.abs(attitude_error_deg(turn, ahead)).max() < 0.6
    assert ahead.lat is None
    assert ahead.vel_n is None


def test_modes_follow_what_is_heard():
    straight = Turn(0.0)
    navigator = Ahrs(settings())
    assert (navigator.mode, navigator.reason) == ("initialising", "waiting for measurements")
    navigator.feed_all(straight.measurements(0.0, 8.0))
    assert navigator.mode == "calibrating"
    navigator.feed_all(straight.measurements(8.0, 14.0, ("mag", "air")))
    assert navigator.mode == "coasting"
    assert "airspeed" in navigator.reason
    navigator.feed_all(straight.measurements(14.0, 24.0, ("mag",)))
    assert navigator.mode == "coasting"
    assert "steady flight" in navigator.reason
    navigator.feed_all(straight.measurements(24.0, 30.0, ("gps",)))
    assert navigator.mode == "calibrating"
    assert "no magnetic heading" in navigator.reason
    status = navigator.status()
    assert {a.name for a in status.aids} == {"gps_velocity", "accelerometer_level", "airdata", "hard_iron", "magnetic_heading"}
    assert status.sigmas["roll_deg"] < 1.0


def test_hole_in_the_inertial_data_aligns_anew_and_keeps_the_biases():
    turn, bias = Turn(0.0), np.array([0.1, 0.1, -0.1]) * DEG
    navigator = Ahrs(settings())
    before = navigator.feed_all(turn.measurements(0.0, 60.0, gyro_bias=bias))[-1]
    aids = [m for m in turn.measurements(60.0, 62.0) if not isinstance(m, ImuBlock)]
    navigator.feed_all(aids + turn.measurements(62.0, 62.5, gyro_bias=bias))
    assert navigator.mode == "aligning"
    assert navigator.reason == "inertial data missing for 2.0 s"
    assert navigator.restarts["inertial gap"] == 1
    assert navigator.input_status["gps/vel"].rejected["inertial data missing"] > 5
    after = navigator.feed_all(turn.measurements(62.5, 70.0, gyro_bias=bias))[-1]
    assert navigator.mode == "calibrating"
    assert after.states["gyro_bias_x_radps"][1] < 1.5 * before.states["gyro_bias_x_radps"][1]
    assert np.abs(attitude_error_deg(turn, after)).max() < 0.6


def test_hole_is_seen_wherever_blocks_are_cut():
    turn = Turn(0.0)
    navigator = Ahrs(settings())
    navigator.feed_all(turn.measurements(0.0, 10.0))
    before, after = turn.imu(10.0, 10.5), turn.imu(12.5, 13.0)
    names = ("stamps_ns", "specific_force_b", "angular_rate_b")
    navigator.feed(ImuBlock.of("imu/data_raw", *(np.concatenate((getattr(before, n), getattr(after, n))) for n in names)))
    assert navigator.mode == "aligning"
    assert navigator.reason == "inertial data missing for 2.0 s"


def test_measurements_that_are_not_numbers_do_no_harm():
    turn = Turn(0.0)
    navigator = Ahrs(settings())
    navigator.feed(GpsPosition(T0 + 5, "gps/fix", np.nan, 0.0, 0.0, np.eye(3)))
    for m in turn.measurements(0.0, 12.0):
        t = (m.stamp_ns - T0) * 1e-9
        if isinstance(m, GpsVelocity) and (t < 2.0 or t > 11.0):
            m.vel_n[0] = np.nan
        navigator.feed(m)
    assert navigator.input_status["gps/fix"].rejected["not a place on earth"] == 1
    assert navigator.input_status["gps/vel"].rejected["not finite"] > 5
    assert navigator.mode == "calibrating"
    assert np.abs(attitude_error_deg(turn, navigator.output())).max() < 0.6


def test_short_hole_is_bridged():
    turn = Turn(0.0)
    navigator = Ahrs(settings())
    navigator.feed_all(turn.measurements(0.0, 10.0) + turn.measurements(10.3, 12.0))
    assert navigator.mode == "calibrating"
    assert not navigator.restarts


@pytest.mark.parametrize(
    ("force_factor", "rate_factor", "words"),
    [(1.0 / 9.80665, 1.0, "looks like g"), (0.1, 0.0, "g"), (1.0, 180.0 / math.pi, "looks like deg/s")],
)
def test_wrong_units_at_the_start_are_named(force_factor, rate_factor, words):
    navigator = Ahrs(settings())
    for m in Turn(bank_deg=45.0, speed=25.0).measurements(0.0, 6.0, ("gps", "mag")):
        if isinstance(m, ImuBlock):
            m = ImuBlock.of(m.source, m.stamps_ns, m.specific_force_b * force_factor, m.angular_rate_b * rate_factor)
        navigator.feed(m)
    assert navigator.mode == "failed"
    assert words in navigator.reason


def test_without_a_heading_it_says_so_and_then_takes_the_track():
    standing = Turn(0.0, speed=0.0)
    navigator = Ahrs(settings())
    assert not navigator.feed_all(standing.measurements(0.0, 6.0, ("gps",)))
    assert (navigator.mode, navigator.reason) == ("aligning", "levelled, but no heading: no magnetometer and no GPS track")
    flying = Turn(20.0)
    navigator = Ahrs(settings())
    solution = navigator.feed_all(flying.measurements(0.0, 40.0, ("gps",)))[-1]
    assert np.abs(attitude_error_deg(flying, solution)).max() < 1.0
    assert math.sqrt(solution.cov_att[2, 2]) < 6.0 * DEG  # from 12 at the start: in turns acceleration shows the heading


def test_a_receiver_without_vertical_velocity_aligns_as_well():
    flying, navigator = Turn(20.0), Ahrs(settings())

    def flat(item):
        if not isinstance(item, GpsVelocity):
            return item
        cov = item.cov_n.copy()
        cov[2, 2] = UNKNOWN_VARIANCE
        return dataclasses.replace(item, vel_n=item.vel_n * [1.0, 1.0, 0.0], cov_n=cov)

    solutions = navigator.feed_all(map(flat, flying.measurements(0.0, 10.0, ("gps", "mag"))))
    first = solutions[0]
    sigma_deg = np.sqrt(np.diag(first.cov_att)) / DEG
    assert first.mode != "failed" and sigma_deg[:2].max() < 3.0
    assert (np.abs(attitude_error_deg(flying, first)) < 3.0 * sigma_deg[[0, 0, 2]]).all()


def test_unknown_declination_is_not_zero():
    standing = Turn(0.0, speed=0.0)
    navigator = Ahrs(settings(place__lat_lon_deg=[]))
    navigator.feed_all(standing.measurements(0.0, 6.0, ("mag",)))
    assert navigator.mode == "aligning"
    assert "declination unknown" in navigator.reason
    by_hand = Ahrs(settings(place__lat_lon_deg=[], magnetic__declination_deg=[0.0]))
    solution = by_hand.feed_all(standing.measurements(0.0, 6.0, ("mag",)))[-1]
    declination = math.atan2(standing.field_n[1], standing.field_n[0])
    assert attitude_error_deg(standing, solution)[2] == pytest.approx(declination / DEG, abs=0.3)


def test_magnetic_interference_is_named_and_not_fused():
    turn = Turn(0.0)
    navigator = Ahrs(settings())
    navigator.feed_all(turn.measurements(0.0, 10.0))
    fused = navigator.aid("magnetic_heading").status.fused
    for m in turn.measurements(10.0, 15.0):
        navigator.feed(MagneticField(m.stamp_ns, m.source, 1.5 * m.field_b, m.cov_b) if isinstance(m, MagneticField) else m)
    assert navigator.aid("magnetic_heading").status.fused <= fused + 1
    assert "interference: field is 1.50" in navigator.aid("magnetic_heading").status.reason


def test_samples_that_are_not_numbers_are_left_out():
    turn = Turn(0.0)
    navigator = Ahrs(settings())
    for k, m in enumerate(turn.measurements(0.0, 12.0)):
        if isinstance(m, ImuBlock) and k % 7 == 0:
            m.specific_force_b[3] = np.nan
        navigator.feed(m)
    assert navigator.input_status["imu/data_raw"].rejected["not finite"] > 10
    assert navigator.mode == "calibrating"
    assert np.isfinite(navigator.output().q_nb).all()


def test_reset_forgets_everything():
    navigator = Ahrs(settings())
    navigator.feed_all(Turn(0.0).measurements(0.0, 10.0))
    navigator.reset("asked for")
    assert (navigator.mode, navigator.reason) == ("initialising", "asked for")
    assert navigator.output() is None
    assert navigator.feed_all(Turn(0.0).measurements(20.0, 30.0))


def test_half_a_place_is_refused():
    with pytest.raises(SettingsError, match="latitude"):
        from_mapping(AhrsSettings, {"place.lat_lon_deg": [37.0]})
    with pytest.raises(SettingsError, match="forward, right, down"):
        from_mapping(AhrsSettings, {"gps.lever_arm_b_m": [1.0]})
