"""Aids of the constant-gain filters: each measures the attitude and moves it by a gain that was known before the flight.

The covariance follows the filter that really runs: ``P = (I - K H) P (I - K H)' + K R K'`` holds for any gain, so a gain that is not
the best one for these sensors shows as a larger sigma.  Errors that no gain moves (accelerometer bias, the slow error of the magnetic
heading) are carried in P all the same.  Vector matching has the measured vectors in its Jacobian and keeps the Kalman gain.
"""

from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.aids.ahrs_aids import GpsAttitudeAid
from lowcostnav_ros.aids.ins_gps_aids import MagneticAid
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import Attitude, MagneticField, Measurement
from lowcostnav_ros.base.small_matrices import matmul, turned
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Innovation
from lowcostnav_ros.estimation.attitude_gains import Tuning, axis_gains, scheduled_euler_gain
from lowcostnav_ros.estimation.attitude_vectors import matching_rows
from lowcostnav_ros.navigators.ahrs.settings import AhrsSettings, LevelSettings
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import euler_jacobian_n, quat_to_dcm, quat_to_euler, wrap

if TYPE_CHECKING:
    from lowcostnav_ros.navigators.ahrs.constant_gain import ConstantGainAhrs

STEEPEST_EULER = 80.0 * DEGREE
UNKNOWN_DIP = "place unknown: wait for a fix or set place.lat_lon_deg, else the dip of the field is not known"


def tunings(settings: AhrsSettings) -> tuple[Tuning, Tuning]:
    """Tuning for GPS attitude, and for level and magnetic heading."""
    g = settings.constant_gain
    gyro = (g.gyro_sigma_dps, g.drift_dps, g.drift_tau_s)
    gps = Tuning(g.gps_alpha, gyro[0], g.gps_beta, gyro[1], gyro[2], True, (g.gps_sigma_deg,) * 3, g.gps_period_s)
    angles = (g.level_sigma_deg, g.level_sigma_deg, g.heading_sigma_deg)
    return gps, Tuning(g.level_alpha, gyro[0], g.level_beta, gyro[1], gyro[2], False, angles, g.level_period_s)


@kernel
def joseph(P, K, H, R):
    """Covariance after an update with any gain, in place: (I - K H) P (I - K H)' + K R K', kept symmetric."""
    moved = turned(np.eye(P.shape[0]) - matmul(K, H), P) + turned(K, R)
    for i in range(P.shape[0]):
        for j in range(P.shape[0]):
            P[i, j] = 0.5 * (moved[i, j] + moved[j, i])


def fuse_constant(innovation: Innovation, K: np.ndarray, host: "ConstantGainAhrs") -> None:
    """Apply a gain (n, m): covariance, then correction."""
    joseph(host.P, K, innovation.H, innovation.R)
    host.correct(K @ innovation.y)


class ConstantQuaternionAid(GpsAttitudeAid):
    """GPS attitude with one pair of gains at every attitude: ``phi += L_a y``, ``bias -= L_b C' y``."""

    def __init__(self, settings: AhrsSettings, tuning: Tuning) -> None:
        super().__init__(settings.gps_attitude)
        self.tuning = tuning
        self.on_angle, self.on_rate = axis_gains(tuning, tuning.angle_sigma_deg[0])

    def gain(self, host: "ConstantGainAhrs") -> np.ndarray:
        """Gain (n, 3) on the innovation; a gyro bias is minus the rate correction of the source."""
        K = np.zeros((host.layout.size, 3))
        K[ATT] = self.on_angle * np.eye(3)
        K[host.layout["gyro_bias"]] = -self.on_rate * quat_to_dcm(host.core.nav[6:10]).T
        return K

    def fuse(self, innovation: Innovation, host: "ConstantGainAhrs") -> None:
        """Apply the constant gain."""
        fuse_constant(innovation, self.gain(host), host)


class ScheduledEulerAid(ConstantQuaternionAid):
    """GPS attitude as differences of Euler angles, the gain on the biases scheduled on roll and pitch."""

    def __init__(self, settings: AhrsSettings, tuning: Tuning) -> None:
        super().__init__(settings, tuning)
        self.status.labels = ("roll_rad", "pitch_rad", "heading_rad")

    def innovation(self, measurement: Attitude, host: "ConstantGainAhrs") -> Innovation | str:
        """``y = (roll, pitch, heading)_gps - estimated``, wrapped; H is the derivative of the angles by phi_n."""
        estimated = np.array(quat_to_euler(host.core.nav[6:10]))
        if abs(estimated[1]) > STEEPEST_EULER:
            return "too steep for Euler angles"
        measured = np.array(quat_to_euler(measurement.q_nb))
        J = euler_jacobian_n(*estimated)
        base = super().innovation(measurement, host)
        return Innovation(wrap(measured - estimated), J @ base.H, J @ base.R @ J.T, measured)

    def gain(self, host: "ConstantGainAhrs") -> np.ndarray:
        """Gain (n, 3) on Euler differences; angle corrections are turned back to phi_n."""
        angles = quat_to_euler(host.core.nav[6:10])
        on_euler = scheduled_euler_gain(angles[0], angles[1], self.tuning)
        K = np.zeros((host.layout.size, 3))
        K[ATT] = np.linalg.solve(euler_jacobian_n(*angles), on_euler[:3])
        K[host.layout["gyro_bias"]] = -on_euler[3:]
        return K


class ConstantLevelAid(Aid):
    """Level by the mean specific force of a steady span: ``phi_N = -f_E / g``, ``phi_E = f_N / g``."""

    def __init__(self, settings: LevelSettings, tuning: Tuning) -> None:
        super().__init__("accelerometer_level", ("north_rad", "east_rad"), settings.gate)
        self.settings = settings
        self.on_angle, self.on_rate = axis_gains(tuning, tuning.angle_sigma_deg[0])

    def innovation(self, measurement: Measurement, host: "ConstantGainAhrs") -> Innovation | str:
        """Tilt of the specific force against minus gravity; the accelerometer bias enters H, the acceleration of steady flight R."""
        force_b = host.switch.mean_force()
        if force_b is None:
            return "manoeuvring"
        C = quat_to_dcm(host.core.nav[6:10])
        force_n = C @ force_b
        y = np.array([-force_n[1], force_n[0]]) / STANDARD_GRAVITY
        H = np.zeros((2, host.layout.size))
        H[0, ATT.start], H[1, ATT.start + 1] = 1.0, 1.0
        H[:, host.layout["accel_bias"]] = np.vstack((-C[1], C[0])) / STANDARD_GRAVITY
        return Innovation(y, H, np.eye(2) * (self.settings.acceleration_mps2 / STANDARD_GRAVITY) ** 2, y.copy())

    def fuse(self, innovation: Innovation, host: "ConstantGainAhrs") -> None:
        """Apply the constant gain."""
        K = np.zeros((host.layout.size, 2))
        K[ATT.start, 0], K[ATT.start + 1, 1] = self.on_angle, self.on_angle
        K[host.layout["gyro_bias"]] = -self.on_rate * quat_to_dcm(host.core.nav[6:10]).T[:, :2]
        fuse_constant(innovation, K, host)


class ConstantHeadingAid(MagneticAid):
    """Magnetic heading with a constant gain on the rotation about the vertical; its slow error is carried, not estimated."""

    def __init__(self, settings: AhrsSettings, tuning: Tuning) -> None:
        super().__init__(settings.magnetic)
        self.on_angle, self.on_rate = axis_gains(tuning, tuning.angle_sigma_deg[2])

    def fuse(self, innovation: Innovation, host: "ConstantGainAhrs") -> None:
        """Apply the constant gain."""
        K = np.zeros((host.layout.size, 1))
        K[ATT.stop - 1, 0] = self.on_angle
        K[host.layout["gyro_bias"], 0] = -self.on_rate * quat_to_dcm(host.core.nav[6:10])[2]
        fuse_constant(innovation, K, host)


class FieldMatchAid(Aid):
    """Direction of the magnetic field as a vector; what calibration left of it is a slow error in b that is carried, not moved."""

    def __init__(self, settings: AhrsSettings) -> None:
        super().__init__("magnetic_vector", ("north", "east", "down"), settings.magnetic.gate)
        self.settings = settings.magnetic

    def innovation(self, measurement: MagneticField, host: "ConstantGainAhrs") -> Innovation | str:
        """``y = u_n - C u_b`` of unit vectors (equation 4.60)."""
        field_n = host.field_n()
        if field_n is None:
            return UNKNOWN_DIP
        reason = host.magnetic.known().refusal(measurement.field_b)
        if reason:
            return reason
        strength = float(np.linalg.norm(field_n))
        C = quat_to_dcm(host.core.nav[6:10])
        y, on_attitude = matching_rows(C, field_n / strength, measurement.field_b / strength)
        H = np.zeros((3, host.layout.size))
        H[:, ATT], H[:, host.layout["magnetic_error"]] = on_attitude, -C
        noise = self.settings.noise_deg * DEGREE * float(np.hypot(field_n[0], field_n[1])) / strength
        return Innovation(y, H, np.eye(3) * noise**2, measurement.field_b.copy(), host.matched)


class ForceMatchAid(Aid):
    """Specific force that GPS velocity shows against the accelerometers' mean over the same span, in units of g."""

    def __init__(self, gate: GateSettings, accel_noise_mg_rthz: float) -> None:
        super().__init__("specific_force_vector", ("north_g", "east_g", "down_g"), gate)
        self.noise_g_rthz = 1e-3 * accel_noise_mg_rthz

    def innovation(self, measurement: Measurement, host: "ConstantGainAhrs") -> Innovation | str:
        """``y = f_n - C f_b``; successive spans share a velocity, whose noise then cancels: taking it as white is on the safe side."""
        span = host.span
        if span is None:
            return "no span between two velocities"
        C = quat_to_dcm(host.core.nav[6:10])
        y, on_attitude = matching_rows(C, span.force_n / STANDARD_GRAVITY, span.force_b / STANDARD_GRAVITY)
        H = np.zeros((3, host.layout.size))
        H[:, ATT], H[:, host.layout["accel_bias"]] = on_attitude, -C / STANDARD_GRAVITY
        R = span.velocity_cov / (span.seconds * STANDARD_GRAVITY) ** 2 + np.eye(3) * self.noise_g_rthz**2 / span.seconds
        return Innovation(y, H, R, span.force_n / STANDARD_GRAVITY, host.matched)
