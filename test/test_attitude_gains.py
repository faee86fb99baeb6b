"""Constant gains against printed and recomputed figures, a time-varying Kalman filter and simulation."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.estimation import attitude_gains as g
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.physics.attitude_propagation import euler_rate_matrix
from lowcostnav_ros.studies.attitude_filters import euler_filter

DEG = math.pi / 180.0


def test_gains_of_the_tuning_tables():
    assert g.axis_gains(g.GPS_FLOWN, 0.25) == pytest.approx((0.0358, 5.2e-4), rel=0.01)
    assert g.axis_gains(g.ACCEL_MAG, 0.06)[0] == pytest.approx(0.97, abs=0.005)
    assert g.axis_gains(g.ACCEL_MAG, 0.80)[0] == pytest.approx(0.35, abs=0.01)
    assert g.axis_gains(g.ACCEL_MAG, 0.06)[1] < 1e-9  # the null shift is frozen


def test_time_constants_of_the_pole_study():
    assert g.closed_loop_times(g.GPS_FLOWN, 0.25) == pytest.approx((19.0, 46.0), rel=0.02)
    assert g.closed_loop_times(g.SLOW_POLES, 0.25) == pytest.approx((0.38, 218.0), rel=0.02)
    assert g.closed_loop_times(g.FAST_POLES, 0.25) == pytest.approx((0.38, 22.0), rel=0.02)


@settings(deadline=None, max_examples=15)
@given(roll=st.floats(-1.5, 1.5))
def test_schedule_is_the_steady_gain_at_zero_pitch(roll):
    K, _ = kalman.steady_state_gain(*g.euler_model(roll, 0.0, g.GPS_FLOWN))
    np.testing.assert_allclose(g.scheduled_euler_gain(roll, 0.0, g.GPS_FLOWN), K, rtol=1e-6, atol=1e-9)


def test_schedule_off_zero_pitch_sends_each_error_to_the_axis_that_made_it():
    roll, pitch = 0.6, 0.35
    K = g.scheduled_euler_gain(roll, pitch, g.GPS_FLOWN)
    rate_error = np.array([1e-3, -2e-3, 5e-4])
    np.testing.assert_allclose(K[3:] @ (euler_rate_matrix(roll, pitch) @ rate_error), g.axis_gains(g.GPS_FLOWN, 0.25)[1] * rate_error)


def test_steady_gain_is_where_a_kalman_filter_ends():
    Phi, Qd, H, R = g.quaternion_model(np.zeros(3), g.GPS_FLOWN)
    P = np.eye(6)
    for _ in range(3000):
        P = Phi @ P @ Phi.T + Qd
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        P = P - K @ H @ P
    np.testing.assert_allclose(K, g.constant_gain(g.GPS_FLOWN), rtol=1e-4, atol=1e-9)


def test_vertical_is_refused():
    with pytest.raises(SettingsError, match="quaternion filter"):
        g.euler_model(0.0, 0.5 * math.pi, g.GPS_FLOWN)


def test_filter_learns_the_bias_in_a_steep_turn_as_slowly_as_its_poles_say():
    rate_hz, every, bias = 20, 10, np.array([0.2, -0.1, 0.3]) * DEG
    bank, turn = 40.0 * DEG, 9.81 * math.tan(40.0 * DEG) / 60.0
    n = 1200 * rate_hz
    body = turn * np.array([0.0, math.sin(bank), math.cos(bank)])
    heading = turn * np.arange(1, n + 1) / rate_hz
    measured = np.column_stack((np.full(n // every, bank), np.zeros(n // every), heading[every - 1 :: every]))
    start, gains = np.array([bank, 0.0, 0.0]), g.axis_gains(g.GPS_FLOWN, 0.25)
    angles, learned = euler_filter(start, np.zeros(3), np.tile(body + bias, (n, 1)), measured, every, *gains, 1.0 / rate_hz, n // every)
    left = np.linalg.norm(learned[rate_hz * np.array([600, 1200]) - 1] + bias, axis=1)
    # across the turn axis the angle error turns with the aircraft: z' = -(a + i w) z + d, d' = -b z, two gains over the period of updates
    a, b = gains[0] / 0.5, gains[1] / 0.5
    slowest = max(np.roots([1.0, a + 1j * turn, b]).real)
    assert -1.0 / slowest > 300.0  # against 46 s in straight flight
    assert left[1] / left[0] == pytest.approx(math.exp(600.0 * slowest), rel=0.15)
    assert left[1] < 0.012 * DEG
    assert np.abs(angles[-1] - [bank, 0.0, heading[-1]]).max() < 0.1 * DEG
