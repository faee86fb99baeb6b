"""Wind reported from the ground by data link (Gebre-Egziabher 2004, sections 6.2 and 8.2); off until its topic is set.

A stamp is when the value held; what comes later than the fusion horizon allows is dropped by name.
"""

from dataclasses import dataclass

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.cores.views import AirMass
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Host, Innovation, Sensor, SensorSettings, each, floored
from lowcostnav_ros.physics.stochastic import correlation_factor


@dataclass(frozen=True)
class WindUplinkSettings(SensorSettings):
    """Wind reported from the ground by data link."""

    topic: str = setting("", "Topic of the wind (TwistWithCovarianceStamped), such as uplink/wind; empty for none.")
    floor_mps: float = setting(2.0, "Smallest sigma a reported component is given.", unit="m/s", minimum=0.1, maximum=50.0)
    correlation_s: float = setting(600.0, "Time over which the errors of reports stay correlated.", unit="s", minimum=0.0, maximum=1e5)
    gate: GateSettings = group(GateSettings, recovery_s=180.0)


class WindUplinkAid(Aid):
    """Wind as the ground reports it, m/s; many reports repeat one forecast error and add little to the first."""

    name, labels = "wind_uplink", ("wind_north_mps", "wind_east_mps")
    measurement, topic, views = NavSolution, "uplink/wind", (AirMass,)

    def attach(self, host: Host) -> None:
        """See that there is a wind among the states.

        Raises
        ------
        SettingsError
            When the host estimates no wind.
        """
        super().attach(host)
        if not host.core.wind_rows.any():
            raise SettingsError(f"{host.name} cannot take the aid '{self.status.name}': it estimates no wind; use air data beside it.")

    def innovation(self, measurement: NavSolution, host: Host) -> Innovation | str:
        """y = w_reported - w; H sums the states of the wind."""
        if measurement.wind_n is None or measurement.cov_wind is None:
            return "wind or its covariance is missing"
        factor = correlation_factor(self.since_s(measurement), self.settings.correlation_s)
        R = factor * floored(measurement.cov_wind, 1.0, self.settings.floor_mps)
        return Innovation(measurement.wind_n - host.core.wind_n(), host.core.wind_rows, R, measurement.wind_n)

    def words(self, now_ns: int) -> str:
        """A report used lately."""
        return self.ago("wind from the ground", now_ns)


WIND_UPLINK = AIDS.register("wind_uplink", Sensor("wind_uplink", WindUplinkSettings, each(WindUplinkAid)), __name__)
