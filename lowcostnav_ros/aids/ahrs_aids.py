"""Aids of the attitude reference that no other navigator has: airflow without GPS velocity, and steady flight.

GPS velocity and magnetic heading are the same aids as in GPS/INS.  All of them see the attitude through the velocity the inertial
core carries: between two measured velocities the core integrates ``C_nb f_b + g``, so the error of that integral, ``-[integral
of f_n x] phi``, is in the covariance between velocity and attitude.  That is the exact form of comparing the change of velocity with
the integral of specific force, in turns as well, and successive differences share no noise they would have to account for.
"""

from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.aids.ins_gps_aids import floored
from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity, Attitude, Measurement
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT, VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision, Innovation
from lowcostnav_ros.navigators.ahrs.settings import AirflowSettings, GpsAttitudeSettings, LevelSettings
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, quat_to_dcm, rotvec_from_quat, skew

if TYPE_CHECKING:
    from lowcostnav_ros.navigators.ahrs.base import Ahrs

SMALLEST_SPEED = 1.0
VANE_SHARE = 0.5 * DEGREE
"""Smallest error of a vane believed, rad: position error and mounting."""


class AirflowAid(Aid):
    """Velocity through the air: its length is the true airspeed, its direction sideslip and incidence.

    While GPS velocity is good it teaches wind, airspeed error and flow angles and moves nothing else; without GPS it holds velocity
    and thereby attitude, and its innovation is limited, not rejected: it is the last there is.
    """

    def __init__(self, settings: AirflowSettings) -> None:
        super().__init__("airflow", ("tas_mps", "lateral_mps", "vertical_mps"), settings.gate)
        self.settings = settings

    def control(self, stamp_ns: int, test_ratio: float, host: "Ahrs") -> tuple[Decision, str]:
        """Limit instead of reject when nothing else holds the velocity."""
        self.limit_instead_of_reject = not host.gps_is_fresh(stamp_ns)
        return super().control(stamp_ns, test_ratio, host)

    def innovation(self, measurement: AirVelocity, host: "Ahrs") -> Innovation | str:
        """Rows airspeed, lateral, vertical against ``u = C' (v - w)``.

        ``TAS = |u| + b``;  lateral ``u_y``, vertical ``u_z``: a vane's measurement, else TAS times the estimated flow angle.
        Jacobian of u: ``C'`` on velocity, ``-C'`` on wind, ``C' [(v - w) x]`` on attitude.
        """
        tas = float(np.linalg.norm(measurement.vel_b))
        if not tas >= self.settings.minimum_mps:
            return "below minimum airspeed"
        air_n = host.core.nav[3:6] - host.wind_n()
        speed = float(np.linalg.norm(air_n))
        if speed < SMALLEST_SPEED:
            return "predicted airspeed is zero"
        H, predicted = self._rows(host, air_n, speed, tas)
        measured, sigma = self._measured(measurement, H, host, tas)
        free = host.airflow_states if host.gps_is_fresh(measurement.stamp_ns) else None
        return Innovation(measured - predicted, H, np.diag(sigma**2), measured, free)

    def _rows(self, host: "Ahrs", air_n: np.ndarray, speed: float, tas: float) -> tuple[np.ndarray, np.ndarray]:
        layout = host.layout
        C = quat_to_dcm(host.core.nav[6:10])
        H = np.zeros((3, layout.size))
        to_u = np.vstack((air_n / speed, C.T[1:]))
        H[:, VEL] = to_u
        H[1:, ATT] = (C.T @ skew(air_n))[1:]
        H[:, layout["wind"]], H[:, layout["updraught"]] = -to_u[:, :2], -to_u[:, 2:]
        bias = layout["airspeed_bias"].start
        H[0, bias] = 1.0
        return H, np.array([speed + host.core.estimate[bias], *(C.T @ air_n)[1:]])

    def _measured(self, measurement: AirVelocity, H: np.ndarray, host: "Ahrs", tas: float) -> tuple[np.ndarray, np.ndarray]:
        """What each row saw and its white sigma; an unmeasured direction is the flow angle's estimate, a state of its own."""
        settings, layout = self.settings, host.layout
        stated = measurement.cov_b[0, 0] - settings.bias_mps**2  # the message states the whole error; its slow part is a state here
        measured, sigma = np.empty(3), np.full(3, settings.noise_mps)
        measured[0], sigma[0] = tas, np.sqrt(max(settings.noise_mps**2, stated))
        for axis, name, usual in ((1, "sideslip", 0.0), (2, "incidence", settings.incidence_deg * DEGREE)):
            variance = measurement.cov_b[axis, axis]
            if variance < UNKNOWN_VARIANCE:
                measured[axis] = measurement.vel_b[axis]
                sigma[axis] = np.sqrt(settings.noise_mps**2 + max(variance, (tas * VANE_SHARE) ** 2))
            else:
                state = layout[name].start
                H[axis, state] = -tas
                measured[axis] = tas * (usual + host.core.estimate[state])
        return measured, sigma


class SteadyFlightAid(Aid):
    """Plain levelling: over a span of steady flight the velocity has not changed, so the specific force was minus gravity."""

    def __init__(self, settings: LevelSettings) -> None:
        super().__init__("accelerometer_level", ("north_mps", "east_mps"), settings.gate)
        self.settings = settings

    def innovation(self, measurement: Measurement, host: "Ahrs") -> Innovation | str:
        """``y = 0 - v`` of a velocity that was set to zero at the beginning of the span; sigma is acceleration times span."""
        if not host.switch.steady_over(host.level_since_ns):
            return "manoeuvring"
        span_s = 1e-9 * (measurement.stamp_ns - host.level_since_ns)
        H = np.zeros((2, host.layout.size))
        H[0, VEL.start], H[1, VEL.start + 1] = 1.0, 1.0
        R = np.eye(2) * (self.settings.acceleration_mps2 * span_s) ** 2
        return Innovation(-host.core.nav[3:5], H, R, host.core.nav[3:5] / span_s)


class GpsAttitudeAid(Aid):
    """Attitude from several GPS antennas against the estimate, as the small rotation between the two, rad in n."""

    def __init__(self, settings: GpsAttitudeSettings) -> None:
        super().__init__("gps_attitude", ("north_rad", "east_rad", "down_rad"), settings.gate)
        self.settings = settings

    def innovation(self, measurement: Attitude, host: "Ahrs") -> Innovation | str:
        """``y = log(q_gps q_est*)`` = phi_n, so H is I on attitude."""
        H = np.zeros((3, host.layout.size))
        H[:, ATT] = np.eye(3)
        y = rotvec_from_quat(quat_multiply(measurement.q_nb, quat_conjugate(host.core.nav[6:10])))
        return Innovation(y, H, floored(measurement.cov_att, self.settings.sigma_scale, self.settings.floor_deg * DEGREE), y.copy())

    def recover(self, measurement: Attitude, innovation: Innovation, host: "Ahrs") -> None:
        """Take the attitude from GPS afresh: it does not drift, so a long disagreement is ours."""
        kalman.reset_block(host.P, ATT, floored(measurement.cov_att, self.settings.sigma_scale, self.settings.floor_deg * DEGREE))
        dx = np.zeros(host.layout.size)
        dx[ATT] = rotvec_from_quat(quat_multiply(measurement.q_nb, quat_conjugate(host.core.nav[6:10])))
        host.correct(dx)
