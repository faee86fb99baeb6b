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

from lowcostnav_ros.aids._carrier_channels import MOST
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.estimation.carrier_model import row_variances
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

    def take(
        self, stamp_ns: int, P: np.ndarray, H: np.ndarray, y: np.ndarray, valid: np.ndarray, channel: np.ndarray, sigma_m: float
    ) -> np.ndarray:
        """Take the residuals y (m,) of the valid codes of an epoch with their rows H (m, n); return channels excluded from now on."""
        of_all = self.mean_m, self._count, self.excluded
        fell, looked_at = take_codes(P, H, y, valid, channel, of_all, (sigma_m, self._slow_m))
        for number in looked_at.tolist():
            latch = self.latches.get(number)
            if latch is not None:
                latch.judge(stamp_ns, bool(self.excluded[number]), abs(float(self.mean_m[number])), latch.parties[0])
        return fell


@kernel
def take_codes(P, H, y, valid, channel, of_all, sigmas):
    """Add an epoch to the means of the codes and judge them, see :class:`CodeWatch`.

    ``of_all``: means, counts and exclusions of all channels, changed in place; ``sigmas``: white and slow, m.  Returns the channels that
    are excluded from now on, and those that were or might have been.
    """
    (mean, count, excluded), (white, slow), rows = of_all, sigmas, np.flatnonzero(valid)
    S = row_variances(P, H[rows], np.full(rows.shape[0], white * white))
    off, limit = np.zeros(rows.shape[0], dtype=np.bool_), np.empty(rows.shape[0])
    for i in range(rows.shape[0]):
        c = channel[rows[i]]
        count[c] = min(count[c] + 1, WINDOW)
        mean[c] += (y[rows[i]] - mean[c]) / count[c]
        known = max(S[i] - white * white, 0.0)
        limit[i] = SIGMAS * np.sqrt(white * white / count[c] + known) + SLOW_SIGMAS * slow
        off[i] = count[c] == WINDOW and abs(mean[c]) > limit[i]
    if 2 * np.count_nonzero(off) >= rows.shape[0]:
        off[:] = False  # then it is not they that are wrong
    fell, looked_at = np.zeros(rows.shape[0], dtype=np.bool_), np.zeros(rows.shape[0], dtype=np.bool_)
    for i in range(rows.shape[0]):
        c = channel[rows[i]]
        looked_at[i] = excluded[c] or off[i]
        fell[i] = off[i] and not excluded[c]
        excluded[c] = off[i] or (excluded[c] and abs(mean[c]) > 0.5 * limit[i])
    return channel[rows[fell]], channel[rows[looked_at]]


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
        self._from_ns, self._from = np.zeros(MOST, dtype=np.int64), np.zeros((MOST, 3))  # code, carrier and wavelength, m
        self._ratios: deque[float] = deque(maxlen=PAIRS)

    def take(self, epoch: CarrierEpoch, rows: np.ndarray, channel: np.ndarray) -> None:
        """Take the carriers of an epoch with codes beside them; a pair ends when the range has changed by enough."""
        now = epoch.code_m[rows], epoch.carrier_cycles[rows], epoch.wavelength_m[rows], epoch.code_valid[rows]
        for code_m, carrier_m in pairs(self._from_ns, self._from, epoch.stamp_ns, channel, now).tolist():
            self._add(epoch.stamp_ns, carrier_m, code_m)

    def _add(self, stamp_ns: int, carrier_m: float, code_m: float) -> None:
        self._ratios.append(code_m / carrier_m if carrier_m else math.inf)
        if len(self._ratios) < FEWEST:
            return
        factor = median(self._ratios)
        self.trusted = abs(factor - 1.0) <= FACTOR
        if len(self._ratios) > PAIRS // 2:
            advice = "the wavelength is wrong, or the carrier is in metres"
            self.latch.judge(stamp_ns, not self.trusted, factor, self.latch.parties[0], advice)


@kernel
def pairs(from_ns, start, stamp_ns, channel, now):
    """Changes of code and carrier (k, 2), m, of the channels that end a pair; they, and those without a beginning, begin another."""
    code, cycles, wave, valid = now
    out, found = np.empty((channel.shape[0], 2)), 0
    for k in range(channel.shape[0]):
        if not valid[k]:
            continue
        c, carrier_m = channel[k], cycles[k] * wave[k]
        is_new = wave[k] != start[c, 2] or not 0 < stamp_ns - from_ns[c] <= LONGEST_NS
        if not is_new and max(abs(code[k] - start[c, 0]), abs(carrier_m - start[c, 1])) >= CHANGE_M:
            out[found, 0], out[found, 1] = code[k] - start[c, 0], carrier_m - start[c, 1]
            found, is_new = found + 1, True
        if is_new:
            from_ns[c], start[c, 0], start[c, 1], start[c, 2] = stamp_ns, code[k], carrier_m, wave[k]
    return out[:found]
