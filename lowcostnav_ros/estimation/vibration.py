"""Vibration: how many times its declared white noise an inertial unit is flown with, by what its samples show.

An engine or a road shakes a unit by many times the white noise of its data sheet.  Most of that is motion, which a strapdown
integration bears; what scale factors, axes out of square, aliases and a loose mount make of the rest walks off like noise.  Its size comes
and goes with the shaking, so that neither a data sheet nor innovations of minutes past tell it, and in an outage nothing else does.  A turn
or a climb is smooth over a quarter of a second and shakes nothing; nor does a bias, or a receiver that lies.
"""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import ImuBlock

BIN_NS, BINS = 50_000_000, 40.0
"""Samples are averaged over so much, by when a low-pass filter in the unit has settled; their scatter over so many means: two seconds."""
FOURTH, FOURTH_POWER = np.array([1.0, -4.0, 6.0, -4.0, 1.0]), 70.0
"""A fourth difference of white means has so many times their variance."""
SHARE = 1.0 / 3.0
"""Of the shaking, what walks off.  With the shaking itself, the errors in outages of a recorded drive are a third of their sigmas."""
PERIOD_NS = 1_000_000_000


@kernel
def shake(stamps, force, rate, first, end, at, total, means, power):
    """Take samples ``first`` up to ``end`` in, in place, the same however they are cut into blocks.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
    force, rate : ndarray, shape (n, 3)
    at : ndarray of int64, shape (3,)
        Interval that is being filled, means in a row before it, fourth differences so far.
    total : ndarray, shape (7,)
        Sums over its samples, and their number.
    means : ndarray, shape (5, 6)
        Latest means, the oldest first.
    power : ndarray, shape (6,)
        Mean square of fourth differences.
    """
    for k in range(first, end):
        now = stamps[k] // BIN_NS
        if now != at[0]:
            at[1] = at[1] + 1 if total[6] > 0.0 else 0
            for j in range(6):
                for i in range(4):
                    means[i, j] = means[i + 1, j]
                means[4, j] = total[j] / max(total[6], 1.0)
            if at[1] >= 5:
                at[2] += 1
                share = max(1.0 / at[2], 1.0 / BINS)
                for j in range(6):
                    d = 0.0
                    for i in range(5):
                        d += FOURTH[i] * means[i, j]
                    power[j] += share * (d * d - power[j])
            if now != at[0] + 1:
                at[1] = 0
            at[0] = now
            total[:] = 0.0
        for j in range(3):
            total[j] += force[k, j]
            total[3 + j] += rate[k, j]
        total[6] += 1.0


class Vibration:
    """How many times its declared white noise a unit is flown with.

    Parameters
    ----------
    density : ndarray, shape (6,)
        Declared white noise of accelerometers and gyros, m/s^2/sqrt(Hz) and rad/s/sqrt(Hz).

    Attributes
    ----------
    accel, gyro : float
        Factors on it, at least 1, by the axis that is shaken most.
    """

    def __init__(self, density: np.ndarray) -> None:
        self._declared = density
        self._at, self._total, self._means, self._power = np.zeros(3, np.int64), np.zeros(7), np.zeros((5, 6)), np.zeros(6)
        self._looked, self.accel, self.gyro = 0, 1.0, 1.0

    def take(self, block: ImuBlock, first: int = 0, end: int | None = None) -> None:
        """Take in samples ``first`` up to ``end``."""
        samples = block.stamps_ns, block.specific_force_b, block.angular_rate_b, first, len(block) if end is None else end
        shake(*samples, self._at, self._total, self._means, self._power)

    def look(self, t_ns: int) -> bool:
        """Find the factors anew, once a second; return whether they have changed."""
        if t_ns // PERIOD_NS == self._looked:
            return False
        self._looked, before = t_ns // PERIOD_NS, (self.accel, self.gyro)
        shaken = (SHARE * self.shaking() / self._declared).tolist()
        self.accel, self.gyro = max(1.0, *shaken[:3]), max(1.0, *shaken[3:])
        return before != (self.accel, self.gyro)

    def shaking(self) -> np.ndarray:
        """The shaking of each axis (6,) as a density, in the unit of the declared one."""
        return np.sqrt(self._power * (1e-9 * BIN_NS / FOURTH_POWER))

    def level(self) -> np.ndarray:
        """Factors (9,) on the sigmas of what drives position, velocity and attitude."""
        return np.repeat([1.0, self.accel, self.gyro], 3)

    def words(self) -> str:
        """What it is flown with, in words; empty where that is as declared."""
        if max(self.accel, self.gyro) == 1.0:
            return ""
        return f"shaken: accelerometer noise {self.accel:.1f}, gyro noise {self.gyro:.1f} times the settings'"
