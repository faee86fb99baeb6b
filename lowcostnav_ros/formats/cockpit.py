"""What an instrument in the cockpit may show of a navigator, judged in one place for every output.

A position, velocity or attitude is *given* only while the navigator says how it is, has not failed, goes on, and is sure enough for the
limits that its reader sets; what is not given stands as None, and each format has its own way to say that.  Nothing is held: an instrument
that is frozen on an old position is worse than one that is dark.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import AirVelocity, Health, Measurement, NavSolution, Pressure
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.physics import atmosphere
from lowcostnav_ros.physics.rotation import quat_to_euler

RADIUS_95, WITHIN_95 = 2.448, 1.960
"""Radius of a circle that holds 95 % of a plane's normal distribution, and half a band of a line's, in sigmas."""
HEALTH_S = 3.0
"""A navigator says how it is every second; without a word for longer it is not shown."""
SLOW_MPS = 2.0
"""Below this speed a track over ground means nothing."""


@dataclass(frozen=True)
class CockpitLimits:
    """When a solution is shown no more."""

    stale_after_s: float = setting(1.0, "A solution that has not moved on for longer is not shown.", unit="s", minimum=0.1, maximum=10.0)
    position_m: float = setting(1852.0, "Horizontal position, 95 %: worse is not shown.", unit="m", minimum=1.0, maximum=20_000.0)
    height_m: float = setting(150.0, "Height, 95 %: worse is not shown.", unit="m", minimum=1.0, maximum=5000.0)
    velocity_mps: float = setting(10.0, "Velocity over ground, 95 %: worse is not shown.", unit="m/s", minimum=0.1, maximum=100.0)
    attitude_deg: float = setting(10.0, "Roll and pitch, 95 %: worse is not shown.", unit="deg", minimum=0.1, maximum=45.0)
    heading_deg: float = setting(20.0, "Heading, 95 %: worse is not shown.", unit="deg", minimum=0.1, maximum=90.0)


@dataclass(frozen=True, slots=True)
class Picture:
    """What may be shown now; None is not to be shown.

    Attributes
    ----------
    stamp_ns : int
        Time of the solution, ns of UTC; 0 before the first.
    is_degraded : bool
        The navigator flies without what makes it healthy: what is shown is dead reckoning.
    reason : str
        Why there is no position; empty where there is one.
    lat, lon, height : float or None
        Rad, rad, m above the ellipsoid.
    sea_level : float
        Height of the geoid there, m above the ellipsoid.
    cov_pos : ndarray (3, 3) or None
        NED, m^2.
    radius_95_m, height_95_m : float or None
    hpl_m, vpl_m : float or None
        Protection levels, of a navigator that has them.
    vel_n : ndarray (3,) or None
    speed_mps, track : float or None
        Over ground; the track, rad in [0, 2 pi), is None below :data:`SLOW_MPS`.
    roll, pitch, heading : float or None
        Rad; the heading true, in [0, 2 pi).
    tas_mps, cas_mps, pressure_height_m : float or None
        Of the air data, where they come.
    """

    stamp_ns: int = 0
    is_degraded: bool = False
    reason: str = ""
    lat: float | None = None
    lon: float | None = None
    height: float | None = None
    sea_level: float = 0.0
    cov_pos: np.ndarray | None = None
    radius_95_m: float | None = None
    height_95_m: float | None = None
    hpl_m: float | None = None
    vpl_m: float | None = None
    vel_n: np.ndarray | None = None
    speed_mps: float | None = None
    track: float | None = None
    roll: float | None = None
    pitch: float | None = None
    heading: float | None = None
    tas_mps: float | None = None
    cas_mps: float | None = None
    pressure_height_m: float | None = None


class Cockpit:
    """Collects what comes; :meth:`picture` says what of it may be shown.  Times of arrival are those of any steady clock, s."""

    def __init__(self, limits: CockpitLimits) -> None:
        self._limits = limits
        self._latest: dict[type, tuple[float, Measurement]] = {}
        self._protection: tuple[float, float | None, float | None] | None = None

    def take(self, measurement: Measurement, now_s: float) -> None:
        """Take over what came; a solution that is no newer than the last does not count as one."""
        before = self._latest.get(type(measurement))
        moved_on = before is None or measurement.stamp_ns > before[1].stamp_ns or now_s - before[0] > HEALTH_S
        if moved_on or isinstance(measurement, Health):
            self._latest[type(measurement)] = now_s, measurement

    def protect(self, hpl_m: float | None, vpl_m: float | None, now_s: float) -> None:
        """Take over the protection levels; None where the navigator's tests give none, or an alarm lasts."""
        self._protection = now_s, hpl_m, vpl_m

    def picture(self, now_s: float) -> Picture:
        """Return what may be shown at a time."""
        limits, air = self._limits, self._air(now_s)
        solution, health = self._fresh(NavSolution, now_s, limits.stale_after_s), self._fresh(Health, now_s, HEALTH_S)
        reason = self._why_not(solution, health)
        if reason or not isinstance(solution, NavSolution) or not isinstance(health, Health):
            at = self._latest.get(NavSolution)
            return Picture(at[1].stamp_ns if at else 0, True, reason, **air)
        protection = self._protection if self._protection is not None and now_s - self._protection[0] < HEALTH_S else (0.0, None, None)
        place = _placed(solution, limits, *protection[1:])
        motion = _moving(solution, limits) | _turned(solution, limits)
        return Picture(solution.stamp_ns, health.level != Level.OK, **place, **motion, **air)

    def _fresh(self, kind: type, now_s: float, longest_s: float) -> Measurement | None:
        at = self._latest.get(kind)
        return None if at is None or now_s - at[0] > longest_s else at[1]

    def _why_not(self, solution: Measurement | None, health: Measurement | None) -> str:
        if solution is None:
            return "the solution is stale" if NavSolution in self._latest else "no solution has come"
        if not isinstance(health, Health):
            return "the navigator reports no health"
        return f"the navigator has failed: {health.reason or health.mode}" if health.level >= Level.ERROR else ""

    def _air(self, now_s: float) -> dict[str, Any]:
        velocity = self._fresh(AirVelocity, now_s, self._limits.stale_after_s)
        static = self._fresh(Pressure, now_s, self._limits.stale_after_s)
        tas = float(velocity.vel_b[0]) if isinstance(velocity, AirVelocity) else None
        height = cas = None
        if isinstance(static, Pressure):
            height = float(atmosphere.pressure_altitude(static.pressure_pa))
            if tas is not None:
                cas = float(atmosphere.tas_to_cas(max(tas, 0.0), static.pressure_pa, atmosphere.temperature(height)))
        return {"tas_mps": tas, "cas_mps": cas, "pressure_height_m": height}


def _placed(solution: NavSolution, limits: CockpitLimits, hpl_m: float | None, vpl_m: float | None) -> dict:
    """The position, or why there is none."""
    if not solution.has_position:
        return {"reason": "the navigator has no position"}
    cov, (lat, lon, height) = solution.place_cov, solution.place
    radius = RADIUS_95 * math.sqrt(max(float(np.linalg.eigvalsh(cov[:2, :2])[1]), 0.0))
    for what, size_m in (("95 % radius", radius), ("protection level", hpl_m or 0.0)):
        if not size_m <= limits.position_m:
            return {"reason": f"the {what} of the position, {size_m:.0f} m, is beyond the limit"}
    vertical = WITHIN_95 * math.sqrt(max(float(cov[2, 2]), 0.0))
    shown = {"lat": lat, "lon": lon, "cov_pos": cov, "radius_95_m": radius, "hpl_m": hpl_m, "vpl_m": vpl_m}
    shown["sea_level"] = float(undulation(lat, lon))
    return shown | ({"height": height, "height_95_m": vertical} if vertical <= limits.height_m else {})


def _moving(solution: NavSolution, limits: CockpitLimits) -> dict:
    """The velocity over ground."""
    velocity, cov = solution.vel_n, solution.cov_vel
    if velocity is None or cov is None or not RADIUS_95 * math.sqrt(float(np.max(np.diag(cov)))) <= limits.velocity_mps:
        return {}
    speed = math.hypot(velocity[0], velocity[1])
    track = math.atan2(velocity[1], velocity[0]) % (2.0 * math.pi) if speed >= SLOW_MPS else None
    return {"vel_n": velocity, "speed_mps": speed, "track": track}


def _turned(solution: NavSolution, limits: CockpitLimits) -> dict:
    """Roll, pitch and heading."""
    if solution.q_nb is None or solution.cov_att is None:
        return {}
    level, down = (WITHIN_95 * math.sqrt(float(np.max(part))) / DEGREE for part in np.split(np.diag(solution.cov_att), [2]))
    roll, pitch, heading = (float(angle) for angle in quat_to_euler(solution.q_nb))
    shown = {"roll": roll, "pitch": pitch} if level <= limits.attitude_deg else {}
    return shown | ({"heading": heading % (2.0 * math.pi)} if level <= limits.attitude_deg and down <= limits.heading_deg else {})
