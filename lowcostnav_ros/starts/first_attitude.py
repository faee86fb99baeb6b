"""First attitude, standing or on the move, from a window of inertial samples.

Over the window ``integral of C_nb f_b dt = change of velocity - g dt``.  The left side is integrated in the body axes of the window's
beginning with the gyros alone; the change of velocity comes from GPS (in n), from the airspeed (in body axes) or is taken to be zero
when the window looks unaccelerated.  One vector gives roll and pitch; the magnetometer, or else the GPS track, gives heading.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import AirVelocity, Attitude, GpsVelocity, ImuBlock, MagneticField
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.imu_errors import typical
from lowcostnav_ros.navigators.ahrs.kernels import WINDOW_SIZE, gather_window
from lowcostnav_ros.navigators.ahrs.settings import AhrsSettings
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.magnetic_heading import LocalField, magnetic_heading
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_conjugate, quat_multiply, quat_rotate
from lowcostnav_ros.starts.levelling import tilt_from_specific_force, unit_error

UNAIDED_WINDOWS = 1.5
"""So many windows without GPS velocity and airspeed, and the accelerometers have to do alone."""
STALE_WINDOWS = 4.0
"""An end of the window that has not come after so many windows will not come."""
FIELD_AGE_NS = 1_000_000_000
DECLINATION_UNKNOWN = "declination unknown: wait for a fix, or set place.lat_lon_deg or magnetic.declination_deg"
_PASSES = 8


@dataclass(frozen=True, slots=True, eq=False)
class FirstAttitude:
    """Where to start: attitude at ``t_ns``, sigmas in rad, velocity where there is one, and where it all came from."""

    t_ns: int
    q_nb: np.ndarray
    tilt_sigma: float
    heading_sigma: float
    is_magnetic: bool
    gps: GpsVelocity | None = None
    air: AirVelocity | None = None


class Alignment:
    """Gather a window; try to make a first attitude of it at each GPS velocity or airspeed, or after a while without.

    ``reason`` says in words what is missing; ``wrong_unit`` is True while the inertial data looks like the wrong unit.
    """

    def __init__(self, settings: AhrsSettings) -> None:
        self.settings = settings
        self.restart(None)

    def restart(self, t_ns: int | None, reason: str = "waiting for inertial data") -> None:
        """Forget everything; the first window begins at ``t_ns`` (None: with the next sample)."""
        self.t_ns = t_ns
        self.reason, self.wrong_unit = reason, False
        self._field: MagneticField | None = None
        self._begin(None)

    def gather(self, block: ImuBlock, start: int) -> int:
        """Integrate samples from ``start``; return the next index, short of the end when :meth:`unaided` is due."""
        if self.t_ns is None:  # the interval of the very first sample has no known beginning
            self.t_ns = int(block.stamps_ns[start])
            self._begin(None)
            return start + 1
        following, t_ns = gather_window(
            self.t_ns, self._window, block.stamps_ns, block.specific_force_b, block.angular_rate_b, start, self._limit_ns()
        )
        self.t_ns = int(t_ns)
        return following

    def magnetic(self, measurement: MagneticField) -> None:
        """Keep the newest field with the turn at its time."""
        self._field, self._field_turn = measurement, self._window[0:4].copy()

    def attitude(self, measurement: Attitude) -> FirstAttitude | None:
        """Begin at a measured attitude once half a window of inertial data looks like the right unit."""
        force, rate, span_s = self._window[4:7], self._window[7:10], self._window[10]
        if span_s < 0.5 * self.settings.alignment.window_s:
            return None
        wrong = unit_error(force / span_s, rate / span_s)
        self.wrong_unit = bool(wrong)
        if wrong:
            self.reason = wrong
            return None
        self.reason = ""
        sigma = np.sqrt(np.maximum(np.diag(measurement.cov_att), 0.0))
        return FirstAttitude(self.t_ns, measurement.q_nb.copy(), float(max(sigma[:2])), float(sigma[2]), False)

    def gps(self, measurement: GpsVelocity, local: LocalField | None) -> FirstAttitude | None:
        """Close the window at a GPS velocity when it began with one; else begin there."""
        begun = self._anchor
        if not isinstance(begun, GpsVelocity):
            self._begin(measurement)
            return None
        if not self._long_enough():
            return None
        span_s = self._window[10]
        force_n = (measurement.vel_n - begun.vel_n) / span_s - np.array([0.0, 0.0, STANDARD_GRAVITY])
        noise = np.sqrt(max(measurement.cov_n.trace() + begun.cov_n.trace(), 0.0) / 3.0) / (span_s * STANDARD_GRAVITY)
        first = self._solve(self._window[4:7] / span_s, force_n, float(np.hypot(noise, 0.3 * DEGREE)), local, measurement)
        if first is None:
            self._begin(measurement)
        return first

    def air(self, measurement: AirVelocity, local: LocalField | None) -> FirstAttitude | None:
        """Close the window at an airspeed when it began with one; GPS velocity, where it comes, goes first."""
        begun = self._anchor
        if isinstance(begun, GpsVelocity) or np.linalg.norm(measurement.vel_b) < self.settings.airflow.minimum_mps:
            return None
        if not isinstance(begun, AirVelocity):
            self._begin(measurement)
            return None
        if self._window[10] < UNAIDED_WINDOWS * self.settings.alignment.window_s:
            return None
        change_b0 = quat_rotate(self._window[0:4], measurement.vel_b) - begun.vel_b
        force_b0 = (self._window[4:7] - change_b0) / self._window[10]
        gravity_n = np.array([0.0, 0.0, -STANDARD_GRAVITY])
        first = self._solve(force_b0, gravity_n, self.settings.alignment.air_tilt_deg * DEGREE, local, measurement)
        if first is None:
            self._begin(measurement)
        return first

    def unaided(self, local: LocalField | None) -> FirstAttitude | None:
        """At the end of a window without velocities: level by the accelerometers when it looks unaccelerated."""
        if self.t_ns is None or self.t_ns < self._limit_ns():
            return None
        stale, window = self._anchor is not None, self._window
        first = None
        if not stale:
            force, rate = window[4:7] / window[10], window[7:10] / window[10]
            level = self.settings.level
            bias_sigma = np.hypot(typical(self.settings.imu.gyro_turn_on_dps), typical(self.settings.imu.gyro_bias_dps))
            if np.linalg.norm(rate) > (level.yaw_rate_dps + 3.0 * bias_sigma) * DEGREE:
                self.reason = "turning, and neither GPS velocity nor airspeed to tell the acceleration"
            elif abs(np.linalg.norm(force) / STANDARD_GRAVITY - 1.0) > level.force_g:
                self.reason = unit_error(force, rate) or "accelerating, and neither GPS velocity nor airspeed to tell how much"
                self.wrong_unit = bool(unit_error(force, rate))
            else:
                gravity_n = np.array([0.0, 0.0, -STANDARD_GRAVITY])
                first = self._solve(force, gravity_n, self.settings.alignment.unaided_tilt_deg * DEGREE, local, None)
        self._begin(None)
        return first

    def _begin(self, anchor: GpsVelocity | AirVelocity | None) -> None:
        if self._field is not None:  # the newest field, seen from the axes in which the new window begins
            self._field_turn = quat_multiply(quat_conjugate(self._window[0:4]), self._field_turn)
        self._anchor = anchor
        self._window = np.zeros(WINDOW_SIZE)
        self._window[0] = 1.0
        self._since_ns = self.t_ns

    def _limit_ns(self) -> int:
        windows = UNAIDED_WINDOWS if self._anchor is None else STALE_WINDOWS
        return self._since_ns + round(1e9 * windows * self.settings.alignment.window_s)

    def _long_enough(self) -> bool:
        return self._window[10] >= self.settings.alignment.window_s - 1e-6

    def _solve(self, force_b0, force_n, tilt_sigma: float, local: LocalField | None, end) -> FirstAttitude | None:
        """Attitude at the end of the window; tilt and heading depend on each other, so they are found by turns."""
        turn, span_s = self._window[0:4], self._window[10]
        wrong = unit_error(self._window[4:7] / span_s, self._window[7:10] / span_s)
        self.wrong_unit = bool(wrong)
        if wrong:
            self.reason = wrong
            return None
        force_b = quat_rotate(quat_conjugate(turn), force_b0)
        field_b, trouble = self._field_at_end(local)
        track = self._track(end)
        if field_b is None and track is None:
            self.reason = f"levelled, but no heading: {trouble}"
            return None
        heading = 0.0 if track is None else track
        for _ in range(_PASSES):
            roll, pitch = tilt_from_specific_force(force_b, force_n, heading)
            if field_b is not None:
                heading = magnetic_heading(roll, pitch, field_b, local.declination)
        sigma = self.settings.magnetic.noise_deg if field_b is not None else self.settings.alignment.track_sigma_deg
        gps = end if isinstance(end, GpsVelocity) else None
        air = end if isinstance(end, AirVelocity) else None
        self.reason = ""
        return FirstAttitude(self.t_ns, euler_to_quat(roll, pitch, heading), tilt_sigma, sigma * DEGREE, field_b is not None, gps, air)

    def _field_at_end(self, local: LocalField | None) -> tuple[np.ndarray | None, str]:
        """Newest magnetic field turned to the end of the window, or why there is none."""
        if not self.settings.magnetic.enabled:
            return None, "magnetometer switched off and no GPS track"
        if self._field is None or self.t_ns - self._field.stamp_ns > FIELD_AGE_NS:
            return None, "no magnetometer and no GPS track"
        if local is None:
            return None, DECLINATION_UNKNOWN
        refusal = local.refusal(self._field.field_b)
        if refusal:
            return None, refusal
        since = quat_multiply(quat_conjugate(self._window[0:4]), self._field_turn)
        return quat_rotate(since, self._field.field_b), ""

    def _track(self, end) -> float | None:
        if not isinstance(end, GpsVelocity):
            return None
        north, east = end.vel_n[0], end.vel_n[1]
        return float(np.arctan2(east, north)) if np.hypot(north, east) >= self.settings.alignment.track_speed_mps else None
