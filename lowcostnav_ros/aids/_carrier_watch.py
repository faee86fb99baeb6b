"""Is a transmitter in step with the others, and does a carrier count what it says it counts?

A code that is off by more, on the mean of its last epochs, than its noise and its slow error explain belongs to a transmitter that has lost
its synchronisation or stands elsewhere than the table says; while most codes agree, it is not used until it agrees again.

A carrier, times its wavelength, changes as the code does.  Where all of them together change by another factor, they are in metres or the
wavelength is wrong.
"""

from collections import deque
from statistics import median

import numpy as np

from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.estimation.cross_checks.latch import Latch

WINDOW, SIGMAS, SLOW_SIGMAS = 50, 4.0, 3.0
OUT_OF_STEP = "transmitter out of step"
SCALE = "carrier and code disagree in scale"
SPAN_NS = 5_000_000_000
PAIRS, CHANGE_M, FACTOR = 61, 60.0, 0.1
"""Pairs that are kept, the change that a pair must show, and by how much the factor may differ from one: a code is off by metres."""


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
    """Ratio of the codes' changes over seconds to those of the carriers: its median over the last pairs, which slips hardly move."""

    def __init__(self, source: str) -> None:
        self.latch = Latch(SCALE, (source, "its code"), "times", begin_s=1.0)
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.latch.clear()
        self._from: dict[int, tuple[int, float, float, float]] = {}
        self._ratios: deque[float] = deque(maxlen=PAIRS)

    def take(self, epoch: CarrierEpoch, rows: np.ndarray, channel: np.ndarray) -> None:
        """Take the carriers of an epoch with codes beside them."""
        stamp_ns = epoch.stamp_ns
        for row, number in zip(rows.tolist(), channel.tolist(), strict=True):
            first, wave = self._from.get(number), float(epoch.wavelength_m[row])
            if first is not None and 0 < stamp_ns - first[0] < SPAN_NS and wave == first[3] or not epoch.code_valid[row]:
                continue
            code_m, carrier_m = float(epoch.code_m[row]), float(epoch.carrier_cycles[row]) * wave
            self._from[number] = stamp_ns, code_m, carrier_m, wave
            if first is not None and SPAN_NS <= stamp_ns - first[0] < 2 * SPAN_NS and wave == first[3]:
                self._add(stamp_ns, carrier_m - first[2], code_m - first[1])

    def _add(self, stamp_ns: int, carrier_m: float, code_m: float) -> None:
        if max(abs(carrier_m), abs(code_m)) < CHANGE_M or carrier_m == 0.0:
            return
        self._ratios.append(code_m / carrier_m)
        if len(self._ratios) > PAIRS // 2:
            factor = median(self._ratios)
            advice = "the wavelength is wrong, or the carrier is in metres"
            self.latch.judge(stamp_ns, abs(factor - 1.0) > FACTOR, factor, self.latch.parties[0], advice)
