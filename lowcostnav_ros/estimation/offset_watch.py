"""GPS against an inertial solution that it does not correct: a jump of their offset, or of its rate, is no error of inertial sensors.

With o the offset of the two positions per axis, d = do/dt, z - x what the filter did not expect of the offset and u, v their velocities
(Njenga 2008, chapter 3, which prints no limits), GPS is not healthy where

    |d - mean d| > 5 s_d             s_d the scatter of d in the last half minute
    |z - x| > 4 s in 3 epochs        s of the filter and of what it has lately been off by
    correlation of u and v < 0.5     over half a minute in which the velocity changed by more than its noise

and it is healthy again after ten epochs in a row that are.
"""

import math
from collections import deque

import numpy as np

WINDOW_NS = 30_000_000_000
FEWEST = 8
"""Epochs from which a scatter is one."""
JUMP, LEAST_MPS = 5.0, 0.15
"""Sigmas of the rate of the offset; its least scatter, m/s."""
INNOVATION, IN_ROW = 4.0, 3
CORRELATED, CHANGED_MPS = 0.5, 5.0
"""Least correlation of the velocities; scatter of the inertial one from which a correlation means anything, m/s."""
GOOD_AGAIN = 10
JUMPED, UNEXPECTED, UNCORRELATED = "offset of GPS jumped", "offset of GPS not as predicted", "velocities of GPS and INS do not correlate"


class OffsetWatch:
    """Whether GPS is healthy, by its offset from an inertial solution.

    Attributes
    ----------
    fault : str
        What speaks against GPS; empty: nothing.
    correlation : float or None
        Of the velocities, the axis that changed most; None where nothing changed.
    offset_std_m, rate_std_mps : float
        Scatter of the offset and of its rate, root mean square over the axes.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._last: tuple[int, np.ndarray] | None = None
        self._rates: deque[tuple[int, np.ndarray]] = deque()
        self._offsets: deque[tuple[int, np.ndarray]] = deque()
        self._velocities: deque[tuple[int, np.ndarray, np.ndarray]] = deque()
        self._unexpected = self._good = 0
        self.fault = ""
        self.correlation: float | None = None
        self.offset_std_m = self.rate_std_mps = 0.0

    def take(self, stamp_ns: int, offset: np.ndarray, ins: np.ndarray, gps: np.ndarray, innovation: np.ndarray, sigma: np.ndarray) -> str:
        """Take an epoch in; return what is wrong with it, empty for nothing.

        Parameters
        ----------
        stamp_ns : int
        offset : ndarray (3,)
            Inertial less GPS position, m.
        ins, gps : ndarray (3,)
            Velocities, m/s, of the same axes.
        innovation, sigma : ndarray (3,)
            What the filter did not expect of the offset, m, and its sigma with what it has lately been off by.
        """
        for kept in (self._rates, self._offsets, self._velocities):
            while kept and stamp_ns - kept[0][0] > WINDOW_NS:
                kept.popleft()
        found = self._judge(stamp_ns, offset, innovation, sigma)
        if found != JUMPED:  # the velocity that it makes of two fixes is none
            self._velocities.append((stamp_ns, ins.copy(), gps.copy()))
        self.correlation = self._correlation()
        if not found and self.correlation is not None and self.correlation < CORRELATED:
            found = UNCORRELATED
        if found:
            self.fault, self._good = self.fault or found, 0
        elif self.fault:
            self._good += 1
            if self._good >= GOOD_AGAIN:
                self.fault = ""
        return found

    def _judge(self, stamp_ns: int, offset: np.ndarray, innovation: np.ndarray, sigma: np.ndarray) -> str:
        last, self._last = self._last, (stamp_ns, offset.copy())
        self._unexpected = self._unexpected + 1 if (np.abs(innovation) > INNOVATION * sigma).any() else 0
        self._offsets.append((stamp_ns, offset.copy()))
        self.offset_std_m = scatter(self._offsets)
        found = UNEXPECTED if self._unexpected >= IN_ROW else ""
        if last is None or stamp_ns <= last[0]:
            return found
        rate = (offset - last[1]) / (1e-9 * (stamp_ns - last[0]))
        self.rate_std_mps = scatter(self._rates)
        if len(self._rates) >= FEWEST:
            rates = np.array([r for _, r in self._rates])
            limit = JUMP * np.maximum(rates.std(axis=0, ddof=1), LEAST_MPS)
            if (np.abs(rate - rates.mean(axis=0)) > limit).any():
                return JUMPED  # what is no rate of an error is kept out of their scatter
        self._rates.append((stamp_ns, rate))
        return found

    def _correlation(self) -> float | None:
        if len(self._velocities) < FEWEST:
            return None
        u, v = (np.array([row[k] for row in self._velocities]) for k in (1, 2))
        u, v = u - u.mean(axis=0), v - v.mean(axis=0)
        axis = int(np.argmax((u * u).sum(axis=0)))
        mine, other = float(u[:, axis] @ u[:, axis]), float(v[:, axis] @ v[:, axis])
        if math.sqrt(mine / len(u)) < CHANGED_MPS:
            return None
        return float(u[:, axis] @ v[:, axis]) / math.sqrt(max(mine * other, 1e-300))


def scatter(kept: "deque[tuple[int, np.ndarray]]") -> float:
    """Root mean square over the axes of the standard deviations of what is kept; 0 for less than two."""
    return float(np.sqrt(np.mean(np.var([value for _, value in kept], axis=0, ddof=1)))) if len(kept) > 1 else 0.0
