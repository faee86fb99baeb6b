"""VOR: the radial an aircraft is on, and how it turns as the aircraft moves.

A radial is the bearing FROM the station TO the aircraft, clockwise, counted from the station's own north, which was magnetic north when
the station was last aligned:

    true bearing = radial + declination of the station (east positive)

The bearing is the azimuth of the straight line in the station's horizontal plane.  Over the 130 NM a VOR serves it differs from the azimuth
of the geodesic by less than 0.001 degrees.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef
from lowcostnav_ros.physics.rotation import wrap_2pi
from lowcostnav_ros.radionav.selection import audible, view
from lowcostnav_ros.radionav.stations import Station, StationTable

STEEPEST = math.radians(60.0)
"""Elevation above which an aircraft is in the cone of confusion, where the radials of a VOR cannot be separated."""


@dataclass(frozen=True, slots=True, eq=False)
class BearingView:
    """An aircraft as its VOR sees it.

    ``bearing`` rad, true, clockwise, in [-pi, pi]; ``distance_m`` in the station's horizontal plane; ``elevation`` rad above that plane;
    ``gradient_n`` (3,) rad/m: derivative of the bearing by the aircraft's position north, east, down.
    """

    bearing: float
    distance_m: float
    elevation: float
    gradient_n: np.ndarray


def bearing_view(station: Station, lat: float, lon: float, height: float) -> BearingView:
    """Return how a station sees an aircraft (rad, rad, m above the ellipsoid)."""
    return BearingView(*bearing_and_gradient(lat, lon, height, station.lat, station.lon, station.height))


@kernel
def bearing_and_gradient(
    lat: float, lon: float, height: float, station_lat: float, station_lon: float, station_height: float
) -> tuple[float, float, float, np.ndarray]:
    """Bearing, horizontal distance, elevation and gradient of a :class:`BearingView`; the gradient is zero right over the station."""
    d_e = geodetic_to_ecef(lat, lon, height) - geodetic_to_ecef(station_lat, station_lon, station_height)
    c_se, c_ne = dcm_ne(station_lat, station_lon), dcm_ne(lat, lon)
    d = np.zeros(3)
    for i in range(3):
        d[i] = c_se[i, 0] * d_e[0] + c_se[i, 1] * d_e[1] + c_se[i, 2] * d_e[2]
    square = d[0] * d[0] + d[1] * d[1]
    distance_m = math.sqrt(square)
    gradient_n = np.zeros(3)
    if square > 0.0:
        across_e = np.zeros(3)  # unit turn per metre: d(bearing) = (north d_east - east d_north) / distance^2, taken to e and on to n
        for j in range(3):
            across_e[j] = (d[0] * c_se[1, j] - d[1] * c_se[0, j]) / square
        for i in range(3):
            gradient_n[i] = c_ne[i, 0] * across_e[0] + c_ne[i, 1] * across_e[1] + c_ne[i, 2] * across_e[2]
    return math.atan2(d[1], d[0]), distance_m, math.atan2(-d[2], distance_m), gradient_n


def radial_of(bearing: float, declination: float) -> float:
    """Return the radial, rad in [0, 2 pi), of a true bearing from a station with this declination."""
    return float(wrap_2pi(bearing - declination))


def out_of_service(station: Station, lat: float, lon: float, height: float) -> str:
    """State why no bearing of a station can be used from a position, in a fixed phrase; empty when one can."""
    if not station.has_vor:
        return "station has no VOR"
    if bearing_view(station, lat, lon, height).elevation > STEEPEST:
        return "in the cone of confusion"
    return "" if audible(station, lat, lon, height) else "outside the service volume"


def nearest_vors(table: StationTable, lat: float, lon: float, height: float, count: int) -> list[Station]:
    """Return the ``count`` nearest stations whose radials can be used, nearest first: an error of bearing grows with the distance."""
    received = [s for s in table if not out_of_service(s, lat, lon, height)]
    return sorted(received, key=lambda s: (view(s, lat, lon, height).range_m, s.ident))[:count]
