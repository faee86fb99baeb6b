"""An axis of the gyros that does not change while others do: dead, or at the end of its range."""

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.estimation.cross_checks.latch import Latch

STILL_NS = 1_000_000_000
STEPS = 8.0
"""Steps of its own that another axis has moved by meanwhile: it is no coarse gyro in calm air."""


class StillAxisCheck(Latch):
    """Which axes of the gyros stand still, s.

    One that never moved says nothing: a vehicle in a plane, simulated without noise, has such.

    Attributes
    ----------
    axes : ndarray (k,)
        Those that stand still while the contradiction lasts.
    """

    def __init__(self, imu: str) -> None:
        super().__init__("gyro axis does not change", (imu, "the other axes"), "s", begin_s=0.0, end_s=1.0)

    def clear(self) -> None:
        """Forget all."""
        super().clear()
        self.axes = np.zeros(0, dtype=int)
        self._last: np.ndarray | None = None
        self._since_ns, self._moved = np.zeros(3, dtype=np.int64), np.zeros(3, dtype=bool)
        self._low, self._high, self._step = np.zeros((3, 3)), np.zeros((3, 3)), np.full((3, 3), np.inf)  # since then; of each axis

    def take(self, block: ImuBlock) -> None:
        """Take samples in order; what is found does not depend on how they are cut into blocks."""
        rates, stamps = block.angular_rate_b, block.stamps_ns
        if self._last is None:
            self._last, self._since_ns[:] = rates[0], stamps[0]
            self._begin(np.arange(3), rates[0])
        changed = np.diff(rates, axis=0, prepend=self._last[None]) != 0.0
        if changed.all() and self.held is None:  # nearly always
            self._since_ns[:], self._moved[:] = stamps[-1], True
            self._begin(np.arange(3), rates[-1])
        else:
            for stamp_ns, rate, moved in zip(stamps.tolist(), rates, changed, strict=True):
                self._add(stamp_ns, rate, moved)
        self._last = rates[-1]

    def _begin(self, axes: np.ndarray, rate: np.ndarray) -> None:
        """Begin to look at what the others do while these stand still."""
        self._low[axes], self._high[axes], self._step[axes] = rate, rate, np.inf

    def _add(self, stamp_ns: int, rate: np.ndarray, moved: np.ndarray) -> None:
        last = self._last
        self._last = rate
        self._since_ns[moved], self._moved = stamp_ns, self._moved | moved
        steps = np.where(moved, np.abs(rate - last), np.inf)
        self._low, self._high = np.minimum(self._low, rate), np.maximum(self._high, rate)
        self._step = np.minimum(self._step, steps)
        self._begin(np.flatnonzero(moved), rate)
        turning = ((self._high - self._low) > STEPS * self._step).any(axis=1)
        still = np.flatnonzero((stamp_ns - self._since_ns >= STILL_NS) & turning & self._moved)
        if len(still):
            self.axes = still
        words = " and ".join("xyz"[axis] for axis in self.axes)
        lasted_s = 1e-9 * (stamp_ns - int(self._since_ns[self.axes].min())) if len(self.axes) else 0.0
        self.judge(stamp_ns, len(still) > 0, lasted_s, self.parties[0], f"{words}: dead, or beyond its range")
        if self.held is None:
            self.axes = still
