"""Inertial motion against the air, without GPS: what strays across the flight is no fault of a pitot tube.

Air data that is refused along the flight may be wrong itself, or the wind has changed.  Beyond the gate across it, where sideslip and
incidence are small whatever the airspeed, it is the inertial motion that is off.  By ``y`` after ``T`` it accelerates as ``a = |y| / T``
says, and goes on for as long as GPS does not hold the solution: what is published covers half of it, in any direction.  The state stays
as it is; what the air shows is not good enough to move it.
"""

import math

import numpy as np

from lowcostnav_ros.aids.airdata import AirDataAid
from lowcostnav_ros.base import chi_square
from lowcostnav_ros.cores.inertial import ATT, CORE, POS, VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Decision
from lowcostnav_ros.navigators.trust import COVERED

CHANCE = chi_square.threshold(0.9999, 2)
LASTING_NS, UNNOTICED_NS = 1_000_000_000, 5_000_000_000
"""What strays for so long is no gust; it has done so, unnoticed, for a while before."""
SLOWEST_MPS = 12.0


class AgainstAir:
    """An acceleration that the inertial sensors do not show, or pretend, m/s^2, and since when."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all: GPS holds the solution."""
        self._since_ns: int | None = None
        self._accel = 0.0

    def take(self, aid: AirDataAid) -> None:
        """Take what became of an air velocity."""
        y, S, now_ns = aid.status.innovation, aid.status.innovation_covariance, aid.status.stamp_ns
        if aid.decision is not Decision.REJECT or y is None or S is None or not strays(y, S):
            self._since_ns = None if self._accel == 0.0 else self._since_ns
            return
        self._since_ns = now_ns if self._since_ns is None else self._since_ns
        if now_ns - self._since_ns >= LASTING_NS:
            self._accel = max(self._accel, float(np.linalg.norm(y)) / self._lasted_s(now_ns))

    def _lasted_s(self, t_ns: int) -> float:
        return 0.0 if self._since_ns is None else 1e-9 * (t_ns - self._since_ns + UNNOTICED_NS)

    @property
    def is_straying(self) -> bool:
        """Whether there is one."""
        return self._accel != 0.0

    def doubt(self, t_ns: int, speed_mps: float) -> np.ndarray:
        """What is added to the covariance (9, 9) of position, velocity and attitude, m, m/s, rad."""
        off = COVERED * self._accel * self._lasted_s(t_ns)
        sigma = np.zeros(CORE)
        sigma[POS], sigma[VEL] = 0.5 * off * self._lasted_s(t_ns), off
        sigma[ATT] = min(off / max(speed_mps, SLOWEST_MPS), math.pi)  # a heading that is off turns the velocity as much
        return np.diag(sigma**2)


def strays(y: np.ndarray, S: np.ndarray) -> bool:
    """Whether an innovation (3,) of the air velocity of covariance (3, 3) is beyond chance across the flight."""
    return kalman.normalised_innovation_squared(y[1:], np.ascontiguousarray(S[1:, 1:])) > CHANCE
