"""Bridging a hole in the inertial data: closed forms of the mean and of the growth."""

import numpy as np
import pytest

from lowcostnav_ros.aids.gnss import GnssSettings, clock_block
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.bridging import ACCELERATION, ACCELERATION_TAU_S, TILT_LIMIT, TURN_TAU_S, LastMotion
from lowcostnav_ros.cores.imu_errors import ImuSettings, core_block
from lowcostnav_ros.cores.inertial import InertialCore
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, difference_n
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_to_dcm, quats_to_euler

SPEED, TURN = 60.0, 3.0 * DEGREE


def turning():
    """State (10,) and last motion of a level coordinated turn, heading north."""
    bank = np.arctan(SPEED * TURN / STANDARD_GRAVITY)
    q = euler_to_quat(bank, 0.0, 0.0)
    C = quat_to_dcm(q)
    motion = LastMotion(C, C.T @ np.array([0.0, SPEED * TURN, -STANDARD_GRAVITY]), C.T @ np.array([0.0, 0.0, TURN]))
    return np.array([0.7, 0.1, 1000.0, SPEED, 0.0, 0.0, *q]), motion


def test_a_turn_goes_on_and_dies_away():
    nav, motion = turning()
    before = nav.copy()
    motion.carry(nav, 1.0)
    angle = TURN * TURN_TAU_S * (1.0 - np.exp(-1.0 / TURN_TAU_S))
    np.testing.assert_allclose(nav[3:6], SPEED * np.array([np.cos(angle), np.sin(angle), 0.0]), atol=1e-9)
    roll, pitch, heading = quats_to_euler(nav[6:10][None])[0]
    assert (roll, pitch, heading) == pytest.approx((np.arctan(SPEED * TURN / STANDARD_GRAVITY), 0.0, angle), abs=1e-9)
    arc = SPEED / TURN * np.array([np.sin(TURN), 1.0 - np.cos(TURN), 0.0])
    np.testing.assert_allclose(difference_n(*nav[:3], *before[:3]), arc, atol=0.2)  # a turn that lasts is met to this in 60 m


def test_the_growth_is_that_of_white_acceleration_whatever_the_pieces():
    whole, pieces = np.zeros((9, 9)), np.zeros((9, 9))
    nav, motion = turning()
    nav[6:10] = euler_to_quat(0.0, 0.0, 0.0)
    straight = LastMotion(np.eye(3), np.array([0.0, 0.0, -STANDARD_GRAVITY]), np.zeros(3))
    whole += straight.noise(whole, 2.0)
    for _ in range(20):
        Phi = straight.carry(nav, 0.1)
        pieces = Phi @ pieces @ Phi.T + straight.noise(pieces, 0.1)
    np.testing.assert_allclose(pieces, whole, rtol=1e-9, atol=1e-9)
    assert whole[3, 3] == pytest.approx(2.0 * ACCELERATION**2 * ACCELERATION_TAU_S * 2.0)
    assert motion.noise(whole, 2.0)[3, 3] > whole[3, 3]  # more was seen, more is possible
    assert whole[0, 0] == pytest.approx(whole[3, 3] * 4.0 / 3.0)
    assert whole[0, 3] == pytest.approx(whole[3, 3])
    assert np.sqrt((whole + straight.noise(whole, 100.0))[6, 6]) == pytest.approx(TILT_LIMIT)


def test_a_clock_runs_on_over_a_hole():
    core = InertialCore(Layout([core_block(ImuSettings()), clock_block(GnssSettings())]))
    core.start(0, turning()[0], np.eye(9))
    core.estimate[-2:] = 100.0, 8.0
    before = core.P[-2:, -2:].copy()
    core.bridge(500_000_000)
    assert core.estimate[-2:] == pytest.approx([104.0, 8.0])
    assert core.P[-2, -2] - before[0, 0] == pytest.approx(0.25 * before[1, 1], rel=1e-2)
