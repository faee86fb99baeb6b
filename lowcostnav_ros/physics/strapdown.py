"""Strapdown: inertial increments to position, velocity and attitude in the local level frame, and exactly back.

A navigation state is one array ``nav`` of shape (10,): latitude, longitude (rad), height (m), velocity NED (m/s), ``q_nb``.

The step is of second order: every navigation-frame quantity (earth and transport rate, gravity, Coriolis, radii) is taken at the
middle of the interval.  The middle is predicted from the state and the increments of this very interval, never remembered from
the one before, so that a filter correction between two steps leaves nothing stale.  Rotation of the body and of the navigation
frame multiply the attitude from the right and from the left, which is exact for constant rates.  Coning and sculling within the
interval use the previous increments, assuming the rates vary linearly over the two.  Like every mechanisation that points north
it is singular at the poles; keep 10 km away.

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: section 3.3, equations (3-25) to (3-36).
Savage (1998), Strapdown inertial navigation integration algorithm design, J. Guidance 21(1, 2): the 1/12 terms.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics.earth import EARTH_RATE, earth_rate_n, gravity, radii, transport_rate_n
from lowcostnav_ros.physics.rotation import (
    product,
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    quat_normalise,
    quat_rotate,
    rotated,
    rotvec_from_quat,
    turn_of,
    wrap,
)

LAT, LON, HEIGHT = 0, 1, 2
VEL = slice(3, 6)
Q = slice(6, 10)

_SOLVED = 1.0e-12  # m/s and rad; a few units in the last place of 100 m/s
_MAX_ITERATIONS = 25


@kernel
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _scaled(factor, a):
    return factor * a[0], factor * a[1], factor * a[2]


@kernel
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def _velocity_increment_b(dv, dtheta, dv_prev, dtheta_prev):
    """Specific-force increment referred to the body axes at the start of the interval: rotation compensation and sculling."""
    angle2 = dtheta[0] ** 2 + dtheta[1] ** 2 + dtheta[2] ** 2
    once = _cross(dtheta, dv)
    x, y, z = _sum(_cross(dtheta_prev, dv), _cross(dv_prev, dtheta))
    turned = _sum(dv, _scaled(0.5 - angle2 / 24.0, once))
    return _sum(_sum(turned, _scaled(1.0 / 6.0 - angle2 / 120.0, _cross(dtheta, once))), (x / 12.0, y / 12.0, z / 12.0))


@kernel
def _frame_rates(lat, height, vel):
    """Rate of e relative to i, of n relative to e (n axes, rad/s), and acceleration over ground without specific force, m/s^2.

    The last is gravity - (2 omega_ie + omega_en) x v.
    """
    meridian, normal = radii(lat)
    earth = EARTH_RATE * math.cos(lat), 0.0, -EARTH_RATE * math.sin(lat)
    east = vel[1] / (normal + height)
    transport = east, -vel[0] / (meridian + height), -east * math.tan(lat)
    x, y, z = _cross(_sum(_scaled(2.0, earth), transport), vel)
    return earth, transport, (-x, -y, -z + gravity(lat, height))


@kernel
def strapdown_step(nav, dv, dtheta, dv_prev, dtheta_prev, dt):
    """Advance ``nav`` in place over one interval.

    Vectors are arrays or tuples of three; inside they are tuples, which cost no memory.

    Parameters
    ----------
    nav : ndarray, shape (10,)
        State at the start, overwritten with the state at the end.
    dv, dtheta : ndarray, shape (3,)
        Integral of specific force (m/s) and angular rate relative to i (rad) over the interval, body axes.
    dv_prev, dtheta_prev : ndarray, shape (3,)
        The same of the preceding interval, rescaled to ``dt`` where its length differed; zeros switch coning and sculling
        compensation off.
    dt : float
        Length of the interval, s.
    """
    vel, q = (nav[3], nav[4], nav[5]), (nav[6], nav[7], nav[8], nav[9])
    dv_n = rotated(q, _velocity_increment_b(dv, dtheta, dv_prev, dtheta_prev))
    # the middle of the interval
    meridian, _ = radii(nav[LAT])
    lat = nav[LAT] + 0.5 * dt * vel[0] / (meridian + nav[HEIGHT])
    height = nav[HEIGHT] - 0.5 * dt * vel[2]
    _, _, start = _frame_rates(lat, height, vel)
    vel_mid = _sum(vel, _scaled(0.5, _sum(dv_n, _scaled(dt, start))))
    earth, transport, acceleration = _frame_rates(lat, height, vel_mid)
    omega_in = _sum(earth, transport)
    # the level frame turns under the increment by half on average
    x, y, z = _scaled(0.5 * dt, _cross(omega_in, dv_n))
    end = _sum(vel, _sum((dv_n[0] - x, dv_n[1] - y, dv_n[2] - z), _scaled(dt, acceleration)))
    mean_vel = _scaled(0.5, _sum(vel, end))
    meridian, normal = radii(lat)
    nav[LAT] += mean_vel[0] * dt / (meridian + height)
    nav[LON] = wrap(nav[LON] + mean_vel[1] * dt / ((normal + height) * math.cos(lat)))
    nav[HEIGHT] -= mean_vel[2] * dt
    x, y, z = _cross(dtheta_prev, dtheta)
    body_turn = turn_of(_sum(dtheta, (x / 12.0, y / 12.0, z / 12.0)))
    q = product(turn_of(_scaled(-dt, omega_in)), product(q, body_turn))
    size = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for k in range(3):
        nav[3 + k] = end[k]
    for k in range(4):
        nav[6 + k] = q[k] / size


@kernel
def literal_step(nav, dv, dtheta, dt):
    """Advance ``nav`` in place by the printed first-order algorithm, every n-frame quantity at the start of the interval.

    Kept to show what the mid-interval quantities of :func:`strapdown_step` are worth: about 1 m in ten minutes of gentle
    flight at 100 Hz, 12 m in turns (Solimeno, section 3.3).
    """
    lat, height, vel = nav[LAT], nav[HEIGHT], nav[3:6].copy()
    omega_in = earth_rate_n(lat) + transport_rate_n(lat, height, vel)
    dtheta_nb = dtheta - dt * quat_rotate(quat_conjugate(nav[6:10]), omega_in)
    nav[6:10] = quat_normalise(quat_multiply(nav[6:10], quat_from_rotvec(dtheta_nb)))
    dv_n = rotated(nav[6:10], _sum(dv, _scaled(-0.5, _cross(dtheta_nb, dv))))
    _, _, acceleration = _frame_rates(lat, height, vel)
    for k in range(3):
        nav[3 + k] += dv_n[k] + acceleration[k] * dt
    meridian, normal = radii(lat)
    mean_vel = 0.5 * (vel + nav[3:6])
    nav[LAT] += mean_vel[0] * dt / (meridian + height)
    nav[LON] = wrap(nav[LON] + mean_vel[1] * dt / ((normal + height) * math.cos(lat)))
    nav[HEIGHT] -= mean_vel[2] * dt


@kernel
def increments_after(nav0, nav1, dt, dv_prev, dtheta_prev):
    """Increments (dv, dtheta) that make :func:`strapdown_step` take ``nav0`` to ``nav1`` after the given previous increments.

    Velocity and attitude of ``nav1`` are met to 1e-12 m/s and rad by shooting with the step itself; position follows from
    velocity and is not imposed (six increments cannot meet nine numbers).
    """
    dtheta = rotvec_from_quat(quat_multiply(quat_conjugate(nav0[6:10]), nav1[6:10]))
    dv = np.zeros(3)
    for _ in range(_MAX_ITERATIONS):
        trial = nav0.copy()
        strapdown_step(trial, dv, dtheta, dv_prev, dtheta_prev, dt)
        back = quat_conjugate(trial[6:10])
        missing_v = quat_rotate(back, nav1[3:6] - trial[3:6])
        missing_turn = rotvec_from_quat(quat_multiply(back, nav1[6:10]))
        dv += missing_v
        dtheta += missing_turn
        if max(np.abs(missing_v).max(), np.abs(missing_turn).max()) < _SOLVED:
            break
    return dv, dtheta


@kernel
def _ideal_rows(dt, navs):
    count = navs.shape[0]
    force, rate = np.zeros((count, 3)), np.zeros((count, 3))
    for k in range(1, count):  # row 0 is still zero when row 1 is solved: nothing precedes the first interval
        dv, dtheta = increments_after(navs[k - 1], navs[k], dt[k], force[k - 1] * dt[k], rate[k - 1] * dt[k])
        force[k] = dv / dt[k]
        rate[k] = dtheta / dt[k]
    if count > 1:
        force[0], rate[0] = force[1], rate[1]
    return force, rate


def ideal_increments(
    stamps_ns: np.ndarray, lat: np.ndarray, lon: np.ndarray, height: np.ndarray, vel_n: np.ndarray, q_nb: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What an ideal integrating IMU measures along a true trajectory: the inverse of the step, row by row.

    Feeding the result to :func:`strapdown_step` (first step with zero previous increments) gives velocity and attitude back
    to rounding, whatever made the trajectory, at even or uneven stamps.

    Parameters
    ----------
    stamps_ns : ndarray of int64, shape (n,)
        Strictly increasing.
    lat, lon, height : ndarray, shape (n,)
        Rad, rad, m above the ellipsoid.
    vel_n : ndarray, shape (n, 3)
        m/s, NED.
    q_nb : ndarray, shape (n, 4)

    Returns
    -------
    specific_force_b, angular_rate_b : ndarray, shape (n, 3)
        Mean over the interval that ends at each stamp, m/s^2 and rad/s; row 0, which has no interval, repeats row 1.

    Raises
    ------
    ValueError
        For fewer than two rows or stamps that do not increase.
    """
    stamps_ns = np.asarray(stamps_ns, np.int64)
    if len(stamps_ns) < 2 or np.any(np.diff(stamps_ns) <= 0):
        raise ValueError("Ideal increments need at least two rows with strictly increasing stamps; sort and drop duplicates first.")
    dt = np.concatenate(([0.0], np.diff(stamps_ns) * 1.0e-9))
    navs = np.column_stack((lat, lon, height, vel_n, q_nb)).astype(float)
    return _ideal_rows(dt, navs)
