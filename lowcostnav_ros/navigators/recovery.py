"""Recovery with memory: what an inertial navigator does when GPS contradicts it again and again.

The first time position and velocity are reset to GPS, and the sensors' noise is taken for ten times as large for a minute.  A second
time within a minute it is not they that are wrong: attitude and biases are aligned anew in motion, first with ten, then with thirty
times the errors that the IMU's settings state, noise included, and the settings are the suspect.
"""

import math

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.units import DEGREE, MILLI_G
from lowcostnav_ros.cores.imu_errors import ImuSettings, typical
from lowcostnav_ros.cores.inertial import ATT, VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Decision
from lowcostnav_ros.estimation.error_state import Kind, Layout
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

MEMORY_NS = 60_000_000_000
ONE_EVENT_NS = 2_000_000_000
"""Recoveries of position and velocity this close are one."""
AGAIN_S = 3.0
WIDENINGS = (10.0, 30.0)
YOUNG_NS = 30_000_000_000
"""A state that began anew has not found out yet what is bias and what is tilt."""
PACE_NS, ENOUGH = 6_000_000_000, 8
"""The widened noise is judged over so long, and by so many velocities at least."""
AS_SET, TOO_MUCH, MOST = 1.3, 2.0, 10.0
"""Their mean normalised square, 1 in theory, up to which the noise is halved, and beyond which doubled; the most that one counts for."""
CALM_NS = 120_000_000_000
"""Without a rejection for so long, and with biases as the settings say, a fault of the IMU has ended."""
COMPASS_NS, COMPASS_LATEST_NS = 30_000_000_000, 180_000_000_000
HEADING_SIGMA, UNKNOWN_SIGMA = 4.0 * DEGREE, 20.0 * DEGREE
"""The magnetometer waits until GPS has shown the heading to the first, or lost it beyond the second, between these times."""
EXCEEDED, FAR_EXCEEDED = 3.0, 6.0
"""Sigmas of its setting by which a bias is too large: after an alignment anew; and where it was learnt without one."""
ABSURD = {int(Kind.ACCEL_BIAS): (2.0, "another unit, axes"), int(Kind.GYRO_BIAS): (0.09, "rates in deg/s, axes")}
"""No unit's bias is as large, m/s^2 and rad/s (200 mg, 5 deg/s), and what is wrong instead."""
BEYOND_SPOOFING = 20.0
"""Sigmas of its setting that no bias learnt from a spoofer reaches."""
SHORTEST, NOISY = 3, 4.0
"""A run of fewer rejections is none; times the square that white noise leaves of a mean, on average, which may be chance."""
UNNOTICED_S = 1.0
"""An error of the sensors works so long before it shows."""
LASTING_NS = 4_000_000_000
"""A velocity that was rejected so long and passes the gate again has not come back by itself."""
LARGE, VERY_LARGE = 0.5, 1.5
"""Errors of the sensors, m/s^2, that leave no attitude (3 deg) to go on with; and that call for the wider settings at once."""
TURNED_S = 10.0
"""A gyro that has turned the heading beyond what wind explains has taken about so long."""
FASTEST, STEEPEST = 0.5, 0.6
"""Largest rate, rad/s, and tilt, rad, that sensors are taken to be off by."""
NEVER_NS = -(10**18)
SETTINGS = "its settings"
LOOK_NS = 1_000_000_000


def turned_by(layout: Layout, apart: float) -> np.ndarray:
    """Sigmas (n,) of gyros that have turned a heading by ``apart``, rad, unseen, rad/s: turn-on and drift, either may be it."""
    return np.where(layout.kind == int(Kind.GYRO_BIAS), apart / TURNED_S, 0.0)


class Run:
    """Innovations (3,) of velocities that were rejected one after the other."""

    def __init__(self) -> None:
        self.count, self._sum, self._last, self._differences = 0, np.zeros(3), np.zeros(3), 0.0

    def add(self, y: np.ndarray) -> None:
        """Take one in."""
        if self.count:
            self._differences += float(np.sum((y - self._last) ** 2))
        self.count, self._sum, self._last = self.count + 1, self._sum + y, y

    def mean(self) -> float:
        """Length of their mean, less what white noise leaves of one."""
        noise2 = self._differences / (2.0 * (self.count - 1)) / self.count
        return math.sqrt(max(float(np.sum((self._sum / self.count) ** 2)) - NOISY * noise2, 0.0))


class Recovery:
    """Memory of an inertial navigator's recoveries to GPS.

    Parameters
    ----------
    imu : ImuSettings
    layout : Layout
        Error state whose driving noise is widened, in place.

    Attributes
    ----------
    is_lost : bool
        Whether the navigator is to begin anew as soon as it can.
    """

    def __init__(self, imu: ImuSettings, layout: Layout) -> None:
        self._layout = layout
        self._steps, self._factor, self._worst, self._is_fault = 0, 1.0, 0.0, False
        self._tested_ns: int | None = None
        self._since_ns, self._is_far, self._now_ns = NEVER_NS, False, 0
        self._looked, self._looked_steps = -1, 0
        self._usual: np.ndarray | None = None  # what the layout holds while the IMU is as good as set
        self._found: Contradiction | None = None
        self._sensors = np.isin(layout.kind, [int(kind) for kind in (Kind.ACCEL_BIAS, Kind.GYRO_BIAS, Kind.ACCEL_SCALE, Kind.GYRO_SCALE)])
        accel, gyro = (("imu.accel_turn_on_mg", MILLI_G, "mg"), ("imu.gyro_turn_on_dps", DEGREE, "deg/s"))
        self._rows = {kind: np.flatnonzero(layout.kind == int(kind)) for kind in (Kind.ACCEL_BIAS, Kind.GYRO_BIAS)}
        self._named = {
            int(Kind.ACCEL_BIAS): (*accel, math.hypot(typical(imu.accel_turn_on_mg), typical(imu.accel_bias_mg))),
            int(Kind.GYRO_BIAS): (*gyro, math.hypot(typical(imu.gyro_turn_on_dps), typical(imu.gyro_bias_dps))),
        }
        rows = np.flatnonzero(np.isin(layout.kind, list(self._named)))
        self._biases = list(zip(rows.tolist(), layout.kind[rows].tolist(), layout.axis[rows].tolist(), strict=True))
        self.restart()

    def restart(self) -> None:
        """Forget the recoveries; what was learnt of the IMU stays."""
        self.is_lost = False
        self._off_since_ns: int | None = None
        self._agreed_ns: int | None = None
        self._accel = self._rate = 0.0
        self._run, self._nis, self._strange_ns = Run(), 1.0, self._now_ns
        self._recovered_ns = self._rejected_ns = self._compass_off_ns = NEVER_NS

    def acquit(self) -> None:
        """Take the IMU for as good as set: it was GPS that was wrong."""
        self._steps, self._found, self._is_far = 0, None, False
        self._widen(1.0)
        self.restart()

    @property
    def is_widened(self) -> bool:
        """Whether the IMU is taken for worse than its settings."""
        return self._steps > 0

    @property
    def explains(self) -> bool:
        """Whether velocities have agreed as they should for a while with biases that are larger than set: it is they, and nothing else."""
        return self._now_ns - self._strange_ns > YOUNG_NS

    @property
    def shows(self) -> bool:
        """Whether GPS velocity contradicts attitude or sensors at present, or has shown them to be lost."""
        return self.is_lost or self._off_since_ns is not None

    @property
    def widening(self) -> float:
        """By how much the IMU may be worse than its settings at the next alignment."""
        return WIDENINGS[-1] if self._steps or self._accel > VERY_LARGE else WIDENINGS[0]

    @property
    def gathers(self) -> bool:
        """Whether data for an alignment is to be gathered: GPS was rejected of late."""
        return self._now_ns - self._rejected_ns <= MEMORY_NS

    def patience_s(self, stamp_ns: int, usual_s: float) -> float:
        """How long GPS must have been rejected, s."""
        return min(usual_s, AGAIN_S) if stamp_ns - self._recovered_ns <= MEMORY_NS else usual_s

    def note(self, stamp_ns: int, decision: Decision | None, off: np.ndarray | None = None, nis: float = 0.0) -> None:
        """Take what became of a GPS measurement; of a velocity its innovation (3,), m/s, and normalised square; None: it was excluded."""
        self._now_ns = stamp_ns
        if off is not None:
            self._size(stamp_ns, decision, off)
            self._nis += (min(nis / len(off), MOST) - self._nis) / ENOUGH
            if self._nis > TOO_MUCH:
                self._strange_ns = stamp_ns
            if self._steps and decision is not None and stamp_ns - self._since_ns > YOUNG_NS:
                self._narrow(stamp_ns, nis / len(off))
        if decision in (Decision.REJECT, Decision.RECOVER):
            self._rejected_ns = stamp_ns
        if decision is Decision.RECOVER and stamp_ns - self._recovered_ns > ONE_EVENT_NS:
            self.is_lost |= stamp_ns - self._recovered_ns <= MEMORY_NS or self._accel > LARGE
            self._recovered_ns = stamp_ns
            if not self._steps:
                self._widen(WIDENINGS[0])
        if not self._steps and stamp_ns - max(self._rejected_ns, self._recovered_ns) > MEMORY_NS:
            self._accel = self._rate = 0.0
            if self._layout.least is not self._usual:
                self._widen(1.0)
                self._usual = self._layout.least
        if self._steps and stamp_ns - max(self._rejected_ns, self._since_ns) > CALM_NS and self._calm:
            self._steps = 0
            self._widen(1.0)

    def _size(self, stamp_ns: int, decision: Decision | None, off: np.ndarray) -> None:
        """Find how large an error of the sensors explains velocities that GPS contradicts.

        They are off by ``y = a t`` or ``y = g w t^2 / 2``, so that over a run of T seconds their mean is a T / 2 or g w T^2 / 6; white
        noise of the receiver averages out, and what is left of it, the mean square of successive differences over 2 n, is taken off.
        """
        if decision not in (Decision.REJECT, Decision.RECOVER):
            lasted = self._off_since_ns is not None and stamp_ns - self._off_since_ns > LASTING_NS
            self.is_lost |= lasted and self._accel > LARGE  # the gate has grown to it
            self._off_since_ns = None
            self._agreed_ns = stamp_ns if decision is not None else self._agreed_ns
            return
        if self._off_since_ns is None:
            self._off_since_ns, self._run = stamp_ns, Run()
        self._run.add(off)
        if self._run.count < SHORTEST:
            return
        begun_ns = self._off_since_ns if self._agreed_ns is None else self._agreed_ns  # after an outage: with it
        lasted_s, mean = 1e-9 * (stamp_ns - begun_ns) + UNNOTICED_S, self._run.mean()
        self._accel = min(max(self._accel, 2.0 * mean / lasted_s), STANDARD_GRAVITY)
        self._rate = min(max(self._rate, 6.0 * mean / (STANDARD_GRAVITY * lasted_s**2)), FASTEST)

    def _narrow(self, stamp_ns: int, nis: float) -> None:
        """Halve the noise while GPS velocities agree with the prediction as well as they should, double it while they do not.

        A bias beyond what a poor unit has is a fault, which may end as it came: the noise stays.
        """
        self._is_fault |= self._worst > WIDENINGS[-1]
        if self._is_fault:
            return
        if self._tested_ns is None:
            self._tested_ns, self._tests, self._squares = stamp_ns, 0, 0.0
        self._tests, self._squares = self._tests + 1, self._squares + min(nis, MOST)
        if self._tests < ENOUGH or stamp_ns - self._tested_ns < PACE_NS:
            return
        mean, self._tested_ns = self._squares / self._tests, None
        by = 0.5 if mean < AS_SET else 2.0 if mean > TOO_MUCH else 1.0
        self._widen(min(max(by * self._factor, 1.0), WIDENINGS[-1]))

    def lose(self, stamp_ns: int) -> None:
        """Take attitude and biases for lost: GPS corrects them one way again and again."""
        self.is_lost, self._rejected_ns = True, stamp_ns

    def turned(self, stamp_ns: int, apart: float) -> np.ndarray:
        """Note a heading that is off by ``apart``, rad, as a recovery; sigmas (n,) that the gyro biases must have at least, rad/s."""
        self.note(stamp_ns, Decision.RECOVER)
        return turned_by(self._layout, apart)

    def seen(self) -> np.ndarray:
        """Sigmas (n,) that there must be at least of attitude and sensor errors, by what GPS has shown them to be off by."""
        least = np.zeros(self._layout.size)
        least[ATT] = min(self._accel / STANDARD_GRAVITY, STEEPEST)
        least[self._rows[Kind.ACCEL_BIAS]], least[self._rows[Kind.GYRO_BIAS]] = self._accel, self._rate
        return least

    def begin(self, stamp_ns: int, P: np.ndarray, *, moving: bool) -> None:
        """Widen the covariance of the sensor errors, in place, and the driving noise, after an alignment."""
        factor = self.widening
        self._steps, self._since_ns, self.is_lost = self._steps + 1, stamp_ns, False
        self._calm = self._is_fault = False
        P[np.ix_(self._sensors, self._sensors)] *= factor**2
        kalman.raise_sigmas(P, self.seen())
        self._widen(factor)
        if moving:
            self.distrust_compass(stamp_ns)

    def _widen(self, factor: float) -> None:
        """Take the sensors' noise for so much larger than set; a bias far beyond its setting is no steadier than that shows."""
        self._factor, self._tested_ns = factor, None
        worst, least = min(self._worst, WIDENINGS[-1]), np.zeros(self._layout.size)
        least[VEL], least[ATT] = factor, factor
        least[self._sensors] = math.sqrt(worst) if self._steps and worst > factor**2 else factor
        self._layout.widen(least)

    def distrust_compass(self, stamp_ns: int) -> None:
        """Let the magnetometer wait: the heading comes from the track."""
        self._compass_off_ns = stamp_ns

    def compass_waits(self, now_ns: int, P: np.ndarray) -> bool:
        """Whether the magnetometer is not to be used yet."""
        since_ns = now_ns - self._compass_off_ns
        return since_ns < COMPASS_NS or (since_ns < COMPASS_LATEST_NS and HEADING_SIGMA**2 < P[8, 8] < UNKNOWN_SIGMA**2)

    def contradiction(self, estimate: np.ndarray) -> Contradiction | None:
        """The IMU against its settings, while it is taken for worse or a bias is far too large; looked at once a second."""
        if self._now_ns // LOOK_NS != self._looked or self._looked_steps != self._steps:
            self._looked, self._looked_steps = self._now_ns // LOOK_NS, self._steps
            self._found = self._look(estimate)
        return self._found

    def _look(self, estimate: np.ndarray) -> Contradiction | None:
        """Which setting is by how many sigmas too small."""
        totals = {kind: np.zeros(3) for kind in self._named}
        for row, kind, axis in self._biases:
            totals[kind][axis] += estimate[row]
        worst, advice = 0.0, "no bias explains it: look at noise, vibration, scale and mounting, or a fault that has ended"
        for kind, (name, unit, word, sigma) in self._named.items():
            axis = int(np.argmax(np.abs(totals[kind])))
            value = abs(float(totals[kind][axis])) / unit
            ratio = value / max(sigma, 1e-9)
            if ratio > max(worst, EXCEEDED):
                largest, instead = ABSURD[kind]
                remedy = f"set it to {value:.2g} or more" if value * unit < largest else f"{instead} or mounting are wrong"
                advice = f"{'xyz'[axis]} is off by {value:.3g} {word}, {ratio:.0f} sigmas of {name}: {remedy}"
            worst = max(worst, ratio)
        self._calm, self._worst = worst <= EXCEEDED, worst
        if not self._steps:
            self._since_ns = self._since_ns if worst > FAR_EXCEEDED and self._is_far else self._now_ns
            self._is_far = worst > FAR_EXCEEDED
            if not self._is_far:
                return None
        parties = "imu/data_raw", SETTINGS
        return Contradiction("inertial data and settings disagree", parties, worst, "sigma", self._since_ns, SETTINGS, advice)
