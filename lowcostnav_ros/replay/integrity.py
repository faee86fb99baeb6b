"""Integrity over a replay: how long each verdict held, what was excluded when, and whether an error passed its protection level."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from lowcostnav_ros.base.measurements import Integrity, NavSolution
from lowcostnav_ros.replay.metrics import Errors
from lowcostnav_ros.replay.result import Alarm, Exclusion, IntegritySummary

MAX_LISTED = 50
"""Exclusions listed one by one; more are counted."""
GAP_S = 2.0
"""A verdict holds for no longer than this without a further solution."""


class IntegrityRecord:
    """What one navigator's integrity tests found; empty for a navigator that has none."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.exclusions: list[Exclusion] = []
        self.exclusion_count = 0
        self.alarm: Alarm | None = None
        self.compared = self.beyond = 0
        self.largest_share = 0.0
        self._levels: dict[int, float] = {}
        self._last: tuple[int, Integrity] | None = None

    def add(self, solutions: Sequence[NavSolution]) -> None:
        """Take fused solutions in, in order of stamps."""
        for solution in solutions:
            integrity = solution.integrity
            if integrity is None:
                continue
            last_ns, last = self._last or (solution.stamp_ns, integrity)
            self.seconds[last.verdict] += min(GAP_S, 1e-9 * (solution.stamp_ns - last_ns))
            new = integrity.excluded.keys() - (last.excluded.keys() if self._last else ())
            self.exclusion_count += len(new)
            listed = [Exclusion(1e-9 * solution.stamp_ns, satellite, integrity.excluded[satellite]) for satellite in new]
            self.exclusions += listed[: MAX_LISTED - len(self.exclusions)]
            if integrity.alarm and self.alarm is None:
                self.alarm = Alarm(1e-9 * (integrity.alarm_ns or 0), integrity.alarm)
            if integrity.hpl_m is not None:
                self._levels[solution.stamp_ns] = integrity.hpl_m
            self._last = solution.stamp_ns, integrity

    def add_errors(self, errors: Errors) -> None:
        """Compare horizontal errors with the protection level of their stamp."""
        horizontal = np.hypot(errors.axis("north_m"), errors.axis("east_m"))
        for stamp, error in zip(errors.stamps_ns.tolist(), horizontal.tolist(), strict=True):
            level = self._levels.pop(stamp, None)
            if level is not None and np.isfinite(error):
                self.compared += 1
                self.beyond += error > level
                self.largest_share = max(self.largest_share, error / level)
        if len(errors):
            newest = int(errors.stamps_ns[-1])
            self._levels = {stamp: level for stamp, level in self._levels.items() if stamp > newest}

    def result(self) -> IntegritySummary | None:
        """What they found; None without integrity tests."""
        if self._last is None:
            return None
        share = self.largest_share if self.compared else None
        exclusions = tuple(self.exclusions), self.exclusion_count
        return IntegritySummary(dict(self.seconds), *exclusions, self.alarm, self.compared, int(self.beyond), share)
