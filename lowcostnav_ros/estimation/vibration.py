"""Vibration: how many times its declared white noise an inertial unit is flown with, by what its samples show.

An engine or a road shakes a unit by many times the white noise of its data sheet.  Most of that is motion, which a strapdown
integration bears; what scale factors, axes out of square, aliases and a loose mount make of the rest walks off like noise.  Its size comes
and goes with the shaking, so that neither a data sheet nor innovations of minutes past tell it, and in an outage nothing else does.

What walks off is white, of the same density at any frequency; what is motion falls: gusts by -5/3 and faster, for an aircraft is slow to
follow them.  So scatter is seen twice, between means of 50 ms (5 to 10 Hz) and of 10 ms (25 to 50 Hz), and the lesser of the two
counts.  A turn or a climb is smooth over a quarter of a second and shakes neither; nor does a bias, or a receiver that lies.
"""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import ImuBlock

SPANS_NS = np.array([50_000_000, 9_500_000])
"""Samples are averaged over so much at least: slow, by when a low-pass filter in the unit has settled, and fast."""
TRIED_NS = 2_000_000_000
"""Their scatter is of so much time."""
FOURTH, FOURTH_POWER = np.array([1.0, -4.0, 6.0, -4.0, 1.0]), 70.0
"""A fourth difference of white means has so many times their variance."""
FILTERED = 1.0 / 16.0
"""Motion falls to no less from slow to fast (gusts to a fifth); what does was filtered in the unit, and the fast band tells nothing."""
SHARE = 0.4
"""Of the shaking, what walks off: with twice that, the errors in outages of a recorded drive are half their sigmas."""
SPARSE_NS = 25_000_000
"""Samples further apart than this were picked out of faster ones, as autopilots log them: all that shakes is an alias, and walks off."""
PERIOD_NS = 1_000_000_000


@kernel
def shake(stamps, force, rate, first, end, begun, row, total, means, power):
    """Take samples ``first`` up to ``end`` in, in place, the same however they are cut into blocks.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
    force, rate : ndarray, shape (n, 3)
    begun : ndarray of int64, shape (2, 2)
        Slow and fast: when the interval that is being filled began, and how long the one before it was.
    row : ndarray of int64, shape (2, 2)
        Means in a row, fourth differences so far.
    total : ndarray, shape (2, 7)
        Sums over the samples of the interval, and their number.
    means : ndarray, shape (2, 5, 6)
        Latest means, the oldest first.
    power : ndarray, shape (2, 6)
        Mean square of fourth differences, as a density: times the length of an interval.
    """
    for k in range(first, end):
        for s in range(2):
            spent = stamps[k] - begun[s, 0]
            if spent >= SPANS_NS[s]:
                row[s, 0] = row[s, 0] + 1 if 2 * spent <= 3 * begun[s, 1] else 0
                begun[s, 0], begun[s, 1] = stamps[k], spent
                for j in range(6):
                    for i in range(4):
                        means[s, i, j] = means[s, i + 1, j]
                    means[s, 4, j] = total[s, j] / max(total[s, 6], 1.0)
                    total[s, j] = 0.0
                total[s, 6] = 0.0
                if row[s, 0] >= 5:
                    row[s, 1] += 1
                    share = max(1.0 / row[s, 1], spent / TRIED_NS)
                    for j in range(6):
                        d = 0.0
                        for i in range(5):
                            d += FOURTH[i] * means[s, i, j]
                        power[s, j] += share * (d * d * (1e-9 * spent / FOURTH_POWER) - power[s, j])
            for j in range(3):
                total[s, j] += force[k, j]
                total[s, 3 + j] += rate[k, j]
            total[s, 6] += 1.0


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
        self._begun, self._row = np.zeros((2, 2), np.int64), np.zeros((2, 2), np.int64)
        self._total, self._means, self._power = np.zeros((2, 7)), np.zeros((2, 5, 6)), np.zeros((2, 6))
        self._looked, self._share, self.accel, self.gyro = 0, SHARE, 1.0, 1.0

    def take(self, block: ImuBlock, first: int = 0, end: int | None = None) -> None:
        """Take in samples ``first`` up to ``end``."""
        samples = block.stamps_ns, block.specific_force_b, block.angular_rate_b, first, len(block) if end is None else end
        shake(*samples, self._begun, self._row, self._total, self._means, self._power)

    def look(self, t_ns: int) -> bool:
        """Find the factors anew, once a second; return whether they have changed."""
        if t_ns // PERIOD_NS == self._looked:
            return False
        self._looked, before = t_ns // PERIOD_NS, (self.accel, self.gyro)
        if self._row[1, 0] > 0:  # not of a hole
            self._share = 1.0 if self._begun[1, 1] > SPARSE_NS else SHARE
        shaken = (self._share * self.shaking() / self._declared).tolist()
        self.accel, self.gyro = max(1.0, *shaken[:3]), max(1.0, *shaken[3:])
        return before != (self.accel, self.gyro)

    @property
    def due_ns(self) -> int:
        """From when on to look again."""
        return (self._looked + 1) * PERIOD_NS

    def shaking(self) -> np.ndarray:
        """The shaking of each axis (6,) that is white, as a density in the unit of the declared one."""
        slow, fast = np.sqrt(self._power)
        return np.where(fast < FILTERED * slow, slow, np.minimum(slow, fast))

    def level(self) -> np.ndarray:
        """Factors (9,) on the sigmas of what drives position, velocity and attitude."""
        return np.repeat([1.0, self.accel, self.gyro], 3)

    def words(self) -> str:
        """What it is flown with, in words; empty where that is as declared."""
        if max(self.accel, self.gyro) == 1.0:
            return ""
        return f"shaken: accelerometer noise {self.accel:.1f}, gyro noise {self.gyro:.1f} times the settings'"
