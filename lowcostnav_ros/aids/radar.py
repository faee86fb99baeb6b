"""Ground radar: horizontal position fixes sent up a data link (Gebre-Egziabher 2004, sections 6.2 and 8.2).

They come as any navigator's fixes do and are off until their topic is set.  A stamp is when the fix held; what comes later than the
fusion horizon allows is dropped by name, so the ground carries a fix on to the time of sending.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.views import Place
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Host, Innovation, Sensor, SensorSettings, each, floored
from lowcostnav_ros.physics.earth import difference_n


@dataclass(frozen=True)
class RadarSettings(SensorSettings):
    """Position fixes of a ground radar, sent up by data link."""

    topic: str = setting("", "Topic of the fixes (NavSatFix), such as radar/fix; empty for none.")
    floor_m: float = setting(200.0, "Smallest horizontal sigma a fix is given.", unit="m", minimum=1.0, maximum=1e5)
    gate: GateSettings = group(GateSettings, recovery_s=60.0)  # a radar sees the aircraft every few seconds


class RadarAid(Aid):
    """Horizontal position as a ground radar saw it, m; never height."""

    name, labels = "radar_fix", ("north_m", "east_m")
    measurement, topic, views = NavSolution, "radar/fix", (Place,)

    def innovation(self, measurement: NavSolution, host: Host) -> Innovation | str:
        """y = p_radar - p, horizontally; H = I on position north and east."""
        if measurement.lat is None or measurement.lon is None or measurement.cov_pos is None:
            return "position or its covariance is missing"
        nav = host.core.nav
        y = difference_n(measurement.lat, measurement.lon, nav[2], nav[0], nav[1], nav[2])[0:2]
        H = np.zeros((2, host.layout.size))
        H[0, 0] = H[1, 1] = 1.0
        R = floored(measurement.cov_pos[0:2, 0:2], 1.0, self.settings.floor_m)
        return Innovation(y, H, R, y.copy(), host.core.ranging)

    def words(self, now_ns: int) -> str:
        """A fix used lately."""
        return self.ago("radar fix", now_ns)


RADAR = AIDS.register("radar", Sensor("radar", RadarSettings, each(RadarAid)), __name__)
