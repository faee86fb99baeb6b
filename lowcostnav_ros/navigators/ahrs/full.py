"""The full attitude filter: the covariance of the whole error state is carried, and every aid is weighed by it.

Accelerometers show the vertical only once the acceleration is known.  It comes, in this order, from GPS velocity, from the velocity
through the air, or it is taken to be zero while a manoeuvre switch sees steady flight.  The error state is that of the inertial
core with gyro and accelerometer biases, a slow magnetic heading error, wind and airflow; velocity is carried because it links
attitude to acceleration exactly.  See :mod:`lowcostnav_ros.aids.ahrs_aids` for the measurements.
"""

import numpy as np

from lowcostnav_ros.aids.ahrs_aids import AirflowAid, GpsAttitudeAid, SteadyFlightAid
from lowcostnav_ros.aids.ins_gps_aids import VelocityAid
from lowcostnav_ros.base.measurements import AirVelocity, Attitude, GpsVelocity, ImuBlock, MagneticField, Measurement
from lowcostnav_ros.cores.inertial import VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Block
from lowcostnav_ros.navigators.ahrs.base import AIR, ATTITUDE, FIX, IMU, LEVEL_TIMEOUT_NS, MAG, VELOCITY, Ahrs
from lowcostnav_ros.navigators.ahrs.settings import AhrsSettings, chosen_blocks
from lowcostnav_ros.navigators.ahrs.switch import ManoeuvreSwitch
from lowcostnav_ros.physics.rotation import quat_to_dcm
from lowcostnav_ros.starts.attitude_core import restart_velocity_from_air


class FullAhrs(Ahrs):
    """Attitude and heading reference with a full covariance; see the module head."""

    def __init__(self, settings: AhrsSettings) -> None:
        self.inputs = {IMU: True, MAG: False, VELOCITY: False, FIX: False, AIR: False}
        if settings.gps_attitude.enabled:
            self.inputs[ATTITUDE] = False
        super().__init__(settings)
        self.velocity_aid, self.attitude_aid = VelocityAid(settings.gps), GpsAttitudeAid(settings.gps_attitude)
        self.airflow_aid, self.steady_aid = AirflowAid(settings.airflow), SteadyFlightAid(settings.level)
        optional = (
            (settings.gps_attitude.enabled, self.attitude_aid),
            (settings.airflow.enabled, self.airflow_aid),
            (settings.magnetic.enabled, self.magnetic_aid),
        )
        self.aids = [self.velocity_aid, self.steady_aid, *(aid for enabled, aid in optional if enabled)]
        self.airflow_states = self.layout.mask("wind", "updraught", "airspeed_bias", "sideslip", "incidence")
        self.switch = ManoeuvreSwitch(settings.level)

    @staticmethod
    def _blocks(settings: AhrsSettings) -> list[Block]:
        return chosen_blocks(settings)

    def wind_n(self) -> np.ndarray:
        """Estimated wind (3,), m/s, NED."""
        estimate = self.core.estimate
        return np.concatenate((estimate[self.layout["wind"]], estimate[self.layout["updraught"]]))

    def gps_is_fresh(self, stamp_ns: int) -> bool:
        """Whether a GPS velocity was accepted within the time-out."""
        return stamp_ns - self._gps_ns <= 1e9 * self.settings.gps.timeout_s

    def _begun(self, t_ns: int) -> None:
        self.switch.restart(t_ns)

    def _follow(self, block: ImuBlock, start: int, following: int) -> None:
        self.switch.follow(block, start, following)

    def _keep(self, now: int) -> None:
        """Judge the motion; level by steady flight when nothing measures velocity."""
        self.switch.decide(quat_to_dcm(self.core.nav[6:10]), self.core.errors()[1])
        if self.gps_is_fresh(now) or now - self._air_ns <= 1e9 * self.settings.airflow.timeout_s:
            self.level_since_ns = None
        elif self.level_since_ns is None:
            self._hold_velocity(now)
        elif now - self.level_since_ns >= 1e9 * self.settings.level.period_s:
            if self.use_aid(self.steady_aid, Measurement(now, IMU)):
                self._steady_ns = now
            self._hold_velocity(now)

    def _aid(self, item: Measurement) -> None:
        if isinstance(item, GpsVelocity):
            self._aid_velocity(item)
        elif isinstance(item, AirVelocity):
            self._aid_airflow(item)
        elif isinstance(item, MagneticField) and self.settings.magnetic.enabled:
            self._aid_magnetic(item)
        elif isinstance(item, Attitude):
            self.core.settle()
            if self.use_aid(self.attitude_aid, item):
                self._attitude_ns = item.stamp_ns

    def _aid_velocity(self, item: GpsVelocity) -> None:
        self.core.settle()
        if self.level_since_ns is not None:
            self.core.nav[VEL] = item.vel_n  # the velocity counted from zero means nothing beside a measured one
            kalman.reset_block(self.P, VEL, item.cov_n + np.eye(3) * self.settings.gps.velocity_floor_mps**2)
            self.level_since_ns = None
        if self.use_aid(self.velocity_aid, item):
            self._gps_ns = item.stamp_ns

    def _aid_airflow(self, item: AirVelocity) -> None:
        air = self.settings.airflow
        if not air.enabled or item.stamp_ns - self._tried_air_ns < 1e9 * air.period_s - 1e6:
            return
        self._tried_air_ns = item.stamp_ns
        self.core.settle()
        if self.level_since_ns is not None and np.linalg.norm(item.vel_b) >= air.minimum_mps:
            restart_velocity_from_air(self.core, item, self.wind_n())
            self.level_since_ns = None
        if self.use_aid(self.airflow_aid, item):
            self._air_ns = item.stamp_ns

    def _mode(self, now: int, has_heading: bool) -> tuple[str, str]:
        heading = "" if has_heading else ", no magnetic heading"
        if self.gps_is_fresh(now):
            return "calibrating", "GPS velocity gives the acceleration" + heading
        if now - self._attitude_ns <= 1e9 * self.settings.gps_attitude.timeout_s:
            return "calibrating", "no GPS velocity, GPS attitude holds the attitude"
        if now - self._air_ns <= 1e9 * self.settings.airflow.timeout_s:
            return "coasting", "no GPS velocity, airspeed gives the acceleration" + heading
        if now - self._steady_ns <= LEVEL_TIMEOUT_NS:
            return "coasting", "no GPS velocity or airspeed, levelled in steady flight" + heading
        if has_heading:
            return "coasting", "magnetic heading only: roll and pitch run on the gyros while manoeuvring"
        return "gyro_only", "manoeuvring without GPS velocity, airspeed and magnetic heading"
