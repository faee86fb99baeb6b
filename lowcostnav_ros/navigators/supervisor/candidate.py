"""One solution that may be flown: what its navigator says of it, and whether it contradicts itself.

A position and a velocity that go out together must fit: the way between two positions is the integral of the velocity, within what the
position was uncertain by at first (a correction may move it by that much) and what the velocity is uncertain by.  A frozen output, one
that runs away and one that jumps farther than its own sigma all fail this test, whoever is right about the place.
"""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import Health, NavSolution
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.physics.earth import difference_n

LOOK_NS, SILENT_NS = 500_000_000, 3_000_000_000
WINDOWS_NS = (1_000_000_000, 8_000_000_000, 30_000_000_000)
"""The way is compared with the velocity over these times: a jump shows in the first, what creeps away in the last."""
SIGMAS, SIGMAS_WAY, FLOOR_M, FLOOR_MPS = 4.5, 1.5, 4.0, 0.5
"""How far way and velocity may be apart: in sigmas of the position at first and of the velocity, which is corrected with it; and what
sampling the velocity misses."""
STILL_NS, MOVING_MPS = 1_500_000_000, 5.0
"""For so long, at this speed, the same bits of a position, seen three times, are no measurement."""
DOUBTED_NS, LONGEST_NS, FORGIVEN_NS = 30_000_000_000, 480_000_000_000, 120_000_000_000
"""A contradiction is kept for the first time after it was seen last, doubled where it returns within the last time, up to the second."""
WAY, STILL = "way and velocity disagree", "position does not change in flight"


@dataclass(frozen=True, slots=True)
class Look:
    """Position (lat, lon rad, height m) at a stamp, its ``sigma`` (3,) m; velocity integrated until then, (3,) m NED, its ``sigma_way``."""

    stamp_ns: int
    place: tuple[float, float, float]
    sigma: np.ndarray
    way: np.ndarray
    sigma_way: np.ndarray
    slack: float


class Candidate:
    """A solution, tested against itself.

    Parameters
    ----------
    name : str
    fixes : bool
        Whether its positions are fixes as received, whose errors are independent: both of two are uncertain, not the first alone.

    Attributes
    ----------
    name : str
    newest : NavSolution or None
    health : Health or None
        None where nothing says how it is.
    contradiction : Contradiction or None
        How it contradicts itself, kept for a while.
    offset_n : ndarray (3,)
        By how far, m.
    doubted_ns : int
        When it last did.
    """

    def __init__(self, name: str, fixes: bool = False) -> None:
        self.name, self._fixes = name, fixes
        self.newest: NavSolution | None = None
        self.health: Health | None = None
        self.contradiction: Contradiction | None = None
        self.offset_n = np.zeros(3)
        self._looks: deque[Look] = deque()
        self._way, self._sigma_way, self._slack = np.zeros(3), np.zeros(3), 0.0
        self._anchor: Look | None = None
        self.doubted_ns, self._until_ns, self._kept_ns = 0, 0, DOUBTED_NS
        self._still, self._still_since_ns = 0, 0

    def take(self, solution: NavSolution) -> None:
        """Take its next solution in."""
        before, self.newest = self.newest, solution
        if solution.vel_n is None:
            return
        if before is None or before.vel_n is None or solution.stamp_ns - before.stamp_ns > SILENT_NS:
            self._looks.clear()  # what the velocity was in between is not known
            self._anchor, self._still = None, 0
        else:
            self._move(before, solution)
        now = Look(solution.stamp_ns, solution.place, _sigmas(solution.place_cov), self._way, self._sigma_way, self._slack)
        self._test(now, self._is_still(before, solution))
        if not self._looks or now.stamp_ns - self._looks[-1].stamp_ns >= LOOK_NS:
            self._looks.append(now)
            while now.stamp_ns - self._looks[0].stamp_ns > WINDOWS_NS[-1]:
                self._looks.popleft()

    def _move(self, before: NavSolution, solution: NavSolution) -> None:
        dt_s, velocity = 1e-9 * (solution.stamp_ns - before.stamp_ns), np.asarray(solution.vel_n)
        change = velocity - before.vel_n
        self._way = self._way + dt_s * (before.vel_n + 0.5 * change)
        if solution.cov_vel is not None:
            self._sigma_way = self._sigma_way + dt_s * _sigmas(solution.cov_vel)
        squares = float(change @ change)
        if squares > 0.0:  # a chord for an arc: v (w dt)^2 dt / 12
            self._slack += dt_s * squares / (6.0 * max(_size(velocity), math.sqrt(squares)))

    def _is_still(self, before: NavSolution | None, solution: NavSolution) -> bool:
        if before is None or before.place != solution.place or _size(np.asarray(solution.vel_n)) < MOVING_MPS:
            self._still, self._still_since_ns = 0, solution.stamp_ns
            return False
        self._still += 1
        return self._still > 1 and solution.stamp_ns - self._still_since_ns >= STILL_NS

    def _test(self, now: Look, still: bool) -> None:
        looks = [next((look for look in self._looks if now.stamp_ns - look.stamp_ns <= window), None) for window in WINDOWS_NS]
        off = next((look for look in looks if look is not None and self._is_off(look, now)), None)
        if still and off is None:
            off = next((look for look in reversed(looks) if look is not None), None)
        if off is not None:
            self._doubt(STILL if still else WAY, off, now.stamp_ns)
        if self.contradiction is None:
            return
        if self._anchor is not None:
            self.offset_n = _apart(self._anchor, now)
        if off is None and (now.stamp_ns >= self._until_ns or (self._anchor is not None and not self._is_off(self._anchor, now))):
            self.forgive()
        else:
            self.contradiction = replace(self.contradiction, size=_size(self.offset_n))

    def _doubt(self, name: str, look: Look, stamp_ns: int) -> None:
        if self.contradiction is None:
            again = self._until_ns > 0 and stamp_ns - self._until_ns < FORGIVEN_NS
            self._kept_ns = min(2 * self._kept_ns, LONGEST_NS) if again else DOUBTED_NS
            self.contradiction = Contradiction(name, (self.name, "its velocity"), 0.0, "m", stamp_ns, self.name)
            self._anchor = look
        self.doubted_ns, self._until_ns = stamp_ns, stamp_ns + self._kept_ns

    def _is_off(self, look: Look, now: Look) -> bool:
        lasted_s = 1e-9 * (now.stamp_ns - look.stamp_ns)
        sigma = np.hypot(look.sigma, now.sigma) if self._fixes else look.sigma
        allowed = SIGMAS * sigma + SIGMAS_WAY * (now.sigma_way - look.sigma_way) + FLOOR_M + FLOOR_MPS * lasted_s + now.slack - look.slack
        return bool((np.abs(_apart(look, now)) > allowed).any())

    def forgive(self) -> None:
        """Believe it again."""
        self.contradiction, self.offset_n, self._anchor = None, np.zeros(3), None
        self._looks.clear()

    def trust(self) -> int:
        """2: sound as far as it can tell; 1: suspect; 0: failed, and nobody knows how wrong."""
        mode = "" if self.health is None else self.health.mode
        if mode == Mode.FAILED:
            return 0
        return 1 if mode == Mode.SUSPECT or self.contradiction is not None else 2

    def why(self) -> str:
        """What speaks against it, for people."""
        if self.health is not None and self.health.mode in (Mode.FAILED, Mode.SUSPECT):
            return f"{self.name} says {self.health.mode}: {self.health.reason}"
        return "" if self.contradiction is None else f"{self.name}: {self.contradiction.name}"


def _size(vector: np.ndarray) -> float:
    return math.sqrt(float(vector @ vector))


def _sigmas(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _apart(look: Look, now: Look) -> np.ndarray:
    """How far the way since a look and the velocity since then are apart, (3,) m NED."""
    return difference_n(*now.place, *look.place) - (now.way - look.way)
