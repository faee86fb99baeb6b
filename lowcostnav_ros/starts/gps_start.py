"""How an inertial navigator begins with GPS: position and velocity from the receiver, attitude from levelling and a heading."""

from typing import NamedTuple

import numpy as np

from lowcostnav_ros.aids.magnetic import MagneticAid
from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, ImuBlock, MagneticField, Measurement
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.headings import CELLS, WIDTH
from lowcostnav_ros.cores.imu_errors import ImuSettings, typical
from lowcostnav_ros.cores.inertial import ATT, CORE, POS, VEL
from lowcostnav_ros.estimation.cross_checks.heading import crabs
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.magnetic_heading import magnetic_heading
from lowcostnav_ros.physics.rotation import euler_to_quat
from lowcostnav_ros.starts.levelling import (
    AlignmentSettings,
    Levelling,
    agrees_with_track,
    gyrocompass,
    gyrocompass_sigma,
    tilt_from_specific_force,
    unit_error,
)

GRAVITY_N = np.array([0.0, 0.0, -STANDARD_GRAVITY])
ACCELERATION_SPAN_NS = 2_100_000_000
"""GPS velocities this far apart give the acceleration of an alignment on the move; shorter, their noise tilts it."""
OLDEST_FIX_NS = 2_000_000_000
"""A position older than this against the velocity is not used."""
SHORTEST_SPAN_S = 0.9
POSITION_VARIANCE, VELOCITY_SIGMA = 0.5, 0.1
"""What is added to the receiver's own covariances, m^2 and m/s."""
STILL_TILT_DEG = 0.2


class Start(NamedTuple):
    """A first state: stamp, ``nav`` (10,), covariance (9, 9) of the core states, the stamp of the fix; and where nothing gives a heading
    a state for each that is tried.
    """

    stamp_ns: int
    nav: np.ndarray
    covariance: np.ndarray
    fix_ns: int
    headings: tuple[np.ndarray, ...] = ()


class GpsStart:
    """Gather what alignment needs; give a first state with the first GPS velocity that allows one.

    Parameters
    ----------
    settings : AlignmentSettings
    imu : ImuSettings
    layout : Layout
        Error state of the navigator: what its filter expects of the sensors.
    magnetic : MagneticAid or None
        Gives the first heading where a magnetometer is used.

    Attributes
    ----------
    reason : str
        What it waits for.
    refused : str
        Why the fixes that come are not begun with; empty where they are.
    widening : float
        By how much the IMU may be worse than its settings.
    compass : bool
        Whether a moving vehicle's first heading may come from the magnetometer.
    moving : bool
        Whether the vehicle moves.
    force_b : ndarray (3,) or None
        Mean specific force, m/s^2, that the last state was levelled with.
    turned : float or None
        By how much, rad, the magnetic heading was off the track, where it was not believed.
    """

    def __init__(self, settings: AlignmentSettings, imu: ImuSettings, layout: Layout, magnetic: MagneticAid | None) -> None:
        self.settings, self._imu, self._layout, self._magnetic = settings, imu, layout, magnetic
        self.levelling = Levelling(settings.still_s)
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.reason = self.refused = ""
        self.widening, self.compass, self.moving = 1.0, True, False
        self._no_compass = ""
        self._fix: GpsPosition | None = None
        self.force_b: np.ndarray | None = None
        self.turned: float | None = None
        self._velocities: list[GpsVelocity] = []
        self._field_b: np.ndarray | None = None
        self.levelling.clear()

    def add(self, block: ImuBlock) -> None:
        """Take inertial samples in."""
        self.levelling.add(block)

    def take(self, item: Measurement) -> Start | None:
        """Take any other measurement in; the first state, once there is one."""
        if isinstance(item, MagneticField):
            self._field_b = item.field_b
            if self._magnetic is not None:
                self._magnetic.reference.follow(item.stamp_ns)
        elif isinstance(item, GpsPosition):
            self._fix, self.refused = item, ""
            if not self._velocities:
                self.reason = "waiting for a GPS velocity"
        elif isinstance(item, GpsVelocity):
            self._velocities = [v for v in self._velocities if item.stamp_ns - v.stamp_ns <= ACCELERATION_SPAN_NS] + [item]
            start = self._align(self._velocities[0], item)
            self.reason = start if isinstance(start, str) else ""
            return None if isinstance(start, str) else start
        return None

    def _align(self, earlier: GpsVelocity, velocity: GpsVelocity) -> Start | str:
        """The first state when an attitude can be had, else the reason why not."""
        choice, fix = self.settings, self._fix
        if fix is None or velocity.stamp_ns - fix.stamp_ns > OLDEST_FIX_NS:
            return self.refused or "waiting for a GPS position"
        speed = float(np.hypot(velocity.vel_n[0], velocity.vel_n[1]))
        still = speed < choice.still_speed_mps
        self.moving = not still
        span_s = choice.still_s if still else 1e-9 * (velocity.stamp_ns - earlier.stamp_ns)
        means = self.levelling.mean(max(span_s, 0.2))
        if means is None:
            return "waiting for inertial data"
        wrong = unit_error(*means)
        if wrong:
            return wrong
        force_n = GRAVITY_N
        if still:
            if not self.levelling.still(span_s):
                return "GPS speed is zero but the inertial data moves: cannot level"
        elif speed < choice.moving_speed_mps and not choice.any_heading:
            return f"speed {speed:.1f} m/s: too fast to level, too slow for a track"
        elif span_s < SHORTEST_SPAN_S:
            return "waiting for two GPS velocities a second apart"
        else:
            force_n = (velocity.vel_n - earlier.vel_n) / span_s + GRAVITY_N
        heading, sigma = self._first_heading(*means, force_n, fix, velocity, still)
        if heading is None and not choice.any_heading:
            return f"levelled; waiting for a heading ({self._no_compass}magnetometer, motion, alignment.heading_deg or any_heading)"
        self.force_b = means[0]
        tried = np.arange(CELLS) * WIDTH if heading is None else [heading]
        place, navs = (fix.lat, fix.lon, fix.height), []
        for one in tried:
            roll, pitch = tilt_from_specific_force(means[0], force_n, one)
            navs.append(np.array([*place, *velocity.vel_n, *euler_to_quat(roll, pitch, one)]))
        covariance = self._first_covariance(np.pi if heading is None else sigma, fix, velocity, still)
        return Start(velocity.stamp_ns, navs[0], covariance, fix.stamp_ns, () if heading is not None else tuple(navs))

    def _first_heading(
        self, f_b: np.ndarray, w_b: np.ndarray, force_n: np.ndarray, fix: GpsPosition, velocity: GpsVelocity, still: bool
    ) -> tuple[float | None, float]:
        choice = self.settings
        if choice.gyrocompass and still:
            sigma, limits = gyrocompass_sigma(self._layout, fix.lat, choice.still_s)
            if sigma <= choice.gyrocompass_limit_deg * DEGREE:
                return gyrocompass(f_b, w_b), sigma
            size = f"{sigma / DEGREE:.1f} deg" if sigma < np.pi / 2.0 else "above 90 deg"
            self._no_compass = f"gyrocompassing not possible: predicted heading sigma {size}, {limits}; "
        self.turned = None
        if self._magnetic is not None and self._field_b is not None and (still or self.compass):
            reference = self._magnetic.reference.at(fix.lat, fix.lon, fix.height)
            if reference is not None and not reference.refusal(self._field_b):
                heading = 0.0
                for _ in range(5):  # tilt on the move depends on heading, and heading on tilt
                    roll, pitch = tilt_from_specific_force(f_b, force_n, heading)
                    heading = magnetic_heading(roll, pitch, self._field_b, reference.declination)
                self.turned = None if still else crabs(heading, *velocity.vel_n[:2])
                if self.turned is None:
                    return heading, choice.magnetic_sigma_deg * DEGREE
        track = float(np.arctan2(velocity.vel_n[1], velocity.vel_n[0]))
        if choice.heading_deg and (still or agrees_with_track(choice.heading_deg[0] * DEGREE, track, choice)):
            return choice.heading_deg[0] * DEGREE, choice.heading_sigma_deg * DEGREE
        return (None, 0.0) if still or choice.any_heading else (track, choice.track_sigma_deg * DEGREE)

    def _first_covariance(self, sigma: float, fix: GpsPosition, velocity: GpsVelocity, still: bool) -> np.ndarray:
        lag_s = 1e-9 * (velocity.stamp_ns - fix.stamp_ns)
        accel_sigma = self.widening * np.hypot(typical(self._imu.accel_turn_on_mg), typical(self._imu.accel_bias_mg)) * 1e-3
        tilt = np.hypot(accel_sigma, (STILL_TILT_DEG if still else self.settings.tilt_sigma_deg) * DEGREE)
        cov = np.zeros((CORE, CORE))
        cov[POS, POS] = fix.cov_n + np.eye(3) * (POSITION_VARIANCE + (lag_s * np.linalg.norm(velocity.vel_n)) ** 2)
        cov[VEL, VEL] = velocity.cov_n + np.eye(3) * VELOCITY_SIGMA**2
        cov[ATT, ATT] = np.diag([tilt**2, tilt**2, sigma**2])
        return cov
