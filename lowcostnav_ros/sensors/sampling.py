"""When a sensor samples, and what it sees of the truth: shared by all simulators."""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics.rotation import quat_to_dcm

TICK_TOLERANCE = 1.0e-6  # of a sample period: stamps are whole nanoseconds, so 1/30 s arrives a little early


class SampleClock:
    """Choose the truth rows on which a sensor of a given rate samples.

    Sample k falls on the first row at or after ``k / rate_hz`` seconds from the first row ever seen, so the choice depends on
    the stamps only, not on how they were cut into blocks.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._start_ns: int | None = None
        self._tick = -1

    def rows(self, stamps_ns: np.ndarray) -> np.ndarray:
        """Return the indices into ``stamps_ns`` (n,) of the rows to sample."""
        if len(stamps_ns) == 0:
            return np.zeros(0, dtype=np.int64)
        if self._start_ns is None:
            self._start_ns = int(stamps_ns[0])
        elapsed_s = (stamps_ns - self._start_ns) * 1e-9
        ticks = np.floor(elapsed_s * self._rate_hz + TICK_TOLERANCE).astype(np.int64)
        before = np.concatenate(([self._tick], ticks[:-1]))
        self._tick = int(ticks[-1])
        return np.flatnonzero(ticks > before)


@kernel
def to_body(q_nb: np.ndarray, vectors_n: np.ndarray) -> np.ndarray:
    """Resolve vectors (n, 3), NED, in the body axes of attitudes ``q_nb`` (n, 4): the transpose of C_nb applied row by row."""
    out = np.empty_like(vectors_n)
    for k in range(len(vectors_n)):
        c_nb = quat_to_dcm(q_nb[k])
        for i in range(3):
            out[k, i] = c_nb[0, i] * vectors_n[k, 0] + c_nb[1, i] * vectors_n[k, 1] + c_nb[2, i] * vectors_n[k, 2]
    return out


@kernel
def means_between(values: np.ndarray, ends: np.ndarray, total: np.ndarray, count: int) -> tuple[np.ndarray, int]:
    """Average rows since the previous sample up to each row in ``ends``, carrying the unfinished sum from call to call.

    Parameters
    ----------
    values : ndarray, shape (n, m)
        Means over consecutive equal intervals.
    ends : ndarray of int, shape (k,)
        Last row of each average, increasing.
    total : ndarray, shape (m,)
        Sum carried over from the previous call; updated in place.
    count : int
        Number of rows in ``total``.

    Returns
    -------
    means : ndarray, shape (k, m)
    count : int
        Rows now held in ``total``.
    """
    width = values.shape[1]
    means = np.empty((len(ends), width))
    done = 0
    for row in range(len(values)):
        for j in range(width):
            total[j] += values[row, j]
        count += 1
        if done < len(ends) and row == ends[done]:
            for j in range(width):
                means[done, j] = total[j] / count
                total[j] = 0.0
            count = 0
            done += 1
    return means, count
