"""Position fixes on a plane from ranges and bearings: rho-rho, theta-theta, rho-theta and any combination.

Coordinates are metres (or any one unit) north and east; a bearing is the true one FROM the station TO the aircraft, clockwise from
north: add the station's magnetic variation to a VOR radial first.  Least squares is iterated with a step gain
(Gebre-Egziabher 2004, appendix D: (D.2), (D.4), (D.5), (D.11) with its corrections: the innovation is measured minus predicted and the
step is added; P = (H' R^-1 H)^-1).
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.radionav.geometry import GeometryError, mirror_point, two_range_fixes

MAX_ITERATIONS = 200
MISS_SIGMAS = 5.0
CONDITION = 1.0e6
"""Ratio of the ellipse's axes beyond which a geometry gives a line of positions, not a position."""


@dataclass(frozen=True, slots=True, eq=False)
class Range:
    """Horizontal distance ``measured`` to ``station`` (2,), north east, with 1-sigma ``sigma``."""

    station: np.ndarray
    measured: float
    sigma: float

    def predicted(self, position: np.ndarray) -> float:
        """Distance of ``position`` (2,) from the station."""
        return float(np.hypot(*np.subtract(position, self.station)))

    def innovation(self, position: np.ndarray) -> float:
        """Measured minus predicted."""
        return self.measured - self.predicted(position)

    def row(self, position: np.ndarray) -> np.ndarray:
        """Derivative by north and east, shape (2,): the unit vector from station to aircraft."""
        return np.subtract(position, self.station) / _apart(self.predicted(position))


@dataclass(frozen=True, slots=True, eq=False)
class Bearing:
    """True bearing ``measured`` (rad) from ``station`` (2,), north east, to the aircraft, with 1-sigma ``sigma`` (rad)."""

    station: np.ndarray
    measured: float
    sigma: float

    def predicted(self, position: np.ndarray) -> float:
        """Bearing of ``position`` (2,) from the station, rad."""
        north, east = np.subtract(position, self.station)
        return math.atan2(east, north)

    def innovation(self, position: np.ndarray) -> float:
        """Measured minus predicted, in (-pi, pi]."""
        return wrap(self.measured - self.predicted(position))

    def row(self, position: np.ndarray) -> np.ndarray:
        """Derivative by north and east, shape (2,), rad per unit of length."""
        north, east = np.subtract(position, self.station)
        return np.array([-east, north]) / _apart(math.hypot(north, east)) ** 2


Sight = Range | Bearing


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """A position fix.

    Attributes
    ----------
    position : ndarray, shape (2,)
        North, east.
    covariance : ndarray, shape (2, 2)
        Depends on the weighting, see :func:`covariance`.
    mirror : ndarray (2,) or None
        The other position with the same ranges, where the sights do not separate them.
    iterations : int
    misfit : float
        Root mean square of the innovations, each over its sigma; near 1 when the sigmas are right, large for a wrong sight.
    """

    position: np.ndarray
    covariance: np.ndarray
    mirror: np.ndarray | None
    iterations: int
    misfit: float


def fix(
    sights: Sequence[Sight],
    predicted: np.ndarray | None = None,
    *,
    step_gain: float = 1.0,
    weighted: bool = True,
    tolerance: float = 1e-6,
) -> Fix:
    """Find the position that fits the sights best.

    Parameters
    ----------
    sights : sequence of Range or Bearing
        Two or more.
    predicted : ndarray (2,), optional
        Position by dead reckoning: where to begin, and which of two mirror solutions is meant.  Needed for ranges to one pair of
        stations alone.
    step_gain : float
        Part of each step that is taken, in (0, 1]; small values converge slowly and from farther away.
    weighted : bool
        False solves the rows as they stand (metres and radians mixed), the way the thesis printed its combined fix.
    tolerance : float
        A step shorter than this ends the iteration (unit of the coordinates).

    Raises
    ------
    GeometryError
        When the sights give no position, or two and there is no prediction to choose by; the message states what to do.
    """
    _check(sights, step_gain)
    position = np.array(_start(sights) if predicted is None else predicted, dtype=float)
    for iteration in range(1, MAX_ITERATIONS + 1):
        H, y, sigma = _system(sights, position)
        scale = sigma if weighted else np.ones_like(sigma)
        step = step_gain * np.linalg.lstsq(H / scale[:, None], y / scale, rcond=None)[0]
        position = position + step
        if not np.isfinite(position).all() or np.abs(position).max() > 1e9:
            break
        if math.hypot(*step) < tolerance:
            P = covariance(sights, position, weighted=weighted)
            _, y, sigma = _system(sights, position)
            return Fix(position, P, _mirror(sights, position), iteration, float(np.sqrt(np.mean((y / sigma) ** 2))))
    raise GeometryError(f"The fix did not converge in {MAX_ITERATIONS} steps; begin nearer the aircraft or use a smaller step gain.")


def covariance(sights: Sequence[Sight], position: np.ndarray, *, weighted: bool = True) -> np.ndarray:
    """Return the covariance (2, 2) of a fix at ``position``: (H' R^-1 H)^-1, or H+ R H+' of the unweighted rows.

    Raises
    ------
    GeometryError
        When stations and position lie on one line.
    """
    H, _, sigma = _system(sights, np.asarray(position, dtype=float))
    axes = np.linalg.svd(H / sigma[:, None], compute_uv=False)
    if axes[1] * CONDITION < axes[0]:
        raise GeometryError("Stations and aircraft lie on one line, which gives no position across it; take a station to the side.")
    if weighted:
        return np.linalg.inv((H / sigma[:, None]).T @ (H / sigma[:, None]))
    solve = np.linalg.pinv(H)
    return (solve * sigma**2) @ solve.T


def _system(sights: Sequence[Sight], position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows (n, 2), innovations (n,) and sigmas (n,)."""
    H = np.array([s.row(position) for s in sights])
    return H, np.array([s.innovation(position) for s in sights]), np.array([s.sigma for s in sights])


def _apart(distance: float) -> float:
    if distance == 0.0:
        raise GeometryError("The position lies on a station, where ranges and bearings have no direction; begin elsewhere.")
    return distance


def _check(sights: Sequence[Sight], step_gain: float) -> None:
    if len(sights) < 2:
        raise GeometryError("A fix needs two ranges or bearings; wait for another station.")
    if not 0.0 < step_gain <= 1.0:
        raise GeometryError(f"The step gain must lie in (0, 1], got {step_gain:g}.")
    for s in sights:
        if not (np.isfinite(s.station).all() and math.isfinite(s.measured) and math.isfinite(s.sigma) and s.sigma > 0.0):
            raise GeometryError("Every sight needs a finite station, a finite measurement and a positive sigma; correct or drop it.")
        if isinstance(s, Range) and s.measured <= 0.0:
            raise GeometryError(f"A range of {s.measured:g} is not positive; drop it.")
    refuse_apart([s for s in sights if isinstance(s, Range)])
    one_place = all(np.array_equal(s.station, sights[0].station) for s in sights)
    if one_place and len({type(s) for s in sights}) == 1:
        raise GeometryError("All sights are of one kind to the same place; use a second station.")


def refuse_apart(ranges: Sequence[Range]) -> None:
    """Refuse circles that miss each other by more than the noise explains: least squares would invent a place between them.

    Raises
    ------
    GeometryError
        Naming both ranges and the gap.
    """
    for a, b in itertools.combinations(ranges, 2):
        length = math.dist(a.station, b.station)
        miss = max(length - a.measured - b.measured, abs(a.measured - b.measured) - length)
        if length > 0.0 and miss > MISS_SIGMAS * math.hypot(a.sigma, b.sigma):
            ranges_text = f"Ranges of {a.measured:g} and {b.measured:g} miss each other by {miss:.3g}"
            raise GeometryError(f"{ranges_text} over a baseline of {length:g}; one station or one range is not the one meant.")


def _start(sights: Sequence[Sight]) -> np.ndarray:
    """A first position without a prediction: range and bearing, else two bearings, else three ranges."""
    ranges = [s for s in sights if isinstance(s, Range)]
    bearings = [s for s in sights if isinstance(s, Bearing)]
    if ranges and bearings:
        places = [crossing for r, b in itertools.product(ranges, bearings) for crossing in _range_on_bearing(r, b)]
        if not places:
            raise GeometryError("No range circle meets a bearing line; check the sights, magnetic variation first.")
        return min(places, key=lambda place: sum((s.innovation(place) / s.sigma) ** 2 for s in sights))
    return _bearing_cross(bearings) if bearings else _range_cross(ranges)


def _range_on_bearing(r: Range, b: Bearing) -> list[np.ndarray]:
    """Where a bearing line, forward of its station, meets a range circle."""
    unit = np.array([math.cos(b.measured), math.sin(b.measured)])
    offset = np.subtract(r.station, b.station)
    along = float(offset @ unit)
    square = r.measured**2 - (float(offset @ offset) - along**2)
    if square < 0.0:
        return []
    return [b.station + t * unit for t in (along - math.sqrt(square), along + math.sqrt(square)) if t > 0.0]


def _bearing_cross(bearings: Sequence[Bearing]) -> np.ndarray:
    """Least-squares meeting point of bearing lines; it must lie forward of every station."""
    normal = np.array([[-math.sin(b.measured), math.cos(b.measured)] for b in bearings])
    if np.linalg.svd(normal, compute_uv=False)[1] < 1.0 / CONDITION:
        raise GeometryError("The bearings are parallel and do not meet; take a station to the side.")
    place = np.linalg.lstsq(normal, np.array([n @ b.station for n, b in zip(normal, bearings, strict=True)]), rcond=None)[0]
    if any(math.cos(b.innovation(place)) < 0.0 for b in bearings):
        raise GeometryError("The bearings meet behind a station; check for a bearing TO the station given as one FROM it.")
    return place


def _range_cross(ranges: Sequence[Range]) -> np.ndarray:
    """Meeting point of three or more circles by their differences, which are linear in the position."""
    stations = np.array([r.station for r in ranges])
    offsets = stations - stations.mean(axis=0)
    spread = np.linalg.svd(offsets, compute_uv=False)
    if spread[1] < spread[0] / CONDITION:
        raise GeometryError("Ranges to stations on one line fit two mirror positions; give a position by dead reckoning to choose.")
    squares = np.array([r.measured**2 for r in ranges]) - (stations**2).sum(axis=1)
    return np.linalg.lstsq(2.0 * offsets, squares.mean() - squares, rcond=None)[0]


def _mirror(sights: Sequence[Sight], position: np.ndarray) -> np.ndarray | None:
    """The mirror of ``position`` about the line of the stations, None where bearings or a station off the line decide."""
    if not all(isinstance(s, Range) for s in sights):
        return None
    stations = np.array([s.station for s in sights])
    spread = np.linalg.svd(stations - stations.mean(axis=0), compute_uv=False)
    if spread[1] >= spread[0] / CONDITION:
        return None
    far = max(range(len(stations)), key=lambda i: math.dist(stations[0], stations[i]))
    return mirror_point(position, stations[0], stations[far])


def rho_rho(a: Range, b: Range, predicted: np.ndarray) -> Fix:
    """Fix by two ranges in closed form; of the two circle crossings the one nearer ``predicted`` (2,), the other named as mirror.

    Raises
    ------
    GeometryError
        For coincident stations, circles that do not meet, or an aircraft on the line through the stations.
    """
    _check((a, b), 1.0)
    crossings = two_range_fixes(a.station, b.station, a.measured, b.measured)
    order = np.argsort(np.hypot(*(crossings - predicted).T))
    place, other = crossings[order]
    return Fix(place, covariance((a, b), place), other, 0, 0.0)
