"""Aids of the constant-gain filters: each measures the attitude and moves it by a gain that was known before the flight.

The covariance follows the filter that really runs: ``P = (I - K H) P (I - K H)' + K R K'`` holds for any gain, so a gain that is not
the best one for these sensors shows as a larger sigma.  Errors that no gain moves (accelerometer bias, the slow error of the magnetic
heading) are carried in P all the same.  Vector matching has the measured vectors in its Jacobian and keeps the Kalman gain.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.aids.gps_attitude import GpsAttitudeAid, GpsAttitudeSettings
from lowcostnav_ros.aids.level import MANOEUVRING, LevelSettings
from lowcostnav_ros.aids.magnetic import MagneticAid, MagneticSettings
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import Attitude, GpsVelocity, ImuBlock, MagneticField, Measurement
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.small_matrices import matmul, turned
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.views import Attitude as AttitudeView
from lowcostnav_ros.estimation.aiding import Aid, Host, Innovation, Reason, floored
from lowcostnav_ros.estimation.attitude_gains import Tuning, axis_gains, scheduled_euler_gain
from lowcostnav_ros.estimation.attitude_vectors import RIGHT, match_vectors, matching_rows, specific_force_from_velocity
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov
from lowcostnav_ros.estimation.inertial_window import InertialWindow
from lowcostnav_ros.estimation.manoeuvre import RateSwitch, RateSwitchSettings
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.magnetic_heading import FieldAtPlace
from lowcostnav_ros.physics.rotation import (
    euler_jacobian_n,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    quat_to_euler,
    rotvec_from_quat,
    wrap,
)

STEEPEST_EULER = 80.0 * DEGREE
LONGEST_SPAN_S, SHORTEST_SPAN_S = 3.0, 0.9
"""Of two GPS velocities between which specific forces are compared."""
WAHBA_STEPS, FIELD_HELD_S, MOST_PARALLEL = 6, 0.5, 1e6
"""Whole steps of the iteration, which settles within them; age of a field; condition from which two vectors count as parallel."""
NO_FIELD, PARALLEL = Reason("no magnetic field"), Reason("field and specific force are parallel")
UNKNOWN_DIP = Reason("place unknown", "wait for a fix or set place.lat_lon_deg, else the dip of the field is not known")


@dataclass(frozen=True)
class ConstantGainSettings:
    """Tuning of the constant-gain filters; the defaults are those flown (Gebre-Egziabher 2004, tables 4.2 and 4.4)."""

    gps_alpha: float = setting(0.2, "GPS attitude: factor on the gyro noise.", minimum=1e-3, maximum=1e3)
    gps_beta: float = setting(2e-4, "GPS attitude: driving noise of the gyro biases.", unit="deg/s/sqrt(s)", minimum=1e-9, maximum=1.0)
    gps_sigma_deg: float = setting(0.25, "GPS attitude: noise of each angle.", unit="deg", minimum=0.01, maximum=10.0)
    gps_period_s: float = setting(0.5, "GPS attitude: spacing the gain is made for; faster ones are skipped.", unit="s", minimum=0.05)
    level_alpha: float = setting(10.0, "Level and magnetic heading: factor on the gyro noise.", minimum=1e-3, maximum=1e3)
    level_beta: float = setting(1e-5, "Level and magnetic heading: factor on the gyro drift.", minimum=1e-9, maximum=1e3)
    level_sigma_deg: float = setting(0.06, "Noise of roll and pitch by accelerometers, 1 milli-g.", unit="deg", minimum=0.001, maximum=10.0)
    heading_sigma_deg: float = setting(0.8, "Noise of the magnetic heading.", unit="deg", minimum=0.01, maximum=30.0)
    level_period_s: float = setting(0.5, "Spacing of level and magnetic heading.", unit="s", minimum=0.05, maximum=10.0)
    gyro_sigma_dps: float = setting(0.05, "Gyro noise the gains are made for.", unit="deg/s/sqrt(Hz)", minimum=1e-6, maximum=10.0)
    drift_dps: float = setting(0.05, "Gyro drift the gains are made for.", unit="deg/s", minimum=1e-6, maximum=10.0)
    drift_tau_s: float = setting(1000.0, "Correlation time of that drift.", unit="s", minimum=1.0)


def tunings(g: ConstantGainSettings) -> tuple[Tuning, Tuning]:
    """Tuning for GPS attitude, and for level and magnetic heading."""
    gyro, drift = g.gyro_sigma_dps, (g.drift_dps, g.drift_tau_s)
    angles = (g.level_sigma_deg, g.level_sigma_deg, g.heading_sigma_deg)
    gps = Tuning(g.gps_alpha, gyro, g.gps_beta, *drift, True, (g.gps_sigma_deg,) * 3, g.gps_period_s)
    return gps, Tuning(g.level_alpha, gyro, g.level_beta, *drift, False, angles, g.level_period_s)


@kernel
def joseph(P, K, H, R):
    """Covariance after an update with any gain, in place: (I - K H) P (I - K H)' + K R K', kept symmetric."""
    moved = turned(np.eye(P.shape[0]) - matmul(K, H), P) + turned(K, R)
    for i in range(P.shape[0]):
        for j in range(P.shape[0]):
            P[i, j] = 0.5 * (moved[i, j] + moved[j, i])


class ConstantGainAid(Aid):
    """Base of the aids with a gain of their own."""

    def gain(self, host: Host) -> np.ndarray:
        """Gain (n, m) on the innovation; a gyro bias is minus the rate correction of the source."""
        raise NotImplementedError

    def fuse(self, innovation: Innovation, host: Host) -> None:
        """Apply the gain: covariance, then correction."""
        K = self.gain(host)
        joseph(host.P, K, innovation.H, innovation.R)
        host.correct(K @ innovation.y)


class ConstantQuaternionAid(ConstantGainAid, GpsAttitudeAid):
    """GPS attitude with one pair of gains at every attitude: ``phi += L_a y``, ``bias -= L_b C' y``."""

    def __init__(self, settings: GpsAttitudeSettings, key: str, tuning: Tuning) -> None:
        super().__init__(settings, key)
        self.tuning, self.period_s = tuning, tuning.period_s
        self.on_angle, self.on_rate = axis_gains(tuning, tuning.angle_sigma_deg[0])

    def gain(self, host: Host) -> np.ndarray:
        """Gain (n, 3) on the small rotation."""
        K = np.zeros((host.layout.size, 3))
        K[host.core.attitude_rows] = self.on_angle * np.eye(3)
        K[host.layout["gyro_bias"]] = -self.on_rate * host.core.C_nb().T
        return K


class ScheduledEulerAid(ConstantQuaternionAid):
    """GPS attitude as differences of Euler angles, the gain on the biases scheduled on roll and pitch."""

    labels = ("roll_rad", "pitch_rad", "heading_rad")

    def innovation(self, measurement: Attitude, host: Host) -> Innovation | str:
        """``y = (roll, pitch, heading)_gps - estimated``, wrapped; H is the derivative of the angles by phi_n."""
        estimated = np.array(quat_to_euler(host.core.nav[6:10]))
        if abs(estimated[1]) > STEEPEST_EULER:
            return "too steep for Euler angles"
        measured, J = np.array(quat_to_euler(measurement.q_nb)), euler_jacobian_n(*estimated)
        H = np.zeros((3, host.layout.size))
        H[:, host.core.attitude_rows] = np.eye(3)
        return Innovation(wrap(measured - estimated), J @ H, J @ self.seen(measurement, host)[1] @ J.T, measured)

    def gain(self, host: Host) -> np.ndarray:
        """Gain (n, 3) on Euler differences; angle corrections are turned back to phi_n."""
        angles = quat_to_euler(host.core.nav[6:10])
        on_euler = scheduled_euler_gain(angles[0], angles[1], self.tuning)
        K = np.zeros((host.layout.size, 3))
        K[host.core.attitude_rows] = np.linalg.solve(euler_jacobian_n(*angles), on_euler[:3])
        K[host.layout["gyro_bias"]] = -on_euler[3:]
        return K


class ConstantLevelAid(ConstantGainAid):
    """Level by the mean specific force of a steady span: ``phi_N = -f_E / g``, ``phi_E = f_N / g``."""

    name, labels, views = "accelerometer_level", ("north_rad", "east_rad"), (AttitudeView,)

    def __init__(self, settings: LevelSettings, key: str, tuning: Tuning, rates: RateSwitchSettings) -> None:
        super().__init__(settings, key)
        self.switch, self.period_s = RateSwitch(settings, rates), tuning.period_s
        self.on_angle, self.on_rate = axis_gains(tuning, tuning.angle_sigma_deg[0])

    def innovation(self, measurement: Measurement, host: Host) -> Innovation | str:
        """Tilt of the specific force against minus gravity; the accelerometer bias enters H, the acceleration of steady flight R."""
        force_b = self.switch.mean_force()
        if force_b is None:
            return MANOEUVRING
        C, tilt = host.core.C_nb(), host.core.attitude_rows.start
        force_n = C @ force_b
        y = np.array([-force_n[1], force_n[0]]) / STANDARD_GRAVITY
        H = np.zeros((2, host.layout.size))
        H[0, tilt], H[1, tilt + 1] = 1.0, 1.0
        H[:, host.layout["accel_bias"]] = np.vstack((-C[1], C[0])) / STANDARD_GRAVITY
        return Innovation(y, H, np.eye(2) * (self.settings.acceleration_mps2 / STANDARD_GRAVITY) ** 2, y.copy())

    def gain(self, host: Host) -> np.ndarray:
        """Gain (n, 2) on the tilt."""
        K, tilt = np.zeros((host.layout.size, 2)), host.core.attitude_rows.start
        K[tilt, 0], K[tilt + 1, 1] = self.on_angle, self.on_angle
        K[host.layout["gyro_bias"]] = -self.on_rate * host.core.C_nb().T[:, :2]
        return K


class ConstantHeadingAid(ConstantGainAid, MagneticAid):
    """Magnetic heading with a constant gain on the rotation about the vertical; its slow error is carried, not estimated."""

    def __init__(self, settings: MagneticSettings, key: str, tuning: Tuning) -> None:
        super().__init__(settings, key)
        self.on_angle, self.on_rate = axis_gains(tuning, tuning.angle_sigma_deg[2])

    def shows_heading(self, stamp_ns: int, host: Host) -> bool:
        """No velocity is estimated beside it."""
        return False

    def gain(self, host: Host) -> np.ndarray:
        """Gain (n, 1) on the heading."""
        K = np.zeros((host.layout.size, 1))
        K[host.core.attitude_rows.stop - 1, 0] = self.on_angle
        K[host.layout["gyro_bias"], 0] = -self.on_rate * host.core.C_nb()[2]
        return K


class VectorAid(Aid):
    """A vector known in n and measured in b; attitude and gyro bias alone are moved."""

    views = (AttitudeView,)

    def attach(self, host: Host) -> None:
        """Find the states it moves."""
        super().attach(host)
        self._matched = host.layout.mask("gyro_bias")
        self._matched[host.core.attitude_rows] = 1.0


class FieldMatchAid(VectorAid):
    """Direction of the magnetic field as a vector; what calibration left of it is a slow error in b that is carried, not moved.

    ``reference`` gives the field expected at the place last known; its host sets it.
    """

    name, labels = "magnetic_vector", ("north", "east", "down")
    measurement, topic = MagneticField, "imu/mag"
    reference: FieldAtPlace | None = None

    def blocks(self) -> list[Block]:
        """Error of the field in b, of unit strength."""
        name, sigma = self.own("magnetic_error"), 0.5 * (self.settings.bias_deg * DEGREE)  # half the field is horizontal
        return [gauss_markov(name, [f"{name}_{axis}" for axis in "xyz"], Kind.FREE, sigma, self.settings.bias_tau_s)]

    def innovation(self, measurement: MagneticField, host: Host) -> Innovation | str:
        """``y = u_n - C u_b`` of unit vectors (equation 4.60)."""
        place = self.reference
        if place is not None:
            place.follow(measurement.stamp_ns)
        field_n, local = (None, None) if place is None else (place.field_n(), place.known())
        if field_n is None or local is None:
            return UNKNOWN_DIP
        refusal = Reason.of(local.refusal(measurement.field_b))
        if refusal:
            return refusal
        strength = float(np.linalg.norm(field_n))
        C = host.core.C_nb()
        y, on_attitude = matching_rows(C, field_n / strength, measurement.field_b / strength)
        H = np.zeros((3, host.layout.size))
        H[:, host.core.attitude_rows], H[:, host.layout[self.own("magnetic_error")]] = on_attitude, -C
        noise = self.settings.noise_deg * DEGREE * float(np.hypot(field_n[0], field_n[1])) / strength
        return Innovation(y, H, np.eye(3) * noise**2, measurement.field_b.copy(), self._matched)


class ForceMatchAid(VectorAid):
    """Specific force that GPS velocity shows against the accelerometers' mean over the same span, in units of g.

    Parameters
    ----------
    settings : GpsVelocitySettings
    key : str
    accel_noise_mg_rthz : float
        White noise of the accelerometers.
    """

    name, labels = "specific_force_vector", ("north_g", "east_g", "down_g")
    measurement, topic = GpsVelocity, "gps/vel"

    def __init__(self, settings: Any, key: str, accel_noise_mg_rthz: float) -> None:
        super().__init__(settings, key)
        self.noise_g_rthz = 1e-3 * accel_noise_mg_rthz
        self.window = InertialWindow()
        self.begin(None)

    def begin(self, velocity: GpsVelocity | None) -> None:
        """Begin a span at a velocity; None: with the next one."""
        self._velocity = velocity
        self.window.begin(None if velocity is None else velocity.stamp_ns)

    def follow(self, block: ImuBlock, start: int, stop: int) -> None:
        """Take samples ``start`` to ``stop`` of a block into the span."""
        if self._velocity is not None:
            self.window.gather(block, start, stop)

    def due(self, measurement: GpsVelocity) -> bool:
        """Whether the span is long enough for an acceleration, and short enough for its mean to be one."""
        return self._velocity is not None and SHORTEST_SPAN_S <= self.window.seconds <= LONGEST_SPAN_S

    def after(self, measurement: GpsVelocity, host: Host) -> None:
        """Begin the next span."""
        if self._velocity is None or self.window.seconds >= SHORTEST_SPAN_S:
            self.begin(measurement)

    def innovation(self, measurement: GpsVelocity, host: Host) -> Innovation | str:
        """``y = f_n - C f_b``; successive spans share a velocity, whose noise then cancels: taking it as white is on the safe side."""
        if self._velocity is None:
            return "no span between two velocities"
        seconds, scale, floor = self.window.seconds, self.settings.sigma_scale, self.settings.velocity_floor_mps
        cov = floored(measurement.cov_n, scale, floor) + floored(self._velocity.cov_n, scale, floor)
        force_b = quat_rotate(quat_conjugate(self.window.turn), self.window.force_b0) / seconds
        force_n = specific_force_from_velocity(self._velocity.vel_n, measurement.vel_n, seconds)
        C = host.core.C_nb()
        y, on_attitude = matching_rows(C, force_n / STANDARD_GRAVITY, force_b / STANDARD_GRAVITY)
        H = np.zeros((3, host.layout.size))
        H[:, host.core.attitude_rows], H[:, host.layout["accel_bias"]] = on_attitude, -C / STANDARD_GRAVITY
        R = cov / (seconds * STANDARD_GRAVITY) ** 2 + np.eye(3) * self.noise_g_rthz**2 / seconds
        return Innovation(y, H, R, force_n / STANDARD_GRAVITY, self._matched)


class HeldFieldAid(FieldMatchAid):
    """The field as a vector that moves nothing by itself: it is kept for the next solution of two vectors."""

    held: tuple[int, Innovation] | None = None

    def fuse(self, innovation: Innovation, host: Host) -> None:
        """Keep what passed the gate."""
        self.held = self.status.stamp_ns, innovation


class WahbaAid(ForceMatchAid):
    """Attitude of field and specific force together, by iterated least squares from the estimate, as one measurement (equation 4.31).

    The solution weighs both vectors alike, whatever their noise; ``y = phi_n`` and R is that of such a solution.
    """

    name, labels = "wahba_attitude", ("north_rad", "east_rad", "down_rad")
    field: HeldFieldAid | None = None

    def innovation(self, measurement: GpsVelocity, host: Host) -> Innovation | str:
        """Rotation from the estimate to the solution; errors of both vectors enter through the pseudo-inverse of its last step."""
        force = super().innovation(measurement, host)
        if isinstance(force, str):
            return force
        held = None if self.field is None else self.field.held
        if held is None or abs(measurement.stamp_ns - held[0]) > 1e9 * FIELD_HELD_S:
            return NO_FIELD
        vectors, q_nb, att = (held[1], force), host.core.nav[6:10].copy(), host.core.attitude_rows
        seen_n = [-_axis(one.H[:, att]) for one in vectors]
        true_n = [one.y + seen for one, seen in zip(vectors, seen_n, strict=True)]
        seen_b = [quat_rotate(quat_conjugate(q_nb), seen) for seen in seen_n]
        q = match_vectors(q_nb, true_n[0], true_n[1], seen_b[0], seen_b[1], 1.0, WAHBA_STEPS, RIGHT)
        rows = np.vstack([one.H[:, att] for one in vectors])
        normal = rows.T @ rows
        if np.linalg.cond(normal) > MOST_PARALLEL:
            return PARALLEL
        inverse = np.linalg.solve(normal, rows.T)
        on_field, on_force = inverse[:, :3], inverse[:, 3:]
        H = on_field @ vectors[0].H + on_force @ force.H
        R = turned(on_field, vectors[0].R) + turned(on_force, force.R)
        y = rotvec_from_quat(quat_multiply(q, quat_conjugate(q_nb)))
        return Innovation(y, H, R, y.copy(), self._matched)


def _axis(matrix: np.ndarray) -> np.ndarray:
    """Vector (3,) of a skew-symmetric matrix."""
    return np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0]])
