"""First attitude, standing or on the move, from a window of inertial samples.

Over the window ``integral of C_nb f_b dt = change of velocity - g dt``.  The left side is integrated in the body axes of the window's
beginning with the gyros alone; the change of velocity comes from GPS (in n), from the airspeed (in body axes) or is taken to be zero
when the window looks unaccelerated.  One vector gives roll and pitch; the magnetometer, or else the GPS track, gives heading.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids.magnetic import DECLINATION_UNKNOWN
from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity, Attitude, GpsVelocity, ImuBlock, MagneticField, Measurement
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.imu_errors import ImuSettings, typical
from lowcostnav_ros.estimation.cross_checks.heading import crabs
from lowcostnav_ros.estimation.inertial_window import InertialWindow
from lowcostnav_ros.estimation.manoeuvre import SteadyLimits
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.magnetic_heading import LocalField, magnetic_heading
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_conjugate, quat_multiply, quat_rotate
from lowcostnav_ros.starts.levelling import tilt_from_specific_force, unit_error

UNAIDED_WINDOWS = 1.5
"""So many windows without GPS velocity and airspeed, and the accelerometers have to do alone."""
STALE_WINDOWS = 4.0
"""An end of the window that has not come after so many windows will not come."""
FIELD_AGE_NS = 1_000_000_000
HEAVE = 1.0
"""Vertical acceleration of an aircraft over a window, m/s^2, sigma, where no receiver measures it."""
_PASSES = 8


def change_sigma(cov_n: np.ndarray, force_n: np.ndarray, span_s: float) -> float:
    """Sigma per axis, m/s, of a change between two velocities whose covariances add to ``cov_n`` (3, 3), NED, as far as it tilts.

    A receiver that measures no vertical velocity is as good: what is unknown of it only stretches gravity, and tilts as far as the force
    ``force_n`` (3,), m/s^2, leans.
    """
    if cov_n[2, 2] < UNKNOWN_VARIANCE:
        return float(np.sqrt(max(cov_n.trace(), 0.0) / 3.0))
    level = math.sqrt(max(float(cov_n[0, 0] + cov_n[1, 1]), 0.0) / 2.0)
    return math.hypot(level, HEAVE * span_s * math.hypot(force_n[0], force_n[1]) / STANDARD_GRAVITY)


@dataclass(frozen=True)
class FirstAttitudeSettings:
    """How the first attitude is found."""

    window_s: float = setting(2.0, "Average the specific force this long.", unit="s", minimum=0.5, maximum=60.0)
    track_speed_mps: float = setting(10.0, "Above this GPS speed the track serves as heading.", unit="m/s", minimum=1.0, maximum=100.0)
    track_sigma_deg: float = setting(12.0, "Sigma of heading minus track (wind drift).", unit="deg", minimum=0.5, maximum=60.0)
    air_tilt_deg: float = setting(1.5, "Sigma of roll and pitch found with airspeed.", unit="deg", minimum=0.1, maximum=30.0)
    unaided_tilt_deg: float = setting(3.0, "Sigma of roll and pitch by accelerometers alone.", unit="deg", minimum=0.1, maximum=30.0)


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

    Parameters
    ----------
    settings : FirstAttitudeSettings
    imu : ImuSettings
    steady : SteadyLimits
        What looks unaccelerated.
    magnetic_deg : float or None
        Sigma of a heading taken from the magnetometer; None where it is switched off.
    slowest_air_mps : float or None
        Smallest airspeed used; None where air data is not.

    Attributes
    ----------
    reason : str
        What is missing, in words.
    wrong_unit : bool
        Whether the inertial data looks like the wrong unit.
    """

    def __init__(
        self,
        settings: FirstAttitudeSettings,
        imu: ImuSettings,
        steady: SteadyLimits,
        magnetic_deg: float | None = None,
        slowest_air_mps: float | None = None,
    ) -> None:
        self.settings, self._imu, self._steady = settings, imu, steady
        self._magnetic_deg, self._slowest_air_mps = magnetic_deg, slowest_air_mps
        self._window = InertialWindow()
        self.restart(None)

    def restart(self, t_ns: int | None, reason: str = "waiting for inertial data") -> None:
        """Forget everything; the first window begins at ``t_ns`` (None: with the next sample)."""
        self._window.begin(t_ns)
        self.reason, self.wrong_unit = reason, False
        self._field: MagneticField | None = None
        self._begin(None)

    def gather(self, block: ImuBlock, start: int) -> int:
        """Integrate samples from ``start``; return the next index, short of the end when :meth:`unaided` is due."""
        if self._window.t_ns is None:  # the interval of the very first sample has no known beginning
            self._window.begin(int(block.stamps_ns[start]))
            self._begin(None)
            return start + 1
        return self._window.gather(block, start, limit_ns=self._limit_ns())

    def take(self, measurement: Measurement, local: LocalField | None) -> FirstAttitude | None:
        """Take any other measurement in; the first attitude, once there is one."""
        if isinstance(measurement, MagneticField):
            self.magnetic(measurement)
        elif isinstance(measurement, Attitude):
            return self.attitude(measurement)
        elif isinstance(measurement, GpsVelocity):
            return self.gps(measurement, local)
        elif isinstance(measurement, AirVelocity):
            return self.air(measurement, local)
        return None

    def magnetic(self, measurement: MagneticField) -> None:
        """Keep the newest field with the turn at its time."""
        self._field, self._field_turn = measurement, self._window.turn.copy()

    def attitude(self, measurement: Attitude) -> FirstAttitude | None:
        """Begin at a measured attitude once half a window of inertial data looks like the right unit."""
        if self._window.seconds < 0.5 * self.settings.window_s or self._is_wrong_unit():
            return None
        self.reason = ""
        sigma = np.sqrt(np.maximum(np.diag(measurement.cov_att), 0.0))
        return FirstAttitude(self._window.end_ns, measurement.q_nb.copy(), float(max(sigma[:2])), float(sigma[2]), False)

    def gps(self, measurement: GpsVelocity, local: LocalField | None) -> FirstAttitude | None:
        """Close the window at a GPS velocity when it began with one; else begin there."""
        begun = self._anchor
        if not isinstance(begun, GpsVelocity):
            self._begin(measurement)
            return None
        if not self._long_enough():
            return None
        span_s = self._window.seconds
        force_n = (measurement.vel_n - begun.vel_n) / span_s - np.array([0.0, 0.0, STANDARD_GRAVITY])
        noise = change_sigma(measurement.cov_n + begun.cov_n, force_n, span_s) / (span_s * STANDARD_GRAVITY)
        first = self._solve(self._window.force_b0 / span_s, force_n, float(np.hypot(noise, 0.3 * DEGREE)), local, measurement)
        if first is None:
            self._begin(measurement)
        return first

    def air(self, measurement: AirVelocity, local: LocalField | None) -> FirstAttitude | None:
        """Close the window at an airspeed when it began with one; GPS velocity, where it comes, goes first."""
        begun, slowest, window = self._anchor, self._slowest_air_mps, self._window
        if slowest is None or isinstance(begun, GpsVelocity) or np.linalg.norm(measurement.vel_b) < slowest:
            return None
        if not isinstance(begun, AirVelocity):
            self._begin(measurement)
            return None
        if window.seconds < UNAIDED_WINDOWS * self.settings.window_s:
            return None
        change_b0 = quat_rotate(window.turn, measurement.vel_b) - begun.vel_b
        force_b0 = (window.force_b0 - change_b0) / window.seconds
        gravity_n = np.array([0.0, 0.0, -STANDARD_GRAVITY])
        first = self._solve(force_b0, gravity_n, self.settings.air_tilt_deg * DEGREE, local, measurement)
        if first is None:
            self._begin(measurement)
        return first

    def unaided(self, local: LocalField | None) -> FirstAttitude | None:
        """At the end of a window without velocities: level by the accelerometers when it looks unaccelerated."""
        window, stale = self._window, self._anchor is not None
        if window.t_ns is None or window.t_ns < self._limit_ns():
            return None
        first = None
        if not stale:
            force, rate, steady = window.force_b0 / window.seconds, window.rate_b / window.seconds, self._steady
            bias_sigma = np.hypot(typical(self._imu.gyro_turn_on_dps), typical(self._imu.gyro_bias_dps))
            if np.linalg.norm(rate) > (steady.yaw_rate_dps + 3.0 * bias_sigma) * DEGREE:
                self.reason = "turning, and neither GPS velocity nor airspeed to give the acceleration"
            elif abs(np.linalg.norm(force) / STANDARD_GRAVITY - 1.0) > steady.force_g:
                if not self._is_wrong_unit():
                    self.reason = "accelerating, and neither GPS velocity nor airspeed to give how much"
            else:
                gravity_n = np.array([0.0, 0.0, -STANDARD_GRAVITY])
                first = self._solve(force, gravity_n, self.settings.unaided_tilt_deg * DEGREE, local, None)
        self._begin(None)
        return first

    def _begin(self, anchor: GpsVelocity | AirVelocity | None) -> None:
        if self._field is not None:  # the newest field, seen from the axes in which the new window begins
            self._field_turn = quat_multiply(quat_conjugate(self._window.turn), self._field_turn)
        self._anchor, self._since_ns = anchor, self._window.t_ns
        self._window.begin(self._since_ns)

    def _limit_ns(self) -> int:
        windows = UNAIDED_WINDOWS if self._anchor is None else STALE_WINDOWS
        return (self._since_ns or 0) + round(1e9 * windows * self.settings.window_s)

    def _is_wrong_unit(self) -> bool:
        wrong = unit_error(self._window.force_b0 / self._window.seconds, self._window.rate_b / self._window.seconds)
        self.wrong_unit, self.reason = bool(wrong), wrong or self.reason
        return self.wrong_unit

    def _long_enough(self) -> bool:
        return self._window.seconds >= self.settings.window_s - 1e-6

    def _solve(
        self, force_b0: np.ndarray, force_n: np.ndarray, tilt_sigma: float, local: LocalField | None, end: GpsVelocity | AirVelocity | None
    ) -> FirstAttitude | None:
        """Attitude at the end of the window; tilt and heading depend on each other, so they are found by turns."""
        if self._is_wrong_unit():
            return None
        force_b = quat_rotate(quat_conjugate(self._window.turn), force_b0)
        field_b, trouble = self._field_at_end(local)
        track = self._track(end)
        if field_b is None and track is None:
            self.reason = f"levelled, but no heading: {trouble}"
            return None
        heading = 0.0 if track is None else track
        for _ in range(_PASSES):
            roll, pitch = tilt_from_specific_force(force_b, force_n, heading)
            if field_b is not None and local is not None:
                heading = magnetic_heading(roll, pitch, field_b, local.declination)
        if field_b is not None and isinstance(end, GpsVelocity) and crabs(heading, *end.vel_n[:2]) is not None:
            heading, field_b = math.atan2(end.vel_n[1], end.vel_n[0]), None  # no wind explains it: the magnetometer is turned
            roll, pitch = tilt_from_specific_force(force_b, force_n, heading)
        magnetic_deg, track_deg = self._magnetic_deg, self.settings.track_sigma_deg
        sigma = track_deg if field_b is None or magnetic_deg is None else magnetic_deg
        gps = end if isinstance(end, GpsVelocity) else None
        air = end if isinstance(end, AirVelocity) else None
        self.reason = ""
        q_nb, is_magnetic = euler_to_quat(roll, pitch, heading), field_b is not None
        return FirstAttitude(self._window.end_ns, q_nb, tilt_sigma, sigma * DEGREE, is_magnetic, gps, air)

    def _field_at_end(self, local: LocalField | None) -> tuple[np.ndarray | None, str]:
        """Newest magnetic field turned to the end of the window, or why there is none."""
        if self._magnetic_deg is None:
            return None, "magnetometer switched off and no GPS track"
        if self._field is None or self._window.end_ns - self._field.stamp_ns > FIELD_AGE_NS:
            return None, "no magnetometer and no GPS track"
        if local is None:
            return None, DECLINATION_UNKNOWN
        refusal = local.refusal(self._field.field_b)
        if refusal:
            return None, refusal
        since = quat_multiply(quat_conjugate(self._window.turn), self._field_turn)
        return quat_rotate(since, self._field.field_b), ""

    def _track(self, end: Measurement | None) -> float | None:
        if not isinstance(end, GpsVelocity):
            return None
        north, east = end.vel_n[0], end.vel_n[1]
        return float(np.arctan2(east, north)) if np.hypot(north, east) >= self.settings.track_speed_mps else None
