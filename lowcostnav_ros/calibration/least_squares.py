"""Linear least squares by Householder reflections, compiled: the one solver of the magnetometer fits.

Normal equations square the condition number, and a calibration from a thin strip of attitudes has little to spare.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel


@kernel
def solve_least_squares(rows, right):
    """Least-squares solution of ``rows @ x = right`` by QR.

    Parameters
    ----------
    rows : ndarray, shape (n, m), n >= m
        Overwritten.
    right : ndarray, shape (n,)
        Overwritten.

    Returns
    -------
    x : ndarray, shape (m,)
        Not finite where a column is dependent.
    upper : ndarray, shape (m, m)
        Triangular factor; its singular values are those of ``rows``.
    squares : float
        Sum of squared residuals.
    """
    n, m = rows.shape
    upper = np.zeros((m, m))
    for k in range(m):
        norm = 0.0
        for i in range(k, n):
            norm += rows[i, k] * rows[i, k]
        norm = -math.copysign(math.sqrt(norm), rows[k, k])
        upper[k, k] = norm
        head = rows[k, k] - norm
        rows[k, k] = head
        scale = -norm * head
        if scale == 0.0:
            continue
        for j in range(k + 1, m + 1):
            product = 0.0
            for i in range(k, n):
                product += rows[i, k] * (right[i] if j == m else rows[i, j])
            product /= scale
            for i in range(k, n):
                if j == m:
                    right[i] -= product * rows[i, k]
                else:
                    rows[i, j] -= product * rows[i, k]
            if j < m:
                upper[k, j] = rows[k, j]
    x = np.empty(m)
    for k in range(m - 1, -1, -1):
        total = right[k]
        for j in range(k + 1, m):
            total -= upper[k, j] * x[j]
        x[k] = total / upper[k, k]
    squares = 0.0
    for i in range(m, n):
        squares += right[i] * right[i]
    return x, upper, squares


def condition_number(upper: np.ndarray) -> float:
    """Condition number of a triangular factor (m, m) with its columns scaled to unit length; ``inf`` where it is singular."""
    norms = np.linalg.norm(upper, axis=0)
    if not np.all(np.isfinite(norms)) or np.any(norms == 0.0):
        return math.inf
    singular = np.linalg.svd(upper / norms, compute_uv=False)
    return float(singular[0] / singular[-1]) if singular[-1] > 0.0 else math.inf
