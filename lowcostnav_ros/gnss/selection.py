"""Choose the satellites of the smallest GDOP when a receiver has fewer channels than satellites in view (Solimeno 2007, section 6.5)."""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.gnss import GnssError

EXHAUSTIVE_LIMIT = 20_000
"""Combinations up to which all are tried (about 10 ms); beyond, satellites are dropped one at a time, each time the least missed."""


def select(los: np.ndarray, count: int) -> np.ndarray:
    """Indices of the ``count`` satellites with the smallest GDOP.

    Parameters
    ----------
    los : ndarray, shape (n, 3)
        Unit vectors from the receiver, in any frame (GDOP does not depend on it).
    count : int
        Wanted number, at least 4.

    Returns
    -------
    ndarray of int
        Sorted; all satellites when there are no more than ``count``.  Where every choice is singular, the first ``count``.

    Raises
    ------
    GnssError
        For a count below 4, which has no GDOP.
    """
    if count < 4:
        raise GnssError(f"GDOP needs at least 4 satellites, {count} were asked for; take the highest instead.")
    n = len(los)
    if n <= count:
        return np.arange(n)
    outer = _outer_products(np.ascontiguousarray(los, dtype=float))
    if math.comb(n, count) <= EXHAUSTIVE_LIMIT:
        return _best_combination(outer, count)
    return _drop_one_at_a_time(outer, count)


@kernel
def _outer_products(los):
    """Lower triangle (10) of h h' for the rows h = [-e, 1]."""
    out = np.empty((los.shape[0], 10))
    h = np.ones(4)
    for k in range(los.shape[0]):
        for j in range(3):
            h[j] = -los[k, j]
        m = 0
        for i in range(4):
            for j in range(i + 1):
                out[k, m] = h[i] * h[j]
                m += 1
    return out


@kernel
def _gdop_squared(packed):
    """Trace of the inverse of a packed symmetric 4x4 matrix, by Cholesky: the sum of squares of L^-1; inf when singular."""
    lower, inverse = np.zeros((4, 4)), np.zeros((4, 4))
    m = 0
    for i in range(4):
        for j in range(i + 1):
            value = packed[m]
            m += 1
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            if i == j:
                if value <= 1e-10:
                    return np.inf
                lower[i, i] = math.sqrt(value)
            else:
                lower[i, j] = value / lower[j, j]
    total = 0.0
    for j in range(4):
        for i in range(j, 4):
            value = 1.0 if i == j else 0.0
            for k in range(j, i):
                value -= lower[i, k] * inverse[k, j]
            inverse[i, j] = value / lower[i, i]
            total += inverse[i, j] * inverse[i, j]
    return total


@kernel
def _best_combination(outer, count):
    n = outer.shape[0]
    chosen, best = np.arange(count), np.arange(count)
    lowest, packed = np.inf, np.empty(10)
    while True:
        packed[:] = 0.0
        for k in chosen:
            for m in range(10):
                packed[m] += outer[k, m]
        value = _gdop_squared(packed)
        if value < lowest:
            lowest = value
            best[:] = chosen
        i = count - 1  # the next combination in lexical order
        while i >= 0 and chosen[i] == n - count + i:
            i -= 1
        if i < 0:
            return best
        chosen[i] += 1
        for j in range(i + 1, count):
            chosen[j] = chosen[j - 1] + 1


@kernel
def _drop_one_at_a_time(outer, count):
    kept, packed = np.arange(outer.shape[0]), np.empty(10)
    while kept.size > count:
        lowest, drop = np.inf, kept.size - 1
        for out in range(kept.size):
            packed[:] = 0.0
            for i in range(kept.size):
                if i != out:
                    for m in range(10):
                        packed[m] += outer[kept[i], m]
            value = _gdop_squared(packed)
            if value < lowest:
                lowest, drop = value, out
        kept = np.concatenate((kept[:drop], kept[drop + 1 :]))
    return kept
