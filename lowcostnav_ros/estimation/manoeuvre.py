"""Manoeuvre switches: whether flight is steady enough for levelling and magnetic heading.

A turn is known by its yaw rate and by more than one g (Gebre-Egziabher 2004, section 4.6: 0.5 deg/s and 1.05 g).  In a coordinated turn
the accelerometers show the floor of the cabin, not the vertical, so levelling must stop.  Low-pass and hysteresis keep gyro noise from
flickering the switch.

:class:`ManoeuvreSwitch` decides at the outputs, on yaw rate and load, for a filter whose covariance weighs what a late decision costs.
:class:`RateSwitch` decides at every sample, for gains that weigh nothing.  The source's own switch (equation 4.67) differences the
estimated heading over the last second.  A roll-in takes half a second or more to show there, and a levelling correction that falls into it
pulls the estimate back to level for the whole turn; the gyros see the same roll-in in a tenth of a second.  So this one opens on roll and
pitch rate as well, keeps open below smaller limits (hysteresis), and closes only after a quiet time (hold-off).

They are two, not one with a further test: one holds the vertical of the last output, the other that of the last sample, one remembers the
specific force, the other its excess over one g, and either change would move decisions near the limits.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation.aiding import SensorSettings
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

MEMORY = 5


@dataclass(frozen=True)
class SteadyLimits(SensorSettings):
    """What counts as steady flight."""

    yaw_rate_dps: float = setting(0.5, "Turning faster than this is manoeuvring.", unit="deg/s", minimum=0.05, maximum=10.0)
    force_g: float = setting(0.05, "Specific force further than this from one g is manoeuvring.", unit="g", minimum=0.005, maximum=0.5)
    filter_s: float = setting(1.0, "Time constant of the low-pass before the switch.", unit="s", minimum=0.05, maximum=20.0)
    release: float = setting(0.7, "Share of the limits below which flight counts as steady again.", minimum=0.1, maximum=1.0)


@dataclass(frozen=True)
class RateSwitchSettings:
    """Manoeuvre switch of the constant-gain filters: what it has beside the yaw rate, load, low-pass and release of ``level``."""

    tilt_rate_dps: float = setting(2.0, "Rolling or pitching faster than this is manoeuvring.", unit="deg/s", minimum=0.1, maximum=50.0)
    tilt_filter_s: float = setting(0.2, "Time constant of the low-pass of roll and pitch rate.", unit="s", minimum=0.01, maximum=10.0)
    hold_off_s: float = setting(1.0, "Flight must be quiet for this long before it counts as steady.", unit="s", minimum=0.0, maximum=60.0)


@kernel
def low_pass_motion(t_ns, motion, stamps, f, w, start, stop, down_b, gyro_bias, tau_s):
    """Low-pass turn rate about the vertical and strength of the specific force, in place.

    Parameters
    ----------
    t_ns : int
        Stamp before sample ``start``.
    motion : ndarray, shape (2,)
        Filtered yaw rate, rad/s, and specific force, m/s^2.
    stamps, f, w, start, stop
        Columns of an inertial block and the range of samples.
    down_b : ndarray, shape (3,)
        The vertical in body axes, last row of ``C_nb``.
    gyro_bias : ndarray, shape (3,)
    tau_s : float
    """
    for k in range(start, stop):
        share = -np.expm1(-(stamps[k] - t_ns) * 1e-9 / tau_s)
        rate, squared = 0.0, 0.0
        for i in range(3):
            rate += (w[k, i] - gyro_bias[i]) * down_b[i]
            squared += f[k, i] * f[k, i]
        motion[0] += share * (rate - motion[0])
        motion[1] += share * (np.sqrt(squared) - motion[1])
        t_ns = stamps[k]


class ManoeuvreSwitch:
    """Follow the motion sample by sample; decide at the times :meth:`decide` is called."""

    def __init__(self, settings: SteadyLimits) -> None:
        self.settings = settings
        self.restart(0)

    def restart(self, t_ns: int) -> None:
        """Begin again, called steady only after it was seen to be."""
        self._t_ns = t_ns
        self._motion = np.array([0.0, STANDARD_GRAVITY])
        self._down_b = np.array([0.0, 0.0, 1.0])
        self._gyro_bias = np.zeros(3)
        self.steady_since_ns: int | None = None

    def follow(self, block: ImuBlock, start: int, stop: int) -> None:
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


def switch_limits(level: SteadyLimits, rates: RateSwitchSettings) -> np.ndarray:
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
    """Follow the inertial samples: whether flight has been steady, and the mean specific force of that time."""

    def __init__(self, level: SteadyLimits, rates: RateSwitchSettings) -> None:
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

    def follow(self, block: ImuBlock, start: int, stop: int, C_nb: np.ndarray, gyro_bias: np.ndarray) -> None:
        """Take samples ``start`` to ``stop`` of an ImuBlock in, with the attitude and gyro bias now estimated."""
        self._t_ns = follow_switch_block(
            *(self._t_ns, self._memory, self.limits, block.stamps_ns, block.specific_force_b, block.angular_rate_b, start, stop),
            *(np.ascontiguousarray(C_nb[2]), gyro_bias, self._total),
        )
