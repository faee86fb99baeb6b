"""Manoeuvre switch: whether flight is steady enough for the accelerometers to show the vertical.

A turn is known by its yaw rate and by more than one g (Gebre-Egziabher 2004, section 4.6: 0.5 deg/s and 1.05 g).  In a coordinated
turn the accelerometers show the floor of the cabin, not the vertical, so levelling must stop.  Low-pass and hysteresis keep
gyro noise from flickering the switch.
"""

import numpy as np

from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.navigators.ahrs.kernels import low_pass_motion
from lowcostnav_ros.navigators.ahrs.settings import LevelSettings
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY


class ManoeuvreSwitch:
    """Follow the motion sample by sample; decide at the times :meth:`decide` is called."""

    def __init__(self, settings: LevelSettings) -> None:
        self.settings = settings
        self.restart(0)

    def restart(self, t_ns: int) -> None:
        """Begin again, called steady only after it was seen to be."""
        self._t_ns = t_ns
        self._motion = np.array([0.0, STANDARD_GRAVITY])
        self._down_b = np.array([0.0, 0.0, 1.0])
        self._gyro_bias = np.zeros(3)
        self.steady_since_ns: int | None = None

    def follow(self, block, start: int, stop: int) -> None:
        """Take samples ``start`` to ``stop`` of an ImuBlock in."""
        low_pass_motion(
            *(self._t_ns, self._motion, block.stamps_ns, block.specific_force_b, block.angular_rate_b, start, stop),
            *(self._down_b, self._gyro_bias, self.settings.filter_s),
        )
        self._t_ns = int(block.stamps_ns[stop - 1])

    def decide(self, C_nb: np.ndarray, gyro_bias: np.ndarray) -> None:
        """Judge the motion and take the attitude and gyro bias for the samples to come."""
        self._down_b, self._gyro_bias = C_nb[2].copy(), gyro_bias.copy()
        factor = 1.0 if self.steady_since_ns is not None else self.settings.release
        turning = abs(self._motion[0]) > factor * self.settings.yaw_rate_dps * DEGREE
        loaded = abs(self._motion[1] / STANDARD_GRAVITY - 1.0) > factor * self.settings.force_g
        if turning or loaded:
            self.steady_since_ns = None
        elif self.steady_since_ns is None:
            self.steady_since_ns = self._t_ns

    def steady_over(self, since_ns: int) -> bool:
        """Whether flight has been steady ever since ``since_ns``."""
        return self.steady_since_ns is not None and self.steady_since_ns <= since_ns
