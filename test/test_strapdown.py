"""Strapdown against closed-form flights, coning and sculling benchmarks, and its own inverse.

The flights are the three closed-form profiles of the data sets: velocity and attitude are given functions of time, so specific
force and angular rate are exact (complex-step derivatives) and increments come from Boole's rule, not from the code under test.
"""

import functools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson
from scipy.special import j1

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics import earth, strapdown
from lowcostnav_ros.physics import rotation as rot

START = (math.radians(38.7), math.radians(-9.1), 500.0)
DEG = math.pi / 180
STEP = 1e-30  # complex step: derivatives exact to rounding


def smooth(x):
    x = np.where(x.real < 0, 0.0, np.where(x.real > 1, 1.0, x))
    return x**3 * (10 - 15 * x + 6 * x**2)


def smooth_integral(x):
    inside = np.where(x.real < 0, 0.0, np.where(x.real > 1, 1.0, x))
    return inside**4 * (2.5 - 3 * inside + inside**2) + np.where(x.real > 1, x - 1, 0.0)


def low_dynamics(t):
    heading = sum(0.5 * np.pi * smooth((t - c + 20) / 40) for c in (75, 225, 375, 525))
    return 42.5 + 12.5 * np.cos(2 * np.pi * t / 75), heading, 4 * np.sin(2 * np.pi * t / 150)


def gentle(t):
    return 45 + 10 * np.cos(2 * np.pi * t / 300), 2 * np.pi * t / 600, 4 * np.sin(2 * np.pi * t / 150)


def high_dynamics(t):
    speed = 30 + 70 * smooth(t / 200) - 70 * smooth((t - 400) / 200)
    heading = DEG * (9 * t - 600 * smooth_integral(t / 200) + 600 * smooth_integral((t - 400) / 200))
    first, last = smooth((t - 200) / 10), smooth((t - 395) / 10)
    middle = (-3 + 2 * np.sin(2 * np.pi * (t - 200) / 100)) * first * (1 - last)
    return speed, heading, 6 * smooth(t / 200) * (1 - first) + middle + 6 * last * (1 - smooth((t - 405) / 195))


def heading_rate(profile, t):
    """Closed forms again, because a complex step inside a complex step does not work."""
    if profile is high_dynamics:
        return DEG * (9 - 3 * smooth(t / 200) + 3 * smooth((t - 400) / 200))
    if profile is gentle:
        return np.full_like(t, 2 * np.pi / 600)
    rate = np.zeros_like(t)
    for c in (75, 225, 375, 525):
        x = (t - c + 20) / 40
        rate = rate + np.where((x.real > 0) & (x.real < 1), 0.5 * np.pi / 40 * 30 * x**2 * (1 - x) ** 2, 0.0)
    return rate


def attitude(profile, t):
    speed, heading, climb = profile(t)
    return np.arctan(speed * heading_rate(profile, t) / 9.8), np.arctan(climb / speed), heading


def velocity(profile, t):
    speed, heading, climb = profile(t)
    return np.stack((speed * np.cos(heading), speed * np.sin(heading), -climb), axis=-1)


def path(vel, dt):
    """Latitude, longitude and height from velocity: quadrature on the fine grid, latitude by fixed-point iteration."""
    height = START[2] - cumulative_simpson(vel[:, 2], dx=dt, initial=0)
    lat = np.full_like(height, START[0])
    for _ in range(4):
        w2 = 1 - earth.WGS84_E2 * np.sin(lat) ** 2
        normal = earth.WGS84_A / np.sqrt(w2)
        meridian = normal * (1 - earth.WGS84_E2) / w2
        lat = START[0] + cumulative_simpson(vel[:, 0] / (meridian + height), dx=dt, initial=0)
    lon = START[1] + cumulative_simpson(vel[:, 1] / ((normal + height) * np.cos(lat)), dx=dt, initial=0)
    rates = np.stack((vel[:, 1] / (normal + height), -vel[:, 0] / (meridian + height), -vel[:, 1] / (normal + height) * np.tan(lat)), -1)
    return lat, lon, height, rates


@kernel
def to_body(eulers, vectors_n, lat, height):
    """Columns of n-vectors in body axes, less gravity where a height is given."""
    out = np.empty(vectors_n.shape)
    for k in range(out.shape[0]):
        vector = vectors_n[k].copy()
        if not np.isnan(height[k]):
            vector[2] -= earth.gravity(lat[k], height[k])
        out[k] = rot.euler_to_dcm(eulers[k, 0], eulers[k, 1], eulers[k, 2]).T @ vector
    return out


def true_rates(profile, t, vel, lat, height, transport):
    """Specific force and angular rate in body axes at the times t, from Newton's law and the Euler kinematics."""
    roll, pitch, heading = attitude(profile, t)
    d_roll, d_pitch, d_heading = (a.imag / STEP for a in attitude(profile, t + 1j * STEP))
    earth_n = earth.EARTH_RATE * np.stack((np.cos(lat), 0 * lat, -np.sin(lat)), -1)
    accel = velocity(profile, t + 1j * STEP).imag / STEP + np.cross(2 * earth_n + transport, vel)
    eulers = np.stack((roll, pitch, heading), axis=-1)
    rate = np.stack(
        (
            d_roll - d_heading * np.sin(pitch),
            d_pitch * np.cos(roll) + d_heading * np.cos(pitch) * np.sin(roll),
            -d_pitch * np.sin(roll) + d_heading * np.cos(pitch) * np.cos(roll),
        ),
        axis=-1,
    )
    return to_body(eulers, accel, lat, height), rate + to_body(eulers, earth_n + transport, lat, np.full_like(lat, np.nan))


@functools.cache
def flight(profile, rate_hz, seconds=600):
    """True states at the sample times (columns) and exact increments over each interval, by Boole's rule."""
    dt = 1.0 / rate_hz
    fine = np.arange(4 * seconds * rate_hz + 1) * (dt / 4)
    vel = velocity(profile, fine)
    lat, lon, height, transport = path(vel, dt / 4)
    increments = []
    for values in true_rates(profile, fine, vel, lat, height, transport):
        a, b, c, d, e = values[:-4:4], values[1:-3:4], values[2:-2:4], values[3:-1:4], values[4::4]
        increments.append(dt / 90 * (7 * a + 32 * b + 12 * c + 32 * d + 7 * e))
    quats = rot.eulers_to_quat(np.stack(attitude(profile, fine[::4]), -1))
    return dt, np.column_stack((lat[::4], lon[::4], height[::4], vel[::4], quats)), *increments


@kernel
def run(nav0, dv, dtheta, dt, compensate):
    out = np.empty((dv.shape[0] + 1, 10))
    out[0] = nav0
    zero = np.zeros(3)
    for k in range(dv.shape[0]):
        out[k + 1] = out[k]
        if compensate and k > 0:
            strapdown.strapdown_step(out[k + 1], dv[k], dtheta[k], dv[k - 1], dtheta[k - 1], dt)
        else:
            strapdown.strapdown_step(out[k + 1], dv[k], dtheta[k], zero, zero, dt)
    return out


@kernel
def run_literal(nav0, dv, dtheta, dt):
    out = np.empty((dv.shape[0] + 1, 10))
    out[0] = nav0
    for k in range(dv.shape[0]):
        out[k + 1] = out[k]
        strapdown.literal_step(out[k + 1], dv[k], dtheta[k], dt)
    return out


def worst(navs, truth):
    """Largest position (m), velocity (m/s) and attitude (deg) error of a run, norms."""
    position = [earth.difference_n(*a[:3], *b[:3]) for a, b in zip(navs[::50], truth[::50], strict=True)]
    turn = [rot.rotvec_from_quat(rot.quat_multiply(a[6:], rot.quat_conjugate(b[6:]))) for a, b in zip(navs[::50], truth[::50], strict=True)]
    norms = [np.linalg.norm(x, axis=1).max() for x in (position, navs[:, 3:6] - truth[:, 3:6], turn)]
    return norms[0], norms[1], math.degrees(norms[2])


@pytest.mark.parametrize(
    ("profile", "compensate", "metres", "mps", "deg"),
    [
        (gentle, False, 2e-3, 2e-4, 1e-5),
        (low_dynamics, False, 0.1, 2e-4, 1e-5),
        (high_dynamics, False, 0.1, 2e-4, 1e-5),
        (gentle, True, 3e-5, 1e-7, 1e-8),
        (low_dynamics, True, 1e-4, 3e-7, 1e-8),
        (high_dynamics, True, 4e-4, 3e-7, 1e-8),
    ],
)
def test_ten_minutes_with_an_ideal_imu(profile, compensate, metres, mps, deg):
    """The published claim is 0.5 mm, 2e-6 m/s, 5e-7 deg for its own flights; ours hold it with the compensation terms on."""
    dt, truth, dv, dtheta = flight(profile, 100)
    errors = worst(run(truth[0], dv, dtheta, dt, compensate), truth)
    assert errors[0] < metres
    assert errors[1] < mps
    assert errors[2] < deg


@pytest.mark.parametrize(("profile", "expected"), [(gentle, 1.00), (high_dynamics, 12.3)])
def test_the_literal_algorithm_is_of_first_order(profile, expected):
    """Its error at 100 Hz is known from an independent implementation; halving the step must halve it."""
    dt, truth, dv, dtheta = flight(profile, 100)
    error = worst(run_literal(truth[0], dv, dtheta, dt), truth)[0]
    assert error == pytest.approx(expected, rel=0.2)
    coarse = worst(run_literal(truth[0], dv[::2] + dv[1::2], dtheta[::2] + dtheta[1::2], 2 * dt), truth[::2])[0]
    assert coarse == pytest.approx(2 * error, rel=0.05)


@pytest.mark.parametrize("eulers_deg", [(0, 0, 0), (10, -5, 135)])
def test_still_for_an_hour(eulers_deg):
    dt, nav = 0.02, np.array([*START, 0.0, 0.0, 0.0, *rot.euler_to_quat(*np.radians(eulers_deg))])
    to_body = rot.euler_to_dcm(*np.radians(eulers_deg)).T
    dv = to_body @ np.array([0.0, 0.0, -earth.gravity(START[0], START[2])]) * dt
    dtheta = to_body @ (earth.EARTH_RATE * np.array([math.cos(START[0]), 0.0, -math.sin(START[0])])) * dt
    last = run(nav, np.tile(dv, (180_000, 1)), np.tile(dtheta, (180_000, 1)), dt, True)[-1]
    moved = earth.difference_n(*last[:3], *START)
    assert np.hypot(moved[0], moved[1]) < 1e-3
    assert abs(moved[2]) < 5e-3  # height is unstable: rounding grows as cosh(t sqrt(2g/R)), 270-fold in an hour
    np.testing.assert_allclose(last[6:], nav[6:], atol=1e-9)


def vibration_free_fall(dv, dtheta, dt, compensate):
    """End state with the given increments minus the end state of an undisturbed fall, so that gravity and earth drop out."""
    nav = np.array([*START, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    shaken = run(nav, dv, dtheta, dt, compensate)[-1]
    quiet = run(nav, np.zeros_like(dv), np.zeros_like(dtheta), dt, compensate)[-1]
    return shaken[3:6] - quiet[3:6], rot.rotvec_from_quat(rot.quat_multiply(shaken[6:], rot.quat_conjugate(quiet[6:])))


def test_coning_drift_is_the_closed_form():
    """Classical coning (half angle a, turning at w): q = [cos a/2, sin a/2 cos wt, sin a/2 sin wt, 0] after the start attitude.

    Over one interval the true non-commutative turn is (1 - sin(wt)/wt) sin(a)^2 w dt/2, of which the previous-increment term
    gives back sin(a)^2 sin(w dt/2)^2 sin(w dt)/3.
    """
    half_angle, dt, count = math.radians(1.0), 0.01, 1000
    turn = 2 * math.pi * 5.0 * dt
    phase = turn * np.arange(count + 1)
    dtheta = np.column_stack(
        (np.diff(np.cos(phase)) * math.sin(half_angle), np.diff(np.sin(phase)) * math.sin(half_angle), np.full(count, 0.0))
    )
    dtheta[:, 2] = -turn * (1 - math.cos(half_angle))
    true_turn = 0.5 * math.sin(half_angle) ** 2 * (turn - math.sin(turn))
    given_back = math.sin(half_angle) ** 2 * math.sin(turn / 2) ** 2 * math.sin(turn) / 3
    plain = vibration_free_fall(np.zeros((count, 3)), dtheta, dt, False)[1]
    corrected = vibration_free_fall(np.zeros((count, 3)), dtheta, dt, True)[1]
    assert plain[2] == pytest.approx(-count * true_turn, rel=0.01)
    assert corrected[2] == pytest.approx(-count * (true_turn - given_back), rel=0.05)
    assert abs(corrected[2]) < 0.03 * abs(plain[2])


def test_sculling_rectifies_as_the_bessel_function_says():
    """Roll a sin(wt) with lateral force A sin(wt) gives the mean downward acceleration A J1(a)."""
    angle, force, dt, count = 0.01, 10.0, 0.01, 100
    fine = np.arange(4 * count + 1) * dt / 4
    wave = 2 * math.pi * 5.0
    dtheta, dv = np.zeros((count, 3)), np.zeros((count, 3))
    dtheta[:, 0] = angle * np.diff(np.sin(wave * fine[::4]))
    dv[:, 1] = -force / wave * np.diff(np.cos(wave * fine[::4]))
    expected = force * j1(angle) * count * dt
    corrected = vibration_free_fall(dv, dtheta, dt, True)[0][2]
    plain = vibration_free_fall(dv, dtheta, dt, False)[0][2]
    assert corrected == pytest.approx(expected, rel=2e-3)
    assert abs(plain - expected) > 10 * abs(corrected - expected)


SMALL = st.floats(-1.0, 1.0)


@given(st.floats(-1.4, 1.4), st.tuples(*[SMALL] * 3), st.tuples(*[SMALL] * 3), st.tuples(*[SMALL] * 3), st.floats(0.002, 0.1))
def test_the_inverse_is_exact(lat, velocity_unit, force_unit, turn_unit, dt):
    """Manoeuvres up to 5 g and 3 rad/s, steps up to 0.1 s: increments through the step and back."""
    nav0 = np.array([lat, 0.5, 1000.0, *(200 * np.array(velocity_unit)), *rot.euler_to_quat(0.3, -0.2, 2.0)])
    dv, dtheta = 50 * np.array(force_unit) * dt, 3 * np.array(turn_unit) * dt
    prev = (0.9 * dv, 1.1 * dtheta)
    nav1 = nav0.copy()
    strapdown.strapdown_step(nav1, dv, dtheta, *prev, dt)
    solved = strapdown.increments_after(nav0, nav1, dt, *prev)
    np.testing.assert_allclose(solved[0], dv, atol=2e-12)
    np.testing.assert_allclose(solved[1], dtheta, atol=2e-12)
    trial, none = nav0.copy(), (np.zeros(3), np.zeros(3))
    strapdown.strapdown_step(trial, *strapdown.increments_after(nav0, nav1, dt, *none), *none, dt)
    np.testing.assert_allclose(trial[3:], nav1[3:], atol=2e-12)


@pytest.mark.parametrize("profile", [low_dynamics, high_dynamics])
def test_ideal_increments_are_what_newton_says_and_bring_the_flight_back(profile):
    dt, truth, dv, dtheta = flight(profile, 100)
    rows = slice(5500, 8500)  # the first turn of the low-dynamics flight
    truth, dv, dtheta = truth[rows], dv[5500:8499], dtheta[5500:8499]
    stamps = np.arange(3000) * 10_000_000
    force, rate = strapdown.ideal_increments(stamps, truth[:, 0], truth[:, 1], truth[:, 2], truth[:, 3:6], truth[:, 6:])
    np.testing.assert_array_equal(force[0], force[1])
    np.testing.assert_allclose(force[3:], dv[2:] / dt, atol=2e-5)
    np.testing.assert_allclose(rate[3:], dtheta[2:] / dt, atol=2e-7)
    errors = worst(run(truth[0], force[1:] * dt, rate[1:] * dt, dt, True), truth)
    assert errors[0] < 5e-4
    assert errors[1] < 1e-9
    assert errors[2] < 1e-9


def test_ideal_increments_refuse_repeated_stamps():
    still = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1))
    with pytest.raises(ValueError, match="strictly increasing"):
        strapdown.ideal_increments(np.array([5, 5]), *still)


def test_the_date_line_is_crossed_without_a_jump():
    nav = np.array([0.0, math.pi - 1e-7, 0.0, 0.0, 100.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    ahead = nav.copy()
    strapdown.strapdown_step(ahead, np.array([0.0, 0.0, -0.098]), np.zeros(3), np.zeros(3), np.zeros(3), 0.01)
    assert -math.pi < ahead[strapdown.LON] < -3.0
    assert earth.difference_n(*ahead[:3], *nav[:3])[1] == pytest.approx(1.0, abs=1e-6)


def test_uneven_stamps_come_back_too():
    truth = flight(high_dynamics, 100)[1][np.cumsum(np.tile([1, 2, 1, 3], 100))]
    stamps = np.cumsum(np.tile([1, 2, 1, 3], 100)) * 10_000_000
    force, rate = strapdown.ideal_increments(stamps, truth[:, 0], truth[:, 1], truth[:, 2], truth[:, 3:6], truth[:, 6:])
    nav, last = truth[0].copy(), np.zeros((2, 3))
    for k in range(1, len(stamps)):
        dt = (stamps[k] - stamps[k - 1]) * 1e-9
        strapdown.strapdown_step(nav, force[k] * dt, rate[k] * dt, last[0] * dt, last[1] * dt, dt)
        last = np.array([force[k], rate[k]])
    np.testing.assert_allclose(nav[3:], truth[-1, 3:], atol=1e-9)
    assert np.linalg.norm(earth.difference_n(*nav[:3], *truth[-1, :3])) < 5e-3
