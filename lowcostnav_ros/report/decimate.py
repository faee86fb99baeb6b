"""Thinning a curve for a plot without losing its extremes."""

import numpy as np

BUCKETS = 600
"""Buckets per curve; two points each, so a curve never has more than 1200."""


def thin(x: np.ndarray, y: np.ndarray, buckets: int = BUCKETS) -> tuple[np.ndarray, np.ndarray]:
    """Keep, of every bucket of x, the smallest and the largest y, in order of x; gaps (NaN) are kept as one NaN.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        ``x`` not decreasing.
    buckets : int
        At most two points of each are kept.
    """
    if len(x) <= 2 * buckets:
        return x, y
    edges = np.linspace(x[0], x[-1], buckets + 1)
    starts = np.unique(np.searchsorted(x, edges[:-1], side="left"))
    keep: list[int] = []
    for first, last in zip(starts, [*starts[1:], len(x)], strict=True):
        part = y[first:last]
        if np.isnan(part).all():
            keep.append(int(first))
            continue
        pair = {int(first + np.nanargmin(part)), int(first + np.nanargmax(part))}
        gap = {int(first + np.flatnonzero(np.isnan(part))[0])} if np.isnan(part).any() else set()
        keep += sorted(pair | gap)
    return x[keep], y[keep]


def thin_dots(x: np.ndarray, y: np.ndarray, most: int = BUCKETS) -> tuple[np.ndarray, np.ndarray]:
    """Keep every k-th point, so that they stay as dense where they were dense, and those that stick out furthest from the median.

    At most about ``most`` points of each kind; ``x``, ``y`` have shape (n,).
    """
    if len(x) <= 2 * most:
        return x, y
    far = np.argsort(-np.abs(y - np.nanmedian(y)), kind="stable")[: most // 4]
    keep = np.union1d(np.arange(0, len(x), -(-len(x) // most)), far)
    return x[keep], y[keep]


def thin_envelope(x: np.ndarray, y: np.ndarray, buckets: int = BUCKETS // 2) -> tuple[np.ndarray, np.ndarray]:
    """Keep the largest y of every bucket of x: for the edge of a sigma band, which must not look smaller than it was."""
    if len(x) <= buckets:
        return x, y
    starts = np.unique(np.searchsorted(x, np.linspace(x[0], x[-1], buckets + 1)[:-1], side="left"))
    keep = [
        int(first + np.nanargmax(part)) if np.isfinite(part := y[first:last]).any() else int(first)
        for first, last in zip(starts, [*starts[1:], len(x)], strict=True)
    ]
    return x[keep], y[keep]


def straightened(x: np.ndarray, y: np.ndarray, most: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    """Leave out points that lie within ``most`` of the line from the last point that is kept to the next one.

    One pass: the slopes that pass every point left out so far within ``most`` stay a wedge, and where it closes a point is kept.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        ``x`` in order, rising or falling.
    most : float
        In the unit of ``y``; smaller than the line is wide.
    """
    keep, low, high = [0], -np.inf, np.inf
    xs, ys = x.tolist(), y.tolist()
    for k in range(1, len(xs)):
        at = keep[-1]
        run, rise = abs(xs[k] - xs[at]), ys[k] - ys[at]
        if run > 0.0 and low <= rise / run <= high:
            low, high = max(low, (rise - most) / run), min(high, (rise + most) / run)
            continue
        if k - 1 > at:
            keep.append(k - 1)
            run, rise = abs(xs[k] - xs[k - 1]), ys[k] - ys[k - 1]
        if run > 0.0 and rise == rise:
            low, high = (rise - most) / run, (rise + most) / run
        else:  # a gap, or a step: both its ends are kept
            keep.append(k)
            low, high = -np.inf, np.inf
    keep += [len(xs) - 1] if keep[-1] != len(xs) - 1 else []
    return x[keep], y[keep]
