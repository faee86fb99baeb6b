"""Which stations to ask: in line of sight, inside the service volume, not overhead, lines of sight near a right angle.

Rules of Gebre-Egziabher 2004, sections 2.6 and 7.1: two ranges fix a position with HDOP sqrt(2)/|sin gamma|, so the pair with
the smallest error wins, and a pair on one line with the aircraft never does.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.physics.earth import line_of_sight_clear
from lowcostnav_ros.radionav.geometry import hdop, horizontal_range, range_and_direction
from lowcostnav_ros.radionav.stations import Station, StationTable

STEEPEST = math.radians(45.0)
"""Elevation above which a slant range depends more on height than on position."""
KEEP_MARGIN = 1.5
"""How much worse than the best a pair may be and still be kept."""


@dataclass(frozen=True, slots=True, eq=False)
class InView:
    """A station as seen from the aircraft: ``range_m``, ``direction_n`` (3,) from station to aircraft, ``elevation`` rad."""

    station: Station
    range_m: float
    direction_n: np.ndarray
    elevation: float


def view(station: Station, lat: float, lon: float, height: float) -> InView:
    """Return range and direction of one station from a position (rad, rad, m above the ellipsoid)."""
    range_m, direction_n = range_and_direction(lat, lon, height, station.lat, station.lon, station.height)
    return InView(station, range_m, direction_n, math.asin(min(1.0, max(-1.0, -direction_n[2]))))


def audible(station: Station, lat: float, lon: float, height: float) -> bool:
    """Return whether a station can be received: inside its service volume and above the radio horizon."""
    seen = view(station, lat, lon, height)
    ground_m = horizontal_range(seen.range_m, height - station.height)
    altitude = height - (station.height - station.elevation)  # the horizon is that of the sea, not of the ellipsoid
    in_volume = seen.range_m <= station.service_range_m(height)
    return in_volume and bool(line_of_sight_clear(altitude, station.elevation, ground_m))


def usable(table: StationTable, lat: float, lon: float, height: float) -> list[InView]:
    """Return the DME that can reply and are not too nearly overhead, nearest first."""
    seen = [view(s, lat, lon, height) for s in table if s.has_dme and audible(s, lat, lon, height)]
    return sorted((v for v in seen if v.elevation <= STEEPEST), key=lambda v: (v.range_m, v.station.ident))


def best_pair(
    table: StationTable, lat: float, lon: float, height: float, keep: tuple[Station, Station] | None = None
) -> tuple[Station, Station] | None:
    """Return the pair of stations that fixes this position best, or None where fewer than two give a position.

    The measure is the HDOP of the pair with each range weighted by the cosine of its elevation, since a slant range error acts
    on the ground divided by it.  Equal pairs are decided by ident, so the choice does not depend on the order of the table.

    Parameters
    ----------
    table : StationTable
    lat, lon, height : float
        Aircraft, rad, rad, m above the ellipsoid.
    keep : tuple of Station, optional
        The present pair: kept while its measure is within :data:`KEEP_MARGIN` of the best, since every change costs a search.
    """
    scores = {
        tuple(sorted((a.station.ident, b.station.ident))): _error_per_range_error(a, b)
        for a, b in itertools.combinations(usable(table, lat, lon, height), 2)
    }
    scores = {pair: score for pair, score in scores.items() if math.isfinite(score)}
    if not scores:
        return None
    best = min(scores, key=lambda pair: (scores[pair], pair))
    if keep is not None:
        present = tuple(sorted(s.ident for s in keep))
        if scores.get(present, math.inf) <= KEEP_MARGIN * scores[best]:
            best = present
    return table[best[0]], table[best[1]]


def _error_per_range_error(a: InView, b: InView) -> float:
    return hdop(np.array([a.direction_n, b.direction_n])) / min(math.cos(a.elevation), math.cos(b.elevation))
