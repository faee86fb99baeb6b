"""How large a fault is that GPS shows, what a velocity scatters, and what a navigator without GPS cannot know."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_ins_gps import GPS_ONLY

from lowcostnav_ros.aids.gps import Bends, PositionAid, VelocityAid
from lowcostnav_ros.cores.imu_errors import ImuSettings, bias_blocks, core_block
from lowcostnav_ros.cores.inertial import CORE
from lowcostnav_ros.estimation.aiding import Decision, floored
from lowcostnav_ros.estimation.cross_checks.scatter import UNDERSTATED, ScatterCheck
from lowcostnav_ros.estimation.error_state import Kind, Layout
from lowcostnav_ros.navigators.against_air import AgainstAir
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.navigators.recovery import UNNOTICED_S, Recovery
from lowcostnav_ros.navigators.trust import alone
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

SECOND = 1_000_000_000


def remembered():
    layout = Layout([core_block(ImuSettings()), *bias_blocks(ImuSettings())])
    return Recovery(ImuSettings(), layout), layout


def refused(recovery, innovations, rate_hz=2.0):
    """Feed a velocity that agrees at 100 s, then innovations (n, 3) that are refused."""
    recovery.note(100 * SECOND, Decision.FUSE, np.zeros(3))
    for k, y in enumerate(innovations, 1):
        recovery.note(round((100.0 + k / rate_hz) * SECOND), Decision.REJECT, y)
    return recovery.seen()


@pytest.mark.parametrize("accel", [0.3, 2.0])
def test_an_acceleration_is_read_off_the_mean_of_the_velocities_it_spoils(accel):
    recovery, layout = remembered()
    times = UNNOTICED_S + np.arange(1, 21) / 2.0
    seen = refused(recovery, accel * times[:, None] * np.array([0.6, 0.8, 0.0]))
    assert (
        accel < seen[layout.kind == int(Kind.ACCEL_BIAS)].max() < 1.7 * accel
    )  # the largest of the run, what passed the gate is not in it


def test_a_gyro_is_read_off_the_mean_of_the_velocities_it_spoils():
    recovery, layout = remembered()
    times, rate = UNNOTICED_S + np.arange(1, 21) / 2.0, 0.02
    seen = refused(recovery, 0.5 * STANDARD_GRAVITY * rate * times[:, None] ** 2 * np.array([1.0, 0.0, 0.0]))
    assert rate < seen[layout.kind == int(Kind.GYRO_BIAS)].max() < 2.0 * rate


def test_white_noise_of_the_receiver_is_no_error_of_the_inertial_sensors():
    for seed in range(20):
        recovery, layout = remembered()
        refused(recovery, np.random.default_rng(seed).normal(size=(20, 3)))
        recovery.note(112 * SECOND, Decision.FUSE, np.zeros(3))
        assert recovery.seen()[layout.kind == int(Kind.ACCEL_BIAS)].max() < 0.25 and not recovery.is_lost


def test_an_error_found_after_an_outage_has_had_the_outage_to_grow():
    recovery, layout = remembered()
    recovery.note(100 * SECOND, Decision.FUSE, np.zeros(3))
    for k in range(8):
        recovery.note(round((200.0 + 0.5 * k) * SECOND), Decision.REJECT, np.array([10.0, 0.0, 0.0]))
    assert recovery.seen()[layout.kind == int(Kind.ACCEL_BIAS)].max() == pytest.approx(2.0 * 10.0 / 102.0, rel=0.01)


@pytest.mark.parametrize(("nis", "factor"), [(3.0, 1.0), (4.5, 10.0), (12.0, 30.0)])
def test_noise_that_was_widened_comes_back_while_velocities_agree(nis, factor):
    recovery, layout = remembered()
    set_to = layout.psd[3:9].copy()
    recovery.begin(100 * SECOND, layout.initial_covariance(), moving=False)
    assert layout.psd[3:9] == pytest.approx(100.0 * set_to)
    for k in range(160):
        recovery.note(round((100.5 + 0.5 * k) * SECOND), Decision.FUSE, np.full(3, 0.1), nis)
    assert layout.psd[3:9] == pytest.approx(factor**2 * set_to)


def test_noise_stays_wide_where_a_bias_is_beyond_what_a_poor_unit_has():
    recovery, layout = remembered()
    set_to, estimate = layout.psd[3:9].copy(), np.zeros(layout.size)
    estimate[np.flatnonzero(layout.kind == int(Kind.GYRO_BIAS))[2]] = np.radians(5.0)
    recovery.begin(100 * SECOND, layout.initial_covariance(), moving=False)
    for k in range(160):
        recovery.note(round((100.5 + 0.5 * k) * SECOND), Decision.FUSE, np.full(3, 0.1), 3.0)
        recovery.contradiction(estimate)
    assert layout.psd[3:9] == pytest.approx(100.0 * set_to)


def test_what_sensor_errors_do_is_straight_and_white_noise_bends_by_as_much_as_its_variance_says():
    bends, rng = Bends(), np.random.default_rng(1)
    for k in range(6):
        bend = bends.take(k * SECOND, np.array([1.0, 2.0, 3.0]) * k + 5.0, np.ones(3))
    assert bend == pytest.approx((1.0, 0.0), abs=1e-12)
    bends.clear()
    stamps = np.cumsum(rng.choice([0.2, 0.5, 1.0], size=4000))
    seen = [bends.take(round(t * SECOND), 0.3 * rng.normal(size=3), np.full(3, 0.09)) for t in stamps]
    assert np.mean([square for _, square in filter(None, seen)]) == pytest.approx(1.0, abs=0.06)


def test_a_velocity_that_scatters_is_named_and_one_that_jumps_is_not():
    for sigma, jump, named in ((1.0, 0.0, False), (10.0, 0.0, True), (1.0, 50.0, False)):
        bends, check, rng = Bends(), ScatterCheck("gps/vel"), np.random.default_rng(2)
        for k in range(60):
            y = 0.1 * sigma * rng.normal(size=3) + 0.1 * jump * (k == 30)
            bend = bends.take(k * SECOND // 2, y, np.full(3, 0.01))
            if bend is not None:
                check.take(k * SECOND // 2, *bend)
        assert (check.held is not None and check.held.name == UNDERSTATED) == named
        assert (check.noise_factor > 50.0) == named


def test_what_gps_and_state_are_apart_is_known_no_better_than_measured():
    navigator = InsGps(GPS_ONLY)
    fix, y, S = next(iter(navigator.aids_of(PositionAid))), np.array([100.0, 0.0, 0.0]), np.diag([4.0, 9.0, 25.0])
    fix.unresolved, fix.status.innovation_covariance = (SECOND, y), S
    assert navigator.trust.doubt(SECOND)[0:3, 0:3] == pytest.approx(np.diag([50.0**2, 25.0**2, 25.0**2]) + np.diag([625.0, 0.0, 0.0]) + S)
    velocity = next(iter(navigator.aids_of(VelocityAid)))
    velocity.unresolved, velocity.status.innovation_covariance = (SECOND, np.array([0.0, 2.0, 0.0])), 0.01 * np.eye(3)
    doubt = navigator.trust.doubt(3 * SECOND)  # two seconds and the one before it was noticed
    assert doubt[3:6, 3:6] == pytest.approx(np.diag([0.26, 1.26, 0.26]))
    moved = np.array([100.0, 6.0, 0.0])
    assert doubt[0:3, 0:3] == pytest.approx(0.25 * np.outer(moved, moved) + (moved @ moved / 16.0 + 0.09) * np.eye(3) + S)


def test_position_velocity_and_attitude_that_are_apart_are_covered_each_in_its_own_unit():
    apart = np.repeat([100.0, 1.0, 0.01], 3)
    cover = alone(np.eye(9), apart)
    for rows, size in ((slice(0, 3), 100.0), (slice(3, 6), 1.0), (slice(6, 9), 0.01)):
        assert cover[rows, rows] == pytest.approx(np.eye(3) + size**2 * (0.25 * np.ones((3, 3)) + 3.0 / 16.0 * np.eye(3)))
        cover[rows, rows] = 0.0
    assert not cover.any()


def air(t_s, y, decision):
    status = SimpleNamespace(stamp_ns=round(t_s * SECOND), innovation=np.asarray(y, float), innovation_covariance=np.eye(3))
    return SimpleNamespace(status=status, decision=decision)


def test_what_strays_across_the_air_is_covered_until_gps_is_back_and_a_pitot_tube_is_believed_to_be_one():
    along, across = AgainstAir(), AgainstAir()
    for k in range(20):
        along.take(air(0.2 * k, [30.0, 0.5, 0.5], Decision.REJECT))
        across.take(air(0.2 * k, [0.0, 6.0 + 0.2 * k, 0.0], Decision.REJECT))
    assert not along.is_straying
    accel = 7.0 / 6.0  # 1 s after it was first refused, 5 s more unnoticed
    P = across.doubt(20 * SECOND, 50.0)
    assert np.sqrt(P.diagonal()) == pytest.approx(0.5 * accel * np.repeat([0.5 * 25.0**2, 25.0, 25.0 / 50.0], 3))
    assert P.shape == (CORE, CORE)
    across.take(air(21.0, [0.0, 0.0, 0.0], Decision.FUSE))
    assert across.is_straying
    across.clear()
    assert not across.is_straying


def test_a_gust_across_is_no_fault_of_the_inertial_sensors():
    check = AgainstAir()
    for k in range(100):
        check.take(air(0.2 * k, [0.0, 6.0, 0.0], Decision.REJECT if k % 10 < 4 else Decision.FUSE))
    assert not check.is_straying


def test_correlations_of_one_are_no_measurements():
    assert np.allclose(floored(4.0 * np.ones((3, 3)), 1.0, 0.5), 4.0 * np.eye(3))
    long = np.array([[4.0, 3.9, 0.0], [3.9, 4.0, 0.0], [0.0, 0.0, 9.0]])
    assert np.allclose(floored(long, 1.0, 0.1), long)
