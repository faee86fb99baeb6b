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
from lowcostnav_ros.radionav.troposphere import path_delays


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
def predicted_codes(nav, lever_n, pos_e, estimate, model, air, clock, scale, attitude):
    """Predict codes: ranges with troposphere and clock, and what the states do to them.

    Parameters
    ----------
    nav : ndarray (10,)
    lever_n, pos_e, attitude
        As of :func:`transmitter_model`.
    estimate : ndarray (n,)
    model, air
        Of the troposphere, as of :func:`.path_delays`.
    clock, scale : int
        States: the clock's error, m, and the factor on the delays; the latter negative where there is none.

    Returns
    -------
    ranges, codes : ndarray (m,)
        Straight, and with all that is added, m.
    H : ndarray (m, n)
    delays : ndarray (m,)
        Modelled, m.
    """
    ranges, H = transmitter_model(nav[0], nav[1], nav[2], lever_n, pos_e, estimate.shape[0], attitude)
    delays = path_delays(model, air, nav[2] - lever_n[2], ranges)
    factor = 1.0 + estimate[scale] if scale >= 0 else 1.0
    for k in range(ranges.shape[0]):
        H[k, clock] = 1.0
        if scale >= 0:
            H[k, scale] = delays[k]
    return ranges, ranges + factor * delays + estimate[clock], H, delays


@kernel
def rows_of(predicted, jacobian, estimate, signals, channel, state, slow, known, counts, codes_always, noise):
    """Rows of an epoch to be fused: codes, then carriers that have an ambiguity.

    Parameters
    ----------
    predicted, jacobian : ndarray (m,), (m, n)
        Of the codes, m.
    estimate : ndarray (n,)
    signals : tuple of ndarray (m,)
        Codes, m, carriers, cycles, wavelengths, m, and which codes and which carriers are valid.
    channel, state : ndarray of int (m,)
        Number of each transmitter in the arrays of ``known``, and the state of its ambiguity, negative for none.
    slow : int
        What leads from that state to the one of the slow error; 0: there is none.
    known : tuple of ndarray
        Of all channels: whether they are excluded, their carrier is lost, has ever begun, and how many codes are still used beside it.
    counts, codes_always : bool
        Whether carriers are used at all, and codes beside carriers.
    noise : (float, float)
        Variances of code and carrier, m^2.

    Returns
    -------
    y_code, y_carrier : ndarray (m,)
        Residuals; NaN of carriers that are not used.
    with_code, counting : ndarray of bool (m,)
        Which are used.
    y, H, r : ndarray (k,), (k, n), (k,)
    codes : int
        How many of the rows are codes.
    is_finite : bool
    """
    code, cycles, wave, has_code, has_carrier = signals
    excluded, lost, begun, budget = known
    m, n = jacobian.shape
    y_code, y_carrier = code - predicted, np.full(m, np.nan)
    with_code, counting = np.zeros(m, dtype=np.bool_), np.zeros(m, dtype=np.bool_)
    for k in range(m):
        c = channel[k]
        beside = not has_carrier[k] or (codes_always and (budget[c] != 0 or not begun[c]))
        with_code[k] = has_code[k] and not excluded[c] and beside
        counting[k] = has_carrier[k] and not lost[c] and state[k] >= 0 and not excluded[c] and counts
    codes, rows = np.count_nonzero(with_code), np.count_nonzero(with_code) + np.count_nonzero(counting)
    y, H, r = np.empty(rows), np.empty((rows, n)), np.empty(rows)
    i, j = 0, codes
    for k in range(m):
        if with_code[k]:
            y[i], H[i], r[i] = y_code[k], jacobian[k], noise[0]
            i += 1
        if counting[k]:
            y_carrier[k] = wave[k] * (cycles[k] - estimate[state[k]]) - predicted[k]
            H[j], r[j] = jacobian[k], noise[1]
            H[j, state[k]] = wave[k]
            if slow:
                H[j, state[k] + slow] = 1.0
                y_carrier[k] -= estimate[state[k] + slow]
            y[j] = y_carrier[k]
            j += 1
    return y_code, y_carrier, with_code, counting, y, H, r, codes, np.isfinite(y.sum())


@kernel
def ranked(P, y, H, r, threshold):
    """Test each row alone: their order, those that agree best first, and number, mean innovation, mean variance and lower median of the
    normalised squares over a threshold, (4,).
    """
    S = row_variances(P, H, r)
    ratios = y * y / (S * threshold)
    order = np.argsort(ratios, kind="mergesort")
    return order, np.array([float(y.shape[0]), y.mean(), S.mean(), ratios[order[(order.shape[0] - 1) // 2]]])


@kernel
def fused(P, y, H, r, order, threshold, by_factors):
    """Fuse rows by :func:`screened_update`, or on the factors; P stays where the result would not be finite.

    Returns
    -------
    dx : ndarray (n,)
    used : ndarray of bool (m,)
    is_finite : bool
    """
    after = P.copy()
    dx, used = screened_update_ud(after, y, H, r, order, threshold) if by_factors else screened_update(after, y, H, r, order, threshold)
    is_finite = np.isfinite(dx.sum() + after.sum())
    if is_finite:
        P[:] = after
    return dx, used, is_finite


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
