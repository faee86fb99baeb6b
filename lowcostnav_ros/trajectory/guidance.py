"""Guidance: the manoeuvres of a mission as what an autopilot is asked for, step by step.

Each manoeuvre is a generator: it is sent the aircraft's state, changes the :class:`Order` that stands, and ends when it is done.
"""

import math
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Any

from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, radii
from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.trajectory import manoeuvres as m


@dataclass(slots=True)
class Fix:
    """State guidance sees: time s, position rad and m, true heading rad, airspeed m/s, steady wind (north, east) m/s."""

    time_s: float
    lat: float
    lon: float
    height: float
    heading: float
    airspeed: float
    wind_north: float
    wind_east: float


@dataclass(slots=True)
class Order:
    """What stands until changed.  ``heading`` is unwrapped: a turn through 720 degrees is asked for as such."""

    heading: float
    max_bank: float
    height: float
    climb_rate: float
    airspeed: float
    bank_ahead: float = 0.0


Flying = Generator[None, Fix, None]
_CAPTURED = math.radians(1.5)
_HEIGHT_REACHED_M = 8.0
_SPEED_REACHED = 1.0
_ABEAM_BANK = math.radians(25.0)


class Guidance:
    """Fly a mission: :meth:`update` with each fix, read :attr:`order`, stop when :attr:`done`.

    Parameters
    ----------
    mission : list of Manoeuvre
    fix : Fix
        State at the start, whose heading, height and airspeed stand until a manoeuvre changes them.
    """

    def __init__(self, mission: list[m.Manoeuvre], fix: Fix) -> None:
        self.order = Order(fix.heading, math.radians(20.0), fix.height, 2.5, fix.airspeed)
        self.done = False
        self._fix = fix
        self._heading = fix.heading
        self._flying = self._mission(mission)
        next(self._flying)

    @property
    def heading_error(self) -> float:
        """Angle still to turn, rad, right positive, whole turns included, with the lead that a steady circle needs."""
        return self.order.heading - self._heading

    def update(self, fix: Fix) -> None:
        """Take the newest state and let the manoeuvre in progress change the order."""
        self._heading += float(wrap(fix.heading - self._heading))
        self._fix = fix
        if not self.done:
            try:
                self._flying.send(fix)
            except StopIteration:
                self.done = True

    def _mission(self, mission: list[m.Manoeuvre]) -> Flying:
        yield
        for manoeuvre in mission:
            self.order.bank_ahead = 0.0
            yield from _FLIERS[type(manoeuvre)](self, manoeuvre)
        self.order.bank_ahead = 0.0  # beyond its end the flight goes straight on, level

    def _wait(self, seconds: float) -> Flying:
        end = self._fix.time_s + seconds
        while self._fix.time_s < end:
            yield

    def _turn_by(self, angle: float, bank_deg: float) -> Flying:
        self.order.max_bank = math.radians(bank_deg)
        self.order.heading += angle
        while abs(self.heading_error) > _CAPTURED:
            yield

    def _turn_to(self, s: m.Heading) -> Flying:
        yield from self._turn_by(float(wrap(math.radians(s.to_deg) - self.order.heading)), s.bank_deg)

    def _climb(self, s: m.Climb) -> Flying:
        self.order.height, self.order.climb_rate = s.to_height_m, s.rate_mps
        while abs(self._fix.height - s.to_height_m) > _HEIGHT_REACHED_M:
            yield

    def _speed(self, s: m.Speed) -> Flying:
        self.order.airspeed = s.to_mps
        end = self._fix.time_s + 60.0  # a speed out of reach must not hold up the mission
        while abs(self._fix.airspeed - s.to_mps) > _SPEED_REACHED and self._fix.time_s < end:
            yield

    def _s_turns(self, s: m.STurns) -> Flying:
        for k in range(s.count):
            angle = math.radians(s.by_deg if 0 < k < s.count - 1 else 0.5 * s.by_deg)
            yield from self._turn_by(angle if k % 2 == 0 else -angle, s.bank_deg)

    def _hold(self, s: m.Hold) -> Flying:
        half = math.pi if s.side == "right" else -math.pi
        yield from self._turn_to(m.Heading(s.inbound_deg, s.bank_deg))
        for _ in range(2 * s.laps):
            yield from self._wait(s.leg_s)
            yield from self._turn_by(half, s.bank_deg)

    def _goto(self, s: m.Goto) -> Flying:
        self.order.max_bank = math.radians(s.bank_deg)
        closest = math.inf
        while True:
            north, east = self._to_point(s.lat_deg, s.lon_deg)
            distance = math.hypot(north, east)
            closest = min(closest, distance)
            turn_diameter = 2.0 * self._fix.airspeed**2 / (STANDARD_GRAVITY * math.tan(math.radians(s.bank_deg)))
            if distance < s.within_m or (closest < turn_diameter and distance > closest + 50.0):
                return  # a point passed closely counts as reached: chasing it would circle it for ever
            self._steer(math.atan2(east, north))
            yield

    def _orbit(self, s: m.Orbit) -> Flying:
        side = 1.0 if s.side == "right" else -1.0
        turned, last = 0.0, None
        while turned < 2.0 * math.pi * s.laps:
            north, east = self._to_point(s.lat_deg, s.lon_deg)
            inward, outside = math.atan2(east, north), math.hypot(north, east) / s.radius_m - 1.0
            # Far out fly at the centre, on the circle along its tangent, inside away from it.
            self._steer(inward - side * (0.5 * math.pi - math.atan(2.0 * outside)))
            if outside < 1.0:
                turned += 0.0 if last is None else side * float(wrap(inward - last))
                last = inward
            self._bank_for_circle(s.radius_m if outside < 0.5 else math.inf, side, inward)
            yield

    def _bank_for_circle(self, radius_m: float, side: float, inward: float) -> None:
        """Order the bank that a circle over ground takes in this wind, and leave 1.5 times as much to correct with."""
        tangent, fix = inward - side * 0.5 * math.pi, self._fix
        ground = fix.airspeed + fix.wind_north * math.cos(tangent) + fix.wind_east * math.sin(tangent)
        bank = math.atan2(ground * fix.airspeed, STANDARD_GRAVITY * radius_m)
        self.order.bank_ahead = side * bank
        self.order.max_bank = min(max(1.5 * bank, _ABEAM_BANK), math.radians(40.0))

    def _approach(self, s: m.Approach) -> Flying:
        self.order.max_bank = math.radians(s.bank_deg)
        slope, self.order.climb_rate = math.tan(math.radians(s.glide_deg)), 5.0
        while self._fix.height - s.height_m > s.end_above_m:
            north, east = self._to_point(s.lat_deg, s.lon_deg)
            distance = math.hypot(north, east)
            if distance < 200.0:  # too high at the threshold: the approach is over
                return
            self._steer(math.atan2(east, north))
            self.order.height = min(self.order.height, s.height_m + slope * distance)
            yield

    def _to_point(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        meridian, normal = radii(self._fix.lat)
        north = (math.radians(lat_deg) - self._fix.lat) * (meridian + self._fix.height)
        east = float(wrap(math.radians(lon_deg) - self._fix.lon)) * (normal + self._fix.height) * math.cos(self._fix.lat)
        return north, east

    def _steer(self, course: float) -> None:
        """Order the heading that makes ``course`` good in the steady wind, the shorter way from where the nose is."""
        across = self._fix.wind_east * math.cos(course) - self._fix.wind_north * math.sin(course)
        crab = math.asin(max(-0.9, min(0.9, across / self._fix.airspeed)))
        self.order.heading = self._heading + float(wrap(course - crab - self._heading))


_FLIERS: dict[type[m.Manoeuvre], Callable[[Guidance, Any], Flying]] = {
    m.Straight: lambda flight, s: flight._wait(s.duration_s),
    m.Turn: lambda flight, s: flight._turn_by(math.radians(s.by_deg), s.bank_deg),
    m.Heading: Guidance._turn_to,
    m.Climb: Guidance._climb,
    m.Speed: Guidance._speed,
    m.STurns: Guidance._s_turns,
    m.Hold: Guidance._hold,
    m.Goto: Guidance._goto,
    m.Orbit: Guidance._orbit,
    m.Approach: Guidance._approach,
}


def reference_heights(order: Order, height: float, dt: float) -> Iterator[tuple[float, float]]:
    """Height reference that walks to the ordered height at the ordered rate: yields (height, climb rate)."""
    while True:
        gap = order.height - height
        step = max(-order.climb_rate * dt, min(order.climb_rate * dt, gap))
        height += step
        yield height, step / dt
