"""Sources that contradict each other: named, not followed, covered by sigma; and recovery with memory."""

import dataclasses
import math

import numpy as np
import pytest
from test_ins_gps import GPS_ONLY, PROFILE, errors

from lowcostnav_ros.aids.magnetic import MagneticSettings
from lowcostnav_ros.base.measurements import AirVelocity, GnssEpoch, GpsPosition, GpsVelocity, ImuBlock, MagneticField
from lowcostnav_ros.estimation.cross_checks.air import AirspeedCheck
from lowcostnav_ros.estimation.cross_checks.axes import AxesCheck
from lowcostnav_ros.estimation.cross_checks.heading import crabs
from lowcostnav_ros.estimation.cross_checks.height import ClimbCheck
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.cross_checks.receiver import DISAGREE, FROZEN, ReceiverCheck
from lowcostnav_ros.estimation.cross_checks.scatter import UNDERSTATED
from lowcostnav_ros.estimation.cross_checks.sources import SourceChecks
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.sensors.gps import GpsSimulator, GpsSimulatorSettings
from lowcostnav_ros.sensors.imu import ImuSimulator, ImuSimulatorSettings
from lowcostnav_ros.trajectory import build
from lowcostnav_ros.trajectory.missions import standard

SECOND = 1_000_000_000
HOME = (0.66, -2.1, 900.0)
TRUST = {GpsPosition: True, GpsVelocity: True}


def receiver(duration_s, velocity, *, rate_hz=2.0, noise=True, fix_lie=None, velocity_lie=None, sigma=2.0, seed=1):
    """Fixes and velocities of a receiver that moves with ``velocity(t)`` and lies as told."""
    rng, place, out, fine = np.random.default_rng(seed), np.zeros(3), [], 0.01
    steps = round(1.0 / rate_hz / fine)
    for k in range(round(duration_s * rate_hz)):
        t = k / rate_hz
        lie = np.zeros(3) if fix_lie is None else np.asarray(fix_lie(t), float)
        error = rng.normal(size=3) * sigma if noise else np.zeros(3)
        lat, lon, height = displace(*HOME, place + error + lie)
        stamp = round(t * SECOND) + SECOND
        out.append(GpsPosition(stamp, "gps/fix", float(lat), float(lon), float(height), 4.0 * np.eye(3)))
        seen = velocity(t) + (rng.normal(size=3) * 0.1 if noise else 0.0) + (0.0 if velocity_lie is None else velocity_lie(t))
        out.append(GpsVelocity(stamp, "gps/vel", np.asarray(seen, float), 0.01 * np.eye(3)))
        place = place + sum(velocity(t + (i + 0.5) * fine) for i in range(steps)) * fine
    return out


def checked(stream, trusted=TRUST):
    """The check after a stream, and when each contradiction began and with whom as suspect."""
    check, seen = ReceiverCheck("gps/fix", "gps/vel", 60.0), {}
    for item in stream:
        check.take(item, trusted)
        for held in check.held():
            seen.setdefault(held.name, (1e-9 * item.stamp_ns - 1.0, held.suspect))
    return check, seen


def straight(_t):
    return np.array([40.0, 30.0, 0.0])


def turning(t):
    return np.array([50.0 * math.cos(0.1 * t), 50.0 * math.sin(0.1 * t), 0.0])


def looping(t):
    return np.array([50.0 * math.cos(0.8 * t), 0.0, 50.0 * math.sin(0.8 * t)])


def test_a_contradiction_begins_and_ends_with_hysteresis():
    latch = Latch("a and b disagree", ("a", "b"), "m", begin_s=3.0, end_s=5.0)
    judged = [(t, 10 <= t < 20 and t != 11) for t in range(40)]
    held = [t for t, bad in judged if latch.judge(t * SECOND, bad, 1.0) or latch.held is not None]
    assert held[0] == 15 and held[-1] == 24  # one second of agreement at 11 begins the count anew
    assert latch.held is None


@pytest.mark.parametrize("velocity", [straight, turning, looping])
@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 10.0])
def test_a_sound_receiver_does_not_contradict_itself(velocity, rate_hz):
    for seed in range(4):
        _, seen = checked(receiver(150.0, velocity, rate_hz=rate_hz, seed=seed))
        assert not seen


def test_a_resting_receiver_without_noise_may_repeat_itself():
    _, seen = checked(receiver(60.0, lambda t: np.zeros(3), noise=False))
    assert not seen
    _, seen = checked(receiver(60.0, lambda t: np.zeros(3)))
    assert not seen


@pytest.mark.parametrize(("lie", "within_s"), [("jump", 3.0), ("ramp", 12.0), ("slow ramp", 35.0)])
def test_fixes_that_go_where_the_velocity_does_not_are_named(lie, within_s):
    speed = {"jump": 0.0, "ramp": 2.0, "slow ramp": 0.5}[lie]
    offset = 50.0 if lie == "jump" else 0.0
    _, seen = checked(receiver(120.0, turning, fix_lie=lambda t: [offset + speed * (t - 60.0), 0, 0] if t >= 60.0 else [0, 0, 0]))
    began, suspect = seen[DISAGREE]
    assert 60.0 < began < 60.0 + within_s
    assert suspect == "gps/fix"


def test_a_receiver_is_believed_again_once_it_has_agreed_with_itself_for_its_memory():
    check, _ = checked(receiver(100.0, straight, fix_lie=lambda t: [300.0 * (t >= 60.0), 0, 0]))
    assert check.excluded(GpsPosition) == DISAGREE and not check.excluded(GpsVelocity)
    check, _ = checked(receiver(140.0, straight, fix_lie=lambda t: [300.0 * (t >= 60.0), 0, 0]))
    assert not check.excluded(GpsPosition)


def test_a_velocity_in_a_wrong_frame_never_agreed_and_is_the_suspect():
    stream = [dataclasses.replace(m, vel_n=m.vel_n[[1, 0, 2]]) if isinstance(m, GpsVelocity) else m for m in receiver(30.0, turning)]
    _, seen = checked(stream)
    assert seen[DISAGREE][1] == "gps/vel"


def test_values_that_never_change_while_the_vehicle_moves_are_no_measurements():
    stream = receiver(60.0, straight)
    first = {m.source: m for m in stream if m.stamp_ns == 31 * SECOND}
    frozen = [dataclasses.replace(first[m.source], stamp_ns=m.stamp_ns) if m.stamp_ns > 31 * SECOND else m for m in stream]
    check, seen = checked(frozen)
    assert 30.0 < seen[FROZEN][0] < 33.0
    assert check.excluded(GpsPosition) == check.excluded(GpsVelocity) == FROZEN


def test_fixes_that_scatter_more_than_they_state_are_taken_for_worse():
    check, seen = checked(receiver(120.0, straight, sigma=7.0))
    assert seen[UNDERSTATED][1] == "gps/fix"
    assert 6.0 < check.scatter.noise_factor < 25.0
    assert not check.excluded(GpsVelocity)


def test_a_blocked_pitot_tube_and_a_wrong_unit_are_named_and_wind_is_not():
    for airspeed, ground, named in ((0.0, 50.0, True), (97.0, 50.0, True), (50.0, 30.0, False), (20.0, 35.0, False), (0.0, 5.0, False)):
        check = AirspeedCheck("air/velocity", "gps/vel")
        for t in range(10):
            check.compare(t * SECOND, airspeed, ground)
        assert (check.held is not None) == named


def test_a_barometer_that_climbs_alone_is_named():
    sound, stuck = (ClimbCheck("air/static_pressure", "gps/fix") for _ in range(2))
    for t in range(1, 120):
        sound.compare(t * SECOND, 900.0 + 5.3 * t, 950.0 + 5.0 * t, 3.0)
        stuck.compare(t * SECOND, 900.0, 950.0 + 5.0 * t, 3.0)
    assert sound.held is None and stuck.held is not None


def test_no_wind_turns_a_heading_by_ninety_degrees():
    assert crabs(math.radians(90.0), 50.0, 0.0) == pytest.approx(math.pi / 2.0)
    assert crabs(math.radians(30.0), 50.0, 0.0) is None
    assert crabs(math.radians(170.0), 5.0, 0.0) is None


def test_an_imu_on_its_back_is_named_at_once_and_inverted_flight_is_not():
    check = AxesCheck("imu/data_raw")
    check.begin(SECOND, 9.8)
    assert "z reads -9.8 m/s^2" in check.held.advice
    check.clear()
    for tenth in range(400):
        check.take(tenth * SECOND // 10, 9.8 if 100 <= tenth < 200 else -9.8)
        assert check.held is None


def test_satellites_that_stand_still_are_no_epoch():
    checks = SourceChecks([], epochs="gnss/raw")
    n, zeros = 5, np.zeros((5, 3))
    ones, valid = np.ones(n), np.ones(n, dtype=bool)
    one = GnssEpoch(0, "gnss/raw", np.full(n, "G"), np.arange(n), np.arange(n) + 2e7, *[ones] * 4, zeros, zeros, valid, valid)
    refused = [checks.take(dataclasses.replace(one, stamp_ns=k * SECOND), dict) for k in range(5)]
    assert refused == ["", "", "", FROZEN, FROZEN]
    assert not checks.take(dataclasses.replace(one, stamp_ns=5 * SECOND, pseudorange_m=one.pseudorange_m + 1.0), dict)


# a whole navigator -----------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def truth():
    mission = ["straight duration_s=15", "turn by_deg=120 bank_deg=25", "straight duration_s=15", "turn by_deg=-120 bank_deg=25"]
    return build(standard("demo", kind="segments", mission=mission * 4, duration_s=160.0)).table()


def flown(truth, lie=None, worse=1.0, settings=GPS_ONLY, further=None):
    """A navigator, its solutions and the modes it had; ``lie(item, seconds)`` changes what it is fed with; the IMU is so much worse."""
    gyro, accelerometer = (
        dataclasses.replace(part, **{name: [worse * value for value in getattr(part, name)] for name in names})
        for part, names in (
            (PROFILE.gyro, ("noise_per_sample_deg_per_s", "bias_drift_deg_per_h", "turn_on_bias_deg_per_h")),
            (PROFILE.accelerometer, ("noise_per_sample_mg", "bias_drift_mps2", "turn_on_bias_mps2")),
        )
    )
    imu = ImuSimulator(ImuSimulatorSettings(seed=4, rate_hz=100.0), dataclasses.replace(PROFILE, gyro=gyro, accelerometer=accelerometer))
    gps, navigator, out, modes = GpsSimulator(GpsSimulatorSettings(seed=4, rate_hz=2.0)), InsGps(settings), [], []
    for start in range(0, len(truth), 10):
        block = truth[start : start + 10]
        for item in gps.simulate(block) + imu.simulate(block) + ([] if further is None else further(block)):
            t = 1e-9 * (item.stamp_ns - truth.stamps_ns[0])
            new = navigator.feed(item if lie is None else lie(item, t))
            out += new
            modes += [(navigator.mode, {held.name for held in navigator.contradictions()}) for _ in new]
    return navigator, out, modes


def shares(truth, solutions):
    """Seconds, horizontal error m, and error over sigma."""
    e, _ = errors(truth, solutions)
    rows = dict(zip((s.stamp_ns for s in solutions), solutions, strict=True))
    sigma = np.array([rows[int(truth.stamps_ns[0] + round(1e9 * t))].horizontal_sigma_m for t in e[:, 0]])
    size = np.hypot(e[:, 1], e[:, 2])
    return e[:, 0], size, size / sigma


def moved(item, north):
    lat, lon, height = displace(item.lat, item.lon, item.height, np.array([north, 0.0, 0.0]))
    return dataclasses.replace(item, lat=float(lat), lon=float(lon), height=float(height))


def test_a_healthy_flight_knows_no_contradiction(truth):
    navigator, _, modes = flown(truth)
    assert not any(found for _, found in modes)
    assert not navigator.restarts


@pytest.mark.parametrize("lie_name", ["frozen", "jump", "ramp", "ramp with velocity"])
def test_gps_that_lies_for_a_minute_is_not_followed(truth, lie_name):
    kept = {}

    def lie(item, t):
        if not 70.0 <= t < 130.0 or not isinstance(item, GpsPosition | GpsVelocity):
            return item
        if lie_name == "frozen":
            return dataclasses.replace(kept.setdefault(item.source, item), stamp_ns=item.stamp_ns)
        if isinstance(item, GpsPosition):
            return moved(item, 50.0 if lie_name == "jump" else 5.0 * (t - 70.0))
        return dataclasses.replace(item, vel_n=item.vel_n + [5.0, 0.0, 0.0]) if lie_name == "ramp with velocity" else item

    navigator, solutions, modes = flown(truth, lie)
    t, size, ratio = shares(truth, solutions)
    assert np.mean(ratio > 4.0) < 0.01
    assert size[(t > 70.0) & (t < 130.0)].max() < (5.0 if lie_name in ("jump", "ramp") else 250.0)
    seconds = [1e-9 * (s.stamp_ns - truth.stamps_ns[0]) for s in solutions]
    assert all(found and mode != "gps" for s, (mode, found) in zip(seconds, modes, strict=True) if 80.0 < s < 125.0)
    assert navigator.mode in ("gps", "suspect")


@pytest.mark.parametrize("worse", [10.0, 30.0])
def test_an_imu_far_worse_than_its_settings_is_right_within_a_minute_and_named(truth, worse):
    navigator, solutions, _ = flown(truth, worse=worse)
    t, size, ratio = shares(truth, solutions)
    assert size[t > 60.0].max() < 10.0
    assert np.mean(ratio > 4.0) < 0.01
    assert navigator.restarts["re-aligned in motion"] >= (worse > 10.0)
    held = next(c for c in navigator.contradictions() if c.name == "inertial data and settings disagree")
    assert held.suspect == "its settings" and "set it to" in held.advice
    assert navigator.status().level == 1


@pytest.mark.parametrize("fault", ["rate twice", "vertical dead", "bias"])
def test_after_a_fault_of_the_imu_the_solution_comes_back(truth, fault):
    def lie(item, t):
        if not 50.0 <= t < 90.0 or not isinstance(item, ImuBlock):
            return item
        if fault == "vertical dead":
            return dataclasses.replace(item, specific_force_b=item.specific_force_b * [1.0, 1.0, 0.0])
        rate = 2.0 * item.angular_rate_b if fault == "rate twice" else item.angular_rate_b + np.radians([5.0, 0.0, 0.0])
        return dataclasses.replace(item, angular_rate_b=rate)

    _, solutions, _ = flown(truth, lie)
    t, size, ratio = shares(truth, solutions)
    assert size[t > 120.0].max() < 5.0
    assert np.mean(ratio > 4.0) < 0.01


def test_a_magnetometer_mounted_sideways_does_not_turn_the_solution(truth):
    from lowcostnav_ros.physics.rotation import quat_to_dcm

    settings = dataclasses.replace(GPS_ONLY, magnetic=MagneticSettings(declination_deg=[0.0]))

    def compass(block):
        field_b = quat_to_dcm(block.q_nb[-1]).T @ np.array([2.2e-5, 0.0, 4.2e-5])
        return [MagneticField(int(block.stamps_ns[-1]), "imu/mag", np.array([field_b[1], -field_b[0], field_b[2]]), np.eye(3))]

    navigator, solutions, _ = flown(truth, settings=settings, further=compass)
    t, size, ratio = shares(truth, solutions)
    assert size[t > 10.0].max() < 5.0 and np.mean(ratio > 4.0) < 0.01
    assert "imu/mag" in {held.suspect for held in navigator.contradictions()}
    e, _ = errors(truth, solutions)
    assert np.degrees(np.abs(e[e[:, 0] > 90.0, 9])).max() < 5.0


def test_a_contradiction_is_the_same_for_any_cut_of_the_inertial_data(truth):
    lie = lambda item, t: moved(item, 80.0) if isinstance(item, GpsPosition) and t > 40.0 else item  # noqa: E731
    _, whole, _ = flown(truth[:8000], lie)
    imu, gps = ImuSimulator(ImuSimulatorSettings(seed=4, rate_hz=100.0), PROFILE), GpsSimulator(GpsSimulatorSettings(seed=4, rate_hz=2.0))
    navigator, single = InsGps(GPS_ONLY), []
    for start in range(0, 8000, 10):
        block = truth[start : start + 10]
        for item in gps.simulate(block) + imu.simulate(block):
            parts = [item[k : k + 1] for k in range(len(item))] if isinstance(item, ImuBlock) else [item]
            for part in parts:
                single += navigator.feed(lie(part, 1e-9 * (part.stamp_ns - truth.stamps_ns[0])))
    assert len(single) == len(whole)
    assert all(a.lat == b.lat and (a.cov_pos == b.cov_pos).all() for a, b in zip(single, whole, strict=True))


def test_a_blocked_pitot_tube_in_flight_does_not_land_the_dead_reckoning():
    from test_dead_reckoning import gps_until, in_order, quiet, turning

    from lowcostnav_ros.base.modes import Level

    flight = turning(160.0)
    start = int(flight.stamps_ns[0])
    air = [
        dataclasses.replace(m, vel_b=np.zeros(3)) if isinstance(m, AirVelocity) and m.stamp_ns - start > 60 * SECOND else m
        for m in flight.airspeeds()
    ]
    nav = quiet()
    out = nav.feed_all(in_order(flight.attitudes(), air, gps_until(flight, 90.0)))
    assert any(c.suspect == "air/velocity" for c in nav.trust.checks.held()) or nav.mode == "coasting"
    speed = float(np.hypot(*flight.vel[-1]))
    late = [s for s in out if s.stamp_ns - start > 62 * SECOND]
    assert min(math.sqrt(s.cov_vel[0, 0]) for s in late) > 0.5 * speed
    assert out[-1].horizontal_sigma_m > 500.0
    assert nav._level() is not Level.OK
