"""Attitude from gyros alone: Euler angles or a quaternion carried by the body rates (Gebre-Egziabher 2004, section 4.7).

Angles are (roll, pitch, heading), rad, rates (p, q, r), rad/s, FRD.  Earth rate and transport rate are left out, as in the source: they
are a thousandth of the gyro errors meant here.  Euler rates are singular with the nose straight up or down; the quaternion is not.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import matvec
from lowcostnav_ros.physics.rotation import quat_from_rotvec, quat_multiply, quat_normalise, quat_to_euler


@kernel
def euler_rate_matrix(roll, pitch):
    """Matrix f (3, 3) with ``d(roll, pitch, heading)/dt = f (p, q, r)`` (equation 4.4); singular at a pitch of 90 degrees."""
    sr, cr = math.sin(roll), math.cos(roll)
    tp, cp = math.tan(pitch), math.cos(pitch)
    return np.array([[1.0, sr * tp, cr * tp], [0.0, cr, -sr], [0.0, sr / cp, cr / cp]])


@kernel
def body_rate_matrix(roll, pitch):
    """Matrix (3, 3) with ``(p, q, r) = matrix d(roll, pitch, heading)/dt``: the inverse of :func:`euler_rate_matrix`, never singular."""
    sr, cr = math.sin(roll), math.cos(roll)
    sp, cp = math.sin(pitch), math.cos(pitch)
    return np.array([[1.0, 0.0, -sp], [0.0, cr, sr * cp], [0.0, -sr, cr * cp]])


@kernel
def euler_step(angles, rates, dt):
    """Euler angles (3,) after ``dt`` seconds of constant body rates (3,), rad/s: two-stage Runge-Kutta, heading not wrapped."""
    middle = angles + 0.5 * dt * matvec(euler_rate_matrix(angles[0], angles[1]), rates)
    return angles + dt * matvec(euler_rate_matrix(middle[0], middle[1]), rates)


@kernel
def quaternion_step(q_nb, rates, dt):
    """Unit quaternion (4,) after ``dt`` seconds of constant body rates (3,), rad/s: the exact solution of equation 4.5."""
    return quat_normalise(quat_multiply(q_nb, quat_from_rotvec(rates * dt)))


@kernel
def coast_quaternion(q_nb, rates, dt):
    """Euler angles (roll, pitch, heading) along a record of rates (n, 3), carried as a quaternion from ``q_nb`` (4,): shape (n, 3)."""
    out = np.empty_like(rates)
    now = q_nb.copy()
    for k in range(rates.shape[0]):
        now = quaternion_step(now, rates[k], dt)
        out[k, 0], out[k, 1], out[k, 2] = quat_to_euler(now)
    return out
