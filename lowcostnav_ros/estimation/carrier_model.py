"""Code and carrier of transmitters at a navigation state, compiled: predicted ranges with their Jacobian, and row by row updates.

With p the antenna and e the unit vector from it to the transmitter, in n, and in metres throughout (a carrier times its wavelength),

    code:    y = code - (r + T (1 + s) + clock),              H = [-e | 0 | e x L | 1 on the clock | T on s]
    carrier: y = wavelength (phase - N) - (r + T (1 + s) + clock),    the same and wavelength on N

with L = C l the lever arm (Kawecki 2015, equations (3.8) to (3.11) in consistent units; checked against differences in the tests).
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import matvec, weighted
from lowcostnav_ros.estimation.kalman import SHARPEST
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef


@kernel
def transmitter_model(lat, lon, height, lever_n, pos_e, n, attitude):
    """Predict ranges to transmitters.

    Parameters
    ----------
    lat, lon, height : float
        Of the IMU, rad, rad, m.
    lever_n : ndarray (3,)
        Antenna relative to it, m.
    pos_e : ndarray (m, 3)
        Transmitters, ECEF, m.
    n, attitude : int
        Number of states, and the first of the attitude; negative: there are none.

    Returns
    -------
    ranges : ndarray (m,)
    H : ndarray (m, n)
        Position and attitude columns.
    """
    m = pos_e.shape[0]
    C, place_e = dcm_ne(lat, lon), geodetic_to_ecef(lat, lon, height)
    ranges, H = np.empty(m), np.zeros((m, n))
    for k in range(m):
        e = matvec(C, pos_e[k] - place_e) - lever_n
        rho = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
        ranges[k] = rho
        for j in range(3):
            H[k, j] = -e[j] / rho
        if attitude >= 0:
            for j in range(3):
                i1, i2 = (j + 1) % 3, (j + 2) % 3
                H[k, attitude + j] = (e[i1] * lever_n[i2] - e[i2] * lever_n[i1]) / rho
    return ranges, H


@kernel
def row_variances(P, H, r):
    """Innovation variance h P h' + r of each row alone, (m,)."""
    out, Ph = r.copy(), np.empty(P.shape[0])
    for k in range(H.shape[0]):
        out[k] += weighted(P, H[k], Ph)
    return out


@kernel
def screened_update(P, y, H, r, order, threshold):
    """Fuse rows of independent noise in the given order, each only if it passes the gate against what the rows before it have taught.

    Parameters
    ----------
    P : ndarray (n, n)
        Updated in place.
    y, r : ndarray (m,)
        Innovations before all of them, and variances.
    H : ndarray (m, n)
    order : ndarray of int (m,)
        Rows that agree best come first, so that a bad one is judged by good ones.
    threshold : float
        Of the normalised innovation squared.

    Returns
    -------
    dx : ndarray (n,)
    used : ndarray of bool (m,)
    """
    n = P.shape[0]
    dx, used, Ph = np.zeros(n), np.zeros(y.shape[0], dtype=np.bool_), np.empty(n)
    for k in order:
        s = weighted(P, H[k], Ph)
        s += max(r[k], SHARPEST * s)
        residual = y[k]
        for i in range(n):
            residual -= H[k, i] * dx[i]
        if not residual * residual <= threshold * s:
            continue
        used[k] = True
        for i in range(n):
            gain = Ph[i] / s
            dx[i] += gain * residual
            for j in range(i + 1):
                P[i, j] -= gain * Ph[j]
                P[j, i] = P[i, j]
    return dx, used


@kernel
def factored(P):
    """U (n, n) unit upper triangular and D (n,) with P = U D U'."""
    n = P.shape[0]
    U, D, work = np.eye(n), np.zeros(n), P.copy()
    for j in range(n - 1, -1, -1):
        D[j] = max(work[j, j], 0.0)
        if D[j] <= 0.0:
            continue
        for i in range(j):
            U[i, j] = work[i, j] / D[j]
        for i in range(j):
            for k in range(i, j):
                work[i, k] -= U[i, j] * D[j] * U[k, j]
    return U, D


@kernel
def recomposed(U, D, P):
    """U D U' into P, symmetric by construction."""
    n = D.shape[0]
    for i in range(n):
        for j in range(i, n):
            total = 0.0
            for k in range(j, n):
                total += U[i, k] * D[k] * U[j, k]
            P[i, j] = total
            P[j, i] = total


@kernel
def screened_update_ud(P, y, H, r, order, threshold):
    """As :func:`screened_update`, on the factors P = U D U' (Bierman 1977): factored once, then a scalar update for each row."""
    n = P.shape[0]
    U, D = factored(P)
    dx, used = np.zeros(n), np.zeros(y.shape[0], dtype=np.bool_)
    f, g, K = np.empty(n), np.empty(n), np.empty(n)
    for k in order:
        s, residual = 0.0, y[k]
        for j in range(n):
            f[j] = H[k, j]
            for i in range(j):
                f[j] += U[i, j] * H[k, i]
            g[j] = D[j] * f[j]
            s += f[j] * g[j]
            residual -= H[k, j] * dx[j]
        noise = max(r[k], SHARPEST * s)
        if not residual * residual <= threshold * (s + noise):
            continue
        used[k] = True
        before = noise
        for j in range(n):
            after = before + f[j] * g[j]
            D[j] *= before / after
            K[j] = g[j]
            share = -f[j] / before
            for i in range(j):
                old = U[i, j]
                U[i, j] = old + share * K[i]
                K[i] += g[j] * old
            before = after
        for i in range(n):
            dx[i] += K[i] / before * residual
    recomposed(U, D, P)
    return dx, used


@kernel
def renewed(P, row, index, variance):
    """Let the error of state ``index`` be ``row`` (n,) times the errors of the others plus white noise, in place."""
    n = P.shape[0]
    Ph = np.empty(n)
    total = weighted(P, row, Ph)
    for i in range(n):
        P[i, index] = Ph[i]
        P[index, i] = Ph[i]
    P[index, index] = total + variance
