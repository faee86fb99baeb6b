"""Coverage of a real place by its DME stations: how many answer, the best pair and its HDOP, on a grid of positions.

A station answers inside its service volume and above the radio horizon of a smooth earth: hills are not in it, so a low altitude in
mountains is covered worse than stated here.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.units import FOOT, NAUTICAL_MILE
from lowcostnav_ros.physics.earth import LocalFrame, horizon_distance
from lowcostnav_ros.radionav.layouts import hdop_of_sums
from lowcostnav_ros.radionav.selection import STEEPEST
from lowcostnav_ros.radionav.stations import Station


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Coverage at one height on a grid of shape (n, m).

    Attributes
    ----------
    audible : ndarray of int
        Number of stations that answer and are not overhead.
    hdop_all : ndarray
        HDOP of all of them together, ``inf`` below two.
    hdop_pair : ndarray
        HDOP of the best pair of them, ``inf`` below two.
    pair : ndarray of int, shape (n, m, 2)
        Indices of that pair in the list of stations, -1 where there is none.
    """

    audible: np.ndarray
    hdop_all: np.ndarray
    hdop_pair: np.ndarray
    pair: np.ndarray

    def share(self, at_least: int) -> float:
        """Return the share of the points with ``at_least`` so many stations."""
        return float(np.mean(self.audible >= at_least))


def coverage(stations: Sequence[Station], lat: np.ndarray, lon: np.ndarray, height: float) -> Coverage:
    """Work out the coverage at ``height`` (m above the ellipsoid) for arrays ``lat``, ``lon`` (rad) of one shape.

    The same rules as :func:`lowcostnav_ros.radionav.selection.usable`, for many positions at once.
    """
    lat, lon = np.broadcast_arrays(np.asarray(lat, float), np.asarray(lon, float))
    seen = [_view(s, lat, lon, height) for s in stations]
    if not seen:
        nothing = np.full(lat.shape, np.inf)
        return Coverage(np.zeros(lat.shape, int), nothing, nothing.copy(), np.full((*lat.shape, 2), -1))
    u_n, u_e = (np.array([s[k] for s in seen]) for k in (0, 1))
    received = np.array([s[2] for s in seen])
    every = hdop_of_sums((received * u_n**2).sum(0), (received * u_e**2).sum(0), (received * u_n * u_e).sum(0))
    best, pair = _best_pairs(u_n, u_e, received)
    return Coverage(received.sum(0), every, best, pair)


def _view(station: Station, lat: np.ndarray, lon: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Horizontal unit direction north and east at the aircraft, and whether the station can be used from there."""
    plane = LocalFrame(station.lat, station.lon, station.height)
    d_e = plane.to_ned(lat, lon, np.full(lat.shape, height)) @ plane.C_le  # earth-fixed, from station to aircraft
    slant = np.linalg.norm(d_e, axis=-1)
    sp, cp, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    across = cl * d_e[..., 0] + sl * d_e[..., 1]
    north, east = cp * d_e[..., 2] - sp * across, cl * d_e[..., 1] - sl * d_e[..., 0]
    elevation = np.arcsin(np.clip((cp * across + sp * d_e[..., 2]) / np.maximum(slant, 1e-3), -1.0, 1.0))
    sea = station.height - station.elevation  # the horizon is that of the sea, not of the ellipsoid
    reach = horizon_distance(height - sea) + horizon_distance(station.elevation)
    ground = np.sqrt(np.maximum(slant**2 - (height - station.height) ** 2, 0.0))
    received = (slant <= station.service_range_m(height)) & (ground <= reach) & (elevation <= STEEPEST)
    flat = np.maximum(np.hypot(north, east), 1e-3)
    return north / flat, east / flat, received


def _best_pairs(u_n: np.ndarray, u_e: np.ndarray, received: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    shape = received.shape[1:]
    best, pair = np.full(shape, np.inf), np.full((*shape, 2), -1)
    for i, j in itertools.combinations(range(len(received)), 2):
        both = received[i] & received[j]
        if not both.any():
            continue
        sine = np.abs(u_n[i] * u_e[j] - u_e[i] * u_n[j])
        value = np.where(both & (sine > 1e-6), math.sqrt(2.0) / np.maximum(sine, 1e-6), np.inf)
        better = value < best
        best[better] = value[better]
        pair[better] = i, j
    return best, pair


def grid_about(lat: float, lon: float, half_width_m: float, points: int = 61) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return offsets (points,) m and the latitude and longitude (points, points), rad, of a square grid about a place.

    Row i lies ``offsets[i]`` north, column j ``offsets[j]`` east.
    """
    offsets = np.linspace(-half_width_m, half_width_m, points)
    north, east = np.meshgrid(offsets, offsets, indexing="ij")
    grid_lat, grid_lon, _ = LocalFrame(lat, lon).from_ned(np.stack((north, east, np.zeros_like(north)), axis=-1))
    return offsets, grid_lat, grid_lon


def near(stations: Sequence[Station], lat: np.ndarray, lon: np.ndarray, within_m: float) -> list[Station]:
    """Return the stations within ``within_m`` of any of the places, nearest first."""
    earth = LocalFrame(0.0, 0.0)  # any one frame: straight-line distances do not depend on it
    places = earth.to_ned(np.atleast_1d(lat), np.atleast_1d(lon), 0.0)
    towers = earth.to_ned(*np.array([(s.lat, s.lon, 0.0) for s in stations]).reshape(-1, 3).T)
    distance = [float(np.linalg.norm(places - tower, axis=-1).min()) for tower in towers]
    order = sorted(range(len(distance)), key=lambda i: (distance[i], stations[i].ident))
    return [stations[i] for i in order if distance[i] <= within_m]


def altitudes_above(elevation_m: float) -> tuple[float, ...]:
    """Return the altitudes, m above sea level, coverage is asked for about a place: 500 and 1500 ft above it, then 1 and 2 km."""
    return tuple(elevation_m + above for above in (500.0 * FOOT, 1500.0 * FOOT, 1000.0, 2000.0))


MOST_DISTANT_M = 130.0 * NAUTICAL_MILE
"""Largest service range of any station: farther stations need not be looked at."""
