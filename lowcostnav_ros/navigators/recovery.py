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
from lowcostnav_ros.estimation.aiding import Decision
from lowcostnav_ros.estimation.error_state import Kind, Layout

MEMORY_NS = 60_000_000_000
ONE_EVENT_NS = 2_000_000_000
"""Recoveries of position and velocity this close are one."""
AGAIN_S = 3.0
WIDENINGS = (10.0, 30.0)
CALM_NS = 120_000_000_000
"""Without a rejection for so long, and with biases as the settings say, a fault of the IMU has ended."""
COMPASS_NS, COMPASS_LATEST_NS = 30_000_000_000, 180_000_000_000
HEADING_SIGMA = 4.0 * DEGREE
"""The magnetometer waits until GPS has shown the heading to this, between these times after the alignment."""
EXCEEDED, FAR_EXCEEDED = 3.0, 6.0
"""Sigmas of its setting by which a bias is too large: after an alignment anew; and where it was learnt without one."""
BEYOND_SPOOFING = 20.0
"""Sigmas of its setting that no bias learnt from a spoofer reaches."""
NEVER_NS = -(10**18)
SETTINGS = "its settings"
LOOK_NS = 1_000_000_000


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
        self._layout, self._psd = layout, layout.psd.copy()
        self._steps = 0
        self._since_ns, self._is_far = NEVER_NS, False
        self._looked, self._looked_steps = -1, 0
        self._found: Contradiction | None = None
        self._sensors = np.isin(layout.kind, [int(kind) for kind in (Kind.ACCEL_BIAS, Kind.GYRO_BIAS, Kind.ACCEL_SCALE, Kind.GYRO_SCALE)])
        accel, gyro = (("imu.accel_turn_on_mg", MILLI_G, "mg"), ("imu.gyro_turn_on_dps", DEGREE, "deg/s"))
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
        self._recovered_ns = self._rejected_ns = self._compass_off_ns = NEVER_NS
        self._now_ns = 0

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
    def widening(self) -> float:
        """By how much the IMU may be worse than its settings at the next alignment."""
        return WIDENINGS[min(self._steps, len(WIDENINGS) - 1)]

    @property
    def gathers(self) -> bool:
        """Whether data for an alignment is to be gathered: GPS was rejected of late."""
        return self._now_ns - self._rejected_ns <= MEMORY_NS

    def patience_s(self, stamp_ns: int, usual_s: float) -> float:
        """How long GPS must have been rejected, s."""
        return min(usual_s, AGAIN_S) if stamp_ns - self._recovered_ns <= MEMORY_NS else usual_s

    def note(self, stamp_ns: int, decision: Decision | None) -> None:
        """Take what became of a GPS measurement; None: it was excluded."""
        self._now_ns = stamp_ns
        if decision in (Decision.REJECT, Decision.RECOVER):
            self._rejected_ns = stamp_ns
        if decision is Decision.RECOVER and stamp_ns - self._recovered_ns > ONE_EVENT_NS:
            self.is_lost |= stamp_ns - self._recovered_ns <= MEMORY_NS
            self._recovered_ns = stamp_ns
            if not self._steps:
                self._widen(WIDENINGS[0])
        if not self._steps and stamp_ns - max(self._rejected_ns, self._recovered_ns) > MEMORY_NS:
            self._widen(1.0)
        if self._steps and stamp_ns - max(self._rejected_ns, self._since_ns) > CALM_NS and self._calm:
            self._steps = 0
            self._widen(1.0)

    def begin(self, stamp_ns: int, P: np.ndarray, *, moving: bool) -> None:
        """Widen the covariance of the sensor errors, in place, and the driving noise, after an alignment."""
        factor = self.widening
        self._steps, self._since_ns, self.is_lost = self._steps + 1, stamp_ns, False
        self._calm = False
        P[np.ix_(self._sensors, self._sensors)] *= factor**2
        self._widen(factor)
        if moving:
            self.distrust_compass(stamp_ns)

    def _widen(self, factor: float) -> None:
        """Take the sensors' noise for so much larger than set."""
        rows = self._sensors.copy()
        rows[VEL], rows[ATT] = True, True
        self._layout.psd[rows] = self._psd[rows] * factor**2

    def distrust_compass(self, stamp_ns: int) -> None:
        """Let the magnetometer wait: the heading comes from the track."""
        self._compass_off_ns = stamp_ns

    def compass_waits(self, now_ns: int, P: np.ndarray) -> bool:
        """Whether the magnetometer is not to be used yet."""
        since_ns = now_ns - self._compass_off_ns
        return since_ns < COMPASS_NS or (since_ns < COMPASS_LATEST_NS and P[8, 8] > HEADING_SIGMA**2)

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
                advice = f"{'xyz'[axis]} is off by {value:.3g} {word}, {ratio:.0f} sigmas of {name}: set it to {value:.2g} or more"
            worst = max(worst, ratio)
        self._calm = worst <= EXCEEDED
        if not self._steps:
            self._since_ns = self._since_ns if worst > FAR_EXCEEDED and self._is_far else self._now_ns
            self._is_far = worst > FAR_EXCEEDED
            if not self._is_far:
                return None
        parties = "imu/data_raw", SETTINGS
        return Contradiction("inertial data and settings disagree", parties, worst, "sigma", self._since_ns, SETTINGS, advice)
