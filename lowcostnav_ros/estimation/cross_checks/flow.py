"""The nose against the way: what wings or wheels carry goes about where it points, and wind changes that only as fast as it turns.

Heading less track, and pitch less climb, are a crab and an incidence.  On a straight leg they stay as they are; a turn changes the crab by
up to the share of the speed that the wind has.  A gyro or an accelerometer that is wrong turns the one and not the other.
"""

import math

import numpy as np

from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation.cross_checks.heading import SLOWEST_MPS, STRONGEST_WIND_MPS, heading_of
from lowcostnav_ros.physics.rotation import wrap

STEEPEST = 0.7
"""Sine of the pitch beyond which nothing is compared."""
MARGIN, NOISE = np.array([8.0, 20.0]) * DEGREE, 2.0 * DEGREE
"""By how much crab and incidence change on a straight leg: sideslip, gusts, what a wing flies with in a pull.  A track that
changes by less than the third is no turn."""
SIGMAS, VAGUE = 2.0, 15.0 * DEGREE
"""And by so many sigmas of what is known of attitude and velocity; where that is less than the second, nothing is usual yet."""
EVERY_NS = 1_000_000_000
"""Compared at the first output of each second: wind and nose are slower."""
USUAL_S, ALLOWED_S, PAUSE_S = 60.0, 30.0, 5.0
"""What is usual is learnt in the first time; a turn counts for the second; after a pause of the third all begins anew, s."""


class FlowWatch:
    """Crab and incidence of a vehicle.

    Attributes
    ----------
    off : ndarray (2,)
        By how much both have left what is usual, rad, where no wind explains it; else 0.
    due_ns : int
        Stamp from which on it is to be asked again.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self.off, self._usual, self._allowed = np.zeros(2), np.zeros(2), 0.0
        self._track, self._last_ns, self.due_ns = 0.0, 0, 0

    def take(self, stamp_ns: int, C: np.ndarray, vel_n: np.ndarray, P: np.ndarray) -> None:
        """Compare an attitude ``C_nb`` (3, 3) with a velocity NED (3,), m/s; ``P`` (6, 6) is what is known of velocity and attitude."""
        self.due_ns = (stamp_ns // EVERY_NS + 1) * EVERY_NS
        north, east, down = vel_n.tolist()
        speed = math.hypot(north, east)
        if speed < SLOWEST_MPS or abs(C[2, 0]) > STEEPEST:
            return
        track, climb, dt_s = math.atan2(east, north), math.atan2(-down, speed), 1e-9 * (stamp_ns - self._last_ns)
        seen, turned = np.array([wrap(heading_of(C) - track), -math.asin(C[2, 0]) - climb]), abs(wrap(track - self._track))
        self._last_ns = stamp_ns
        if dt_s > PAUSE_S or turned > NOISE:
            self._track = track
        else:
            turned = 0.0
        if dt_s > PAUSE_S:
            self._usual, self._allowed, self.off = seen, 0.0, np.zeros(2)
            return
        self._allowed = self._allowed * math.exp(-dt_s / ALLOWED_S) + turned * STRONGEST_WIND_MPS / speed
        off = np.array([wrap(seen[0] - self._usual[0]), seen[1] - self._usual[1]])
        self._usual += off * dt_s / USUAL_S
        level, down, tilt, heading = P[0, 0] + P[1, 1], P[2, 2], P[3, 3] + P[4, 4], P[5, 5]
        vague2 = np.maximum([heading + level / speed**2, tilt + down / speed**2], 0.0)
        if not self.off.any() and (vague2 > VAGUE**2).any():
            self.clear()
            return
        self.off = np.where(np.abs(off) > np.sqrt(MARGIN**2 + SIGMAS**2 * vague2) + [self._allowed, 0.0], np.abs(off), 0.0)
