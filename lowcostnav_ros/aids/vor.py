"""VOR receiver: radials, for every navigator that keeps a position.

The error of a radial has three parts, modelled as what they are:

- what is left of the station's *alignment* lasts: a state per station (Gauss-Markov, long), estimated while GPS is good;
- *course bends* change along the way: noise with a correlation distance, of which radials in quick succession repeat one sample.  No state
  could follow them, so their variance is multiplied by the factor that leaves the information such radials hold;
- *receiver noise* is white.

While GPS is good a radial moves the station's own state and nothing else: GPS observes the position better.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.aids._station import StationAid
from lowcostnav_ros.base.measurements import VorBearing
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import DEGREE, NAUTICAL_MILE
from lowcostnav_ros.estimation.aiding import GateSettings, Host, Innovation, Sensor, SensorSettings, each
from lowcostnav_ros.estimation.error_state import SLOWEST_MPS, Block, Kind, gauss_markov
from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.physics.stochastic import correlation_factor
from lowcostnav_ros.radionav.vor import BearingView, bearing_view, out_of_service


@dataclass(frozen=True)
class VorSettings(SensorSettings):
    """VOR radials; the default parts of the error add up to 1 degree (the usual range is 1 to 5)."""

    enabled: bool = setting(False, "Use VOR radials for position.")
    stations_file: str = setting("", "Station table; empty takes that of the DME, where there is one.")
    bias_deg: float = setting(0.6, "Error left of a station's alignment, sigma; 0: no states.", unit="deg", minimum=0.0, maximum=20.0)
    bias_tau_s: float = setting(3600.0, "Correlation time of that error.", unit="s", minimum=10.0)
    bend_deg: float = setting(0.75, "Course bends, sigma.", unit="deg", minimum=0.0, maximum=20.0)
    bend_distance_nm: float = setting(2.0, "Distance flown over which bends stay correlated.", unit="NM", minimum=0.01, maximum=100.0)
    noise_deg: float = setting(0.3, "White noise of the receiver, sigma.", unit="deg", minimum=0.001, maximum=20.0)
    slots: int = setting(4, "Stations whose alignment error is held at one time.", minimum=1, maximum=16)
    period_s: float = setting(5.0, "Use at most one radial of a station in this time.", unit="s", minimum=0.0, maximum=600.0)
    timeout_s: float = setting(30.0, "Without a radial for this long a station is named no more.", unit="s", minimum=1.0, maximum=600.0)
    gate: GateSettings = group(GateSettings, recovery_s=60.0)  # radials are used seconds apart: recovery takes many of them


class VorAid(StationAid):
    """One radial at a time; it needs no height and never moves it by itself."""

    name, labels = "vor", ("radial_rad",)
    measurement, topic = VorBearing, "vor/bearing"
    bias_block = "vor_bias"
    teaches = (bias_block,)
    thins_itself = True

    @property
    def bias_sigma(self) -> float:
        """Sigma of a station's alignment error, rad."""
        return self.settings.bias_deg * DEGREE

    def blocks(self) -> list[Block]:
        """States of the alignment errors, rad; none when the alignment counts as perfect."""
        if self.settings.bias_deg == 0.0:
            return []
        name = self.own(self.bias_block)
        labels = [f"{name}_{i + 1}_rad" for i in range(self.settings.slots)]
        return [gauss_markov(name, labels, Kind.FREE, self.bias_sigma, self.settings.bias_tau_s)]

    def due(self, measurement: VorBearing) -> bool:
        """Whether the last radial used of this station is a period ago; its errors are slow, so that more would not add information."""
        return not 0.0 <= self.since_station_s(measurement) < self.settings.period_s - 1e-3

    def free(self, stamp_ns: int, host: Host) -> np.ndarray | None:
        """The station's own state while GPS is good, else what a bearing may move."""
        taught = super().free(stamp_ns, host)
        return host.core.ranging if taught is None else taught

    def refusal(self, measurement: VorBearing, host: Host) -> str:
        """Why a radial cannot be used at all; empty when it can."""
        lat, lon, height = host.core.nav[:3]
        return super().refusal(measurement, host) or out_of_service(self.stations[measurement.station], lat, lon, height)

    def innovation(self, measurement: VorBearing, host: Host) -> Innovation | str:
        """y = radial + declination - (bearing + alignment error), wrapped; H is the gradient of the bearing and 1 on the error."""
        reason = self.refusal(measurement, host)
        if reason:
            return reason
        station, core = self.stations[measurement.station], host.core
        seen = bearing_view(station, *core.nav[:3])
        y = measurement.bearing_rad + station.declination - seen.bearing
        H = np.zeros((1, host.layout.size))
        H[0, 0:3] = seen.gradient_n
        index = self.slots.index(measurement.station)
        if index is not None:
            H[0, index] = 1.0
            y -= core.estimate[index]
        variance = self._variance(measurement, core.speed_mps, lasting=index is None) + _curvature(host.P, seen)
        free = self.free(measurement.stamp_ns, host)
        return Innovation(np.array([wrap(y)]), H, np.array([[variance]]), np.array([measurement.bearing_rad]), free)

    def _variance(self, measurement: VorBearing, speed_mps: float, lasting: bool) -> float:
        """Variance of a radial, rad^2, without what a state holds; ``lasting``: no state holds the alignment error.

        What the receiver states beyond the three parts lasts as bends do: taken for white it would average out.
        """
        own, since_s = self.settings, self.since_station_s(measurement)
        bias, bend, noise = ((x * DEGREE) ** 2 for x in (own.bias_deg, own.bend_deg, own.noise_deg))
        bend = max(bend, measurement.variance - bias - noise)
        tau_s = own.bend_distance_nm * NAUTICAL_MILE / max(speed_mps, SLOWEST_MPS)
        total = noise + bend * correlation_factor(since_s, tau_s)
        repeated = 1.0 if self._rows is not None else correlation_factor(since_s, own.bias_tau_s)
        return total + bias * repeated if lasting else total


def _curvature(P: np.ndarray, seen: BearingView) -> float:
    """Variance, rad^2, of the bearing's second-order term -(along across)/d^2 where position is known poorly against the distance."""
    across = seen.gradient_n[0:2] * seen.distance_m
    along = np.array([across[1], -across[0]])
    S = P[0:2, 0:2]
    product = float((along @ S @ along) * (across @ S @ across) + (along @ S @ across) ** 2)
    return product / max(seen.distance_m, 1.0) ** 4


VOR = AIDS.register("vor", Sensor("vor", VorSettings, each(VorAid), quiet=True), __name__)
