"""Closed-form flight of a mission: manoeuvres as smooth functions of time, flown through a moving air mass.

Each manoeuvre becomes primitives in which turn rate and climb rate rise smoothly, stay, and fall back, and airspeed makes a smooth
step; all have closed-form integrals.  The aircraft is coordinated *in the air*: its velocity through the air lies in the plane of
symmetry, bank is atan2(V psi_dot, g), the flight path angle comes from climb rate over true airspeed, and the body x axis is a constant
incidence above the airflow.  The wind is added to the velocity over ground.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, difference_n
from lowcostnav_ros.physics.rotation import eulers_to_quat, quat_multiply, wrap
from lowcostnav_ros.trajectory import manoeuvres as m
from lowcostnav_ros.trajectory.missions import mission_lines
from lowcostnav_ros.trajectory.profile import STEEPEST, plateau, plateau_integral, plateau_length, smooth_step, smooth_step_integral
from lowcostnav_ros.trajectory.trajectory import Trajectory, integrate_position, pieces_of_motion
from lowcostnav_ros.trajectory.truth_settings import TruthSettings
from lowcostnav_ros.trajectory.wind import Wind

ROLL_RATE = math.radians(10.0)
"""Largest roll rate while banking, rad/s."""
VERTICAL_ACCELERATION = 1.0
"""Largest vertical acceleration while starting a climb, m/s^2."""
STEEPEST_CLIMB = 0.5
"""Sine of the largest flight path angle a mission may ask for."""
_PLAN_STEP_S = 0.25
_CORRECT_EVERY_S = 40.0  # between heading corrections on the way to a point
_CLOSE_IN_M = 2000.0
_MOST_SPIRALS, _SPIRAL_MPS, _SPIRAL_MARGIN_M = 6, 4.0, 40.0  # descending turns before an approach that begins too high


@dataclass(frozen=True)
class Primitive:
    """One smooth piece of motion.

    Turn rate is zero at both ends and reaches ``turn_rate`` (rad/s, right positive) within ``entry_s``; climb rate changes by
    ``climb_change`` m/s within ``entry_s`` and stays; airspeed changes by ``airspeed_change`` m/s over the whole length.
    """

    length_s: float
    entry_s: float = 1.0
    turn_rate: float = 0.0
    climb_change: float = 0.0
    airspeed_change: float = 0.0


class _Columns:
    """Primitives laid out as columns with the state each begins in, so that many times are looked up at once."""

    def __init__(self, heading: float, height: float, airspeed: float) -> None:
        self.rows: list[tuple[float, ...]] = []
        self.end_s, self.heading, self.height, self.airspeed, self.climb = 0.0, heading, height, airspeed, 0.0
        self._table: np.ndarray | None = None

    def append(self, p: Primitive) -> None:
        row = (self.end_s, self.heading, self.height, self.airspeed, self.climb)
        self.rows.append((*row, p.length_s, p.entry_s, p.turn_rate, p.climb_change, p.airspeed_change))
        self.end_s += p.length_s
        self.heading += p.turn_rate * (p.length_s - p.entry_s)
        self.height += self.climb * p.length_s + p.climb_change * (p.length_s - 0.5 * p.entry_s)
        self.airspeed += p.airspeed_change
        self.climb += p.climb_change
        self._table = None

    def table(self) -> np.ndarray:
        if self._table is None:  # a last row holds the final state for ever
            rest = (self.end_s, self.heading, self.height, self.airspeed, self.climb, 1.0, 0.5, 0.0, 0.0, 0.0)
            self._table = np.array([*self.rows, rest]).T
        return self._table


class SegmentMotion:
    """The planned flight as functions of time (see :class:`~lowcostnav_ros.trajectory.trajectory.Motion`)."""

    def __init__(self, settings: TruthSettings, seed: int) -> None:
        start = settings.start
        self.lat, self.lon, self.height = math.radians(start.lat_deg), math.radians(start.lon_deg), start.height_m
        self.wind = Wind(settings.wind, seed, start.height_m, start.airspeed_mps)
        self.columns = _Columns(math.radians(start.heading_deg), start.height_m, start.airspeed_mps)
        self._incidence = eulers_to_quat(np.array([[0.0, math.radians(settings.incidence_deg), 0.0]]))[0]
        self._reached = (0.0, self.lat, self.lon, self.height)

    @property
    def duration_s(self) -> float:
        """Length of what has been planned so far."""
        return self.columns.end_s

    def fly(self, primitive: Primitive) -> None:
        """Append a primitive to the plan."""
        self.columns.append(primitive)

    def at(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity over ground (n, 3), ``q_nb`` (n, 4) and wind (n, 3) at ``t_s`` seconds."""
        table = self.columns.table()
        begin, heading, height, airspeed, climb, length, entry, turn, climb_change, faster = table[:, self._row(t_s, table[0])]
        t = t_s - begin
        speed = airspeed + faster * smooth_step(t / length)
        heading = heading + turn * plateau_integral(t, length, entry)
        height = height + climb * t + climb_change * entry * smooth_step_integral(t / entry)
        up = climb + climb_change * smooth_step(t / entry)
        sine = up / speed
        level_speed = speed * np.sqrt(1.0 - sine * sine)
        wind = self.wind.at(t_s, height)
        air = np.column_stack((level_speed * np.cos(heading), level_speed * np.sin(heading), -up))
        bank = np.arctan2(speed * turn * plateau(t, length, entry), STANDARD_GRAVITY)
        airflow = eulers_to_quat(np.column_stack((bank, np.arcsin(sine), heading)))
        return air + wind, _rotate_all(airflow, self._incidence), wind

    def position(self) -> tuple[float, float, float]:
        """Position (lat, lon rad, height m) at the end of what has been planned, for manoeuvres that aim at a point."""
        begin, lat, lon, height = self._reached
        steps = math.ceil((self.duration_s - begin) / _PLAN_STEP_S)
        if steps:
            halves = np.linspace(begin, self.duration_s, 2 * steps + 1)
            track = integrate_position(lat, lon, height, self.at(halves)[0], np.diff(halves[::2]))
            self._reached = (self.duration_s, *track[-1])
        return self._reached[1:]

    def wind_now(self) -> np.ndarray:
        """Wind without turbulence at the end of the plan, (3,) m/s."""
        return self.wind.steady(np.array([self.duration_s]), np.array([self.columns.height]))[0]

    @staticmethod
    def _row(t_s: np.ndarray, begins: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(begins, t_s, side="right") - 1, 0, len(begins) - 1)


@kernel
def _rotate_all(quats, last):
    out = np.empty_like(quats)
    for i in range(quats.shape[0]):
        out[i] = quat_multiply(quats[i], last)
    return out


def build_segments(settings: TruthSettings, seed: int) -> Trajectory:
    """Closed-form flight of the mission of ``settings``; see :func:`lowcostnav_ros.trajectory.build`.

    Raises
    ------
    SettingsError
        For a mission line that is not understood or cannot be flown at its airspeed.
    """
    motion = plan(settings, seed)
    duration_s = settings.duration_s or motion.duration_s

    def pieces() -> Iterator:
        return pieces_of_motion(motion, settings.start_ns, settings.rate_hz, duration_s)

    return Trajectory(settings.rate_hz, settings.start_ns, pieces)


def plan(settings: TruthSettings, seed: int) -> SegmentMotion:
    """Lay the manoeuvres of a mission out in time; each is planned from where the one before it ends."""
    motion = SegmentMotion(settings, seed)
    for number, manoeuvre in enumerate(m.parse_mission(mission_lines(settings)), 1):
        try:
            _PLANNERS[type(manoeuvre)](motion, manoeuvre)
        except SettingsError as error:
            raise SettingsError(f"mission line {number}: {error}") from None
    return motion


def _turn(motion: SegmentMotion, s: m.Turn) -> None:
    _climb_at(motion, s.climb_mps)
    _turn_by(motion, math.radians(s.by_deg), s.bank_deg)
    _climb_at(motion, 0.0)


def _turn_by(motion: SegmentMotion, angle: float, bank_deg: float) -> None:
    if abs(angle) < 1e-6:
        return
    bank = math.radians(bank_deg)
    rate = STANDARD_GRAVITY * math.tan(bank) / motion.columns.airspeed
    entry = max(1.0, STEEPEST * bank / ROLL_RATE)
    length, exact = plateau_length(angle, rate, entry)
    motion.fly(Primitive(length, entry, turn_rate=exact))


def _turn_to(motion: SegmentMotion, heading: float, bank_deg: float) -> None:
    _turn_by(motion, float(wrap(heading - motion.columns.heading)), bank_deg)


def _climb_to(motion: SegmentMotion, height: float, rate_mps: float) -> None:
    gain = height - motion.columns.height
    if abs(gain) < 1e-6:
        return
    entry = _climb_entry(rate_mps)
    length, exact = plateau_length(gain, rate_mps, entry)
    _climb_at(motion, exact, entry)
    if length > 2.0 * entry:
        motion.fly(Primitive(length - 2.0 * entry))
    _climb_at(motion, 0.0, entry)


def _climb_at(motion: SegmentMotion, rate_mps: float, entry_s: float | None = None) -> None:
    """Change the climb rate to ``rate_mps`` smoothly; what follows is flown at that rate."""
    change, steepest = rate_mps - motion.columns.climb, STEEPEST_CLIMB * motion.columns.airspeed
    if abs(rate_mps) > steepest:
        raise SettingsError(f"{rate_mps:g} m/s is too steep at this airspeed; ask for {steepest:g} m/s at most.")
    if change:
        entry = entry_s or _climb_entry(change)
        motion.fly(Primitive(entry, entry, climb_change=change))


def _climb_entry(change_mps: float) -> float:
    return max(1.0, STEEPEST * abs(change_mps) / VERTICAL_ACCELERATION)


def _speed(motion: SegmentMotion, s: m.Speed) -> None:
    change = s.to_mps - motion.columns.airspeed
    length = max(2.0, STEEPEST * abs(change) / s.accel_mps2)
    motion.fly(Primitive(length, airspeed_change=change))


def _s_turns(motion: SegmentMotion, s: m.STurns) -> None:
    full = math.radians(s.by_deg)
    for k in range(s.count):
        angle = full if 0 < k < s.count - 1 else 0.5 * full
        _turn_by(motion, angle if k % 2 == 0 else -angle, s.bank_deg)


def _hold(motion: SegmentMotion, s: m.Hold) -> None:
    half = math.pi if s.side == "right" else -math.pi
    _turn_to(motion, math.radians(s.inbound_deg), s.bank_deg)
    for _ in range(s.laps):
        for _ in range(2):
            motion.fly(Primitive(s.leg_s))
            _turn_by(motion, half, s.bank_deg)


def _fly_toward(motion: SegmentMotion, s: m.Goto | m.Approach, stop_m: float) -> None:
    """Fly to ``stop_m`` metres before a point, correcting the heading every so often as the wind changes."""
    before = math.inf
    while stop_m < (distance := _aim(motion, s.lat_deg, s.lon_deg, s.bank_deg)) < before:  # no nearer than before: passed
        before, to_go = distance, (distance - stop_m) / _ground_speed(motion)
        motion.fly(Primitive(min(to_go, _CORRECT_EVERY_S)))
        if to_go <= _CORRECT_EVERY_S:
            return


def _aim(motion: SegmentMotion, lat_deg: float, lon_deg: float, bank_deg: float) -> float:
    """Turn to the point, wind allowed for, and return its distance (m); the second turn removes what the first one moved."""
    for _ in range(2):
        north, east, _ = _to_point(motion, lat_deg, lon_deg)
        course, wind = math.atan2(east, north), motion.wind_now()
        across = wind[1] * math.cos(course) - wind[0] * math.sin(course)
        if abs(across) >= motion.columns.airspeed:
            raise SettingsError(f"a crosswind of {abs(across):.0f} m/s cannot be held at this airspeed; lower the wind.")
        _turn_to(motion, course - math.asin(across / motion.columns.airspeed), bank_deg)
    north, east, _ = _to_point(motion, lat_deg, lon_deg)
    return math.hypot(north, east)


def _to_point(motion: SegmentMotion, lat_deg: float, lon_deg: float) -> np.ndarray:
    lat, lon, height = motion.position()
    return difference_n(math.radians(lat_deg), math.radians(lon_deg), height, lat, lon, height)


def _ground_speed(motion: SegmentMotion) -> float:
    heading, speed, wind = motion.columns.heading, motion.columns.airspeed, motion.wind_now()
    ground = math.hypot(speed * math.cos(heading) + wind[0], speed * math.sin(heading) + wind[1])
    if ground < 5.0:
        raise SettingsError("the wind leaves no ground speed toward the point; lower the wind or raise the airspeed.")
    return ground


def _orbit(motion: SegmentMotion, s: m.Orbit) -> None:
    bank_deg = math.degrees(math.atan2(motion.columns.airspeed**2, STANDARD_GRAVITY * s.radius_m))
    north, east, _ = _to_point(motion, s.lat_deg, s.lon_deg)
    if math.hypot(north, east) > 3.0 * s.radius_m:
        _fly_toward(motion, m.Goto(s.lat_deg, s.lon_deg), s.radius_m)
    _turn_by(motion, math.radians(360.0 * s.laps) * (1.0 if s.side == "right" else -1.0), bank_deg)


def _approach(motion: SegmentMotion, s: m.Approach) -> None:
    slope = math.tan(math.radians(s.glide_deg))
    if motion.columns.height - s.height_m <= s.end_above_m:
        above = motion.columns.height - s.height_m
        raise SettingsError(f"the approach begins only {above:.0f} m above the threshold; begin higher or lower end_above_m.")
    _lose_height(motion, s, slope)
    above = motion.columns.height - s.height_m
    _fly_toward(motion, s, above / slope)
    _descend_toward(motion, s, slope * _ground_speed(motion))


def _descend_toward(motion: SegmentMotion, s: m.Approach, rate_mps: float) -> None:
    """Descend to the height where the approach ends, heading corrected on the way but not close in, where corrections are large."""
    _climb_at(motion, -rate_mps)
    bottom = s.height_m + s.end_above_m + 0.5 * rate_mps * _climb_entry(rate_mps)
    while (left_s := (motion.columns.height - bottom) / rate_mps) > 0.1:
        motion.fly(Primitive(min(left_s, _CORRECT_EVERY_S)))
        if left_s > _CORRECT_EVERY_S and math.hypot(*_to_point(motion, s.lat_deg, s.lon_deg)[:2]) > _CLOSE_IN_M:
            _aim(motion, s.lat_deg, s.lon_deg, s.bank_deg)
    _climb_at(motion, 0.0)


def _lose_height(motion: SegmentMotion, s: m.Approach, slope: float) -> None:
    """Descend in full turns while the approach is too near for its glide path."""
    for _ in range(_MOST_SPIRALS):
        excess = motion.columns.height - s.height_m - slope * _aim(motion, s.lat_deg, s.lon_deg, s.bank_deg)
        if excess < 0.0:
            return
        turn_s = 2.0 * math.pi * motion.columns.airspeed / (STANDARD_GRAVITY * math.tan(math.radians(s.bank_deg)))
        _climb_at(motion, -min(_SPIRAL_MPS, (excess + _SPIRAL_MARGIN_M) / turn_s))
        _turn_by(motion, 2.0 * math.pi, s.bank_deg)
        _climb_at(motion, 0.0)
    raise SettingsError(f"the approach begins {excess:.0f} m too high for its glide path; begin lower or farther out.")


_PLANNERS: dict[type[m.Manoeuvre], Callable[[SegmentMotion, Any], None]] = {
    m.Straight: lambda motion, s: motion.fly(Primitive(s.duration_s)),
    m.Turn: _turn,
    m.Heading: lambda motion, s: _turn_to(motion, math.radians(s.to_deg), s.bank_deg),
    m.Climb: lambda motion, s: _climb_to(motion, s.to_height_m, s.rate_mps),
    m.Speed: _speed,
    m.STurns: _s_turns,
    m.Hold: _hold,
    m.Goto: lambda motion, s: _fly_toward(motion, s, s.within_m),
    m.Orbit: _orbit,
    m.Approach: _approach,
}
