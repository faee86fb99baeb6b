"""Is a transmitter in step with the others, and does a carrier count what it says it counts?

A code that is off by more, on the mean of its last epochs, than its noise and its slow error explain belongs to a transmitter that has lost
its synchronisation or stands elsewhere than the table says; while most codes agree, it is not used until it agrees again.

A carrier, times its wavelength, changes as the code does.  Where all of them together change by another factor, they are in metres or the
wavelength is wrong.  No carrier is used before that has been looked at: it takes a second or two of flight.
"""

import math
from collections import deque
from statistics import median

import numpy as np

from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.estimation.cross_checks.latch import Latch

WINDOW, SIGMAS, SLOW_SIGMAS = 50, 4.0, 3.0
OUT_OF_STEP = "transmitter out of step"
SCALE = "carrier and code disagree in scale"
LONGEST_NS = 10_000_000_000
PAIRS, FEWEST, CHANGE_M, FACTOR = 61, 15, 60.0, 0.1
"""Pairs that are kept and that tell, the change that a pair must show, and by how much the factor may differ from one: codes are off by
metres."""


class CodeWatch:
    """Mean residual of each channel's code.

    Parameters
    ----------
    channels : int
    slow_m : float
        Slow part of the error, 1 sigma.

    Attributes
    ----------
    mean_m : ndarray (channels,)
    excluded : ndarray of bool (channels,)
    """

    def __init__(self, channels: int, slow_m: float) -> None:
        self._slow_m, self._n = slow_m, channels
        self.latches: dict[int, Latch] = {}
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.mean_m, self._count = np.zeros(self._n), np.zeros(self._n, dtype=np.int64)
        self.excluded = np.zeros(self._n, dtype=bool)
        self._off_ns = np.zeros(self._n, dtype=np.int64)

    def take(self, stamp_ns: int, channel: np.ndarray, y: np.ndarray, S: np.ndarray, sigma_m: float) -> np.ndarray:
        """Take the residuals (m,) of an epoch with their variances; return channels that are excluded from now on."""
        count = np.minimum(self._count[channel] + 1, WINDOW)
        self._count[channel] = count
        self.mean_m[channel] += (y - self.mean_m[channel]) / count
        known = np.sqrt(np.maximum(S - sigma_m**2, 0.0))
        limit = SIGMAS * np.sqrt(sigma_m**2 / count + known**2) + SLOW_SIGMAS * self._slow_m
        off = (count == WINDOW) & (np.abs(self.mean_m[channel]) > limit)
        if 2 * np.count_nonzero(off) >= len(off):
            off[:] = False  # then it is not they that are wrong
        before = self.excluded[channel]
        self.excluded[channel] = off | (before & (np.abs(self.mean_m[channel]) > 0.5 * limit))
        for number in channel[before | off].tolist():
            latch = self.latches.get(number)
            if latch is not None:
                latch.judge(stamp_ns, bool(self.excluded[number]), abs(float(self.mean_m[number])), latch.parties[0])
        return channel[self.excluded[channel] & ~before]


class ScaleWatch:
    """Ratio of the codes' changes to those of the carriers: its median over the last pairs, which slips hardly move.

    Attributes
    ----------
    latch : Latch
        Holds the contradiction.
    trusted : bool
        Whether the carriers have been seen to change as the codes do; without motion nobody can tell.
    """

    def __init__(self, source: str) -> None:
        self.latch = Latch(SCALE, (source, "its code"), "times", begin_s=1.0)
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.latch.clear()
        self.trusted = False
        self._from: dict[int, tuple[int, float, float, float]] = {}
        self._ratios: deque[float] = deque(maxlen=PAIRS)

    def take(self, epoch: CarrierEpoch, rows: np.ndarray, channel: np.ndarray) -> None:
        """Take the carriers of an epoch with codes beside them; a pair ends when the range has changed by enough."""
        stamp_ns, wave = epoch.stamp_ns, epoch.wavelength_m[rows]
        columns = channel, epoch.code_m[rows], epoch.carrier_cycles[rows] * wave, wave, epoch.code_valid[rows]
        for number, code_m, carrier_m, length, valid in zip(*(column.tolist() for column in columns), strict=True):
            if not valid:
                continue
            first = self._from.get(number)
            if first is None or length != first[3] or not 0 < stamp_ns - first[0] <= LONGEST_NS:
                self._from[number] = stamp_ns, code_m, carrier_m, length
            elif max(abs(code_m - first[1]), abs(carrier_m - first[2])) >= CHANGE_M:
                self._from[number] = stamp_ns, code_m, carrier_m, length
                self._add(stamp_ns, carrier_m - first[2], code_m - first[1])

    def _add(self, stamp_ns: int, carrier_m: float, code_m: float) -> None:
        self._ratios.append(code_m / carrier_m if carrier_m else math.inf)
        if len(self._ratios) < FEWEST:
            return
        factor = median(self._ratios)
        self.trusted = abs(factor - 1.0) <= FACTOR
        if len(self._ratios) > PAIRS // 2:
            advice = "the wavelength is wrong, or the carrier is in metres"
            self.latch.judge(stamp_ns, not self.trusted, factor, self.latch.parties[0], advice)
