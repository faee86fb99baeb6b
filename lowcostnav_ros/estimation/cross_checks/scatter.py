"""A source that scatters more than it states."""

import math

from lowcostnav_ros.estimation.cross_checks.latch import Latch

SCATTER_S, SCATTER = 10.0, 2.5
"""Scatter beyond so many stated sigmas, over such a time, is a contradiction."""
LARGEST = 30.0
"""Most that one measurement counts for at first: a jump is no scatter."""
UNDERSTATED = "scatter exceeds the stated sigma"


class ScatterCheck(Latch):
    """What a source scatters, in sigmas that it states, over some seconds."""

    def __init__(self, source: str) -> None:
        super().__init__(UNDERSTATED, (source, "its stated sigma"), "sigma", begin_s=5.0, end_s=30.0)

    def clear(self) -> None:
        """Forget all."""
        super().clear()
        self._scatter2 = 1.0

    @property
    def noise_factor(self) -> float:
        """By what its stated variance is to be multiplied."""
        return self.held.size**2 if self.held is not None else 1.0

    def take(self, stamp_ns: int, span_s: float, squared: float, *, counts: bool = True) -> None:
        """Take the square of what a measurement, ``span_s`` after the one before, strays by, over what it states: 1 on average.

        ``counts``: whether most of them stray, as white noise does.
        """
        weight = min(1.0, span_s / SCATTER_S)
        largest = max(LARGEST, 4.0 * self._scatter2)
        self._scatter2 += weight * (min(squared, largest) - self._scatter2)
        size = math.sqrt(self._scatter2)
        advice = f"set gps.sigma_scale to {size:.1f} or more"
        self.judge(stamp_ns, counts and size > (SCATTER if self.held is None else 0.7 * SCATTER), size, self.parties[0], advice)
