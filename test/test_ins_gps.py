"""The GPS/INS navigator: consistency, outages, alignment, determinism, bad inertial data."""

import dataclasses
import random

import numpy as np
import pytest

from lowcostnav_ros.aids.airdata import AirDataSettings
from lowcostnav_ros.aids.baro import BaroSettings
from lowcostnav_ros.aids.gps import GpsSettings
from lowcostnav_ros.aids.magnetic import MagneticSettings
from lowcostnav_ros.aids.wheels import WheelSettings
from lowcostnav_ros.base.measurements import AirVelocity, GpsPosition, GpsVelocity, ImuBlock
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.estimation.aiding import GateSettings
from lowcostnav_ros.estimation.consistency import nees
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.physics.rotation import quat_apply_phi_n, quat_conjugate, quat_multiply, quats_to_euler, rotvec_from_quat
from lowcostnav_ros.sensors.gps import GpsSimulator, GpsSimulatorSettings
from lowcostnav_ros.sensors.imu import ImuSimulator, ImuSimulatorSettings
from lowcostnav_ros.sensors.imu_profile import AccelerometerProfile, GyroProfile, ImuProfile
from lowcostnav_ros.trajectory import build
from lowcostnav_ros.trajectory.missions import standard

PROFILE = ImuProfile(
    name="test",
    gyro=GyroProfile(
        noise_per_sample_deg_per_s=[0.05] * 3,
        bias_drift_deg_per_h=[180.0] * 3,
        bias_drift_tau_s=[300.0] * 3,
        turn_on_bias_deg_per_h=[360.0] * 3,
    ),
    accelerometer=AccelerometerProfile(noise_per_sample_mg=[1.0] * 3, bias_drift_mps2=[0.0118] * 3, bias_drift_tau_s=[100.0] * 3),
)
GPS_ONLY = InsGpsSettings(
    imu=imu_settings(PROFILE.filter_noise()),
    baro=BaroSettings(enabled=False),
    magnetic=MagneticSettings(enabled=False),
    airdata=AirDataSettings(enabled=False),
)


@pytest.fixture(scope="module")
def truth():
    mission = ["straight duration_s=10", "turn by_deg=120 bank_deg=25", "straight duration_s=10", "turn by_deg=-120 bank_deg=25"]
    return build(standard("demo", kind="segments", mission=mission * 3, duration_s=150.0)).table()


def measurements(truth, seed=1, **gps):
    imu = ImuSimulator(ImuSimulatorSettings(seed=seed, rate_hz=100.0), PROFILE)
    receiver = GpsSimulator(GpsSimulatorSettings(seed=seed, **{"rate_hz": 1.0, **gps}))
    stream = []
    for start in range(0, len(truth), 10):
        block = truth[start : start + 10]
        stream += receiver.simulate(block) + imu.simulate(block)
    return stream


def errors(truth, solutions):
    """Rows: seconds, position NED m, velocity, attitude rad; and their NEES."""
    rows = np.searchsorted(truth.stamps_ns, [s.stamp_ns for s in solutions])
    out, score = [], []
    for row, s in zip(rows, solutions, strict=True):
        if row >= len(truth) or truth.stamps_ns[row] != s.stamp_ns:
            continue
        position = difference_n(truth.lat[row], truth.lon[row], truth.height[row], s.lat, s.lon, s.height)
        velocity = truth.vel_n[row] - s.vel_n
        attitude = rotvec_from_quat(quat_multiply(truth.q_nb[row], quat_conjugate(s.q_nb)))
        out.append([1e-9 * (s.stamp_ns - truth.stamps_ns[0]), *position, *velocity, *attitude])
        score.append([nees(position, s.cov_pos), nees(velocity, s.cov_vel), nees(attitude, s.cov_att)])
    return np.array(out), np.array(score)


def fed(stream, settings=GPS_ONLY):
    navigator = InsGps(settings)
    return navigator, navigator.feed_all(stream)


def test_a_core_that_other_settings_of_the_imu_make_still_reports_the_offsets_of_stamps():
    navigator = InsGps(GPS_ONLY)
    navigator._fly_on(navigator.settings.imu)
    assert navigator.core.history is navigator.offsets is not None


def test_is_accurate_and_its_sigma_honest_over_several_flights(truth):
    position, attitude, scores = [], [], []
    for seed in range(6):
        _, solutions = fed(measurements(truth, seed))
        e, score = errors(truth, solutions)
        late = e[:, 0] > 60.0
        position.append(e[late, 1:4])
        attitude.append(np.degrees(e[late, 7:]))
        scores.append(score[late].mean(axis=0) / 3.0)
    assert np.sqrt(np.mean(np.square(position))) < 1.0
    tilt, heading = np.array(attitude)[..., :2], np.array(attitude)[..., 2]
    assert np.sqrt(np.mean(tilt**2)) < 0.3
    assert np.sqrt(np.mean(heading**2)) < 1.5
    assert np.all(np.mean(scores, axis=0) > 0.6)
    assert np.all(np.mean(scores, axis=0) < 1.5)


def test_an_outage_names_itself_grows_believably_and_ends_without_a_kick(truth):
    navigator, solutions = fed(measurements(truth, 3, outages_s=[80.0, 110.0]))
    e, _ = errors(truth, solutions)
    coasting = [s for s in solutions if s.mode == "coasting"]
    assert coasting
    assert 81.0 < 1e-9 * (coasting[0].stamp_ns - truth.stamps_ns[0]) < 84.0
    end = np.searchsorted(e[:, 0], 109.5)
    sigma = np.sqrt(np.trace(solutions[end].cov_pos[:2, :2]))
    assert 5.0 < sigma < 300.0
    assert np.hypot(e[end, 1], e[end, 2]) < 3.5 * sigma
    after = e[:, 0] > 113.0
    assert np.abs(e[after, 1:4]).max() < 5.0
    turn = np.diff(e[np.abs(e[:, 0] - 110.5) < 1.5, 7:], axis=0)
    assert np.degrees(np.abs(turn)).max() < 1.5
    assert navigator.mode == "gps"


def test_the_fused_solution_does_not_depend_on_arrival_order_blocks_or_outputs(truth):
    stream = measurements(truth[:6000], 5, rate_hz=5.0)
    _, reference = fed(stream)
    rng = random.Random(7)
    single = []
    for m in stream:
        if isinstance(m, ImuBlock):
            rows = [slice(i, i + 1) for i in range(len(m))]
            single += [ImuBlock.of(m.source, m.stamps_ns[r], m.specific_force_b[r], m.angular_rate_b[r]) for r in rows]
        else:
            single.append(m)
    jittered = sorted(single, key=lambda m: m.stamp_ns + (0 if isinstance(m, ImuBlock) else rng.randrange(0, 45_000_000)))
    navigator, solutions = InsGps(GPS_ONLY), []
    for m in jittered:
        solutions += navigator.feed(m)
        navigator.output()
    assert not any(record.rejected for record in navigator.input_status.values())
    assert len(solutions) == len(reference) > 500
    for a, b in zip(reference, solutions, strict=True):
        assert (a.stamp_ns, a.lat, a.lon, a.height, a.mode) == (b.stamp_ns, b.lat, b.lon, b.height, b.mode)
        assert np.array_equal(a.q_nb, b.q_nb)
        assert np.array_equal(a.cov_pos, b.cov_pos)


def test_low_latency_output_is_the_newest_state(truth):
    navigator = InsGps(GPS_ONLY)
    stream = measurements(truth[:3000], 2)
    fused = navigator.feed_all(stream)
    output = navigator.output()
    assert output.stamp_ns == truth.stamps_ns[2999] > fused[-1].stamp_ns
    expected = difference_n(truth.lat[2999], truth.lon[2999], truth.height[2999], output.lat, output.lon, output.height)
    assert np.linalg.norm(expected) < 6.0


def lever_measurements(truth, lever_b, seed=1):
    from lowcostnav_ros.physics.earth import displace
    from lowcostnav_ros.physics.rotation import quat_to_dcm

    moved = []
    for m in measurements(truth, seed, horizontal_noise_m=0.05, vertical_noise_m=0.05, velocity_noise_mps=0.02):
        if isinstance(m, GpsPosition | GpsVelocity):
            row = np.searchsorted(truth.stamps_ns, m.stamp_ns)
            C = quat_to_dcm(truth.q_nb[row])
            if isinstance(m, GpsPosition):
                lat, lon, height = displace(m.lat, m.lon, m.height, C @ lever_b)
                m = dataclasses.replace(m, lat=lat, lon=lon, height=height)
            else:
                m = dataclasses.replace(m, vel_n=m.vel_n + C @ np.cross(truth.angular_rate_b[row], lever_b))
        moved.append(m)
    return moved


def test_lever_arm_is_taken_out_of_position_and_velocity(truth):
    lever = np.array([2.0, -1.0, -3.0])
    stream = lever_measurements(truth, lever)
    known = GpsSettings(lever_arm_b_m=lever.tolist(), position_floor_m=0.05, velocity_floor_mps=0.02)
    result = []
    for gps in (known, dataclasses.replace(known, lever_arm_b_m=[0.0, 0.0, 0.0])):
        _, solutions = fed(stream, dataclasses.replace(GPS_ONLY, gps=gps))
        e, _ = errors(truth, solutions)
        result.append(np.sqrt(np.mean(e[e[:, 0] > 40.0, 1:4] ** 2)))
    assert result[0] < 0.1
    assert result[1] > 10.0 * result[0]


def test_latency_is_no_error_when_declared(truth):
    late = measurements(truth, 4, latency_s=0.4)
    _, solutions = fed(late, dataclasses.replace(GPS_ONLY, gps=GpsSettings(latency_s=0.4)))
    e, _ = errors(truth, solutions)
    assert np.sqrt(np.mean(e[e[:, 0] > 60.0, 1:4] ** 2)) < 1.0
    undeclared, _ = fed(late, dataclasses.replace(GPS_ONLY, gps=GpsSettings(latency_s=0.0)))
    assert undeclared.input_status["gps/fix"].rejected["late"] > 100
    assert undeclared.status().reason.startswith("waiting")


def test_standing_it_levels_and_waits_for_a_heading():
    stamps = np.arange(1, 1001, dtype=np.int64) * 10_000_000
    rng = np.random.default_rng(0)
    force = np.array([0.0, 0.0, -9.8]) + 0.01 * rng.standard_normal((1000, 3))
    rate = 0.001 * rng.standard_normal((1000, 3))
    fixes = [
        m
        for t in range(1, 10)
        for m in (
            GpsPosition(t * 1_000_000_000, "gps/fix", 0.7, 0.1, 100.0, np.eye(3) * 4.0),
            GpsVelocity(t * 1_000_000_000, "gps/vel", np.zeros(3), np.eye(3) * 0.01),
        )
    ]
    block = ImuBlock.of("imu/data_raw", stamps, force, rate)
    navigator, solutions = fed([*fixes, block])
    assert not solutions
    assert "waiting for a heading" in navigator.reason
    given = dataclasses.replace(GPS_ONLY, alignment=dataclasses.replace(GPS_ONLY.alignment, heading_deg=[123.0]))
    _, solutions = fed([*fixes, block], given)
    assert np.degrees(quats_to_euler(solutions[-1].q_nb[None])[0]) == pytest.approx([0.0, 0.0, 123.0], abs=0.5)


@pytest.mark.parametrize(
    ("force", "rate", "sentence"), [(1.0, 0.0, "looks like g"), (9.8, 20.0, "looks like deg/s"), (40.0, 0.0, "wrong unit or axes")]
)
def test_a_unit_error_at_the_start_is_named(force, rate, sentence):
    stamps = np.arange(1, 501, dtype=np.int64) * 10_000_000
    block = ImuBlock.of("imu/data_raw", stamps, np.tile([0.0, 0.0, -force], (500, 1)), np.tile([rate, 0.0, 0.0], (500, 1)))
    fixes = []
    for t in (3, 4):
        fixes.append(GpsPosition(t * 1_000_000_000, "gps/fix", 0.7, 0.1, 100.0, np.eye(3)))
        fixes.append(GpsVelocity(t * 1_000_000_000, "gps/vel", np.zeros(3), np.eye(3) * 0.01))
    navigator, solutions = fed([*fixes, block])
    assert not solutions
    assert sentence in navigator.reason


def without_imu(stream, truth, begin, end):
    start = truth.stamps_ns[0]
    return [m for m in stream if not (isinstance(m, ImuBlock) and begin * 1e9 < m.stamp_ns - start < end * 1e9)]


@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
@pytest.mark.parametrize(("begin", "end"), [(52.0, 52.7), (60.0, 62.0), (52.0, 57.0), (66.0, 76.0), (52.0, 72.0)])
def test_a_hole_in_the_inertial_data_is_bridged_with_an_honest_sigma(truth, rate_hz, begin, end):
    navigator, solutions = fed(without_imu(measurements(truth, 6, rate_hz=rate_hz), truth, begin, end))
    assert not navigator.restarts  # 52 s and 66 s: in a turn that ends in the hole
    assert navigator.mode == "gps"
    e, score = errors(truth, solutions)
    after = (e[:, 0] > begin) & (e[:, 0] < end + 40.0)
    assert np.diff(e[after, 0]).max() < 0.15
    assert score[after].max() < 36.0
    assert np.abs(e[e[:, 0] > end + 20.0, 1:4]).max() < 3.0
    assert {s.mode for s in solutions if begin + 1.0 < 1e-9 * (s.stamp_ns - truth.stamps_ns[0]) < end} <= {"coasting"}


@pytest.mark.parametrize("length", [2.0, 5.0, 8.0])
def test_a_hole_in_an_outage_does_not_throw_the_state_away(truth, length):
    stream = without_imu(measurements(truth, 3, rate_hz=5.0, outages_s=[60.0, 100.0]), truth, 66.0, 66.0 + length)
    navigator, solutions = fed(stream)
    assert not navigator.restarts
    e, score = errors(truth, solutions)
    after = (e[:, 0] > 60.0) & (e[:, 0] < 120.0)
    assert np.diff(e[after, 0]).max() < 0.15
    assert score[after].max() < 36.0
    assert np.abs(e[e[:, 0] > 110.0, 1:4]).max() < 3.0


def test_beyond_what_can_be_bridged_it_aligns_anew_and_says_so(truth):
    navigator, solutions = fed(without_imu(measurements(truth, 6), truth, 60.0, 100.0))
    assert navigator.restarts["inertial data missing for more than 30 s"] == 1
    assert navigator.mode == "gps"
    e, _ = errors(truth, solutions)
    assert np.abs(e[e[:, 0] > 120.0, 1:4]).max() < 6.0


@pytest.mark.parametrize("cut", [1, 7, 50])
def test_holes_are_bridged_to_the_same_bits_however_blocks_are_cut(truth, cut):
    def again(size):
        out = []
        for m in without_imu(measurements(truth[:8000], 6, rate_hz=5.0), truth, 52.0, 57.0):
            out += [m[k : k + size] for k in range(0, len(m), size)] if isinstance(m, ImuBlock) else [m]
        return [np.concatenate((s.cov_pos.ravel(), s.q_nb, s.vel_n, s.place)) for s in fed(out)[1]]

    np.testing.assert_array_equal(again(1000), again(cut))


def restamped(m, shift_ns):
    changed = {"stamps_ns": m.stamps_ns + shift_ns} if isinstance(m, ImuBlock) else {}
    return dataclasses.replace(m, stamp_ns=m.stamp_ns + shift_ns, **changed)


@pytest.mark.parametrize("step_s", [-5.0, -9.0, -3600.0])
def test_a_step_back_of_all_clocks_starts_over_and_is_right_again(truth, step_s):
    stream = measurements(truth, 6, rate_hz=5.0)
    start, step_ns = truth.stamps_ns[0], round(step_s * 1e9)
    moved = [restamped(m, step_ns if m.stamp_ns - start > 60e9 else 0) for m in stream]
    navigator, solutions = fed(moved)
    assert dict(navigator.restarts) == {"time base jumped": 1}
    after = [dataclasses.replace(s, stamp_ns=s.stamp_ns - step_ns) for s in solutions[next(iter(_steps_back(solutions))) :]]
    e, score = errors(truth, after)
    assert e[0, 0] < 64.0
    assert e[-1, 0] > 148.0
    assert score.max() < 36.0


def test_many_at_once_are_taken_as_one_by_one_where_messages_are_late_and_the_clocks_step_back(truth):
    start, stream = truth.stamps_ns[0], measurements(truth[:7000], 6, rate_hz=5.0)
    late = [0.3e9 * (k % 11 == 0 and not isinstance(m, ImuBlock)) for k, m in enumerate(stream)]
    arrival = sorted(range(len(stream)), key=lambda k: stream[k].stamp_ns + late[k])
    moved = [restamped(stream[k], -9_000_000_000 if stream[k].stamp_ns - start > 30e9 else 0) for k in arrival]
    together, at_once = fed(moved)
    alone = InsGps(GPS_ONLY)
    one_by_one = [solution for m in moved for solution in alone.feed(m)]
    rejected = [{source: dict(record.rejected) for source, record in n.input_status.items()} for n in (together, alone)]
    assert rejected[0] == rejected[1] and any(rejected[0].values()) and together.restarts["time base jumped"] == 1
    assert [s.stamp_ns for s in at_once] == [s.stamp_ns for s in one_by_one] and len(at_once) > 500
    assert all(np.array_equal(a.cov_pos, b.cov_pos) and a.place == b.place for a, b in zip(at_once, one_by_one, strict=True))
    assert [s.health and s.health.reason for s in at_once] == [s.health and s.health.reason for s in one_by_one]


def _steps_back(solutions):
    return [k for k in range(1, len(solutions)) if solutions[k].stamp_ns < solutions[k - 1].stamp_ns]


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 5.0])
def test_inertial_data_with_a_wrong_clock_is_named_and_the_navigator_is_not_well(truth, step_s):
    stream = measurements(truth[:9000], 6, rate_hz=5.0)
    stamps = range(truth.stamps_ns[0], truth.stamps_ns[8999], 100_000_000)
    air = [AirVelocity(t, "air/velocity", np.array([50.0, 0.0, 0.0]), np.eye(3)) for t in stamps]
    start = truth.stamps_ns[0]
    wrong = [restamped(m, round(step_s * 1e9)) if isinstance(m, ImuBlock) and m.stamp_ns - start > 60e9 else m for m in stream]
    order = sorted([*zip(stream, wrong, strict=True), *zip(air, air, strict=True)], key=lambda pair: pair[0].stamp_ns)
    navigator, solutions = fed([m for _, m in order])
    status = navigator.status()
    assert not navigator.restarts
    assert status.level != Level.OK
    assert "no inertial data" in status.reason
    assert [(c.name, c.suspect, round(c.size)) for c in status.contradictions] == [("clock offset", "imu/data_raw", abs(round(step_s)))]
    e, score = errors(truth, solutions)
    assert e[-1, 0] > 87.0
    assert score[e[:, 0] > 60.0].max() < 36.0


@pytest.mark.parametrize("broken", [{"lat": np.nan}, {"cov_n": np.full((3, 3), np.inf)}])
def test_a_value_that_is_no_number_is_refused_by_name_and_harms_nothing(truth, broken):
    stream = measurements(truth[:4000], 3)
    fixes = [i for i, m in enumerate(stream) if isinstance(m, GpsPosition)]
    stream[fixes[-3]] = dataclasses.replace(stream[fixes[-3]], **broken)
    navigator, solutions = fed(stream)
    assert navigator.aid("gps_position").status.rejected["innovation not finite"] == 1
    assert np.isfinite(solutions[-1].lat)


def test_a_spike_is_refused_by_name_and_a_lasting_step_is_followed(truth):
    quick = GateSettings(recovery_s=5.0)
    settings = dataclasses.replace(GPS_ONLY, gps=dataclasses.replace(GPS_ONLY.gps, gate=quick, memory_s=25.0))
    start = truth.stamps_ns[0]
    stream = []
    for m in measurements(truth, 8):
        t = 1e-9 * (m.stamp_ns - start)
        if isinstance(m, GpsPosition) and (70.4 < t < 71.6 or t > 100.0):
            m = dataclasses.replace(m, lat=m.lat + 400.0 / 6.37e6)
        stream.append(m)
    navigator, solutions = fed(stream, settings)
    e, _ = errors(truth, solutions)
    status = navigator.aid("gps_position").status
    assert status.rejected["innovation beyond gate"] >= 2
    assert status.rejected["recovered after rejections"] == 1
    assert np.abs(e[(e[:, 0] > 60.0) & (e[:, 0] < 100.0), 1]).max() < 5.0
    assert e[-1, 1] == pytest.approx(-400.0, abs=10.0)
    assert np.degrees(np.abs(e[e[:, 0] > 60.0, 7:9])).max() < 1.5


def test_a_velocity_refused_by_chance_is_no_step(truth):
    """One a little beyond the gate, then errors of two and a half sigmas: these are no agreement with the first."""
    stream, start = measurements(truth, 1, rate_hz=5.0), truth.stamps_ns[0]
    after = [i for i, m in enumerate(stream) if isinstance(m, GpsVelocity) and m.stamp_ns - start > 90e9]
    for i, error in zip(after, [0.55, 0.25, 0.25, 0.25], strict=False):
        true = truth.vel_n[np.searchsorted(truth.stamps_ns, stream[i].stamp_ns)]
        stream[i] = dataclasses.replace(stream[i], vel_n=true + [0.0, error, 0.0])
    navigator, _ = fed(stream)
    rejected = navigator.aid("gps_velocity").status.rejected
    assert rejected["innovation beyond gate"] >= 1
    assert rejected["velocity stepped without a motion"] == 0


def test_no_output_is_ever_nan_and_covariances_stay_positive(truth):
    _, solutions = fed(measurements(truth, 9, outages_s=[50.0, 150.0]))
    for s in solutions[::10]:
        assert np.isfinite([s.lat, s.lon, s.height, *s.vel_n, *s.q_nb]).all()
        for cov in (s.cov_pos, s.cov_vel, s.cov_att):
            assert np.linalg.eigvalsh(cov).min() > 0.0


@pytest.mark.parametrize("which", ["gps_position", "gps_velocity", "baro_height", "hard_iron", "magnetic_heading", "airdata", "wheels"])
def test_jacobian_of_every_aid_equals_differences(which):
    from lowcostnav_ros.base.measurements import AirVelocity, MagneticField, Pressure
    from lowcostnav_ros.cores.inertial import CORE
    from lowcostnav_ros.physics.earth import displace
    from lowcostnav_ros.physics.rotation import euler_to_quat

    settings = InsGpsSettings(
        gps=GpsSettings(lever_arm_b_m=[1.0, 0.5, -2.0], position_bias_m=1.0),
        wheels=WheelSettings(enabled=True),
        magnetic=MagneticSettings(scale=0.02),
    )
    nav = np.array([0.66, -2.1, 900.0, 45.0, -20.0, 3.0, *euler_to_quat(0.3, 0.1, 5.8)])
    from lowcostnav_ros.physics.rotation import quat_to_dcm

    host = InsGps(settings)
    host.core.start(0, nav, np.eye(CORE))
    host.core.rate_b = np.array([0.1, -0.05, 0.2])
    field = host.aid("magnetic_heading").reference.model.field_n(0.66, -2.1, 900.0)
    samples = {
        "gps_position": GpsPosition(0, "gps/fix", 0.660001, -2.1, 905.0, np.eye(3)),
        "gps_velocity": GpsVelocity(0, "gps/vel", np.array([44.0, -21.0, 2.0]), np.eye(3)),
        "baro_height": Pressure(0, "air/static_pressure", 91000.0, 100.0),
        "magnetic_heading": MagneticField(0, "imu/mag", quat_to_dcm(nav[6:10]).T @ field, np.eye(3)),
        "hard_iron": MagneticField(0, "imu/mag", quat_to_dcm(nav[6:10]).T @ field + 3e-6, np.eye(3)),
        "airdata": AirVelocity(0, "air/velocity", np.array([50.0, 1.0, 2.0]), np.eye(3)),
        "wheels": None,
    }
    aid, sample = host.aid(which), samples[which]
    host.core.P[host.layout["wind"], host.layout["wind"]] = np.eye(2)
    H = aid.innovation(sample, host).H
    step = np.where(np.arange(host.layout.size) < 3, 1.0, 1e-4)
    for i in range(host.layout.size):
        values = []
        for sign in (1.0, -1.0):
            host.core.nav[:] = nav
            host.core.estimate[:] = 0.0
            host.core.rate_b = np.array([0.1, -0.05, 0.2])
            x = np.zeros(host.layout.size)
            x[i] = sign * step[i]
            host.core.nav[:3] = displace(*nav[:3], x[:3])
            host.core.nav[3:6] += x[3:6]
            host.core.nav[6:10] = quat_apply_phi_n(nav[6:10], x[6:9])
            host.core.estimate[CORE:] = x[CORE:]
            rows = host.layout["gyro_bias"]
            host.core.rate_b = host.core.rate_b - x[rows]
            values.append(aid.innovation(sample, host).y)
        numeric = -(values[0] - values[1]) / (2.0 * step[i])
        assert H[:, i] == pytest.approx(numeric, rel=1e-4, abs=2e-4), host.layout.labels[i]
