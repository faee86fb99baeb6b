"""Two-way ranges to beacons on the ground: any cheap radio that measures a distance, one beacon at a time.

As a DME, but exact to a metre: the delay of the troposphere, three metres in ten kilometres, is taken off.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.aids.dme import DmeAid
from lowcostnav_ros.base.measurements import SlantRange
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.estimation.aiding import GateSettings, Host, Sensor, SensorSettings, each
from lowcostnav_ros.estimation.error_state import SLOWEST_MPS
from lowcostnav_ros.physics.stochastic import correlation_factor
from lowcostnav_ros.radionav.stations import Station
from lowcostnav_ros.radionav.transmitters import BEACON
from lowcostnav_ros.radionav.troposphere import MODELS, air_of, path_delays
from lowcostnav_ros.radionav.weather import standard_weather


@dataclass(frozen=True)
class RangingSettings(SensorSettings):
    """Two-way ranges to beacons."""

    stations_file: str = setting("", "Station table; the file name is resolved where the configuration is read.")
    bias: str = setting("estimate", "Range bias: estimated per beacon or only considered.", choices=("estimate", "consider"))
    bias_m: float = setting(2.0, "Range bias of a beacon, 1 sigma.", unit="m", minimum=0.0, maximum=1000.0)
    bias_distance_m: float = setting(1e6, "Distance flown over which the bias stays correlated.", unit="m", minimum=1.0, maximum=1e9)
    noise_m: float = setting(1.0, "White range noise, at least.", unit="m", minimum=0.01, maximum=1000.0)
    troposphere: str = setting("hopfield", "Model of the delay.", choices=MODELS)
    slots: int = setting(8, "Beacons whose bias is held at one time.", minimum=1, maximum=32)
    timeout_s: float = setting(
        10.0, "Without an accepted range for this long ranging counts as lost.", unit="s", minimum=0.1, maximum=600.0
    )
    gate: GateSettings = group(GateSettings, recovery_s=30.0)


class RangingAid(DmeAid):
    """One two-way range at a time; an accepted one holds the position."""

    name, is_fix, last_resort = "ranging", True, False
    topic = "ranging/range"
    bias_block = "ranging_bias"

    @property
    def bias_sigma(self) -> float:
        """Sigma of a beacon's bias, m."""
        return float(self.settings.bias_m)

    @property
    def bias_distance_m(self) -> float:
        """Distance flown over which the bias stays correlated, m."""
        return float(self.settings.bias_distance_m)

    @property
    def noise_m(self) -> float:
        """White noise, m."""
        return float(self.settings.noise_m)

    def curvature(self, measurement: SlantRange, host: Host, direction: np.ndarray, range_m: float) -> float:
        """As a DME's, height included: without a barometer few beacons leave it open.

        The error lasts until the line of sight has turned; ranges in quick succession repeat it.  Taken for white, they would teach
        the filter the very direction that they leave open.
        """
        across = float(host.P[0:3, 0:3].trace() - direction @ host.P[0:3, 0:3] @ direction)
        turned_s = range_m / max(host.core.speed_mps, SLOWEST_MPS)
        return 0.75 * (across / range_m) ** 2 * correlation_factor(self.since_station_s(measurement), turned_s)

    def answers(self, station: Station) -> bool:
        """Whether it is a beacon."""
        return station.kind == BEACON

    def _seen(self, measurement: SlantRange, host: Host) -> tuple[float, np.ndarray]:
        range_m, direction = super()._seen(measurement, host)
        station = self.stations[measurement.station]
        air = air_of(station.weather or standard_weather(station.height), station.height)
        delay = path_delays(MODELS.index(self.settings.troposphere), air[None, :], host.core.nav[2], np.array([range_m]))
        return range_m + float(delay[0]) * (range_m > 0.0), direction


RANGING = AIDS.register("ranging", Sensor("ranging", RangingSettings, each(RangingAid)), __name__)
