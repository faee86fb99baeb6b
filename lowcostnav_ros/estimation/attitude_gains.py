"""Constant gains of the attitude filters: model, steady state, schedule (Gebre-Egziabher 2004, section 4.11, tables 4.2 to 4.4).

State: three angles and three additive rate corrections ``d``, with true rate = gyro + d (so d is minus the gyro bias).  Two forms:

    Euler        d(roll, pitch, heading) = f(roll, pitch) d,     measured angles         noise alpha f, beta I
    quaternion   d(a_b) = -[w x] a_b + d,                        measured small rotation in b (twice the vector part)

f is :func:`~lowcostnav_ros.physics.attitude_propagation.euler_rate_matrix`.  In the quaternion form the gain is the same at every
attitude; in the Euler form it follows in closed form, so one pair of scalars schedules both.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.physics.attitude_propagation import body_rate_matrix, euler_rate_matrix
from lowcostnav_ros.physics.rotation import skew


@dataclass(frozen=True)
class Tuning:
    """Tuning of a constant-gain filter as the source tabulates it.

    Attributes
    ----------
    alpha : float
        Factor on the gyro noise.
    gyro_sigma_dps : float
        Gyro white noise, deg/s, taken as a density per root hertz.
    beta : float
        Factor on the driving noise of the rate corrections.
    drift_sigma_dps, drift_tau_s : float
        Gauss-Markov gyro drift; the corrections decay with this time.  Infinite: a random walk.
    unit_drift : bool
        True drives the corrections with beta deg/s per root second (the reading under which table 4.2 converges as flown); False
        with beta times the Gauss-Markov density ``sqrt(2 sigma^2 / tau)`` (table 4.3).
    angle_sigma_deg : tuple of float
        Noise of measured roll, pitch, heading, deg.
    period_s : float
        Between updates.
    """

    alpha: float
    gyro_sigma_dps: float
    beta: float
    drift_sigma_dps: float
    drift_tau_s: float
    unit_drift: bool
    angle_sigma_deg: tuple[float, float, float]
    period_s: float

    @property
    def decay(self) -> float:
        """Decay rate of the corrections, 1/s."""
        return 0.0 if np.isinf(self.drift_tau_s) else 1.0 / self.drift_tau_s

    @property
    def drift_psd(self) -> float:
        """Driving noise of a correction, (rad/s)^2/s."""
        density = 1.0 if self.unit_drift else self.drift_sigma_dps * np.sqrt(2.0 * self.decay)
        return float((self.beta * density * DEGREE) ** 2)

    @property
    def angle_psd(self) -> float:
        """Driving noise of an angle, rad^2/s."""
        return (self.alpha * self.gyro_sigma_dps * DEGREE) ** 2


GPS_FLOWN = Tuning(0.2, 0.05, 2.0e-4, 0.05, 1000.0, True, (0.25, 0.25, 0.25), 0.5)
"""Table 4.2: GPS attitude at 2 Hz, as flown."""
SLOW_POLES = Tuning(10.0, 0.05, 1.0, 0.05, 1000.0, False, (0.25, 0.25, 0.25), 0.5)
FAST_POLES = Tuning(10.0, 0.05, 10.0, 0.05, 1000.0, False, (0.25, 0.25, 0.25), 0.5)
"""Table 4.3: the pole study."""
ACCEL_MAG = Tuning(10.0, 0.05, 1.0e-5, 0.05, 300.0, False, (0.06, 0.06, 0.80), 0.5)
"""Table 4.4: accelerometers and magnetometer; the corrections stand still in effect."""


def axis_model(tuning: Tuning, sigma_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """One axis, state (angle, correction): Phi, Qd, H, R over one period, rad and rad/s."""
    F = np.array([[0.0, 1.0], [0.0, -tuning.decay]])
    Phi, Qd = kalman.van_loan(F, np.diag([tuning.angle_psd, tuning.drift_psd]), tuning.period_s)
    return Phi, Qd, np.array([[1.0, 0.0]]), np.array([[(sigma_deg * DEGREE) ** 2]])


@lru_cache(maxsize=64)
def axis_gains(tuning: Tuning, sigma_deg: float) -> tuple[float, float]:
    """Steady gains of one axis: on the angle (dimensionless) and on the correction (1/s)."""
    K, _ = kalman.steady_state_gain(*axis_model(tuning, sigma_deg))
    return float(K[0, 0]), float(K[1, 0])


def quaternion_model(rate_b: np.ndarray, tuning: Tuning) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Six states, small rotation in b then corrections: Phi, Qd, H, R over one period at a body rate (3,), rad/s."""
    F = np.zeros((6, 6))
    F[:3, :3], F[:3, 3:], F[3:, 3:] = -skew(rate_b), np.eye(3), -tuning.decay * np.eye(3)
    return _sampled(F, np.eye(3), tuning)


def euler_model(roll: float, pitch: float, tuning: Tuning) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Six states, (roll, pitch, heading) then corrections: Phi, Qd, H, R over one period at a fixed attitude, rad.

    Raises
    ------
    SettingsError
        Within a degree of vertical, where Euler rates do not exist.
    """
    if abs(abs(pitch) - 0.5 * np.pi) < DEGREE:
        raise SettingsError("Euler-angle gains do not exist with the nose straight up or down; use the quaternion filter.")
    f = euler_rate_matrix(roll, pitch)
    F = np.zeros((6, 6))
    F[:3, 3:], F[3:, 3:] = f, -tuning.decay * np.eye(3)
    return _sampled(F, f, tuning)


def _sampled(F: np.ndarray, noise_map: np.ndarray, tuning: Tuning) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    GQG = np.zeros((6, 6))
    GQG[:3, :3] = tuning.angle_psd * noise_map @ noise_map.T
    GQG[3:, 3:] = tuning.drift_psd * np.eye(3)
    Phi, Qd = kalman.van_loan(F, GQG, tuning.period_s)
    return Phi, Qd, np.eye(3, 6), np.diag((np.array(tuning.angle_sigma_deg) * DEGREE) ** 2)


def scheduled_euler_gain(roll: float, pitch: float, tuning: Tuning) -> np.ndarray:
    """Euler gain (6, 3) in closed form: ``L_a I`` on the angles, ``L_b f'`` on the corrections (exact for equal axes at zero pitch).

    At zero pitch the correction rows are p: (1, 0, 0), q: (0, cos roll, sin roll), r: (0, -sin roll, cos roll), times L_b.  Off zero pitch
    the inverse of f takes the place of its transpose, which is its inverse at zero pitch: then angle errors reach the axis that made them.
    """
    on_angle, on_rate = np.array([axis_gains(tuning, sigma) for sigma in tuning.angle_sigma_deg]).T
    return np.vstack((np.diag(on_angle), body_rate_matrix(roll, pitch) * on_rate))


def constant_gain(tuning: Tuning) -> np.ndarray:
    """Quaternion-form gain (6, 3) on the small rotation measured in b: diagonal in both halves, at every attitude."""
    on_angle, on_rate = np.array([axis_gains(tuning, sigma) for sigma in tuning.angle_sigma_deg]).T
    return np.vstack((np.diag(on_angle), np.diag(on_rate)))


def closed_loop_times(tuning: Tuning, sigma_deg: float) -> np.ndarray:
    """Time constants, s, ascending, of one axis of the filter running with its steady gain."""
    Phi, Qd, H, R = axis_model(tuning, sigma_deg)
    K, _ = kalman.steady_state_gain(Phi, Qd, H, R)
    return np.sort(-tuning.period_s / np.log(np.abs(np.linalg.eigvals((np.eye(2) - K @ H) @ Phi))))
