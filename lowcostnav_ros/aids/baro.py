"""Barometer: static pressure as a height, with a slow difference that is estimated."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import Pressure
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.views import Place
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Host, Innovation, Sensor, SensorSettings, each
from lowcostnav_ros.estimation.error_state import Block, Kind, random_walk
from lowcostnav_ros.physics.atmosphere import pressure_altitude


@dataclass(frozen=True)
class BaroSettings(SensorSettings):
    """Static pressure as a height reference."""

    enabled: bool = setting(True, "Use static pressure for height.")
    sigma_m: float = setting(2.0, "White noise of the pressure altitude, at least.", unit="m", minimum=0.01, maximum=1e3, within=3)
    stated_scale: float = setting(0.0, "Factor on the sigma that a message states; 0 ignores it.", minimum=0.0, maximum=100.0)
    bias_m: float = setting(150.0, "Sigma of pressure altitude minus ellipsoid height before GPS.", unit="m", minimum=0.0)
    walk_m_rts: float = setting(1.6, "Growth of that difference (23 m in 400 s).", unit="m/sqrt(s)", minimum=0.0, maximum=100.0, within=3)
    period_s: float = setting(0.5, "Use at most one measurement in this time.", unit="s", minimum=0.0, maximum=60.0)
    gate: GateSettings = group(GateSettings)


class BaroAid(Aid):
    """Pressure altitude against height plus the estimated difference between the two, m."""

    name, labels = "baro_height", ("height_m",)
    measurement, topic, views = Pressure, "air/static_pressure", (Place,)

    def blocks(self) -> list[Block]:
        """Pressure altitude minus height, m."""
        name = self.own("baro_bias")
        return [random_walk(name, [f"{name}_m"], Kind.HELD, self.settings.bias_m, self.settings.walk_m_rts)]

    def innovation(self, measurement: Pressure, host: Host) -> Innovation | str:
        """y = h_pressure - (h + b); height is minus the down error, so H = -1 on down and 1 on the bias."""
        altitude = float(pressure_altitude(measurement.pressure_pa))
        bias, core = host.layout[self.own("baro_bias")].start, host.core
        H = np.zeros((1, host.layout.size))
        H[0, 2], H[0, bias] = -1.0, 1.0
        y = core.height_residual(altitude, core.estimate[bias])
        return Innovation(np.array([y]), H, np.array([[self._variance(measurement, altitude)]]), np.array([altitude]))

    def _variance(self, measurement: Pressure, altitude: float) -> float:
        smallest = self.settings.sigma_m**2
        if self.settings.stated_scale == 0.0:
            return smallest
        slope = float(pressure_altitude(measurement.pressure_pa + 1.0)) - altitude
        return max(slope * slope * measurement.variance * self.settings.stated_scale**2, smallest)


BARO = AIDS.register("baro", Sensor("baro", BaroSettings, each(BaroAid)), __name__)
