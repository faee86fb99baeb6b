"""The receiver's clock from epoch to epoch: resets by whole milliseconds, single pseudoranges that jump, a clock that runs away."""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.gnss.gps_time import SECOND
from lowcostnav_ros.gnss.raw_epoch import RawEpoch
from lowcostnav_ros.gnss.signals import SPEED_OF_LIGHT, name

MILLISECOND_M = SPEED_OF_LIGHT * 1e-3
MAX_RATE_MPS = 1500.0
"""Largest range rate with receiver motion and clock drift, m/s: bounds what a pseudorange without Doppler may change by."""


@dataclass(frozen=True, slots=True)
class ClockReport:
    """What changed since the last epoch.

    Attributes
    ----------
    reset_ms : int
        Whole milliseconds all pseudoranges jumped by together.
    jumped : tuple of (str, int)
        Satellites whose pseudorange jumped alone.
    sentences : tuple of str
        One for each finding.
    """

    reset_ms: int = 0
    jumped: tuple[tuple[str, int], ...] = ()
    sentences: tuple[str, ...] = ()


class ClockWatch:
    """Compare each epoch with the one before.

    Parameters
    ----------
    max_drift_mps : float
        Clock drift above which the clock runs away, m/s; 3000 m/s are ten parts in a million, four times a common crystal's limit.
    """

    def __init__(self, max_drift_mps: float = 3000.0) -> None:
        self.max_drift_mps = max_drift_mps
        self._last: RawEpoch | None = None
        self._last_clock: tuple[int, float] | None = None
        self._reset_m = 0.0

    def observe(self, epoch: RawEpoch) -> ClockReport:
        """Look at the raw pseudoranges of the next epoch; without Dopplers gaps above 100 s are too long to decide."""
        last, self._last = self._last, epoch
        if last is None:
            return ClockReport()
        jumps = _jumps_ms(last, epoch)
        if not jumps:
            return ClockReport()
        counts = Counter(jumps.values())
        most = max(counts.values())
        together = min((k for k, count in counts.items() if count == most), key=abs)
        if len(jumps) < 2:
            together = 0  # one satellite cannot separate a reset from a jump of its own: it is excluded
        jumped = tuple(satellite for satellite, k in jumps.items() if k != together)
        self._reset_m += together * MILLISECOND_M
        sentences = [f"The receiver set its clock by {together} ms."] if together else []
        sentences += [f"The pseudorange of {name(*s)} jumped by {jumps[s] - together} ms; leave it out." for s in jumped]
        return ClockReport(together, jumped, tuple(sentences))

    def solved(self, gps: int, clock_m: float) -> str:
        """Look at the clock of the next fix, m; returns a sentence when it runs away, else an empty text."""
        steady = clock_m - self._reset_m
        last, self._last_clock = self._last_clock, (gps, steady)
        if last is None or gps <= last[0]:
            return ""
        drift = (steady - last[1]) / ((gps - last[0]) / SECOND)
        if abs(drift) <= self.max_drift_mps:
            return ""
        return f"The receiver clock runs away at {drift:.0f} m/s ({drift / SPEED_OF_LIGHT * 1e6:.1f} ppm); check the receiver."


def _jumps_ms(last: RawEpoch, epoch: RawEpoch) -> dict[tuple[str, int], int]:
    """Whole milliseconds by which each common satellite's pseudorange changed beyond its range rate; empty when that is not observable."""
    dt = (epoch.gps_ns - last.gps_ns) / SECOND
    before = {satellite: k for k, satellite in enumerate(last.satellites())}
    jumps = {}
    for k, satellite in enumerate(epoch.satellites()):
        j = before.get(satellite)
        if j is None or dt <= 0.0:
            continue
        rate = 0.5 * (last.doppler_mps[j] + epoch.doppler_mps[k])
        unknown = MAX_RATE_MPS * dt if math.isnan(rate) else 50.0 * dt  # a manoeuvre between the Dopplers
        if unknown < 0.5 * MILLISECOND_M:
            change = epoch.pseudorange_m[k] - last.pseudorange_m[j] - (0.0 if math.isnan(rate) else rate * dt)
            jumps[satellite] = int(np.round(change / MILLISECOND_M))
    return jumps
