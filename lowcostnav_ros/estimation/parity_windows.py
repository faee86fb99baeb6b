"""Parity of satellite innovations, of one epoch and of means over longer times: large faults show at once, slow ones in the means.

Innovations y = G x + e of an epoch hold the error of the prediction, x (position and clock, or velocity and drift), and the errors of the
observations.  The fit of x is taken off first, so that the means gather observation errors alone, whatever the filter does meanwhile.
A mean over N epochs has 1/N of the white variance and all of an error that lasts; a healthy satellite may have a slow one of
``slow_sigma``, which therefore bounds what averaging can see.
"""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import matvec
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.gnss.parity import HEALTHY, judge, parity

SLOTS = 128
GAP_NS = 5_000_000_000
"""After no data from a satellite for so long its means are reset."""
RETURNING_SIGMAS = 3.0
"""An excluded satellite agrees again when every mean of it is within so many sigmas of the fit of the others."""


@kernel
def gather(mean, factor, count, age_s, slots, y, G, R, trusted, dt, times):
    """Add the residuals of an epoch to the running means, in place; return whether the trusted satellites gave a fit.

    A mean is plain until it is as old as its window, then exponential; ``factor`` is the variance of the mean of unit white noise.
    Rows of ``mean`` and ``factor`` are windows, the first of which is the epoch itself.
    """
    b, A = kalman.whiten(y[trusted], G[trusted], chosen(R, np.flatnonzero(trusted)))
    solved, x, _, _, _ = parity(A, b)
    if not solved:
        return False
    fitted = matvec(G, x)
    for k in range(slots.shape[0]):
        s = slots[k]
        count[s] += 1
        age_s[s] += dt
        for i in range(times.shape[0]):
            a = max(1.0 / count[s], min(1.0, dt / times[i])) if times[i] > 0.0 else 1.0
            mean[i, s] += a * (y[k] - fitted[k] - mean[i, s])
            factor[i, s] = (1.0 - a) ** 2 * factor[i, s] + a * a
    return True


@kernel
def chosen(R, rows):
    """Rows and columns of a covariance, (k, k)."""
    out = np.empty((rows.shape[0], rows.shape[0]))
    for k in range(rows.shape[0]):
        for j in range(rows.shape[0]):
            out[k, j] = R[rows[k], rows[j]]
    return out


@kernel
def covariance_of_means(factor, slots, R, slow_sigma):
    """Covariance (n, n) of the means of one window: white noise of covariance R averaged, and a slow error of each satellite."""
    n = slots.shape[0]
    out = np.empty((n, n))
    for k in range(n):
        for j in range(n):
            out[k, j] = np.sqrt(factor[slots[k]] * factor[slots[j]]) * R[k, j]
        out[k, k] += slow_sigma * slow_sigma
    return out


@kernel
def take(mean, factor, count, age_s, seen_ns, slots, y, G, R, passed, judged, stamp_ns, dt, times, slow_sigma, limits):
    """Take an epoch in, and judge it; see :meth:`ParityWindows.take`."""
    for s in slots:
        if stamp_ns - seen_ns[s] > GAP_NS:
            count[s], age_s[s] = 0, 0.0
        seen_ns[s] = stamp_ns
    fitted = gather(mean, factor, count, age_s, slots, y, G, R, passed, dt, times)
    return fitted, judge_windows(mean, factor, age_s, slots, judged, G, R, times, slow_sigma, limits)


@kernel
def judge_windows(mean, factor, age_s, slots, trusted, G, R, times, slow_sigma, limits):
    """Judge the trusted satellites in all windows, the epoch itself first, up to the first that is not healthy.

    Returns
    -------
    window, verdict, row : int
        The last window judged and its judgement, see :func:`lowcostnav_ros.gnss.parity.judge`; the row is one of all.
    steepness : ndarray, shape (windows, 3)
        Horizontal and vertical slope and redundancy of each; infinite and zero where not judged.
    is_full : bool
        Whether the longest window has had these satellites for its whole length.
    """
    steepness = np.zeros((mean.shape[0], 3))
    steepness[:, :2] = np.inf
    verdict, row, window = HEALTHY, -1, 0
    rows = np.flatnonzero(trusted)
    slots, G, R = slots[rows], G[rows], chosen(R, rows)
    is_full = np.all(age_s[slots] >= times[-1])
    for i in range(mean.shape[0]):
        spread = covariance_of_means(factor[i], slots, R, slow_sigma if i > 0 else 0.0)
        b, A = kalman.whiten(mean[i][slots], G, spread)
        verdict, row, horizontal, vertical, redundancy = judge(A, b, limits)
        window = i
        if verdict != HEALTHY:
            break
        steepness[i, 0], steepness[i, 1], steepness[i, 2] = horizontal, vertical, redundancy
    return window, verdict, rows[row] if row >= 0 else -1, steepness, is_full


@kernel
def strays(mean, factor, slots, trusted, G, R, slow_sigma):
    """Largest distance, in sigmas, of each mean from the fit of the trusted satellites, over the windows longer than an epoch; (n,)."""
    n, out = slots.shape[0], np.zeros(slots.shape[0])
    rows = np.flatnonzero(trusted)
    for i in range(min(1, mean.shape[0] - 1), mean.shape[0]):
        spread = covariance_of_means(factor[i], slots, R, slow_sigma if i > 0 else 0.0)
        b, A = kalman.whiten(mean[i][slots[rows]], G[rows], chosen(spread, rows))
        solved, x, gain, _, _ = parity(A, b)
        for k in range(n):
            if not trusted[k]:
                g = matvec(gain.T.copy(), G[k])
                sigma = np.sqrt(spread[k, k] + np.sum(g * g))
                predicted = np.sum(G[k] * x)
                out[k] = max(out[k], abs(mean[i, slots[k]] - predicted) / sigma) if solved else np.inf
    return out


class ParityWindows:
    """Running means of the residuals of one kind of observation.

    Parameters
    ----------
    windows_s : sequence of float
        Lengths of the means, s; the epoch itself is always looked at.
    slow_sigma : float
        Slow error a healthy satellite may have, in the unit of the observations.
    limits : ndarray
        Thresholds by degrees of freedom.
    """

    def __init__(self, windows_s: list[float], slow_sigma: float, limits: np.ndarray) -> None:
        self.times = np.array([0.0, *sorted(windows_s)])
        self.slow_sigma, self.limits = slow_sigma, limits
        self.clear()

    def clear(self) -> None:
        """Forget all means."""
        self.mean, self.factor = np.zeros((len(self.times), SLOTS)), np.zeros((len(self.times), SLOTS))
        self.count, self.seen_ns = np.zeros(SLOTS, dtype=np.int64), np.zeros(SLOTS, dtype=np.int64)
        self.age_s = np.zeros(SLOTS)
        self._last_ns: int | None = None

    def take(
        self, stamp_ns: int, slots: np.ndarray, y: np.ndarray, G: np.ndarray, R: np.ndarray, passed: np.ndarray, judged: np.ndarray
    ) -> tuple | None:
        """Take the innovations of an epoch in: y (n,), rows G (n, m), noise R (n, n) of the satellites in ``slots`` (n,).

        Those that ``passed`` make the fit that is taken off, and ``judged`` are judged, see :func:`judge_windows`; None without a fit.
        """
        dt = 0.0 if self._last_ns is None else 1e-9 * min(stamp_ns - self._last_ns, GAP_NS)
        self._last_ns = stamp_ns
        means = self.mean, self.factor, self.count, self.age_s, self.seen_ns
        fitted, found = take(*means, slots, y, G, R, passed, judged, stamp_ns, dt, self.times, self.slow_sigma, self.limits)
        return found if fitted else None

    def judge(self, slots: np.ndarray, trusted: np.ndarray, G: np.ndarray, R: np.ndarray) -> tuple:
        """Judge the trusted satellites of those in these slots; see :func:`judge_windows`."""
        return judge_windows(self.mean, self.factor, self.age_s, slots, trusted, G, R, self.times, self.slow_sigma, self.limits)

    def strays(self, slots: np.ndarray, trusted: np.ndarray, G: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Distance of each satellite that is not trusted from the others, in sigmas, (n,)."""
        return strays(self.mean, self.factor, slots, trusted, G, R, self.slow_sigma)
