"""Position fixes on the ellipsoid from DME slant ranges and a known height.

With DME geometry height is hardly observable, so the height comes from the altimeter and two positions remain for two stations
(Gebre-Egziabher 2004, equation 6.32 and section 2.6).  What cannot be true is refused with a sentence before it is fused.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.physics.earth import LocalFrame, horizon_distance
from lowcostnav_ros.radionav.fixing import Fix, Range, fix
from lowcostnav_ros.radionav.geometry import GeometryError, range_and_direction
from lowcostnav_ros.radionav.stations import Station

LOWEST_M, HIGHEST_M = -500.0, 30_000.0
SIGMAS = 5.0
HORIZON_MARGIN = 1.25
"""A reply received is evidence: antennas stand on masts and the air bends more on some days."""
STEP_M = 1.0e-4
ITERATIONS = 50


@dataclass(frozen=True, slots=True, eq=False)
class SlantFix:
    """Position ``lat``, ``lon`` rad at the given height, ``covariance`` (2, 2) m^2 north east, ``mirror`` (lat, lon) or None."""

    lat: float
    lon: float
    covariance: np.ndarray
    mirror: tuple[float, float] | None


def refuse_impossible(station: Station, slant_range_m: float, height: float, sigma_m: float) -> None:
    """Raise GeometryError when a slant range cannot be true for an aircraft at ``height`` (m above the ellipsoid)."""
    name = f"Range of {slant_range_m / 1000.0:.1f} km to {station.ident}"
    if not (math.isfinite(slant_range_m) and slant_range_m > 0.0):
        raise GeometryError(f"Range of {slant_range_m:g} m to {station.ident} is not a positive number; drop it.")
    if not LOWEST_M <= height <= HIGHEST_M:
        raise GeometryError(f"Height of {height:.0f} m is not that of an aircraft ({LOWEST_M:.0f} to {HIGHEST_M:.0f} m); check its unit.")
    above = height - station.height
    if slant_range_m < abs(above) - SIGMAS * sigma_m:
        raise GeometryError(f"{name} is shorter than the {abs(above):.0f} m between their heights; check the height or drop the range.")
    sea = station.height - station.elevation  # the horizon is that of the sea, not of the ellipsoid
    reach = HORIZON_MARGIN * float(horizon_distance(height - sea) + horizon_distance(station.elevation))
    if slant_range_m > math.hypot(reach, above) + SIGMAS * sigma_m:
        farthest = f"{reach / 1000.0:.0f} km at most"
        raise GeometryError(f"{name} is far beyond the radio horizon ({farthest}); check unit and station, or drop the range.")


def slant_fix(
    stations: Sequence[Station], slant_ranges_m: Sequence[float], height: float, predicted: tuple[float, float], sigma_m: float = 7.4
) -> SlantFix:
    """Fix a position from slant ranges at a known height.

    Parameters
    ----------
    stations : sequence of Station
        Two or more, different ones.
    slant_ranges_m : sequence of float
    height : float
        Aircraft, m above the ellipsoid.
    predicted : (float, float)
        Latitude and longitude by dead reckoning, rad; chooses between mirror positions.
    sigma_m : float
        1-sigma of each range, m.

    Raises
    ------
    GeometryError
        For ranges that cannot be true, circles that do not meet, or stations and aircraft on one line.
    """
    if len(stations) != len(slant_ranges_m):
        raise GeometryError(f"{len(slant_ranges_m)} ranges for {len(stations)} stations; give one range per station.")
    for station, slant in zip(stations, slant_ranges_m, strict=True):
        refuse_impossible(station, slant, height, sigma_m)
    plane = LocalFrame(*predicted, height)
    start = _on_plane(plane, stations, slant_ranges_m, sigma_m)
    lat, lon, P = _refine(stations, slant_ranges_m, height, plane.from_ned(np.append(start.position, 0.0))[0:2], sigma_m)
    mirror = None
    if start.mirror is not None:
        mirror = _refine(stations, slant_ranges_m, height, plane.from_ned(np.append(start.mirror, 0.0))[0:2], sigma_m)[0:2]
    return SlantFix(lat, lon, P, mirror)


def _on_plane(plane: LocalFrame, stations: Sequence[Station], slant_ranges_m: Sequence[float], sigma_m: float) -> Fix:
    """First solution on the plane tangent at the prediction, with each slant range projected by its height difference."""
    sights = []
    for station, slant in zip(stations, slant_ranges_m, strict=True):
        ned = plane.to_ned(station.lat, station.lon, station.height)
        ground = math.sqrt(max(slant**2 - ned[2] ** 2, (0.5 * sigma_m) ** 2))
        sights.append(Range(ned[0:2], ground, sigma_m))
    return fix(sights, np.zeros(2) + _nudge(sights), tolerance=1.0)


def _nudge(sights: Sequence[Range]) -> np.ndarray:
    """A metre off a station when the prediction sits on one, where a range has no direction."""
    return np.array([1.0, 1.0]) if any(np.hypot(*s.station) < 1.0 for s in sights) else np.zeros(2)


def _refine(
    stations: Sequence[Station], slant_ranges_m: Sequence[float], height: float, start: tuple[float, float], sigma_m: float
) -> tuple[float, float, np.ndarray]:
    """Gauss-Newton on the ellipsoid at constant height; returns lat, lon and covariance (2, 2)."""
    lat, lon = start
    measured = np.asarray(slant_ranges_m, dtype=float)
    for _ in range(ITERATIONS):
        seen = [range_and_direction(lat, lon, height, s.lat, s.lon, s.height) for s in stations]
        H = np.array([direction[0:2] for _, direction in seen])
        information = H.T @ H
        if np.linalg.cond(information) > 1e8:
            raise GeometryError("Stations and aircraft lie on one line, which gives no position across it; take a station to the side.")
        step = np.linalg.solve(information, H.T @ (measured - [r for r, _ in seen]))
        lat, lon, _ = LocalFrame(lat, lon, height).from_ned(np.append(step, 0.0))
        if math.hypot(*step) < STEP_M:
            return lat, lon, sigma_m**2 * np.linalg.inv(information)
    raise GeometryError("The slant ranges fit no position at this height; check the height and the stations.")
