"""Attitude from vectors known in n and measured in b: levelling, vector matching, and the acceleration that GPS velocity shows.

Two vectors that are not parallel (specific force and magnetic field) fix the attitude.  With ``C_true = C_est (I + 2 [e x])`` and
``e`` the vector part of the error quaternion, each vector gives ``u_n - C_est u_b = -2 C_est [u_b x] e``; iterated least squares solve
Wahba's problem (Gebre-Egziabher 2004, sections 4.8 and 4.9, equations 4.17 to 4.31 as corrected there by the frame of the Jacobian).
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import matvec
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import (
    euler_to_quat,
    quat_conjugate,
    quat_multiply,
    quat_normalise,
    quat_rotate,
    quat_to_euler,
    skew,
    wrap,
)

RIGHT, LEFT, LITERAL = 0, 1, 2
"""Forms of the iteration: Jacobian and correction both in b, both in n, or (as printed, and wrong) Jacobian in n, correction in b."""


@kernel
def level_angles(specific_force_b):
    """Roll and pitch, rad, that unaccelerated flight would need for a specific force (3,), m/s^2 or any unit, f = a - g.

    ``roll = atan2(-f_y, -f_z)``, ``pitch = atan2(f_x, hypot(f_y, f_z))``; equations 4.8 and 4.9 with the sign of an accelerometer that
    reads -g at rest.  In a coordinated turn the answer is zero bank.
    """
    fx, fy, fz = specific_force_b[0], specific_force_b[1], specific_force_b[2]
    return math.atan2(-fy, -fz), math.atan2(fx, math.hypot(fy, fz))


@kernel
def solve3(A, b):
    """Solution (3,) of a symmetric (3, 3) system by Cramer's rule; zeros where it is singular (parallel vectors)."""
    c00 = A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1]
    c01 = A[1, 2] * A[2, 0] - A[1, 0] * A[2, 2]
    c02 = A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0]
    determinant = A[0, 0] * c00 + A[0, 1] * c01 + A[0, 2] * c02
    out = np.zeros(3)
    scale = A[0, 0] + A[1, 1] + A[2, 2]
    if abs(determinant) <= 1e-14 * scale * scale * scale:
        return out
    c11 = A[0, 0] * A[2, 2] - A[0, 2] * A[2, 0]
    c12 = A[0, 1] * A[2, 0] - A[0, 0] * A[2, 1]
    c22 = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    out[0] = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / determinant
    out[1] = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / determinant
    out[2] = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / determinant
    return out


@kernel
def _add_normal(A, b, u, z):
    """Add H'H and H'z of one vector with H = -2 [u x]: 4 ([u]^2 I - u u') and 2 [u x] z."""
    square = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
    for i in range(3):
        A[i, i] += 4.0 * square
        for j in range(3):
            A[i, j] -= 4.0 * u[i] * u[j]
    b[0] += 2.0 * (u[1] * z[2] - u[2] * z[1])
    b[1] += 2.0 * (u[2] * z[0] - u[0] * z[2])
    b[2] += 2.0 * (u[0] * z[1] - u[1] * z[0])


@kernel
def match_step(q_nb, field_n, force_n, field_b, force_b, alpha, form):
    """One step of vector matching.

    Parameters
    ----------
    q_nb : ndarray, shape (4,)
        Estimate before the step.
    field_n, force_n, field_b, force_b : ndarray, shape (3,)
        The two vectors known in n and measured in b; scaled to like size, since they weigh by their squares.
    alpha : float
        Share of the least-squares correction applied, 0 to 2.
    form : int
        :data:`RIGHT`, :data:`LEFT` or :data:`LITERAL`.

    Returns
    -------
    ndarray, shape (4,)
    """
    A, b = np.zeros((3, 3)), np.zeros(3)
    back = quat_conjugate(q_nb)
    for k in range(2):
        u_n = field_n if k == 0 else force_n
        u_b = field_b if k == 0 else force_b
        z_n = u_n - quat_rotate(q_nb, u_b)
        if form == 0:  # C'C = I, so the Jacobian may be taken with the residual turned to b
            _add_normal(A, b, u_b, quat_rotate(back, z_n))
        elif form == 1:
            _add_normal(A, b, u_n - z_n, z_n)
        else:
            _add_normal(A, b, u_n, z_n)
    e = alpha * solve3(A, b)
    turn = np.array([1.0, e[0], e[1], e[2]])
    return quat_normalise(quat_multiply(turn, q_nb) if form == 1 else quat_multiply(q_nb, turn))


@kernel
def match_vectors(q_nb, field_n, force_n, field_b, force_b, alpha, iterations, form):
    """Attitude (4,) after a number of steps of :func:`match_step` from ``q_nb``."""
    q = q_nb.copy()
    for _ in range(iterations):
        q = match_step(q, field_n, force_n, field_b, force_b, alpha, form)
    return q


@kernel
def match_history(q_nb, field_n, force_n, field_b, force_b, alpha, iterations, form):
    """Attitudes (iterations + 1, 4) from the start ``q_nb`` on."""
    out = np.empty((iterations + 1, 4))
    out[0] = q_nb
    for k in range(iterations):
        out[k + 1] = match_step(out[k], field_n, force_n, field_b, force_b, alpha, form)
    return out


@kernel
def match_many(eulers, field_n, force_n, field_noise, force_noise, alpha, iterations, form):
    """Errors (n, 3) in roll, pitch, heading, rad, of vector matching from level north at many true attitudes.

    Parameters
    ----------
    eulers : ndarray, shape (n, 3)
        True roll, pitch, heading, rad.
    field_n, force_n : ndarray, shape (3,)
    field_noise, force_noise : ndarray, shape (n, 3)
        Added to the vectors seen in b.
    alpha, iterations, form
        As :func:`match_step`.
    """
    out = np.empty_like(eulers)
    start = np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(eulers.shape[0]):
        back = quat_conjugate(euler_to_quat(eulers[k, 0], eulers[k, 1], eulers[k, 2]))
        field_b = quat_rotate(back, field_n) + field_noise[k]
        force_b = quat_rotate(back, force_n) + force_noise[k]
        found = quat_to_euler(match_vectors(start, field_n, force_n, field_b, force_b, alpha, iterations, form))
        for i in range(3):
            out[k, i] = wrap(found[i] - eulers[k, i])
    return out


@kernel
def specific_force_from_velocity(vel_before_n, vel_after_n, span_s):
    """Mean specific force in n (3,), m/s^2, over ``span_s`` seconds between two GPS velocities (3,), m/s: ``dv/dt - g``.

    It belongs to the middle of the span; compare it with accelerometers averaged over the same span, not with the last sample.
    """
    force_n = (vel_after_n - vel_before_n) / span_s
    force_n[2] -= STANDARD_GRAVITY
    return force_n


@kernel
def matching_rows(C_nb, u_n, u_b):
    """Innovation (3,) and Jacobian (3, 3) on ``phi_n`` of one vector: ``y = u_n - C u_b``, ``H = -[(C u_b) x]`` (equation 4.60)."""
    seen_n = matvec(C_nb, u_b)
    return u_n - seen_n, -skew(seen_n)
