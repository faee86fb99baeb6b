"""What the geometry of the DME stations received lately leaves open: one station, stations in line with the track, a mirror solution."""

import math
from collections.abc import Callable

import numpy as np

from lowcostnav_ros.radionav.geometry import collinear_with_track, mirror_point, range_and_direction
from lowcostnav_ros.radionav.stations import StationTable

SINGLE = "single station"
COLLINEAR = "stations collinear with track"
MIRROR = "mirror ambiguity possible"
SIGMAS = 3.0


class ReceivedStations:
    """Stations with an accepted range in the last ``window_s`` seconds."""

    def __init__(self, stations: StationTable | None, window_s: float) -> None:
        self.stations, self.window_ns = stations, round(1e9 * window_s)
        self._received: dict[str, int] = {}
        self.mirror_n: np.ndarray | None = None  # the other place that two ranges fit, m north and east, where it is near

    def received(self, ident: str, stamp_ns: int) -> None:
        """Note an accepted range."""
        self._received[ident] = stamp_ns

    def idents(self, now_ns: int) -> list[str]:
        """Stations received within the window, by name."""
        return sorted(name for name, stamp in self._received.items() if now_ns - stamp <= self.window_ns)

    def judge(self, now_ns: int, nav: np.ndarray, course: float, sigma_towards: Callable[[np.ndarray], float]) -> str:
        """Name what is wrong with the geometry, empty when nothing is.

        Parameters
        ----------
        nav : ndarray (3,)
            lat, lon [rad], height [m].
        course : float
            Course over ground, rad.
        sigma_towards : callable
            Estimated position sigma, m, along a horizontal unit vector (2,), north east.
        """
        self.mirror_n, idents = None, self.idents(now_ns)
        if not idents or self.stations is None:
            return ""
        if len(idents) == 1:
            return SINGLE
        lines = [range_and_direction(nav[0], nav[1], nav[2], s.lat, s.lon, s.height) for s in (self.stations[i] for i in idents)]
        directions = np.array([direction for _, direction in lines])
        if collinear_with_track(course, directions):
            return COLLINEAR
        if len(idents) > 2:
            return ""
        mirror = mirror_point(np.zeros(2), *(-distance * direction[0:2] for distance, direction in lines))
        distance = math.hypot(*mirror)
        if distance > 0.0 and distance >= 2.0 * SIGMAS * sigma_towards(mirror / distance):
            return ""
        self.mirror_n = mirror
        return MIRROR
