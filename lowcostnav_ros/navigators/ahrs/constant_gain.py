"""The attitude filters of the source: gains that are constant, or scheduled in closed form, and known before the flight.

    euler            GPS attitude as Euler angles, bias gains scheduled on roll and pitch
    quaternion       GPS attitude as a small rotation, one pair of gains everywhere
    vector_matching  GPS velocity and magnetic field as vectors, Kalman gain (its Jacobian changes with every measurement)
    switched         accelerometers and magnetometer alone

When its GPS is silent, each goes on as ``switched``: level and magnetic heading in steady flight, gyros alone in manoeuvres
(Gebre-Egziabher 2004, sections 4.11 and 4.12).  Mean and covariance are carried by the inertial core of all navigators, so the horizon,
the low-latency output and the sigmas mean the same as in the full filter; for ``euler`` the angles are formed where they are compared.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids.constant_gain import (
    ConstantHeadingAid,
    ConstantLevelAid,
    ConstantQuaternionAid,
    FieldMatchAid,
    ForceMatchAid,
    ScheduledEulerAid,
    tunings,
)
from lowcostnav_ros.aids.ins_gps_aids import floored
from lowcostnav_ros.base.measurements import Attitude, GpsVelocity, ImuBlock, MagneticField, Measurement
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.imu_errors import bias_blocks, core_block, typical
from lowcostnav_ros.estimation.attitude_vectors import specific_force_from_velocity
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov
from lowcostnav_ros.navigators.ahrs.base import ATTITUDE, FIX, IMU, LEVEL_TIMEOUT_NS, MAG, VELOCITY, Ahrs
from lowcostnav_ros.navigators.ahrs.kernels import WINDOW_SIZE, gather_window
from lowcostnav_ros.navigators.ahrs.rate_switch import RateSwitch
from lowcostnav_ros.navigators.ahrs.settings import EULER, QUATERNION, VECTOR_MATCHING, AhrsSettings
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_rotate, quat_to_dcm

LONGEST_SPAN_S = 3.0
SHORTEST_SPAN_S = 0.9
_NEVER_NS = 2**62
_SLACK_NS = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Span:
    """Mean specific force between two GPS velocities, m/s^2: as they show it in n, as accelerometers saw it in b at the end."""

    seconds: float
    force_n: np.ndarray
    force_b: np.ndarray
    velocity_cov: np.ndarray


class ConstantGainAhrs(Ahrs):
    """Attitude and heading reference with constant gains; see the module head.

    Attributes
    ----------
    span : Span or None
        What the force aid compares now.
    matched : ndarray
        1 for the states vector matching moves: attitude and gyro bias.
    """

    def __init__(self, settings: AhrsSettings) -> None:
        kind = self.kind = settings.filter
        hears_attitude = kind in (EULER, QUATERNION)
        self.inputs = {IMU: True, MAG: False, VELOCITY: False, FIX: False} | ({ATTITUDE: False} if hears_attitude else {})
        super().__init__(settings)
        gps, level = tunings(settings)
        self.switch = RateSwitch(settings.level, settings.rate_switch)
        self.attitude_aid = (ScheduledEulerAid if kind == EULER else ConstantQuaternionAid)(settings, gps)
        self.level_aid, self.magnetic_aid = ConstantLevelAid(settings.level, level), ConstantHeadingAid(settings, level)
        self.field_aid = FieldMatchAid(settings)
        self.force_aid = ForceMatchAid(settings.gps.gate, typical(settings.imu.accel_noise_mg_rthz))
        primary = [self.attitude_aid] if hears_attitude else [self.force_aid] if kind == VECTOR_MATCHING else []
        field = [self.field_aid] if kind == VECTOR_MATCHING else []
        magnetic = [*field, self.magnetic_aid] if settings.magnetic.enabled else []
        self.aids = [*primary, self.level_aid, *magnetic]
        self.matched = self.layout.mask("gyro_bias")
        self.matched[6:9] = 1.0

    @staticmethod
    def _blocks(settings: AhrsSettings) -> list[Block]:
        magnetic = settings.magnetic
        blocks = [core_block(settings.imu), *bias_blocks(settings.imu)]
        sigma, tau_s = magnetic.bias_deg * DEGREE, magnetic.bias_tau_s
        if magnetic.enabled:
            blocks.append(gauss_markov("heading_bias", ["heading_bias_rad"], Kind.HEADING_BIAS, sigma, tau_s))
        if settings.filter == VECTOR_MATCHING and magnetic.enabled:
            labels = [f"magnetic_error_{axis}" for axis in "xyz"]
            blocks.append(gauss_markov("magnetic_error", labels, Kind.FREE, 0.5 * sigma, tau_s))  # half the field is horizontal
        return blocks

    def field_n(self) -> np.ndarray | None:
        """Expected magnetic field (3,), tesla, NED, or None where the place or the model is missing."""
        reference, place = self.magnetic.reference, self.magnetic.place
        if place is None or reference.model is None:
            return None
        field = reference.model.field_n(*place)
        if reference.override is not None:
            level = float(np.hypot(field[0], field[1]))
            field = np.array([level * np.cos(reference.override), level * np.sin(reference.override), field[2]])
        return field

    def _begun(self, t_ns: int) -> None:
        self.switch.restart(t_ns)
        self._levelled_ns = self._tried_attitude_ns = t_ns
        self._forget_span(None)

    def _follow(self, block: ImuBlock, start: int, following: int) -> None:
        self.switch.follow(block, start, following, quat_to_dcm(self.core.nav[6:10]), self.core.errors()[1])
        if self._velocity is not None:
            columns = (block.stamps_ns[:following], block.specific_force_b, block.angular_rate_b)
            _, t_ns = gather_window(self._span_ns, self._window, *columns, start, _NEVER_NS)
            self._span_ns = int(t_ns)

    def _keep(self, now: int) -> None:
        """Level on the grid of outputs; hold the velocity that nothing here uses at zero."""
        if self.level_since_ns is None or now - self.level_since_ns >= 1_000_000_000:
            self._hold_velocity(now)
        if now - self._levelled_ns < 1e9 * self.settings.constant_gain.level_period_s - _SLACK_NS:
            return
        self._levelled_ns = now
        if not self._gps_holds(now):
            self.core.settle()
            if self.use_aid(self.level_aid, Measurement(now, IMU)):
                self._steady_ns = now
        self.switch.begin_span()

    def _gps_holds(self, now: int) -> bool:
        if self.kind == VECTOR_MATCHING:
            return now - self._gps_ns <= 1e9 * self.settings.gps.timeout_s
        return now - self._attitude_ns <= 1e9 * self.settings.gps_attitude.timeout_s

    def _aid(self, item: Measurement) -> None:
        if isinstance(item, Attitude):
            self._aid_attitude(item)
        elif isinstance(item, GpsVelocity) and self.kind == VECTOR_MATCHING:
            self._aid_force(item)
        elif isinstance(item, MagneticField) and self.settings.magnetic.enabled:
            self._aid_field(item)

    def _aid_attitude(self, item: Attitude) -> None:
        if item.stamp_ns - self._tried_attitude_ns < 1e9 * self.settings.constant_gain.gps_period_s - _SLACK_NS:
            return
        self._tried_attitude_ns = item.stamp_ns
        self.core.settle()
        if self.use_aid(self.attitude_aid, item):
            self._attitude_ns = item.stamp_ns

    def _aid_field(self, item: MagneticField) -> None:
        if not self._gps_holds(item.stamp_ns):
            if self.switch.is_steady:
                self._aid_magnetic(item)
        elif self.kind == VECTOR_MATCHING and item.stamp_ns - self._tried_magnetic_ns >= 1e9 * self.settings.magnetic.period_s - _SLACK_NS:
            self._tried_magnetic_ns = item.stamp_ns
            self.core.settle()
            if self.use_aid(self.field_aid, item):
                self._magnetic_ns = item.stamp_ns

    def _aid_force(self, item: GpsVelocity) -> None:
        """Close the span at a GPS velocity when it is long enough; begin the next one."""
        seconds = self._window[10]
        if self._velocity is not None and seconds < SHORTEST_SPAN_S:
            return
        if self._velocity is not None and seconds <= LONGEST_SPAN_S:
            scale, floor = self.settings.gps.sigma_scale, self.settings.gps.velocity_floor_mps
            cov = floored(item.cov_n, scale, floor) + floored(self._velocity.cov_n, scale, floor)
            force_b = quat_rotate(quat_conjugate(self._window[0:4]), self._window[4:7]) / seconds
            self.span = Span(seconds, specific_force_from_velocity(self._velocity.vel_n, item.vel_n, seconds), force_b, cov)
            self.core.settle()
            if self.use_aid(self.force_aid, item):
                self._gps_ns = item.stamp_ns
        self._forget_span(item)

    def _forget_span(self, velocity: GpsVelocity | None) -> None:
        self.span: Span | None = None
        self._velocity = velocity
        self._window = np.zeros(WINDOW_SIZE)
        self._window[0] = 1.0
        self._span_ns = self.core.t_ns

    def _mode(self, now: int, has_heading: bool) -> tuple[str, str]:
        heading = "" if has_heading else ", no magnetic heading"
        if self._gps_holds(now):
            held = "GPS velocity shows the acceleration" + heading if self.kind == VECTOR_MATCHING else "GPS attitude holds the attitude"
            return "calibrating", held
        if now - self._steady_ns <= LEVEL_TIMEOUT_NS:
            return "coasting", "levelled in steady flight" + heading
        return "gyro_only", "manoeuvring: gyros alone since the last steady flight"
