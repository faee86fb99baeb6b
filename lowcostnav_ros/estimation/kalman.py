"""Kalman algebra: a short module that knows no physics.

Discretisation (Van Loan, or the second-order series and trapezoid that suit short steps), covariance prediction, sequential
scalar measurement updates in Joseph form, a guard on the covariance, and the steady-state gain.
The error state is zero before every update, so an update returns the correction to inject and the new covariance.
"""

from typing import Any

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import cholesky, matmul, turned, weighted

SHARPEST = 1e-12
"""A measurement counts for no better than this share of the variance it meets: what is finer is lost to round-off."""
PIVOT = 1e-13
"""Share of a variance below which what is left of it, once other components are known, is round-off."""
NO_TRACK = np.zeros((0, 0))
"""Where no product of transitions is wanted (:func:`lead`)."""


def van_loan(F: np.ndarray, GQG: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact transition and process noise of a linear time-invariant model over one step.

    As filterpy's van_loan_discretization, which studies use, but from the density of the noise, and without the 44 MB that filterpy's
    imports cost a node.

    Parameters
    ----------
    F : ndarray, shape (n, n)
        Continuous dynamics.
    GQG : ndarray, shape (n, n)
        Power spectral density of the driving noise, already mapped to the states (G Q G').
    dt : float
        Step, s.

    Returns
    -------
    Phi, Qd : ndarray, shape (n, n)

    References
    ----------
    Van Loan, "Computing integrals involving the matrix exponential", IEEE TAC 23 (1978).
    """
    from scipy.linalg import expm  # not on import: nodes never need it, and it costs them 16 MB

    n = F.shape[0]
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -F, GQG, F.T
    e = expm(block * dt)
    Phi = e[n:, n:].T
    Qd = Phi @ e[:n, n:]
    return Phi, 0.5 * (Qd + Qd.T)


@kernel
def transition(F, dt):
    """Second-order transition matrix I + F dt + (F dt)^2 / 2 for a step short against the dynamics."""
    A = F * dt
    Phi = A + 0.5 * matmul(A, A)
    for i in range(F.shape[0]):
        Phi[i, i] += 1.0
    return Phi


@kernel
def lead(track, Phi):
    """Add a transition to a product of transitions ``track`` (n, n), in place; one of no size is of no interest."""
    if track.shape[0]:
        track[:] = matmul(Phi, track)


@kernel
def predict_covariance(P, Phi, GQG, dt):
    """Carry P over one step in place: P = Phi P Phi' + (Phi GQG Phi' + GQG) dt / 2, kept symmetric.

    The trapezoid keeps the noise positive semidefinite, which the form (Phi GQG + GQG Phi') dt / 2 does not.
    """
    n = P.shape[0]
    half = GQG * (0.5 * dt)
    moved = turned(Phi, P + half)
    for i in range(n):
        for j in range(i + 1):
            value = 0.5 * (moved[i, j] + moved[j, i]) + half[i, j]
            P[i, j] = value
            P[j, i] = value


@kernel
def predict_covariance_by_simpson(P, Phi, Phi_half, GQG, dt):
    """The same with the noise by Simpson's rule, exact for a doubly integrated white noise; ``Phi_half`` leads to the middle of the step.

    The trapezoid triples the part of a position's noise that the velocities at both ends of the step do not explain (q dt^3/4 for
    q dt^3/12); where velocity is measured at every step and q is large, that part is what the position wanders by.
    """
    n = P.shape[0]
    share = GQG * (dt / 6.0)
    moved, middle = turned(Phi, P + share), turned(Phi_half, 4.0 * share)
    for i in range(n):
        for j in range(i + 1):
            value = 0.5 * (moved[i, j] + moved[j, i]) + 0.5 * (middle[i, j] + middle[j, i]) + share[i, j]
            P[i, j] = value
            P[j, i] = value


@kernel
def innovation_covariance(P, H, R):
    """S = H P H' + R, symmetric by construction."""
    S = turned(H, P) + R
    return 0.5 * (S + S.T)


@kernel
def tested(P, y, H, R):
    """What is asked of every innovation y (m,) with H (m, n) and R (m, m), at once.

    Returns
    -------
    is_finite : bool
        Whether all numbers of the three are.
    S : ndarray, shape (m, m)
        Its covariance.
    nis : float
        Its normalised square.
    size : float
        Root mean square over its components, in sigmas of their own noise.
    """
    S, total = innovation_covariance(P, H, R), 0.0
    for i in range(y.shape[0]):
        total += y[i] * y[i] / (R[i, i] + 1e-300)
    is_finite = np.isfinite(y.sum() + H.sum() + R.sum())
    return is_finite, S, normalised_innovation_squared(y, S), np.sqrt(total / y.shape[0])


@kernel
def normalised_innovation_squared(y, S):
    """y' S^-1 y by the pivots of S, without an inverse; infinite where S claims to know exactly what y contradicts."""
    parts, _, variances = independent(y, np.zeros((y.shape[0], 0)), S)
    total = 0.0
    for i in range(y.shape[0]):
        if parts[i] != 0.0:
            total += parts[i] * parts[i] / variances[i]
    return total


@kernel
def independent(y, H, R):
    """Combine a measurement of noise R (m, m) into scalars of independent noise, by pivots, the largest share of its variance first.

    Returns innovations (m,), rows (m, n) and variances (m,); these are zero where a semidefinite R says that the scalar is known exactly.
    Nothing is divided by what is round-off (Golub and Van Loan, Matrix Computations, section 4.2.8).
    """
    m = y.shape[0]
    y, H, R, variances, order = y.copy(), H.copy(), R.copy(), np.zeros(m), np.arange(m)
    stated = np.diag(R).copy()
    for done in range(m):
        best = done
        for i in range(done + 1, m):
            if R[order[i], order[i]] * stated[order[best]] > R[order[best], order[best]] * stated[order[i]]:
                best = i
        order[done], order[best] = order[best], order[done]
        k = order[done]
        if R[k, k] <= PIVOT * stated[k]:
            break
        variances[done] = R[k, k]
        for i in order[done + 1 :]:
            factor = R[i, k] / R[k, k]
            if factor != 0.0:
                y[i] -= factor * y[k]
                H[i] -= factor * H[k]
                for j in order[done + 1 :]:
                    R[i, j] -= factor * R[k, j]
    return y[order], H[order], variances


@kernel
def whiten(y, H, R):
    """Scale y and H so that the measurement noise becomes the identity (R = L L', solve by forward substitution)."""
    L, yw, Hw = cholesky(R), y.copy(), H.copy()
    for i in range(H.shape[0]):
        for k in range(i):
            if L[i, k] != 0.0:  # nearly always the noise is independent
                yw[i] -= L[i, k] * yw[k]
                for j in range(H.shape[1]):
                    Hw[i, j] -= L[i, k] * Hw[k, j]
        yw[i] /= L[i, i]
        for j in range(H.shape[1]):
            Hw[i, j] /= L[i, i]
    return yw, Hw


@kernel
def scalar_update(dx, P, y, h, r, free):
    """Fuse one scalar measurement in place, Joseph form, with a gain that may be held off some states.

    Parameters
    ----------
    dx : ndarray, shape (n,)
        Correction gathered so far; ``y`` is the innovation before it.
    P : ndarray, shape (n, n)
        Covariance, updated in place, kept symmetric.
    y, r : float
        Innovation (measured minus predicted) and its noise variance.
    h : ndarray, shape (n,)
        Measurement row.
    free : ndarray, shape (n,)
        1 where the state may move, 0 where it is only considered (Schmidt).

    Returns
    -------
    float
        Innovation variance h P h' + r.
    """
    n = dx.shape[0]
    Ph = np.empty(n)
    s = weighted(P, h, Ph)
    s += max(r, SHARPEST * s)
    residual = y
    for i in range(n):
        residual -= h[i] * dx[i]
    gain = Ph / s * free if s > 0.0 else np.zeros(n)  # nothing is measured, and nothing is uncertain about it
    for i in range(n):
        dx[i] += gain[i] * residual
    # Joseph form (I-Kh)P(I-Kh)' + K r K' = P - K (Ph)' - (Ph) K' + K s K', valid for any gain
    for i in range(n):
        for j in range(i + 1):
            P[i, j] = P[i, j] - gain[i] * Ph[j] - Ph[i] * gain[j] + gain[i] * s * gain[j]
    for i in range(n):  # apart from the loop above, which runs along rows
        for j in range(i):
            P[j, i] = P[i, j]
    return s


@kernel
def update(P, y, H, R, free):
    """Fuse a vector measurement of any positive semidefinite noise as independent scalars.

    P changes in place and the correction (n,) is returned; where any of it would not be finite, P stays and the correction is NaN.
    """
    n, m = P.shape[0], y.shape[0]
    return update_with_parameters(P, y, H, R, free, np.zeros((m, 0)), np.zeros((n, 0)), np.zeros((0, 1)))


@kernel
def update_with_parameters(P, y, H, R, free, D, V, learned):
    """The same where parameters p (k,) that are no states act on the measurement, y = H dx + D p + noise, and through it on the error.

    The filter knows nothing of them: its error is dx = dx_0 + V p with V (n, k), so its innovations are y = y_0 + (H V + D) p, by which
    the parameters are regressed (Friedland, "Treatment of bias in recursive filtering", IEEE TAC 14, 1969).

    V and ``learned`` (k, k + 1), information and score of the regression, change in place; P and the correction are those of
    :func:`update` to the last bit.
    """
    n, k = V.shape
    dx, after, moved, found = np.zeros(n), P.copy(), V.copy(), learned.copy()
    parts, rows, variances = independent(y, np.hstack((H, D)), R)
    u = np.zeros(k)
    for i in range(y.shape[0]):
        h = rows[i, :n].copy()
        gain, residual = np.empty(n), parts[i]
        if k:
            weighted(after, h, gain)
            gain *= free
            for j in range(k):
                u[j] = rows[i, n + j]
                for r in range(n):
                    u[j] += h[r] * moved[r, j]
            for r in range(n):
                residual -= h[r] * dx[r]
        s = scalar_update(dx, after, parts[i], h, variances[i], free)
        if k and s > 0.0:
            for j in range(k):
                for r in range(n):
                    moved[r, j] -= gain[r] / s * u[j]
                for c in range(k):
                    found[j, c] += u[j] * u[c] / s
                found[j, k] += u[j] * residual / s
    if not (np.isfinite(dx).all() and np.isfinite(after).all()):
        return np.full(n, np.nan)
    P[:] = after
    V[:] = moved
    learned[:] = found
    return dx


@kernel
def is_sound(cov, vector):
    """Whether a covariance (n, n) and a vector (m,) are finite and no variance is negative."""
    total = 0.0
    for i in range(cov.shape[0]):
        if not cov[i, i] >= 0.0:
            return False
        for j in range(cov.shape[0]):
            total += cov[i, j]
    for value in vector:
        total += value
    return np.isfinite(total)


@kernel
def are_sound(pos, vel, att, wind, v0, v1, v2, v3, v4):
    """The same of the covariances and vectors of a solution, absent ones of no size."""
    return is_sound(pos, v0) and is_sound(vel, v1) and is_sound(att, v2) and is_sound(wind, v3) and is_sound(pos, v4)


@kernel
def guard_covariance(P, variance_floor, variance_ceiling):
    """Keep every variance inside its bounds and every correlation below one, in place; return how often it had to act.

    Numerical insurance for outages and long runs, not a tuning device: a healthy filter returns 0.
    """
    n = P.shape[0]
    acted = 0
    for i in range(n):
        if not P[i, i] >= variance_floor[i]:  # also true for NaN
            acted += 1
            for j in range(n):
                if not np.isfinite(P[i, j]):
                    P[i, j] = 0.0
                    P[j, i] = 0.0
            P[i, i] = variance_floor[i]
        elif P[i, i] > variance_ceiling[i]:
            acted += 1
            scale = np.sqrt(variance_ceiling[i] / P[i, i])
            for j in range(n):
                P[i, j] *= scale
                P[j, i] *= scale
    for i in range(n):
        for j in range(i):
            bound = np.sqrt(P[i, i] * P[j, j])
            if abs(P[i, j]) > bound:
                acted += 1
                P[i, j] = bound * np.sign(P[i, j])
                P[j, i] = P[i, j]
    return acted


def raise_sigmas(P: np.ndarray, least: np.ndarray, history: Any = None) -> None:
    """Raise the sigmas of a covariance (n, n), in place, to those of ``least`` (n,): states are known less well than was believed.

    ``history`` is that of the core, for the smoother.
    """
    if not (least**2 > P.diagonal()).any():
        return
    if history is not None:
        history.begin(P)
    np.fill_diagonal(P, np.maximum(P.diagonal(), least**2))
    if history is not None:
        history.end(P)


def log_likelihood(P: np.ndarray, y: np.ndarray, H: np.ndarray, R: np.ndarray) -> tuple[float, float]:
    """Log likelihood of an innovation y (m,), up to a constant, and its normalised square: what weighs hypotheses against each other."""
    S = innovation_covariance(P, H, R)
    squared = normalised_innovation_squared(y, S)
    return -0.5 * (squared + float(np.linalg.slogdet(S)[1])), squared


def add_variance(P: np.ndarray, rows: slice, variance: float | np.ndarray, history: Any = None) -> None:
    """Add a variance to each state of one block, or a covariance (m, m) to the block, in place; its correlations with others are left.

    ``history`` is that of the core, for the smoother.
    """
    if history is not None:
        history.begin(P)
    P[rows, rows] += variance if isinstance(variance, np.ndarray) else variance * np.eye(rows.stop - rows.start)
    if history is not None:
        history.end(P)


def reset_block(P: np.ndarray, rows: slice, covariance: np.ndarray, history: Any = None) -> None:
    """Forget what is known of one block, in place: its covariance is replaced, its correlations with the rest removed.

    ``history`` is that of the core, for the smoother.
    """
    if history is not None:
        history.begin(P)[rows] = 0.0
    P[rows, :] = 0.0
    P[:, rows] = 0.0
    P[rows, rows] = covariance
    if history is not None:
        history.end(P)


def steady_state_gain(Phi: np.ndarray, Qd: np.ndarray, H: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Constant gain of a time-invariant filter, by the discrete algebraic Riccati equation.

    Returns
    -------
    K : ndarray, shape (n, m)
        Gain on the innovation.
    P : ndarray, shape (n, n)
        Covariance just after an update.

    Raises
    ------
    ValueError
        When the model is not detectable and no steady state exists.
    """
    from scipy.linalg import solve_discrete_are

    try:
        prior = solve_discrete_are(Phi.T, H.T, Qd, R)
    except np.linalg.LinAlgError as error:
        raise ValueError("No steady-state gain: a state is neither measured nor decaying.") from error
    S = H @ prior @ H.T + R
    K = np.linalg.solve(S, H @ prior).T
    I_KH = np.eye(len(Phi)) - K @ H
    return K, I_KH @ prior @ I_KH.T + K @ R @ K.T
