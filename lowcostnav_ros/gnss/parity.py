"""Parity: how redundant observations contradict each other, whatever the unknowns are.

Whitened observations b = A x + e, e of unit covariance, A (n, m) of full rank, n > m.  With A = Q R the part of b outside the range of A,
w = (I - Q Q') b = (I - Q Q') e, holds no trace of the unknowns: its square is chi-square with n - m degrees of freedom while nothing is
wrong, and a bias on one observation shows along that observation's column alone.

References
----------
B. W. Parkinson and P. Axelrad, "Autonomous GPS integrity monitoring using the pseudorange residual", Navigation 35 (1988);
M. A. Sturza, "Navigation system integrity monitoring using redundant measurements", Navigation 35 (1988).
"""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import cholesky, matmul_transposed

NEARLY_SINGULAR = 1e-6
"""Ratio of the smallest to the largest pivot below which a geometry counts as having no solution."""
UNSEEN = 1e-9
"""Share of an observation's own error left in its residual below which no fault of it can be seen."""
INSEPARABLE = 0.999
"""Correlation of two observations' normalised residuals from which their faults look alike."""


@kernel
def parity(A, b):
    """Solve whitened observations and split off what contradicts the solution.

    Parameters
    ----------
    A : ndarray, shape (n, m)
    b : ndarray, shape (n,)

    Returns
    -------
    solved : bool
        False where the geometry gives no solution; the rest is then meaningless.
    x : ndarray, shape (m,)
        Least-squares solution.
    gain : ndarray, shape (m, n)
        x = gain b.
    w : ndarray, shape (n,)
        Residuals; their sum of squares is the test statistic.
    S : ndarray, shape (n, n)
        Projector onto the residuals, w = S b; also their covariance.
    """
    n, m = A.shape
    columns = A.T.copy()
    L = cholesky(matmul_transposed(columns, columns))
    solved = n >= m
    largest = 0.0
    for i in range(m):
        largest = max(largest, L[i, i])
    for i in range(m):
        solved = solved and L[i, i] > NEARLY_SINGULAR * largest  # false for NaN, too
    Q = np.zeros((n, m))
    for k in range(n):
        for i in range(m):
            Q[k, i] = A[k, i]
            for j in range(i):
                Q[k, i] -= L[i, j] * Q[k, j]
            Q[k, i] /= L[i, i]
    S = -matmul_transposed(Q, Q)
    for k in range(n):
        S[k, k] += 1.0
    gain = np.zeros((m, n))
    for k in range(n):
        for i in range(m - 1, -1, -1):
            total = Q[k, i]
            for j in range(i + 1, m):
                total -= L[j, i] * gain[j, k]
            gain[i, k] = total / L[i, i]
    x, w = np.zeros(m), np.zeros(n)
    for k in range(n):
        for i in range(m):
            x[i] += gain[i, k] * b[k]
        for j in range(n):
            w[k] += S[k, j] * b[j]
    return solved, x, gain, w, S


@kernel
def normalised(w, S):
    """Residuals over their own sigmas (n,) and their correlation (n, n); one that sees nothing of its own error counts as zero."""
    n = w.shape[0]
    scale = np.zeros(n)
    for k in range(n):
        if S[k, k] > UNSEEN:
            scale[k] = 1.0 / np.sqrt(S[k, k])
    correlation = np.zeros((n, n))
    for k in range(n):
        for j in range(n):
            correlation[k, j] = S[k, j] * scale[k] * scale[j]
    return np.abs(w) * scale, correlation


@kernel
def suspect(w, S):
    """The observation most likely wrong, if one is: its row, and whether another's fault would look the same."""
    size, correlation = normalised(w, S)
    worst = 0
    for k in range(1, w.shape[0]):
        if size[k] > size[worst]:
            worst = k
    ambiguous = False
    for k in range(w.shape[0]):
        ambiguous = ambiguous or (k != worst and abs(correlation[worst, k]) > INSEPARABLE)
    return worst, ambiguous


@kernel
def slopes(gain, S):
    """Horizontal and vertical error of the solution per unit of test statistic for a fault of each observation, the largest of each.

    The first three unknowns are north, east and down.  Infinite when a fault of one observation shows nowhere.
    """
    horizontal, vertical = 0.0, 0.0
    for k in range(S.shape[0]):
        if S[k, k] < UNSEEN:
            return np.inf, np.inf
        seen = np.sqrt(S[k, k])
        horizontal = max(horizontal, np.hypot(gain[0, k], gain[1, k]) / seen)
        vertical = max(vertical, abs(gain[2, k]) / seen)
    return horizontal, vertical


HEALTHY, FOUND, TOO_FEW, AMBIGUOUS, SEVERAL, UNTESTED = 0, 1, 2, 3, 4, 5
"""What a judgement can be: no contradiction; one observation is wrong; something is, and which is not observable for want of observations,
because another would look the same, or because the rest contradict each other, too; nothing to test with."""


@kernel
def judge(A, b, limits):
    """Test whitened observations and look for the one that is wrong.

    Parameters
    ----------
    A : ndarray, shape (n, m)
    b : ndarray, shape (n,)
    limits : ndarray
        Threshold of the test statistic by degrees of freedom.

    Returns
    -------
    verdict : int
    row : int
        The one that is wrong, or most likely wrong; -1 where there is none.
    horizontal, vertical : float
        Steepest slopes of the solution without it, see :func:`slopes`; infinite where the verdict allows no statement.
    redundancy : int
        Degrees of freedom of that solution.
    """
    n, m = A.shape
    solved, _, gain, w, S = parity(A, b)
    if not solved or n <= m:
        return UNTESTED, -1, np.inf, np.inf, 0
    if not np.sum(w * w) > limits[n - m]:
        horizontal, vertical = slopes(gain, S)
        return HEALTHY, -1, horizontal, vertical, n - m
    worst, ambiguous = suspect(w, S)
    if n - m < 2:
        return TOO_FEW, worst, np.inf, np.inf, 0
    if ambiguous:
        return AMBIGUOUS, worst, np.inf, np.inf, 0
    rest = np.arange(n) != worst
    solved, _, gain, w, S = parity(A[rest], b[rest])
    if not solved or np.sum(w * w) > limits[n - m - 1]:
        return SEVERAL, worst, np.inf, np.inf, 0
    horizontal, vertical = slopes(gain, S)
    return FOUND, worst, horizontal, vertical, n - m - 1
