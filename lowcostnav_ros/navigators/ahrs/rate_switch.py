"""Manoeuvre switch by body rates: when the accelerometers and the magnetometer may be believed.

The source's switch (Gebre-Egziabher 2004, equation 4.67) differences the estimated heading over the last second.  A roll-in takes half a
second or more to show there, and a levelling correction that falls into it pulls the estimate back to level for the whole turn.  The
gyros see the same roll-in in a tenth of a second.  So this switch opens on roll and pitch rate as well as on yaw rate and load, keeps
open below smaller limits (hysteresis), and closes only after a quiet time (hold-off).
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.navigators.ahrs.settings import LevelSettings, RateSwitchSettings
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

MEMORY = 5


def switch_limits(level: LevelSettings, rates: RateSwitchSettings) -> np.ndarray:
    """Limits as :func:`follow_switch` reads them: yaw and tilt rate [rad/s], load [g], release share, hold-off, two time constants [s]."""
    angular = (level.yaw_rate_dps * DEGREE, rates.tilt_rate_dps * DEGREE)
    return np.array([*angular, level.force_g, level.release, rates.hold_off_s, level.filter_s, rates.tilt_filter_s])


@kernel
def follow_switch(memory, limits, f, w, down_b, dt):
    """Take one sample in; return True while flight counts as steady.

    Parameters
    ----------
    memory : ndarray, shape (5,)
        Changed in place: filtered yaw rate, load minus one [g], roll and pitch rate [rad/s], quiet time so far [s].
    limits : ndarray, shape (7,)
        Of :func:`switch_limits`.
    f, w : ndarray, shape (3,)
        Specific force, m/s^2, and rate less the estimated gyro bias, rad/s, FRD.
    down_b : ndarray, shape (3,)
        The vertical in body axes, last row of C_nb.
    dt : float
    """
    slow, fast = -math.expm1(-dt / limits[5]), -math.expm1(-dt / limits[6])
    load = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]) / STANDARD_GRAVITY - 1.0
    memory[0] += slow * (w[0] * down_b[0] + w[1] * down_b[1] + w[2] * down_b[2] - memory[0])
    memory[1] += slow * (load - memory[1])
    memory[2] += fast * (w[0] - memory[2])
    memory[3] += fast * (w[1] - memory[3])
    share = 1.0 if memory[4] > 0.0 else limits[3]
    turning = abs(memory[0]) > share * limits[0]
    tilting = max(abs(memory[2]), abs(memory[3])) > share * limits[1]
    loaded = abs(memory[1]) > share * limits[2]
    memory[4] = 0.0 if turning or tilting or loaded else memory[4] + dt
    return memory[4] >= limits[4]


@kernel
def follow_switch_block(t_ns, memory, limits, stamps, f, w, start, stop, down_b, gyro_bias, total):
    """Take samples ``start`` to ``stop`` of a block in; sum the specific force of the steady ones.

    ``total`` (5,), changed in place: integral of specific force (3) m/s, seconds, and 1 while every sample was steady.
    """
    for k in range(start, stop):
        dt = (stamps[k] - t_ns) * 1e-9
        if dt <= 0.0:
            continue
        steady = follow_switch(memory, limits, f[k], w[k] - gyro_bias, down_b, dt)
        for i in range(3):
            total[i] += f[k, i] * dt
        total[3] += dt
        if not steady:
            total[4] = 0.0
        t_ns = stamps[k]
    return t_ns


class RateSwitch:
    """Follow the inertial samples; say whether flight has been steady, and the mean specific force of that time."""

    def __init__(self, level: LevelSettings, rates: RateSwitchSettings) -> None:
        self.limits = switch_limits(level, rates)
        self.restart(0)

    def restart(self, t_ns: int) -> None:
        """Begin again, steady only after a hold-off."""
        self._t_ns = t_ns
        self._memory = np.zeros(MEMORY)
        self.begin_span()

    def begin_span(self) -> None:
        """Begin a new mean."""
        self._total = np.array([0.0, 0.0, 0.0, 0.0, 1.0])

    @property
    def is_steady(self) -> bool:
        """Whether flight counts as steady now."""
        return bool(self._memory[4] >= self.limits[4])

    def mean_force(self) -> np.ndarray | None:
        """Mean specific force (3,), m/s^2, FRD, since :meth:`begin_span`; None where a part of it was not steady."""
        return self._total[:3] / self._total[3] if self._total[4] and self._total[3] > 0.0 else None

    def follow(self, block, start: int, stop: int, C_nb: np.ndarray, gyro_bias: np.ndarray) -> None:
        """Take samples ``start`` to ``stop`` of an ImuBlock in, with the attitude and gyro bias now estimated."""
        self._t_ns = follow_switch_block(
            *(self._t_ns, self._memory, self.limits, block.stamps_ns, block.specific_force_b, block.angular_rate_b, start, stop),
            *(np.ascontiguousarray(C_nb[2]), gyro_bias, self._total),
        )
