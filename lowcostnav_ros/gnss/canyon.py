"""Between two cliffs: what is seen of the sky midway between them (Solimeno 2007, sections 7.4.2.1 and 7.5).

Midway between cliffs of height H at distance L, at height h above the floor, a satellite is seen from the elevation
90 deg - atan((L/2)/(H - h)) up, at any azimuth: the thesis takes the cliffs as a wall all around.  Straight cliffs along an axis stand
L/2 / |sin(azimuth - axis)| away, so that along the axis the sky is open to the horizon.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.gnss.constellation import Constellation
from lowcostnav_ros.gnss.dop import NO_SOLUTION, Dops, dops
from lowcostnav_ros.gnss.observables import azimuth_elevation, line_of_sight
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef


@dataclass(frozen=True, slots=True)
class Canyon:
    """A canyon: cliff height, separation, place of its floor (rad; on the ellipsoid), true heading of its axis (rad).

    Without a heading the cliffs are a wall all around.
    """

    cliff_m: float = 1000.0
    width_m: float = 1000.0
    lat: float = 0.0
    lon: float = 0.0
    heading: float | None = None

    def mask(self, height_m: float) -> float:
        """Lowest visible elevation, rad, at a height above the floor; zero at the cliff tops and above."""
        return math.atan2(max(self.cliff_m - height_m, 0.0), 0.5 * self.width_m)

    def lowest(self, height_m: float, azimuth: np.ndarray) -> np.ndarray:
        """Lowest visible elevation (n,), rad, towards azimuths (n,), rad, at a height above the floor: :meth:`mask` across the axis."""
        azimuth, mask = np.asarray(azimuth, float), self.mask(height_m)
        if self.heading is None:
            return np.full(azimuth.shape, mask)
        return np.arctan(math.tan(mask) * np.abs(np.sin(azimuth - self.heading)))


@dataclass(frozen=True)
class CanyonSettings:
    """Cliffs on both sides of a flight that keeps midway between them."""

    cliff_m: float = setting(0.0, "Height of the cliffs above the floor; 0 leaves the sky open.", unit="m", minimum=0.0, maximum=5000.0)
    width_m: float = setting(1000.0, "Distance between the cliffs.", unit="m", minimum=1.0, maximum=1.0e5)
    heading_deg: float = setting(
        0.0, "True heading of the canyon's axis, along which the sky stays open.", unit="deg", minimum=-360.0, maximum=360.0
    )
    floor_m: float = setting(0.0, "Height of the floor above the ellipsoid.", unit="m", minimum=-500.0, maximum=9000.0)
    all_around: bool = setting(False, "Take the cliffs as a wall all around, as the thesis does; the heading then has no meaning.")

    def canyon(self) -> Canyon | None:
        """The canyon, None under an open sky."""
        if self.cliff_m == 0.0:
            return None
        return Canyon(self.cliff_m, self.width_m, heading=None if self.all_around else math.radians(self.heading_deg))


@dataclass(frozen=True, slots=True)
class Level:
    """One height in the canyon: visible satellites (indices into the constellation) and their dilutions of precision."""

    height_m: float
    visible: tuple[int, ...]
    dops: Dops


def climb(canyon: Canyon, constellation: Constellation, heights_m: Sequence[float] | np.ndarray, t_s: float = 0.0) -> list[Level]:
    """Visible satellites and DOPs at some heights; ``t_s`` s after the constellation's epoch, no time passes on the way."""
    position, _ = constellation.states(t_s)
    levels = []
    for height in heights_m:
        _, los = line_of_sight(geodetic_to_ecef(canyon.lat, canyon.lon, float(height)), position)
        azimuth, elevation = azimuth_elevation(canyon.lat, canyon.lon, los)
        seen = np.flatnonzero(elevation >= canyon.lowest(float(height), azimuth))
        geometry = dops(los[seen] @ dcm_ne(canyon.lat, canyon.lon).T) if seen.size >= 4 else NO_SOLUTION
        levels.append(Level(float(height), tuple(int(k) for k in seen), geometry))
    return levels


def appearance_heights(canyon: Canyon, constellation: Constellation, t_s: float = 0.0) -> dict[int, float]:
    """Height, m, at which each satellite comes into view, by index into the constellation, lowest first.

    From tan El = (H - h)/(L/2), cliffs all around; the elevation is that from the height itself.

    Satellites below the horizon are excluded.
    """
    position, _ = constellation.states(t_s)
    found: dict[int, float] = {}
    for k in range(len(constellation)):
        height = canyon.cliff_m
        for _ in range(4):  # the elevation moves by a ten-thousandth of a degree over the canyon
            _, los = line_of_sight(geodetic_to_ecef(canyon.lat, canyon.lon, height), position[k : k + 1])
            elevation = float(azimuth_elevation(canyon.lat, canyon.lon, los)[1][0])
            height = canyon.cliff_m - 0.5 * canyon.width_m * math.tan(elevation)
        if elevation >= 0.0:
            found[k] = max(height, 0.0)
    return dict(sorted(found.items(), key=lambda item: item[1]))
