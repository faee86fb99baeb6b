"""Parts of the attitude reference: Jacobians by differences, window and switch in closed form, first covariance against sampling."""

import math

import numpy as np
import pytest
from ahrs_flights import DEG, GRAVITY, T0, Turn, settings
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from lowcostnav_ros.aids.level import LevelSettings
from lowcostnav_ros.base.measurements import AirVelocity
from lowcostnav_ros.cores.inertial import ATT, VEL
from lowcostnav_ros.estimation.inertial_window import WINDOW_SIZE, gather_window
from lowcostnav_ros.estimation.manoeuvre import ManoeuvreSwitch
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs
from lowcostnav_ros.physics.magnetic_heading import LocalField
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_to_dcm, quat_to_euler, skew, wrap
from lowcostnav_ros.starts.attitude_core import begin_core, restart_velocity_from_air
from lowcostnav_ros.starts.first_attitude import FirstAttitude

UNKNOWN = 1.0e6


def started(roll: float, pitch: float, heading: float, rng: np.random.Generator) -> Ahrs:
    """A navigator at an attitude, flying, with every further estimate off zero."""
    navigator = Ahrs(settings())
    begin_core(navigator.core, FirstAttitude(T0, euler_to_quat(roll, pitch, heading), 0.02, 0.02, True))
    navigator.core.nav[VEL] = 50.0 * quat_to_dcm(navigator.core.nav[6:10])[:, 0] + rng.normal(0.0, 3.0, 3)
    navigator.core.estimate[9:] = 0.3 * navigator.layout.sigma0[9:] * rng.standard_normal(navigator.layout.size - 9)
    return navigator


@hypothesis_settings(deadline=None, max_examples=25)
@given(roll=st.floats(-1.0, 1.0), pitch=st.floats(-0.5, 0.5), heading=st.floats(-3.1, 3.1), vanes=st.booleans(), seed=st.integers(0, 99))
def test_air_data_jacobian_is_the_derivative_of_the_innovation(roll, pitch, heading, vanes, seed):
    navigator = started(roll, pitch, heading, np.random.default_rng(seed))
    cov = np.diag([7.0, 0.2, 0.2] if vanes else [7.0, UNKNOWN, UNKNOWN])
    seen = AirVelocity(T0, "air/velocity", np.array([52.0, 1.0, 2.5]), cov)
    nav, estimate, P = navigator.core.nav.copy(), navigator.core.estimate.copy(), navigator.P.copy()
    H = navigator.aid("airdata").innovation(seen, navigator).H

    def innovation(index: int, step: float) -> np.ndarray:
        navigator.core.nav[:], navigator.core.estimate[:], navigator.core.P[:] = nav, estimate, P
        dx = np.zeros(navigator.layout.size)
        dx[index] = step
        navigator.correct(dx)
        return navigator.aid("airdata").innovation(seen, navigator).y

    for index in range(3, navigator.layout.size):
        slope = -(innovation(index, 1e-5) - innovation(index, -1e-5)) / 2e-5  # a correction takes its error out of the innovation
        np.testing.assert_allclose(slope, H[:, index], atol=2e-5)


def test_air_data_moves_no_attitude_while_gps_is_good():
    turn = Turn(10.0)
    with_air, without = Ahrs(settings()), Ahrs(settings())
    last = with_air.feed_all(turn.measurements(0.0, 20.0, ("gps", "mag", "air")))[-1]
    other = without.feed_all(turn.measurements(0.0, 20.0, ("gps", "mag")))[-1]
    assert with_air.aid("airdata").status.fused > 50
    np.testing.assert_allclose(last.q_nb, other.q_nb, atol=1e-6)


def test_slow_air_is_not_used():
    navigator = Ahrs(settings())
    slow = AirVelocity(T0, "air/velocity", np.array([9.0, 0.0, 0.0]), np.diag([7.0, UNKNOWN, UNKNOWN]))
    assert navigator.aid("airdata").innovation(slow, navigator) == "below minimum airspeed"


def test_window_integral_against_a_differential_equation():
    rate, force = np.array([0.2, -0.1, 0.3]), np.array([1.0, 0.5, -9.5])
    stamps = T0 + (np.arange(1, 201) * 10_000_000)
    window = np.zeros(WINDOW_SIZE)
    window[0] = 1.0
    following, t_ns = gather_window(T0, window, stamps, np.tile(force, (200, 1)), np.tile(rate, (200, 1)), 0, T0 + 1_500_000_000)
    assert (following, t_ns) == (150, T0 + 1_500_000_000)

    def derivative(_, x):
        C = x[:9].reshape(3, 3)
        return np.concatenate(((C @ skew(rate)).ravel(), C @ force))

    exact = solve_ivp(derivative, (0.0, 1.5), np.concatenate((np.eye(3).ravel(), np.zeros(3))), rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(quat_to_dcm(window[:4]), exact[:9].reshape(3, 3), atol=1e-9)
    np.testing.assert_allclose(window[4:7], exact[9:], atol=1e-4)
    np.testing.assert_allclose(window[7:10], 1.5 * rate)


@pytest.mark.parametrize("bank_deg", [-40.0, 5.0, 30.0])
def test_alignment_in_a_turn_is_exact_without_noise(bank_deg):
    turn = Turn(bank_deg, heading0_deg=200.0)
    local = LocalField(math.atan2(turn.field_n[1], turn.field_n[0]), float(np.linalg.norm(turn.field_n)))
    alignment = Ahrs(settings()).alignment
    first = None
    for m in turn.measurements(0.0, 4.0, ("gps", "mag")):
        if m.source == "imu/data_raw":
            start = 0
            while start < len(m):
                start = alignment.gather(m, start)
        elif m.source == "imu/mag":
            alignment.magnetic(m)
        else:
            first = first or alignment.gps(m, local)
    t = (first.t_ns - T0) * 1e-9
    expected = np.array([turn.bank, 0.0, turn.heading(t)])
    # gravity of the flight is 9.80, the alignment's 9.80665: a fraction of a millirad in a steep bank
    assert np.abs(wrap(np.array(quat_to_euler(first.q_nb)) - expected)).max() < 0.05 * DEG


def test_first_covariance_is_that_of_sampled_first_attitudes():
    q, rng = euler_to_quat(0.3, -0.1, 1.0), np.random.default_rng(3)
    navigator = Ahrs(settings(imu__accel_turn_on_mg=20.0))
    begin_core(navigator.core, FirstAttitude(T0, q, 0.001, 0.01, True))
    layout, C = navigator.layout, quat_to_dcm(q)
    accel, bias = layout["accel_bias"], layout["heading_bias"].start
    n = 40_000
    db = rng.standard_normal((n, 3)) * layout.sigma0[accel]
    b = rng.standard_normal(n) * layout.sigma0[bias]
    tilt, turn = 0.001 * rng.standard_normal((n, 2)), 0.01 * rng.standard_normal(n)
    level = db @ C.T / 9.80665  # a level that believes specific force with bias: -[f x] phi = C db
    phi = np.column_stack((level[:, 1] + tilt[:, 0], -level[:, 0] + tilt[:, 1], -b + turn))
    joint = np.cov(np.column_stack((phi, db, b)).T)
    rows = [*range(ATT.start, ATT.stop), *range(accel.start, accel.stop), bias]
    scale = np.sqrt(np.diag(joint))
    np.testing.assert_allclose(navigator.P[np.ix_(rows, rows)] / np.outer(scale, scale), joint / np.outer(scale, scale), atol=0.03)
    assert np.linalg.eigvalsh(navigator.P).min() > 0.0


def test_velocity_from_air_is_as_uncertain_as_the_wind_and_correlated_with_it():
    navigator = Ahrs(settings())
    q = euler_to_quat(0.0, 0.0, 0.5)
    begin_core(navigator.core, FirstAttitude(T0, q, 0.01, 0.03, True))
    air = AirVelocity(T0, "air/velocity", np.array([50.0, 0.0, 0.0]), np.diag([7.0, UNKNOWN, UNKNOWN]))
    restart_velocity_from_air(navigator.core, air, np.array([3.0, -4.0, 0.0]))
    np.testing.assert_allclose(navigator.core.nav[VEL], [50.0 * math.cos(0.5) + 3.0, 50.0 * math.sin(0.5) - 4.0, 0.0])
    wind = navigator.layout["wind"]
    difference = navigator.P[3, 3] - 2.0 * navigator.P[3, wind.start] + navigator.P[wind.start, wind.start]
    assert 3.0 <= math.sqrt(difference) < 6.0
    assert math.sqrt(navigator.P[3, 3]) > 10.0
    assert np.linalg.eigvalsh(navigator.P).min() > 0.0


@pytest.mark.parametrize(("bank_deg", "steady"), [(0.0, True), (1.5, True), (4.0, False), (20.0, False)])
def test_switch_sees_the_source_s_half_degree_a_second(bank_deg, steady):
    turn = Turn(bank_deg, speed=46.3)  # 0.5 deg/s at 46.3 m/s is a bank of 2.4 deg (Gebre-Egziabher 2004, section 4.6)
    switch = ManoeuvreSwitch(LevelSettings())
    switch.restart(T0)
    for k in range(100):
        switch.follow(turn.imu(0.1 * k, 0.1 * (k + 1)), 0, 10)
        switch.decide(turn.dcm(0.1 * (k + 1)), np.zeros(3))
    assert (switch.steady_since_ns is not None) == steady


def test_switch_has_hysteresis():
    switch = ManoeuvreSwitch(LevelSettings(release=0.5))
    switch.restart(T0)

    def state(rate_dps: float, k: int) -> bool:
        turn = Turn(math.degrees(math.atan(rate_dps * DEG * 50.0 / GRAVITY)))
        for step in range(80):
            switch.follow(turn.imu(8.0 * k + 0.1 * step, 8.0 * k + 0.1 * (step + 1)), 0, 10)
            switch.decide(turn.dcm(0.0), np.zeros(3))
        return switch.steady_since_ns is not None

    assert [state(rate, k) for k, rate in enumerate((0.0, 0.4, 0.7, 0.4, 0.2))] == [True, True, False, False, True]


def test_position_that_nothing_corrects_stays_bounded():
    turn = Turn(0.0, speed=0.0)
    navigator = Ahrs(settings())
    navigator.feed_all(turn.measurements(0.0, 5.0, ("mag",)))
    core, P = navigator.core, navigator.P
    for hour in range(10):
        core.P[0:3, 0:3] += np.eye(3) * 1e10 * (hour + 1)  # as if the position had drifted for that long
        t = T0 + 5_000_000_000 + np.arange(1, 401) * 100_000_000 + hour * 40_000_000_000
        block = turn.imu(0.0, 4.0)
        for start in range(0, 400, 50):
            part = slice(start, start + 50)
            navigator.feed(type(block).of("imu/data_raw", t[part], block.specific_force_b[part], block.angular_rate_b[part]))
    assert np.sqrt(np.diag(P)[:3]).max() <= 1001.0
    assert np.linalg.eigvalsh(P).min() > 0.0
    assert not core.guard_actions
