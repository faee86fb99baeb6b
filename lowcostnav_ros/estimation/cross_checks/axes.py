"""Gravity against the axes of the IMU: no aircraft flies on its back for long."""

import numpy as np

from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

SMOOTHING_S = 10.0
OVER = 0.5
"""Share of gravity by which the mean specific force must point down through the floor."""
UPSIDE_DOWN = np.eye(3) * np.pi**2
"""What is added to the covariance of an attitude when nobody knows which side of the IMU is up, rad^2."""


class AxesCheck(Latch):
    """Mean specific force along the vertical axis, m/s^2."""

    def __init__(self, imu: str) -> None:
        super().__init__("gravity and IMU axes disagree", (imu, "gravity"), "m/s^2", begin_s=10.0, end_s=10.0)

    def clear(self) -> None:
        """Forget all."""
        super().clear()
        self._mean, self._last_ns = -STANDARD_GRAVITY, 0

    def begin(self, stamp_ns: int, force_z: float) -> None:
        """Take the mean of an alignment, which lasts: nobody aligns on his back."""
        self._mean, self._last_ns = force_z, stamp_ns - self.begin_ns
        self._judge(self._last_ns)
        self._judge(stamp_ns)
        self._last_ns = stamp_ns

    def take(self, stamp_ns: int, force_z: float) -> None:
        """Take a specific force along the downward axis, m/s^2."""
        span = min(1e-9 * max(stamp_ns - self._last_ns, 0), SMOOTHING_S)
        self._mean += span / SMOOTHING_S * (force_z - self._mean)
        self._last_ns = stamp_ns
        self._judge(stamp_ns)

    @property
    def is_still(self) -> bool:
        """Whether nothing speaks for axes that are wrong."""
        return self.held is None and self._turned_ns is None

    def _judge(self, stamp_ns: int) -> None:
        is_over = self._mean > OVER * STANDARD_GRAVITY
        if not is_over and self.held is None:
            self._turned_ns = None  # nearly always
            return
        advice = f"z reads {-self._mean:.1f} m/s^2: upside down, or forward-right-down axes where forward-left-up is wanted?"
        self.judge(stamp_ns, is_over, self._mean, self.parties[0], advice)
