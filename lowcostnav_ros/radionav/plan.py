"""What the DME stations give along a route: which answer, which pair to ask, when, and where that is not enough.

The pair is chosen anew once a minute by the rules of :mod:`lowcostnav_ros.radionav.selection`; one receiver asks the two in turn.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.radionav.geometry import angle_between, collinear_with_track, hdop, range_and_direction
from lowcostnav_ros.radionav.interrogation import InterrogationSchedule
from lowcostnav_ros.radionav.selection import best_pair, usable, view
from lowcostnav_ros.radionav.stations import StationTable

CHOOSE_EVERY_S = 60.0
LONGEST_LEG_M = 2.0e6
POOR_HDOP = 4.0
"""HDOP above which a pair counts as poor: lines of sight less than 21 degrees apart."""


class PlanError(ValueError):
    """A place or route that cannot be planned; the message says what to do."""


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A route flown at constant speed: columns (n,) of ``time_s``, ``lat``, ``lon`` rad, ``course`` rad; ``speed`` m/s."""

    time_s: np.ndarray
    lat: np.ndarray
    lon: np.ndarray
    course: np.ndarray
    speed: float

    def at(self, time_s: float) -> int:
        """Return the index of the last point at or before a time."""
        return max(0, int(np.searchsorted(self.time_s, time_s, side="right")) - 1)


def route_over(waypoints: Sequence[tuple[float, float]], speed: float, step_s: float = 5.0) -> Route:
    """Lay straight legs over waypoints.

    Parameters
    ----------
    waypoints : sequence of (lat, lon)
        Rad, two or more.
    speed : float
        Speed over ground, m/s.
    step_s : float
        Time between points, at most; every waypoint is a point.

    Raises
    ------
    PlanError
        For fewer than two waypoints, a repeated one, a leg over 2000 km or a speed that is not positive.
    """
    if len(waypoints) < 2:
        raise PlanError("A route needs two waypoints or more; give LAT,LON;LAT,LON.")
    if not (math.isfinite(speed) and speed > 0.0):
        raise PlanError(f"The speed must be positive, got {speed:g} m/s.")
    columns: list[np.ndarray] = []
    begin_s = 0.0
    for number, (a, b) in enumerate(zip(waypoints[:-1], waypoints[1:], strict=True), 1):
        frame = LocalFrame(*a)
        chord = frame.to_ned(b[0], b[1], 0.0)
        length = float(np.linalg.norm(chord))
        if not 1.0 <= length <= LONGEST_LEG_M:
            why = "has no length; remove the repeated waypoint" if length < 1.0 else f"is {length / 1000:.0f} km long; check its waypoints"
            raise PlanError(f"Leg {number} of the route {why}.")
        steps = max(1, math.ceil(length / (speed * step_s)))
        share = np.linspace(0.0, 1.0, steps + 1)[(0 if number == 1 else 1) :]
        lat, lon, _ = frame.from_ned(share[:, None] * chord)
        course = [_course(place, chord, frame) for place in zip(lat, lon, strict=True)]
        columns.append(np.column_stack((begin_s + share * length / speed, lat, lon, course)))
        begin_s += length / speed
    time_s, lat, lon, course = np.vstack(columns).T
    return Route(time_s, lat, lon, course, speed)


def _course(place: tuple[float, float], chord: np.ndarray, frame: LocalFrame) -> float:
    north, east, _ = frame.C_ln(*place).T @ chord
    return math.atan2(east, north) % (2.0 * math.pi)


@dataclass(frozen=True, slots=True)
class Point:
    """What is received at one place of the route.

    ``usable`` idents nearest first, ``pair`` the two to ask or None, ``gamma`` the angle between their lines of sight (rad), ``hdop``
    theirs (``inf`` without a pair), ``collinear`` true when both lie along the track.
    """

    time_s: float
    distance_m: float
    lat: float
    lon: float
    course: float
    usable: tuple[str, ...]
    pair: tuple[str, str] | None
    gamma: float
    hdop: float
    collinear: bool

    @property
    def poor(self) -> bool:
        """Whether the pair gives a poor position: along the track, or with an HDOP above :data:`POOR_HDOP`."""
        return self.collinear or self.hdop > POOR_HDOP


def stations_along(table: StationTable, route: Route, height: float) -> list[Point]:
    """Choose stations every minute of the route, and at its end, at ``height`` (m above the ellipsoid)."""
    points: list[Point] = []
    pair = None
    for time_s in np.append(np.arange(0.0, route.time_s[-1], CHOOSE_EVERY_S), route.time_s[-1]):
        i = route.at(time_s)
        place = (float(route.lat[i]), float(route.lon[i]), height)
        pair = best_pair(table, *place, keep=pair)
        directions = np.array([view(s, *place).direction_n for s in pair]) if pair else np.empty((0, 3))
        course = float(route.course[i])
        points.append(
            Point(
                float(time_s), float(time_s * route.speed), place[0], place[1], course,
                tuple(v.station.ident for v in usable(table, *place)),
                (pair[0].ident, pair[1].ident) if pair else None,
                angle_between(*directions) if pair else 0.0,
                hdop(directions) if pair else math.inf,
                bool(pair) and collinear_with_track(course, directions),
            )
        )  # fmt: skip
    return points


@dataclass(frozen=True, slots=True, eq=False)
class Reply:
    """One range of the schedule: when it is there, from which station, and ``direction`` (2,) unit north east from station to aircraft."""

    time_s: float
    station: str
    direction: np.ndarray


def replies_along(
    table: StationTable, route: Route, height: float, points: Sequence[Point], schedule: InterrogationSchedule
) -> list[Reply]:
    """List the ranges one receiver gets: the pair in turn, a single station at every other turn, none where none answers."""
    replies = []
    turn = 0
    while (slot := schedule.slots(turn)[0]).reply_s <= route.time_s[-1]:
        point = points[min(int(slot.begin_s // CHOOSE_EVERY_S), len(points) - 1)]
        turn += 1
        asked = point.pair or point.usable[:1]
        if slot.channel < len(asked):
            i, station = route.at(slot.reply_s), table[asked[slot.channel]]
            _, direction = range_and_direction(route.lat[i], route.lon[i], height, station.lat, station.lon, station.height)
            flat = math.hypot(direction[0], direction[1])
            if flat > 0.0:
                replies.append(Reply(slot.reply_s, station.ident, direction[0:2] / flat))
    return replies


def pair_changes(points: Sequence[Point]) -> list[tuple[float, float, tuple[str, ...]]]:
    """List (from, to, stations asked) along the route, m: the pair, a single station, or nothing."""
    asked = [p.pair or p.usable[:1] for p in points]
    return [(points[i].distance_m, points[j].distance_m, asked[i]) for i, j in _runs(asked)]


def what_is_wrong(points: Sequence[Point]) -> list[str]:
    """Describe in sentences where the stations are not enough; empty when they are enough everywhere."""
    states = [_state(p) for p in points]
    sentences = []
    for i, j in _runs(states):
        if states[i]:
            stretch = f"{points[i].distance_m / NAUTICAL_MILE:.0f} to {points[j].distance_m / NAUTICAL_MILE:.0f} NM"
            sentences.append(f"{stretch}: {states[i]}")
    return sentences


def _state(point: Point) -> str:
    if not point.usable:
        return "no station audible; the navigator dead-reckons and its error grows, climb or bring another station."
    if len(point.usable) == 1:
        return f"single station only ({point.usable[0]}); it holds the position along one line, climb or move the route."
    if point.pair is None:
        return "the stations lie on one line with the aircraft; move the route to one side."
    if point.collinear:
        pair = "-".join(point.pair)
        return f"pair {pair} is collinear with the route leg; cross-track position is not observed, move the route."
    if point.poor:
        pair = "-".join(point.pair)
        return f"pair {pair} is nearly on one line with the aircraft (HDOP above {POOR_HDOP:g}); move the route off that line."
    return ""


def _runs(values: Sequence) -> list[tuple[int, int]]:
    """First index of each run of equal values and first of the next one (the last index at the end)."""
    starts = [0] + [i for i in range(1, len(values)) if values[i] != values[i - 1]]
    runs = list(zip(starts, [*starts[1:], len(values) - 1], strict=True))
    return [run for run in runs if run[0] < run[1]] or runs  # a change on the very last point has no length
