"""Where to put DME stations about an airport, and how well ranges to them fix a position over the area.

HDOP = sqrt(trace((H' H)^-1)) of horizontal unit lines of sight; position error = HDOP times range error.  Two stations give
sqrt(2)/|sin gamma|, unbounded on the line through them; three at the corners of an equilateral triangle give 2/sqrt(3) = 1.155 at its
centre, the smallest there is (Gebre-Egziabher 2004, section 7.1, figures 7.1 to 7.4).
Coordinates are metres north and east of the airport.
"""

import math
from collections.abc import Sequence

import numpy as np

from lowcostnav_ros.base.units import NAUTICAL_MILE

RADIUS_M = 20.0 * NAUTICAL_MILE
NOISE_M = 7.4
"""White range noise, 0.004 NM."""


def triple(radius_m: float = RADIUS_M, first_bearing: float = 0.0) -> np.ndarray:
    """Return three stations (3, 2) at the corners of an equilateral triangle about the airport, the first at ``first_bearing`` rad."""
    bearing = first_bearing + np.arange(3) * 2.0 * math.pi / 3.0
    return radius_m * np.column_stack((np.cos(bearing), np.sin(bearing)))


def double(half_baseline_m: float = RADIUS_M, beyond_m: float = 0.0, approach_course: float = 0.0) -> np.ndarray:
    """Return two stations (2, 2) left and right of an approach.

    Parameters
    ----------
    half_baseline_m : float
        Distance of each from the approach course, m.
    beyond_m : float
        How far beyond the airport the line through them crosses the course; positive keeps the aircraft from crossing it before it
        lands (the offset layout of figure 7.4).
    approach_course : float
        Course flown to the airport, rad.
    """
    ahead = np.array([math.cos(approach_course), math.sin(approach_course)])
    right = np.array([-ahead[1], ahead[0]])
    return np.array([beyond_m * ahead - half_baseline_m * right, beyond_m * ahead + half_baseline_m * right])


def hdop_map(stations: np.ndarray, north: np.ndarray | float, east: np.ndarray | float) -> np.ndarray:
    """Return the HDOP at every point of a grid.

    Parameters
    ----------
    stations : ndarray, shape (n, 2)
        North, east, m; n >= 2.
    north, east : ndarray
        Coordinates of the points, m; broadcast together.

    Returns
    -------
    ndarray
        ``inf`` where all lines of sight are parallel, or at a station where fewer than two directions remain.
    """
    d_n = np.asarray(north, float)[..., None] - stations[:, 0]
    d_e = np.asarray(east, float)[..., None] - stations[:, 1]
    distance = np.hypot(d_n, d_e)
    at_station = distance == 0.0
    u_n, u_e = (np.where(at_station, 0.0, d / np.where(at_station, 1.0, distance)) for d in (d_n, d_e))
    return hdop_of_sums((u_n * u_n).sum(-1), (u_e * u_e).sum(-1), (u_n * u_e).sum(-1))


def hdop_of_sums(nn: np.ndarray, ee: np.ndarray, ne: np.ndarray) -> np.ndarray:
    """Return sqrt(trace((H' H)^-1)) from the elements of H' H, ``inf`` where it is singular."""
    determinant = nn * ee - ne * ne
    singular = determinant <= 1e-12
    return np.where(singular, np.inf, np.sqrt((nn + ee) / np.where(singular, 1.0, determinant)))


def track_errors(
    stations: np.ndarray, position: Sequence[float] | np.ndarray, course: float, sigma_m: float = NOISE_M
) -> tuple[float, float]:
    """Return the 1-sigma in-track and cross-track errors, m, of a fix at ``position`` (2,) flying ``course`` (rad).

    Both are ``inf`` where the lines of sight are parallel.
    """
    direction = np.asarray(position, float) - stations
    rows = direction / np.hypot(*direction.T)[:, None]
    turn = np.array([[math.cos(course), -math.sin(course)], [math.sin(course), math.cos(course)]])
    information = (rows @ turn).T @ (rows @ turn)
    if np.linalg.det(information) <= 1e-12:
        return math.inf, math.inf
    variance = sigma_m**2 * np.diag(np.linalg.inv(information))
    return math.sqrt(variance[0]), math.sqrt(variance[1])
