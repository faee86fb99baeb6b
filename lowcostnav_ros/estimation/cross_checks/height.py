"""Barometric against GPS climb: the difference of the two heights changes with the weather, not within a minute."""

import numpy as np

from lowcostnav_ros.estimation.cross_checks.latch import Latch

SPANS_S = (10.0, 60.0)
MEAN_S = 4.0
SPACING_NS = 900_000_000
FREE_M, SIGMAS = 20.0, 5.0
COLUMN = 0.12
"""Share of a climb by which the temperature of the air column makes pressure altitude differ from height."""


class ClimbCheck(Latch):
    """Pressure altitude and GPS height, m."""

    def __init__(self, pressure: str, fix: str) -> None:
        super().__init__("barometric and GPS climb disagree", (pressure, fix), "m")

    def clear(self) -> None:
        """Forget all."""
        super().clear()
        self._rows = np.zeros((0, 3))
        self._zero_ns, self._last_ns = 0, -SPACING_NS

    def compare(self, stamp_ns: int, altitude: float, height: float, sigma: float) -> None:
        """Compare pressure altitude with a GPS height of a sigma, m."""
        if stamp_ns - self._last_ns < SPACING_NS:
            return
        self._zero_ns, self._last_ns = self._zero_ns or stamp_ns, stamp_ns
        now = 1e-9 * (stamp_ns - self._zero_ns)
        rows = self._rows[self._rows[:, 0] > now - SPANS_S[-1] - MEAN_S]
        self._rows = rows = np.vstack((rows, [now, altitude - height, height]))
        new = rows[rows[:, 0] > now - MEAN_S].mean(axis=0)
        size, ratio = 0.0, 0.0
        for span in SPANS_S:
            old = rows[(rows[:, 0] <= now - span) & (rows[:, 0] > now - span - MEAN_S)]
            if len(old):
                _, before, low = old.mean(axis=0)
                limit = FREE_M + SIGMAS * sigma + COLUMN * abs(new[2] - low)
                if abs(new[1] - before) / limit > ratio:
                    size, ratio = abs(new[1] - before), abs(new[1] - before) / limit
        self.judge(stamp_ns, ratio > 1.0, size)
