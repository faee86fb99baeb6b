"""Velocity over ground from airspeed, airflow angles, attitude and wind, with ten corrections, and its derivatives (Eggers 1995).

    V = (I + Z) C(psi, theta + dtheta, phi + dphi) u [S (V_C - V_0) + B + V_0] + W,     u = (1, v_y / v_x, v_z / v_x),  Z = [zeta x]

Corrections y (12,): zeta north, east, down [rad], pitch, bank [rad], airspeed scale S [-] and bias B about V_0, wind north, east, down,
and what adds to the incidence and the sideslip where no vane measures them [rad].  Speeds in any one unit.  There is no heading correction:
it is zeta about the vertical.  The derivatives by pitch and bank leave Z out, second order (sections 7.1 and 7.3.4).
"""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import turned
from lowcostnav_ros.cores.reckoning_model import step_matrices
from lowcostnav_ros.estimation.kalman import lead
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.physics.rotation import euler_to_dcm, quat_from_rotvec, quat_to_dcm

ZETA, PITCH, BANK, SCALE, BIAS, WIND, INCIDENCE, SLIP, COUNT = 0, 3, 4, 5, 6, 7, 10, 11, 12


@kernel
def ground_velocity(euler, air_b, y, reference, exact):
    """Velocity over ground (3,) and its derivative (3, 12) by the corrections.

    Parameters
    ----------
    euler : ndarray, shape (3,)
        Roll, pitch and true heading as read, rad.
    air_b : ndarray, shape (3,)
        Air-relative velocity as measured, FRD; its forward component is what the tube shows.
    y : ndarray, shape (12,)
    reference : float
        V_0.
    exact : bool
        Rotate by zeta instead of I + Z, for headings that are off by degrees.
    """
    roll, pitch = euler[0] + y[BANK], euler[1] + y[PITCH]
    C = euler_to_dcm(roll, pitch, euler[2])
    forward = air_b[0]
    u = np.array([1.0, air_b[1] / forward + y[SLIP], air_b[2] / forward + y[INCIDENCE]])
    speed = y[SCALE] * (forward - reference) + y[BIAS] + reference
    zeta = y[ZETA : ZETA + 3].copy()
    T = np.eye(3)
    if exact:
        T = quat_to_dcm(quat_from_rotvec(zeta))
    else:
        T[0, 1], T[0, 2], T[1, 2] = -zeta[2], zeta[1], -zeta[0]
        T[1, 0], T[2, 0], T[2, 1] = zeta[2], -zeta[1], zeta[0]
    H = np.zeros((3, COUNT))
    g, ahead = np.zeros(3), np.zeros(3)
    for i in range(3):
        g[i] = C[i, 0] * u[0] + C[i, 1] * u[1] + C[i, 2] * u[2]
    for i in range(3):
        ahead[i] = T[i, 0] * g[0] + T[i, 1] * g[1] + T[i, 2] * g[2]
        for k, column in ((INCIDENCE, 2), (SLIP, 1)):
            H[i, k] = (T[i, 0] * C[0, column] + T[i, 1] * C[1, column] + T[i, 2] * C[2, column]) * speed
        H[i, SCALE], H[i, BIAS], H[i, WIND + i] = ahead[i] * (forward - reference), ahead[i], 1.0
        H[i, BANK] = (C[i, 2] * u[1] - C[i, 1] * u[2]) * speed  # a turn about the nose: C [x x] u
    arm = ahead if exact else g  # zeta x g and the turn of what is rotated already
    H[0, ZETA + 1], H[0, ZETA + 2] = arm[2] * speed, -arm[1] * speed
    H[1, ZETA], H[1, ZETA + 2] = -arm[2] * speed, arm[0] * speed
    H[2, ZETA], H[2, ZETA + 1] = arm[1] * speed, -arm[0] * speed
    c, s = np.cos(euler[2]), np.sin(euler[2])  # a turn about the horizontal axis (-s, c, 0)
    H[0, PITCH], H[1, PITCH], H[2, PITCH] = c * g[2] * speed, s * g[2] * speed, -(c * g[0] + s * g[1]) * speed
    velocity = np.zeros(3)
    for i in range(3):
        velocity[i] = ahead[i] * speed + y[WIND + i]
    return velocity, H


@kernel
def summed(estimate, column):
    """Corrections (12,) of the states: each adds to the one that ``column`` (n,) names, -1 to none; the scale is one at rest."""
    y = np.zeros(COUNT)
    y[SCALE] = 1.0
    for i in range(estimate.shape[0]):
        if column[i] >= 0:
            y[column[i]] += estimate[i]
    return y


@kernel
def spread(H, column):
    """Derivative (3, n) by the states of one (3, 12) by the corrections."""
    out = np.zeros((3, column.shape[0]))
    for i in range(column.shape[0]):
        if column[i] >= 0:
            for r in range(3):
                out[r, i] = H[r, column[i]]
    return out


@kernel
def move(nav, estimate, column, rate, euler, air_b, reference, airborne, dt, sums):
    """Move position and the means of decaying states over ``dt``, in place; gather ``sums`` (4, 12): derivatives times dt, and dt."""
    if airborne:
        velocity, H = ground_velocity(euler, air_b, summed(estimate, column), reference, True)
        nav[0], nav[1], nav[2] = displace(nav[0], nav[1], nav[2], velocity * dt)
        sums[0:3] += H * dt
    sums[3, 0] += dt
    for i in range(3, estimate.shape[0]):
        if rate[i] > 0.0:
            estimate[i] *= np.exp(-rate[i] * dt)


@kernel
def carry(P, sums, column, rate, psd, track):
    """Carry P (n, n) over what ``sums`` holds and clear it: coupling at its mean, every state its own process (exact otherwise).

    ``sums[3, 1:4]`` is the variance that white noise adds to the position, m^2; ``track``: see :func:`.kalman.lead`.
    """
    dt = sums[3, 0]
    if dt <= 0.0:
        return
    Phi, Qd = step_matrices(spread(sums[0:3] / dt, column), rate, psd, dt)
    lead(track, Phi)
    for i in range(3):
        Qd[i, i] += sums[3, 1 + i]
    moved = turned(Phi, P) + Qd
    for i in range(P.shape[0]):
        for j in range(i + 1):
            P[i, j] = 0.5 * (moved[i, j] + moved[j, i])
            P[j, i] = P[i, j]
    sums[:] = 0.0
