"""Attitude from several GPS antennas: free of drift, and what teaches the gyro biases."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import Attitude
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.views import Attitude as AttitudeView
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Host, Innovation, Sensor, SensorSettings, each, floored, reset_to
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, rotvec_from_quat


@dataclass(frozen=True)
class GpsAttitudeSettings(SensorSettings):
    """Attitude from several GPS antennas: free of drift, and what teaches the gyro biases."""

    enabled: bool = setting(True, "Use GPS attitude; an attitude filter made for it always does.")
    sigma_scale: float = setting(1.0, "Factor on the receiver's stated sigma.", minimum=0.1, maximum=100.0)
    floor_deg: float = setting(0.05, "Smallest sigma used.", unit="deg", minimum=0.001, maximum=10.0)
    period_s: float = setting(0.0, "Use at most one attitude in this time; 0 uses all.", unit="s", minimum=0.0, maximum=60.0)
    timeout_s: float = setting(2.5, "No accepted attitude for this long is an outage.", unit="s", minimum=0.1, maximum=60.0)
    gate: GateSettings = group(GateSettings)


class GpsAttitudeAid(Aid):
    """Attitude from several GPS antennas against the estimate, as the small rotation between the two, rad in n."""

    name, labels = "gps_attitude", ("north_rad", "east_rad", "down_rad")
    measurement, topic, views = Attitude, "gps/attitude", (AttitudeView,)

    def seen(self, measurement: Attitude, host: Host) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3,) from the estimate to what was measured, ``log(q_gps q_est*)`` = phi_n, and its covariance (3, 3), rad^2."""
        phi_n = rotvec_from_quat(quat_multiply(measurement.q_nb, quat_conjugate(host.core.nav[6:10])))
        return phi_n, floored(measurement.cov_att, self.settings.sigma_scale, self.settings.floor_deg * DEGREE)

    def innovation(self, measurement: Attitude, host: Host) -> Innovation | str:
        """``y = phi_n``, so H is I on attitude."""
        H = np.zeros((3, host.layout.size))
        H[:, host.core.attitude_rows] = np.eye(3)
        y, R = self.seen(measurement, host)
        return Innovation(y, H, R, y.copy())

    def recover(self, measurement: Attitude, innovation: Innovation, host: Host) -> None:
        """Reset the attitude to that of GPS: it does not drift, so after a long disagreement the estimate is wrong."""
        reset_to(host, host.core.attitude_rows, *self.seen(measurement, host))


GPS_ATTITUDE = AIDS.register("gps_attitude", Sensor("gps_attitude", GpsAttitudeSettings, each(GpsAttitudeAid), quiet=True), __name__)
