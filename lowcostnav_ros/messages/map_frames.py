"""Which map frame an odometry is expressed in when its navigator has announced more than one origin.

A restarted navigator announces a new origin, and so may a stranger under its name.  The origin is not tied to the odometry by anything
but the track: the frame in which the next position continues the last one is the right one.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.physics.earth import difference_n, displace

if TYPE_CHECKING:
    from lowcostnav_ros.physics.earth import LocalFrame

SAME_M = 0.01
"""Origins nearer than this are one, announced again."""
PAUSE_S = 1.0
"""An odometry silent for longer may come from a process that has been started again."""
AWAY_M, AWAY_MPS = 50.0, 50.0
"""How far from where it was expected a position may be after a pause, and per second of it."""

Place = tuple[float, float, float]


@dataclass(slots=True)
class MapFrame:
    """The origin in use and when it was first announced, another one, and the last position: stamp, place, velocity NED."""

    origin: "LocalFrame"
    stamp_ns: int = 0
    other: "LocalFrame | None" = None
    is_new: bool = False
    last: tuple[int, Place, np.ndarray] | None = None

    def announce(self, origin: "LocalFrame") -> None:
        """Take an origin that was announced: at once while there is no track that tells which is right."""
        apart = difference_n(origin.lat, origin.lon, origin.height, self.origin.lat, self.origin.lon, self.origin.height)
        if float(apart @ apart) < SAME_M**2:
            return
        if self.last is None:
            self.origin = origin
        else:
            self.other, self.is_new = origin, True

    def prefers_other(self, stamp_ns: int, here: Place, there: Place) -> bool:
        """Whether a position that is ``here`` by the origin in use, ``there`` by the other one, continues the track in the other frame."""
        if self.last is None:
            return False
        last_ns, place, vel_n = self.last
        dt_s = 1e-9 * (stamp_ns - last_ns)
        expected = displace(*place, vel_n * dt_s)
        off_here, off_there = (float(np.linalg.norm(difference_n(*where, *expected))) for where in (here, there))
        paused = abs(dt_s) > PAUSE_S and self.is_new  # started again, then: the newer origin is the likelier one
        self.is_new = False
        return off_there < AWAY_M + AWAY_MPS * abs(dt_s) if paused else off_there < off_here

    def swap(self) -> "LocalFrame":
        """Use the other origin, and return it."""
        if self.other is not None:
            self.origin, self.other = self.other, self.origin
        return self.origin
