"""Geometry of ranges: prediction with its derivative, dilution of precision, mirror solutions.

Horizontal directions are NED: x north, y east; a bearing is clockwise from true north.  Equations: Gebre-Egziabher 2004,
section 7.1, chapter 6 and appendix D.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef


class GeometryError(ValueError):
    """Ranges that give no position; the message states why."""


@kernel
def range_and_direction(
    lat: float, lon: float, height: float, station_lat: float, station_lon: float, station_height: float
) -> tuple[float, np.ndarray]:
    """Predict a slant range and its derivative with respect to the aircraft's position.

    Parameters
    ----------
    lat, lon, height : float
        Aircraft, rad, rad, m above the ellipsoid.
    station_lat, station_lon, station_height : float
        Station, likewise.

    Returns
    -------
    range_m : float
        Straight-line distance, m.
    direction_n : ndarray, shape (3,)
        Unit vector FROM the station TO the aircraft, in the aircraft's NED: the row d(range)/d(north, east, down).  Zero at the
        station itself, where the derivative does not exist.
    """
    d_e = geodetic_to_ecef(lat, lon, height) - geodetic_to_ecef(station_lat, station_lon, station_height)
    range_m = math.sqrt(d_e[0] * d_e[0] + d_e[1] * d_e[1] + d_e[2] * d_e[2])
    direction_n = np.zeros(3)
    if range_m > 0.0:
        c_ne = dcm_ne(lat, lon)
        for i in range(3):
            direction_n[i] = (c_ne[i, 0] * d_e[0] + c_ne[i, 1] * d_e[1] + c_ne[i, 2] * d_e[2]) / range_m
    return range_m, direction_n


def horizontal_range(slant_range_m: float, height_difference_m: float) -> float:
    """Return ``sqrt(R^2 - dh^2)`` (eq. 6.32), or 0 when noise makes the slant range shorter than the height difference."""
    return math.sqrt(max(slant_range_m**2 - height_difference_m**2, 0.0))


def hdop(directions: np.ndarray) -> float:
    """Return the horizontal dilution of precision ``sqrt(trace((H^T H)^-1))``.

    Parameters
    ----------
    directions : ndarray, shape (n, 2) or (n, 3)
        Lines of sight; only north and east are used, normalised, n >= 2.

    Returns
    -------
    float
        ``inf`` when all lines of sight are parallel.
    """
    rows = np.asarray(directions, dtype=float)[:, 0:2]
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    information = rows.T @ rows
    determinant = information[0, 0] * information[1, 1] - information[0, 1] ** 2
    if determinant <= 1e-12:
        return math.inf
    return math.sqrt(np.trace(information) / determinant)


def angle_between(direction_a: np.ndarray, direction_b: np.ndarray) -> float:
    """Return the horizontal angle between two lines of sight, rad in [0, pi]."""
    cross = direction_a[0] * direction_b[1] - direction_a[1] * direction_b[0]
    return abs(math.atan2(cross, direction_a[0] * direction_b[0] + direction_a[1] * direction_b[1]))


def collinear_with_track(course: float, directions: np.ndarray, tolerance: float = math.radians(10.0)) -> bool:
    """Return whether every station lies along the track, ahead or behind, so that cross-track position is not observable.

    Parameters
    ----------
    course : float
        Course over ground, rad.
    directions : ndarray, shape (n, 2) or (n, 3)
        Lines of sight.
    tolerance : float
        Largest angle between a line of sight and the track that counts as along it, rad.
    """
    track = np.array([math.cos(course), math.sin(course)])
    return all(math.sin(angle_between(track, direction)) < math.sin(tolerance) for direction in np.asarray(directions))


def two_range_fixes(station_a: np.ndarray, station_b: np.ndarray, range_a_m: float, range_b_m: float) -> np.ndarray:
    """Intersect two circles of horizontal range.

    Parameters
    ----------
    station_a, station_b : ndarray, shape (2,)
        North, east, m.
    range_a_m, range_b_m : float
        Horizontal ranges, m.

    Returns
    -------
    ndarray, shape (2, 2)
        The two solutions, mirror points of each other about the line through the stations; the first lies to the left of the
        way from a to b.

    Raises
    ------
    GeometryError
        When the stations coincide or the circles do not meet.
    """
    baseline = np.subtract(station_b, station_a)
    length = float(np.hypot(*baseline))
    if length == 0.0:
        raise GeometryError("Both ranges are to the same place; use two different stations.")
    along = (range_a_m**2 - range_b_m**2 + length**2) / (2.0 * length)
    square = range_a_m**2 - along**2
    if square < 0.0:
        ranges = f"{range_a_m:.0f} m and {range_b_m:.0f} m"
        raise GeometryError(f"Ranges of {ranges} do not meet over a baseline of {length:.0f} m; wait for new ranges.")
    unit = baseline / length
    left = np.array([unit[1], -unit[0]])  # clockwise bearings: left of north is west
    foot = np.asarray(station_a) + along * unit
    return np.array([foot + math.sqrt(square) * left, foot - math.sqrt(square) * left])


def mirror_point(position: np.ndarray, station_a: np.ndarray, station_b: np.ndarray) -> np.ndarray:
    """Return the other position (2,), north east m, that has the same ranges to both stations as ``position`` (2,)."""
    baseline = np.subtract(station_b, station_a)
    unit = baseline / np.hypot(*baseline)
    offset = np.subtract(position, station_a)
    return np.asarray(station_a) + 2.0 * (offset @ unit) * unit - offset
