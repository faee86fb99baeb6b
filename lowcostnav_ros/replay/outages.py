"""When was there no GPS? Read off the fixes that the navigators were given."""

import bisect

import numpy as np

GAP_NS = 3_000_000_000
"""Without a fix for longer than this is an outage; receivers of 1 Hz keep well inside it."""


class GpsGaps:
    """Keeps the stamps at which fixes stopped and resumed.

    An instant is *without GPS* when the last fix before it is more than :data:`GAP_NS` older.  Before the first fix of all a
    navigator is initialising, which is another matter and not counted.
    """

    def __init__(self) -> None:
        self.intervals: list[tuple[int, int]] = []
        self.last_ns: int | None = None

    def add(self, stamp_ns: int) -> None:
        """Take the stamp of a fix in."""
        if self.last_ns is not None and stamp_ns - self.last_ns > GAP_NS:
            self.intervals.append((self.last_ns + GAP_NS, stamp_ns))
        if self.last_ns is None or stamp_ns > self.last_ns:
            self.last_ns = stamp_ns

    def close(self, end_ns: int) -> None:
        """End the recording: an outage still open lasts until its last stamp."""
        if self.last_ns is not None and end_ns - self.last_ns > GAP_NS:
            self.intervals.append((self.last_ns + GAP_NS, end_ns))
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
        open_start = self.last_ns + GAP_NS
        starts = [start for start, _ in self.intervals]
        for row, stamp in enumerate(stamps_ns):
            at = bisect.bisect_right(starts, stamp) - 1
            if stamp > open_start:
                out[row] = open_start
            elif at >= 0 and starts[at] < stamp < self.intervals[at][1]:
                out[row] = starts[at]
        return out
