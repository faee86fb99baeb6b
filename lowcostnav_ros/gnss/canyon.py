"""A helicopter between two cliffs: what it sees of the sky on its way up (Solimeno 2007, sections 7.4.2.1 and 7.5).

Midway between cliffs of height H at distance L, at height h above the floor, a satellite is seen from the elevation
90 deg - atan((L/2)/(H - h)) up, at any azimuth: the cliffs are taken as a wall all around.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.earth import dcm_ne, geodetic_to_ecef
from lowcostnav_ros.gnss.constellation import Constellation
from lowcostnav_ros.gnss.dop import NO_SOLUTION, Dops, dops
from lowcostnav_ros.gnss.observables import azimuth_elevation, line_of_sight


@dataclass(frozen=True, slots=True)
class Canyon:
    """A canyon: cliff height, separation, place of its floor (rad; the floor lies on the ellipsoid)."""

    cliff_m: float = 1000.0
    width_m: float = 1000.0
    lat: float = 0.0
    lon: float = 0.0

    def mask(self, height_m: float) -> float:
        """Lowest visible elevation, rad, at a height above the floor; zero at the cliff tops and above."""
        return math.atan2(max(self.cliff_m - height_m, 0.0), 0.5 * self.width_m)


@dataclass(frozen=True, slots=True)
class Level:
    """One height in the canyon: visible satellites (indices into the constellation) and their dilutions of precision."""

    height_m: float
    visible: tuple[int, ...]
    dops: Dops


def climb(canyon: Canyon, constellation: Constellation, heights_m: Sequence[float], t_s: float = 0.0) -> list[Level]:
    """Visible satellites and DOPs at some heights; ``t_s`` s after the constellation's epoch, no time passes on the way."""
    position, _ = constellation.states(t_s)
    levels = []
    for height in heights_m:
        _, los = line_of_sight(geodetic_to_ecef(canyon.lat, canyon.lon, float(height)), position)
        _, elevation = azimuth_elevation(canyon.lat, canyon.lon, los)
        seen = np.flatnonzero(elevation >= canyon.mask(height))
        geometry = dops(los[seen] @ dcm_ne(canyon.lat, canyon.lon).T) if seen.size >= 4 else NO_SOLUTION
        levels.append(Level(float(height), tuple(int(k) for k in seen), geometry))
    return levels


def appearance_heights(canyon: Canyon, constellation: Constellation, t_s: float = 0.0) -> dict[int, float]:
    """Height, m, at which each satellite comes into view, by index into the constellation, lowest first.

    From tan El = (H - h)/(L/2); the elevation is that from the height itself.  Satellites below the horizon are left out.
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
