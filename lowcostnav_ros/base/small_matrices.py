"""Products and factors of small dense matrices as plain compiled loops.

A filter's matrices are too small for a BLAS to pay, and a BLAS costs more than time: its kernels differ from machine to machine in the
last bit, and numba's ``@`` pulls scipy.linalg, 16 MB, into every node.  These loops give the same bits everywhere.
"""

import numpy as np

from lowcostnav_ros.base.kernels import kernel


@kernel
def matmul(A, B):
    """A B for A (n, m) and B (m, p), shape (n, p)."""
    n, m, p = A.shape[0], A.shape[1], B.shape[1]
    C = np.zeros((n, p))
    for i in range(n):
        for k in range(m):
            a = A[i, k]
            if a != 0.0:  # dynamics and measurement rows are mostly zeros
                for j in range(p):
                    C[i, j] += a * B[k, j]
    return C


@kernel
def matmul_transposed(A, B):
    """A B' for A (n, m) and B (p, m), shape (n, p)."""
    n, m, p = A.shape[0], A.shape[1], B.shape[0]
    C = np.zeros((n, p))
    for i in range(n):
        for j in range(p):
            total = 0.0
            for k in range(m):
                total += A[i, k] * B[j, k]
            C[i, j] = total
    return C


@kernel
def matvec(A, x):
    """A x for A (n, m) and x (m,), shape (n,)."""
    y = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        total = 0.0
        for k in range(A.shape[1]):
            total += A[i, k] * x[k]
        y[i] = total
    return y


@kernel
def weighted(P, h, Ph):
    """P h into ``Ph`` for a symmetric P and a row of few entries; returns h P h'.  The bits are those of :func:`matvec`."""
    n = h.shape[0]
    Ph[:] = 0.0
    for j in range(n):
        if h[j] != 0.0:
            for i in range(n):
                Ph[i] += P[j, i] * h[j]
    total = 0.0
    for i in range(n):
        total += h[i] * Ph[i]
    return total


@kernel
def turned(C, cov):
    """C cov C': a covariance (m, m) in the axes that C (n, m) turns to, shape (n, n)."""
    return matmul(C, matmul(C, cov).T.copy()).T.copy()  # zeros of C are skipped twice, and both inner loops run along rows


@kernel
def cholesky(A):
    """Lower factor L of a symmetric positive definite A = L L'; rows that are not positive definite come out as NaN."""
    n = A.shape[0]
    L = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = np.sqrt(total) if total > 0.0 else np.nan
            else:
                L[i, j] = total / L[j, j]
    return L


@kernel
def forward_solve(L, b):
    """Solve L x = b for a lower triangular L (n, n) and b (n,)."""
    x = b.copy()
    for i in range(L.shape[0]):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    return x


RESOLVED = 4e-9
"""Share of each variance that no other component can explain: correlations closer to one are round-off."""


def at_least(cov: np.ndarray, sigma: float) -> np.ndarray:
    """Covariance (n, n) in which no direction, be it oblique, has a sigma below ``sigma`` or lost in round-off; itself where none has."""
    variances = cov.diagonal()
    if float(variances.min()) >= sigma * sigma and np.count_nonzero(cov) <= len(cov):
        return cov
    share = np.diag(np.maximum(sigma * sigma, RESOLVED * variances))
    with np.errstate(invalid="ignore"):  # what is infinite stays so, and is refused by whoever uses it
        return cov if np.isfinite(cholesky(cov - (1.0 - 1e-9) * share)).all() else cov + share
