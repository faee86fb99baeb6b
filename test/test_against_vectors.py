"""Gyros that lie, satellites that scatter: a sigma that owns it, and reckoning that heeds it."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from ahrs_flights import DEG, T0, Turn, settings

from lowcostnav_ros.aids.gnss import RATE
from lowcostnav_ros.base.measurements import Attitude, ImuBlock
from lowcostnav_ros.cores.reckoning import UNKNOWN, ReckoningCore
from lowcostnav_ros.navigators.against_satellites import EXCESS, AgainstSatellites
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_to_euler, wrap

GPS_LOST_S, WRONG_S, END_S = 15.0, 20.0, 45.0
SECOND = 1_000_000_000


def heading_errors(gyro_dps):
    """Seconds, heading error and its sigma (n, 3) of a reference whose vertical gyro is off from :data:`WRONG_S` on, without GPS."""
    flight, reference, out = Turn(), Ahrs(settings()), []
    legs = ((0.0, GPS_LOST_S, ("gps", "mag", "air"), 0.0), (GPS_LOST_S, WRONG_S, ("mag", "air"), 0.0))
    for t0, t1, sources, off in (*legs, (WRONG_S, END_S, ("mag", "air"), gyro_dps)):
        for item in flight.measurements(t0, t1, sources, gyro_bias=(0.0, 0.0, off * DEG)):
            for solution in reference.feed(item):
                error = wrap(quat_to_euler(solution.q_nb)[2] - flight.heading(0.0))
                out.append((1e-9 * (solution.stamp_ns - T0), error, math.sqrt(solution.cov_att[2, 2])))
    return reference, np.array(out)


@pytest.mark.parametrize("gyro_dps", [-3.0, 6.0])
def test_gyros_that_turn_away_from_the_compass_are_covered_and_named(gyro_dps):
    reference, found = heading_errors(gyro_dps)
    after = found[found[:, 0] > WRONG_S]
    assert np.abs(after[:, 1]).max() > 20.0 * DEG  # what lies carries the attitude away
    assert np.mean(np.abs(after[:, 1]) > 4.0 * after[:, 2]) < 0.05
    assert after[-1, 2] > 20.0 * DEG
    assert any("gyros" in found.name for found in reference.contradictions())


def test_sound_gyros_are_not_doubted():
    reference, found = heading_errors(0.0)
    assert not reference.against_vectors.sigmas(reference.core.t_ns).any()
    assert not reference.contradictions()
    assert found[-1, 2] < 3.0 * DEG


def test_an_attitude_begun_upside_down_is_as_uncertain_as_it_can_be():
    flight, reference = Turn(), Ahrs(settings())
    turned = np.array([1.0, -1.0, -1.0])
    solutions = []
    for item in flight.measurements(0.0, 8.0):
        if isinstance(item, ImuBlock):
            item = dataclasses.replace(item, specific_force_b=item.specific_force_b * turned, angular_rate_b=item.angular_rate_b * turned)
        solutions += reference.feed(item)
    roll, _, _ = quat_to_euler(solutions[-1].q_nb)
    assert abs(roll) > 170.0 * DEG
    assert math.sqrt(solutions[-1].cov_att[0, 0]) > 90.0 * DEG


def reckoning():
    """A core that flies north at 50 m/s."""
    navigator = DeadReckoning()
    core = ReckoningCore(navigator.settings, navigator.layout)
    core.held.fastest, core.held.airborne, core.held.air_ns = 50.0, True, 0
    core.start(0, np.array([0.6, -2.0, 900.0]), np.eye(3))
    return core


def attitude(t_ns, sigma):
    return Attitude(t_ns, "imu/data_fused", euler_to_quat(0.0, 0.0, 0.0), np.diag([1e-4, 1e-4, sigma**2]), np.zeros(3), np.zeros(3))


def test_reckoning_knows_the_heading_no_better_than_its_reference():
    core = reckoning()
    core.hold(attitude(0, 1.0 * DEG))
    before = core.P.copy()
    core.hold(attitude(0, 1.5 * DEG))
    np.testing.assert_array_equal(core.P, before)  # less than its settings expect
    core.hold(attitude(0, 20.0 * DEG))
    assert core.sigmas()[0] > 19.0 * DEG
    assert math.sqrt(core.P[0, 0]) > 0.4 * 50.0 * 20.0 * DEG * 10.0  # what it was wrong about before
    position = core.P[0, 0]
    core.hold(attitude(0, 20.0 * DEG))
    assert core.P[0, 0] == position  # once
    assert np.linalg.eigvalsh(core.P).min() > 0.0


def test_a_heading_that_is_not_known_is_none():
    core = reckoning()
    core.hold(attitude(0, 20.0 * DEG))
    assert core.timed_out() == ""
    core.hold(attitude(0, 60.0 * DEG))
    assert core.timed_out() == UNKNOWN


def test_satellites_that_scatter_more_than_they_state_widen_the_sigma_for_a_minute():
    against, aid, P = AgainstSatellites(), SimpleNamespace(kind=RATE, scatter=0.4, observed=None), np.eye(8)
    for k in range(20):
        against.take(k * SECOND, [aid], P)
    assert against.doubt(P) is None
    aid.scatter = 40.0
    for k in range(20, 30):
        against.take(k * SECOND, [aid], P)
    assert against.doubt(P)[3, 3] > EXCESS - 1.0
    aid.scatter = 0.4
    for k in range(30, 120):
        against.take(k * SECOND, [aid], P)
    assert against.doubt(P) is None
