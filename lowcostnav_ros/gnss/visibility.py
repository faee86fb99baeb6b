"""Which satellites a receiver uses: the elevation mask, and a schedule of how many (Solimeno 2007, sections 6.1 and 7.4.2.2)."""

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.selection import select

FULL_AVAILABILITY = (0.0, 8, 120.0, 9, 180.0, 8, 264.0, 6, 330.0, 8, 420.0, 5, 480.0, 8)
"""Start (s) and number, over and over: five to nine satellites, eight for most of the time (Figure 7.7, read off)."""
FOUR_GAPS = (0.0, 6, 120.0, 3, 160.0, 6, 240.0, 2, 280.0, 6, 360.0, 1, 400.0, 6, 480.0, 0, 520.0, 6)
"""Six satellites but for four gaps of 40 s with 3, 2, 1 and none (Figure 7.21; the starts are ours)."""


@dataclass(frozen=True, slots=True)
class Schedule:
    """How many satellites may be used from which time on."""

    starts_s: tuple[float, ...]
    counts: tuple[int, ...]

    @classmethod
    def of(cls, flat: Sequence[float]) -> "Schedule":
        """Build from ``[start, count, start, count, ...]``; an empty list sets no limit.

        Raises
        ------
        GnssError
            For an odd number of entries, starts that do not increase, or counts that are no whole numbers.
        """
        starts, counts = tuple(flat[0::2]), tuple(flat[1::2])
        if len(starts) != len(counts):
            raise GnssError("A satellite schedule needs pairs of start and count; add the missing count.")
        if any(b <= a for a, b in zip(starts, starts[1:], strict=False)):
            raise GnssError("The starts of a satellite schedule must increase; sort them.")
        if any(c < 0 or c != int(c) for c in counts):
            raise GnssError("The counts of a satellite schedule are whole numbers, zero or more; correct them.")
        return cls(tuple(float(s) for s in starts), tuple(int(c) for c in counts))

    def at(self, elapsed_s: float) -> int | None:
        """Largest number of satellites at a time, or None for no limit (before the first start)."""
        index = bisect.bisect_right(self.starts_s, elapsed_s) - 1
        return None if index < 0 else self.counts[index]


def above(elevation: np.ndarray, mask: float = 0.0) -> np.ndarray:
    """Indices of the satellites at or above an elevation ``mask``, rad."""
    return np.flatnonzero(np.asarray(elevation) >= mask)


def choose(los: np.ndarray, elevation: np.ndarray, count: int | None) -> np.ndarray:
    """Indices, sorted, of the satellites to use: of smallest GDOP from four on, the highest below four.

    Parameters
    ----------
    los : ndarray, shape (n, 3)
    elevation : ndarray, shape (n,)
        Rad.
    count : int or None
        Wanted number; None uses all.
    """
    if count is None or count >= len(los):
        return np.arange(len(los))
    if count >= 4:
        return select(los, count)
    return np.sort(np.argsort(-np.asarray(elevation), kind="stable")[:count])
