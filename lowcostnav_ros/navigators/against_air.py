"""Inertial motion against air and compass, without GPS: what strays across the flight is no fault of a pitot tube.

Air data that disagrees along the flight may be wrong itself, or the wind has changed, or the inertial motion is off: nobody knows, and
half of the largest disagreement is a velocity that is published as doubtful, and moves the place.  Beyond the gate across the flight,
where sideslip and incidence are small whatever the airspeed, it is the inertial motion that is off.  By ``y`` after ``T`` it accelerates
as ``a = |y| / T`` says, by a tilt or an accelerometer, or its heading is off by ``y / v``, by a gyro.  So velocity, attitude and sensor
errors are known no better than that, and the air data hold the velocity again, as they do in dead reckoning.  What drifts slowly the
filter follows: it shows in innovations that go one way, of the air across the flight or of the compass, which may be as wrong.

How much of it wind and bias have taken over by then nobody knows: what is published covers half of how far it has strayed, in any
direction, for as long as GPS does not hold the solution.
"""

import math

import numpy as np

from lowcostnav_ros.aids.airdata import AirDataAid
from lowcostnav_ros.aids.magnetic import MagneticAid
from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT, CORE, POS, VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision
from lowcostnav_ros.estimation.error_state import Kind, Layout
from lowcostnav_ros.estimation.innovation_watch import InnovationWatch
from lowcostnav_ros.navigators.trust import COVERED
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

STRAYS = "inertial motion strays without GPS"
CHANCE = chi_square.threshold(0.9999, 2)
CHANCE_ALONG = chi_square.threshold(0.9999, 1)
LASTING_NS, UNNOTICED_NS = 1_000_000_000, 5_000_000_000
"""What strays for so long is no gust; it has done so, unnoticed, for a while before."""
SLOWEST_MPS = 12.0
STEEPEST = 0.6
"""Largest tilt, rad, that it is taken to be off by."""
WATCHED_S, RARE = (5.0, 15.0), 1e-6
"""Times over which innovations are watched, s, and how rarely sound ones are suspected."""
CALM_MPS, CALM_RAD = 0.35, 0.35 * DEGREE
"""Mean innovation across the flight, and of a compass, that a sound one may show."""
SUDDEN = 4.0
"""Test ratio with which a compass that is refused anew has stepped: gyros drift, a field beside iron steps."""
FOLLOWED = 2.0
"""What shows in innovations the filter has followed by as much."""


class AgainstAir:
    """An acceleration that the inertial sensors do not show, or pretend, m/s^2, and since when.

    Parameters
    ----------
    layout : Layout
        Of an inertial core.
    imu : str
        Party of the contradiction.

    Attributes
    ----------
    held : Contradiction or None
        While it lasts.
    """

    def __init__(self, layout: Layout, imu: str) -> None:
        self._size, self._imu = layout.size, imu
        self._biases, self._gyros = (np.flatnonzero(layout.kind == int(kind)) for kind in (Kind.ACCEL_BIAS, Kind.GYRO_BIAS))
        self._across, self._along = InnovationWatch(WATCHED_S, [CALM_MPS] * 2, RARE), InnovationWatch(WATCHED_S, [CALM_MPS], RARE)
        self._heading = InnovationWatch(WATCHED_S, [CALM_RAD], RARE)
        self._is_clear = False
        self.clear()

    def clear(self) -> None:
        """Forget all: GPS holds the solution."""
        if self._is_clear:
            return
        self._since_ns: int | None = None
        self._accel = 0.0
        self._along_since_ns: int | None = None
        self._drifts: bool | None = None  # the compass, while it is refused
        self._slip, self._moved, self._moved_ns = 0.0, 0.0, 0  # along the flight, m/s and m
        self.held: Contradiction | None = None
        self._along.clear()
        self._across.clear()
        self._heading.clear()
        self._is_clear = True

    def take(self, aid: Aid, speed_mps: float) -> np.ndarray | None:
        """Take what became of an air velocity or a magnetic heading; return sigmas (n,) that there must be at least, or None."""
        y, S = aid.status.innovation, aid.status.innovation_covariance
        if y is None or S is None or aid.decision is None:
            return None
        self._is_clear = False
        if isinstance(aid, AirDataAid):
            return self._take_air(aid, y, S, speed_mps)
        if isinstance(aid, MagneticAid):
            self._take_compass(aid, y, S, max(speed_mps, SLOWEST_MPS))
        return None

    def _take_compass(self, aid: MagneticAid, y: np.ndarray, S: np.ndarray, speed_mps: float) -> None:
        if aid.decision is Decision.FUSE:
            self._drifts = None
            self._watch(self._heading, aid, y, S, speed_mps)
        elif aid.decision is Decision.REJECT and self._drifts is None:
            self._drifts = aid.status.test_ratio < SUDDEN
        elif aid.decision is Decision.REJECT and self._drifts:
            self._since_ns = aid.status.stamp_ns if self._since_ns is None else self._since_ns
            self._stray(aid, speed_mps * abs(float(y[0])))

    def _take_air(self, aid: AirDataAid, y: np.ndarray, S: np.ndarray, speed_mps: float) -> np.ndarray | None:
        now_ns = aid.status.stamp_ns
        self._look_along(aid, y, S)
        if aid.decision is Decision.FUSE:
            self._watch(self._across, aid, y[1:], np.ascontiguousarray(S[1:, 1:]), 1.0)
        if aid.decision is not Decision.REJECT or not strays(y, S):
            self._since_ns = None if self._accel == 0.0 else self._since_ns
            return None
        self._since_ns = now_ns if self._since_ns is None else self._since_ns
        if now_ns - self._since_ns < LASTING_NS:
            return None
        self._stray(aid, float(np.linalg.norm(y)))
        return self._least(float(np.linalg.norm(y[1:])), self._lasted_s(now_ns), speed_mps)

    def _look_along(self, aid: AirDataAid, y: np.ndarray, S: np.ndarray) -> None:
        """Keep the largest disagreement along the flight that lasts."""
        now_ns = aid.status.stamp_ns
        self._moved += self._slip * 1e-9 * (now_ns - self._moved_ns)
        self._moved_ns = now_ns
        if aid.decision is Decision.FUSE:
            found = self._along.observe(now_ns, y[:1], np.eye(1), np.ascontiguousarray(S[:1, :1]))
            self._along_since_ns, off_mps = None, 0.0 if found is None else FOLLOWED * abs(float(found.offset[0]))
        elif aid.decision is Decision.REJECT and y[0] ** 2 > CHANCE_ALONG * S[0, 0]:
            self._along_since_ns = now_ns if self._along_since_ns is None else self._along_since_ns
            off_mps = abs(float(y[0])) if now_ns - self._along_since_ns >= LASTING_NS else 0.0
        else:
            return
        if off_mps > self._slip:
            self._moved += 1e-9 * UNNOTICED_NS * (off_mps - self._slip)
            self._slip = off_mps

    def _watch(self, watch: InnovationWatch, aid: Aid, y: np.ndarray, S: np.ndarray, factor: float) -> None:
        """Watch what is fused for going one way; ``factor`` makes a velocity, m/s, of it."""
        found = watch.observe(aid.status.stamp_ns, y, np.eye(len(y)), S)
        if found is not None:
            self._since_ns = aid.status.stamp_ns - UNNOTICED_NS if self._since_ns is None else self._since_ns  # slow: for longer
            self._stray(aid, FOLLOWED * factor * float(np.linalg.norm(found.offset)))

    def _stray(self, aid: Aid, off_mps: float) -> None:
        now_ns = aid.status.stamp_ns
        self._accel = max(self._accel, off_mps / self._lasted_s(now_ns))
        since_ns = now_ns if self.held is None else self.held.since_ns
        self.held = Contradiction(STRAYS, (self._imu, aid.source), off_mps, "m/s", since_ns)

    def _least(self, across: float, lasted_s: float, speed_mps: float) -> np.ndarray:
        """Sigmas (n,) by which a velocity may have come to stray ``across`` the flight, m/s, in some time, s."""
        least, accel = np.zeros(self._size), across / lasted_s
        tilt, heading = min(accel / STANDARD_GRAVITY, STEEPEST), min(across / max(speed_mps, SLOWEST_MPS), math.pi)
        least[POS], least[VEL] = 0.5 * across * lasted_s, across
        least[ATT] = tilt, tilt, heading
        least[self._biases], least[self._gyros] = accel, max(tilt, heading) / lasted_s
        return least

    def lasts(self, now_ns: int) -> bool:
        """Whether it has strayed for longer than a gust and what it moved."""
        return self._since_ns is not None and now_ns - self._since_ns > UNNOTICED_NS

    def _lasted_s(self, t_ns: int) -> float:
        return 0.0 if self._since_ns is None else 1e-9 * (t_ns - self._since_ns + UNNOTICED_NS)

    def doubt(self, t_ns: int, speed_mps: float) -> np.ndarray | None:
        """What is added to the covariance (9, 9) of position, velocity and attitude, m, m/s, rad; None for nothing."""
        if self._accel == 0.0 and self._slip == 0.0:
            return None
        off, slip = COVERED * self._accel * self._lasted_s(t_ns), COVERED * self._slip
        variance = np.zeros(CORE)
        variance[POS] = (0.5 * off * self._lasted_s(t_ns)) ** 2 + (COVERED * self._moved + slip * 1e-9 * (t_ns - self._moved_ns)) ** 2
        variance[VEL] = off**2 + slip**2
        variance[ATT] = min(off / max(speed_mps, SLOWEST_MPS), math.pi) ** 2  # a heading that is off turns the velocity as much
        return np.diag(variance)


def strays(y: np.ndarray, S: np.ndarray) -> bool:
    """Whether an innovation (3,) of the air velocity of covariance (3, 3) is beyond chance across the flight."""
    return kalman.normalised_innovation_squared(y[1:], np.ascontiguousarray(S[1:, 1:])) > CHANCE
