"""When was there no GPS? Read off the fixes, or the satellites, that the navigators were given."""

import bisect

import numpy as np

FIX_SATELLITES = 4
"""From so many satellites on an epoch of raw observations is as good as a fix."""
GAP_NS, NEVER_NS = 3_000_000_000, 2**61
"""Without a fix for longer than this, or than :data:`INTERVALS` of its usual intervals, is an outage."""
INTERVALS, KNOWN_BY = 2.5, 25
"""A receiver's usual interval is the median of its first ones; a station that records every 30 s has no outage between."""


class GpsGaps:
    """Keeps the stamps at which fixes stopped and resumed.

    An instant is *without GPS* when the last fix before it is older than :attr:`gap_ns`.  Before the first fix of all a navigator is
    initialising, which is another matter and not counted; between the first two nothing is known of the interval.

    Attributes
    ----------
    intervals : list of (int, int)
        Outages that are over, stamps in ns.
    satellites : dict of int to int
        Start of an outage to the largest number of satellites that was seen in it; only where there are raw observations.
    """

    def __init__(self) -> None:
        self.intervals: list[tuple[int, int]] = []
        self.satellites: dict[int, int] = {}
        self.last_ns: int | None = None
        self._has_fixes = False
        self._usual: list[int] = []

    @property
    def gap_ns(self) -> int:
        """Without a fix for longer than this is an outage."""
        return max(GAP_NS, round(INTERVALS * self._usual[len(self._usual) // 2])) if self._usual else NEVER_NS

    def add_epoch(self, stamp_ns: int, satellites: int) -> None:
        """Take an epoch of raw observations in; without effect where a receiver gives fixes, which are better evidence."""
        if self._has_fixes:
            return
        if satellites >= FIX_SATELLITES:
            self._fixed(stamp_ns)
        elif self.last_ns is not None:
            start = self.last_ns + self.gap_ns
            self.satellites[start] = max(satellites, self.satellites.get(start, 0))

    def add(self, stamp_ns: int) -> None:
        """Take the stamp of a fix in."""
        self._has_fixes = True
        self._fixed(stamp_ns)

    def _fixed(self, stamp_ns: int) -> None:
        if self.last_ns is not None:
            passed_ns, gap_ns = stamp_ns - self.last_ns, self.gap_ns
            if passed_ns > gap_ns:
                self.intervals.append((self.last_ns + gap_ns, stamp_ns))
            else:
                self.satellites.pop(self.last_ns + gap_ns, None)  # a dip too short for an outage
                if passed_ns > 0 and len(self._usual) < KNOWN_BY:
                    bisect.insort(self._usual, passed_ns)
        if self.last_ns is None or stamp_ns > self.last_ns:
            self.last_ns = stamp_ns

    def close(self, end_ns: int) -> None:
        """End the recording: an outage still open lasts until its last stamp."""
        gap_ns = self.gap_ns if self._usual else GAP_NS
        if self.last_ns is not None and end_ns - self.last_ns > gap_ns:
            self.intervals.append((self.last_ns + gap_ns, end_ns))
            self.last_ns = end_ns

    def interval_starts(self, stamps_ns: np.ndarray) -> np.ndarray:
        """Start of the outage each stamp lies in, -1 where there is GPS, shape (n,).

        Parameters
        ----------
        stamps_ns : ndarray of int64, shape (n,)
            None newer than the newest fix that could have been added.
        """
        out = np.full(len(stamps_ns), -1, dtype=np.int64)
        if self.last_ns is None:
            return out
        open_start = self.last_ns + self.gap_ns
        starts = [start for start, _ in self.intervals]
        for row, stamp in enumerate(stamps_ns):
            at = bisect.bisect_right(starts, stamp) - 1
            if stamp > open_start:
                out[row] = open_start
            elif at >= 0 and starts[at] < stamp < self.intervals[at][1]:
                out[row] = starts[at]
        return out
