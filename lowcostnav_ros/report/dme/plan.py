"""A DME plan: coverage by altitude, stations and schedule along the route, expected error of the backup navigator without GPS.

An airport is planned as four straight approaches from north, east, south and west, GPS lost half an hour out.  Heights are above sea
level throughout: stations and aircraft carry the same undulation, so it does not matter here.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lowcostnav_ros.base.units import DEGREE, NAUTICAL_MILE
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.radionav.benchmarks_vor import REQUIREMENT_M
from lowcostnav_ros.radionav.coverage import MOST_DISTANT_M, Coverage, coverage, grid_about
from lowcostnav_ros.radionav.interrogation import InterrogationSchedule
from lowcostnav_ros.radionav.navaid_import import NavaidList, select_near
from lowcostnav_ros.radionav.plan import Point, Reply, Route, replies_along, route_over, stations_along, what_is_wrong
from lowcostnav_ros.radionav.stations import StationTable
from lowcostnav_ros.studies.reduced_covariance import AidedSigma, aided_sigma

OUTAGE_S = 1800.0
"""Flight time without GPS that the requirement is for."""
MARGIN_M = 20.0 * NAUTICAL_MILE
APPROACHES = (("from north", 180.0), ("from east", 270.0), ("from south", 0.0), ("from west", 90.0))


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One way to fly at one altitude: what is received, the ranges of the schedule, both covariances, and what is wrong in sentences."""

    name: str
    route: Route
    points: list[Point]
    replies: list[Reply]
    sigma: AidedSigma
    sentences: list[str]

    @property
    def worst_m(self) -> float:
        """Largest expected horizontal 1-sigma, m."""
        return float(self.sigma.horizontal().max())

    @property
    def arrival_m(self) -> float:
        """Expected horizontal 1-sigma at the end, m."""
        return float(self.sigma.horizontal()[-1])

    @property
    def paired(self) -> float:
        """Share of the way with a pair of stations that fixes a position."""
        return float(np.mean([p.pair is not None for p in self.points]))


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """Everything at one altitude (m above sea level)."""

    altitude_m: float
    coverage: Coverage
    legs: list[Leg]

    @property
    def worst_m(self) -> float:
        """Largest expected horizontal 1-sigma of all legs, m."""
        return max(leg.worst_m for leg in self.legs)


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A plan: the stations of the area, the grid of the maps (offsets in m about ``centre``), one level per altitude, notes."""

    waypoints: list[tuple[float, float]]
    table: StationTable
    centre: tuple[float, float]
    offsets_m: np.ndarray
    schedule: InterrogationSchedule
    levels: list[Level]
    notes: list[str]

    def good_enough(self) -> bool:
        """Whether at some altitude the expected error stays within 0.5 NM all the way."""
        return any(level.worst_m <= REQUIREMENT_M for level in self.levels)


def make_plan(
    navaids: NavaidList, waypoints: Sequence[tuple[float, float]], altitudes: Sequence[float], speed: float, where: str
) -> Plan:
    """Work out a plan.

    Parameters
    ----------
    navaids : NavaidList
    waypoints : sequence of (lat, lon)
        Rad; one for an airport, more for a route.
    altitudes : sequence of float
        M above sea level.
    speed : float
        Over ground, m/s.
    where : str
        Name of the station list for messages.

    Raises
    ------
    StationError, PlanError
        When there is no station in the area, or the route cannot be flown.
    """
    routes = _routes(waypoints, speed)
    lat, lon = (np.concatenate([getattr(r, name)[::20] for _, r in routes]) for name in ("lat", "lon"))
    area = np.column_stack([waypoints[0], (lat, lon)])  # a refusal names the first place
    table, notes = select_near(navaids, area[0], area[1], MOST_DISTANT_M, where)
    table = StationTable(replace(s, height=s.elevation) for s in table)  # everything above sea level
    notes += [f"{count} rows of the list not used: {reason}." for reason, count in sorted(navaids.left_out.items())]
    centre, half_width = _frame(waypoints, lat, lon)
    offsets, grid_lat, grid_lon = grid_about(*centre, half_width)
    schedule = InterrogationSchedule()
    levels = [
        Level(h, coverage(list(table), grid_lat, grid_lon, h), [_leg(name, table, route, h, schedule) for name, route in routes])
        for h in altitudes
    ]
    return Plan(list(waypoints), table, centre, offsets, schedule, levels, notes)


def _routes(waypoints: Sequence[tuple[float, float]], speed: float) -> list[tuple[str, Route]]:
    if len(waypoints) > 1:
        return [("route", route_over(waypoints, speed))]
    route_over([waypoints[0], (waypoints[0][0] + 1e-3, waypoints[0][1])], speed)  # refuses a speed that cannot be flown
    frame = LocalFrame(*waypoints[0])
    routes = []
    for name, course_deg in APPROACHES:
        course = course_deg * DEGREE
        start = frame.from_ned(-speed * OUTAGE_S * np.array([math.cos(course), math.sin(course), 0.0]))
        routes.append((name, route_over([start[0:2], waypoints[0]], speed)))
    return routes


def _leg(name: str, table: StationTable, route: Route, height: float, schedule: InterrogationSchedule) -> Leg:
    points = stations_along(table, route, height)
    replies = replies_along(table, route, height, points, schedule)
    return Leg(name, route, points, replies, aided_sigma(route, replies), what_is_wrong(points))


def _frame(waypoints: Sequence[tuple[float, float]], lat: np.ndarray, lon: np.ndarray) -> tuple[tuple[float, float], float]:
    """Centre (rad) and half width (m) of the maps: an airport with 40 NM around it, a route with a margin."""
    if len(waypoints) == 1:
        return waypoints[0], 2.0 * MARGIN_M
    frame = LocalFrame(float(lat[0]), float(lon[0]))
    ned = frame.to_ned(lat, lon, 0.0)
    middle = 0.5 * (ned.min(axis=0) + ned.max(axis=0))
    centre = frame.from_ned(np.append(middle[:2], 0.0))
    return (centre[0], centre[1]), float(0.5 * np.ptp(ned[:, :2], axis=0).max() + MARGIN_M)
