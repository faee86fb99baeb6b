"""Wheels of a road vehicle: no velocity sideways or up in its own axes."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.views import Attitude, Velocity
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Host, Innovation, Sensor, SensorSettings, each
from lowcostnav_ros.physics.rotation import skew


@dataclass(frozen=True)
class WheelSettings(SensorSettings):
    """Motion constraint of a road vehicle: no velocity sideways or up in its own axes."""

    enabled: bool = setting(False, "The vehicle rolls on wheels.")
    sigma_mps: float = setting(0.2, "Sigma of the sideways and vertical velocity.", unit="m/s", minimum=1e-3, maximum=10.0)
    period_s: float = setting(0.2, "Apply once in this time.", unit="s", minimum=0.01, maximum=60.0)
    minimum_mps: float = setting(1.0, "Applied above this speed only.", unit="m/s", minimum=0.0, maximum=100.0)
    gate: GateSettings = group(GateSettings)


class WheelAid(Aid):
    """Road vehicle: velocity in its own axes has no sideways and no vertical part."""

    name, labels = "wheels", ("lateral_mps", "vertical_mps")
    views = (Velocity, Attitude)

    def innovation(self, measurement: Measurement, host: Host) -> Innovation | str:
        """y = 0 - (C' v)_{y,z} with the attitude column C'[v x]."""
        core = host.core
        vel_n = core.nav[3:6]
        if float(np.linalg.norm(vel_n)) < self.settings.minimum_mps:
            return "below minimum speed"
        C = core.C_nb()
        H = np.zeros((2, host.layout.size))
        H[:, core.velocity_rows], H[:, core.attitude_rows] = C.T[1:], (C.T @ skew(vel_n))[1:]
        return Innovation(-(C.T @ vel_n)[1:], H, np.eye(2) * self.settings.sigma_mps**2, np.zeros(2))


WHEELS = AIDS.register("wheels", Sensor("wheels", WheelSettings, each(WheelAid)), __name__)
