"""DME receiver: slant ranges, for every navigator that keeps a position."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.aids._station import StationAid
from lowcostnav_ros.base.measurements import SlantRange
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.estimation.aiding import GateSettings, Host, Innovation, Sensor, SensorSettings, each
from lowcostnav_ros.estimation.error_state import SLOWEST_MPS, Block, Kind, along_way
from lowcostnav_ros.physics.stochastic import correlation_factor
from lowcostnav_ros.radionav.geometry import range_and_direction
from lowcostnav_ros.radionav.stations import Station

FAR_BEYOND = 9.0
"""Test ratio (three times the gate in sigmas) above which even the last aid left is rejected, not limited."""


@dataclass(frozen=True)
class DmeSettings(SensorSettings):
    """DME slant ranges."""

    stations_file: str = setting(
        "", "Station table; the file name is resolved where the configuration is read.", shipped="dme_stations_bay_area.csv"
    )
    bias: str = setting("estimate", "Range bias: estimated per station or only considered.", choices=("estimate", "consider"))
    bias_nm: float = setting(0.17, "Range bias of a station, Gauss-Markov sigma.", unit="NM", minimum=0.0, maximum=10.0)
    bias_distance_nm: float = setting(0.5, "Distance flown over which the bias stays correlated.", unit="NM", minimum=0.01, maximum=100.0)
    noise_nm: float = setting(0.004, "White range noise.", unit="NM", minimum=1e-5, maximum=1.0)
    slots: int = setting(4, "Stations whose bias is held at one time.", minimum=1, maximum=16)
    timeout_s: float = setting(60.0, "Without an accepted range for this long DME counts as lost.", unit="s", minimum=1.0, maximum=600.0)
    gate: GateSettings = group(GateSettings, recovery_s=180.0)  # ranges come seconds apart: recovery takes many of them


class DmeAid(StationAid):
    """One slant range at a time, in full geometry; it never moves height where another sensor holds it.

    The variance of a reply is that of its whole error; what the bias model explains of it is not counted twice.  Where the bias is no state
    it is noise, of which replies of one station in quick succession repeat the same draw.
    While DME is all there is, a range outside the gate is limited to the gate rather than rejected, unless it lies far beyond.
    """

    name, labels = "dme", ("slant_range_m",)
    measurement, topic = SlantRange, "dme/range"
    bias_block = "dme_bias"
    last_resort = True

    @property
    def bias_sigma(self) -> float:
        """Sigma of a station's range bias, m."""
        return self.settings.bias_nm * NAUTICAL_MILE

    @property
    def bias_distance_m(self) -> float:
        """Distance flown over which the bias stays correlated, m."""
        return self.settings.bias_distance_nm * NAUTICAL_MILE

    @property
    def noise_m(self) -> float:
        """White range noise, m."""
        return self.settings.noise_nm * NAUTICAL_MILE

    def curvature(self, measurement: SlantRange, host: Host, direction: np.ndarray, range_m: float) -> float:
        """Variance, m^2, of what is not linear in the range."""
        return _curvature(host.P, direction, range_m)

    def answers(self, station: Station) -> bool:
        """Whether a station answers this receiver."""
        return station.has_dme

    def blocks(self) -> list[Block]:
        """Range biases, m; they vary with the distance flown."""
        dme, name = self.settings, self.own(self.bias_block)
        if self.bias_sigma == 0.0:
            return []
        labels = [f"{name}_{i + 1}_m" for i in range(dme.slots)]
        kind = Kind.HELD if dme.bias == "consider" else Kind.FREE
        return [along_way(name, labels, kind, self.bias_sigma, self.bias_distance_m)]

    def is_last(self, stamp_ns: int, test_ratio: float, host: Host) -> bool:
        """Whether DME is all there is, and the range not far beyond the gate."""
        return test_ratio < FAR_BEYOND and not host.gps_good(stamp_ns)

    def refusal(self, measurement: SlantRange, host: Host) -> str:
        """Why a range cannot be used at all; empty when it can."""
        reason = super().refusal(measurement, host)
        if reason:
            return reason
        if not self.answers(self.stations[measurement.station]):
            return f"station has no {self.name.upper()}"
        return "over the station" if self._seen(measurement, host)[0] <= 0.0 else ""

    def innovation(self, measurement: SlantRange, host: Host) -> Innovation | str:
        """y = r - (|p - s| + b); H is the line of sight and 1 on the bias."""
        reason = self.refusal(measurement, host)
        if reason:
            return reason
        predicted, direction = self._seen(measurement, host)
        H = np.zeros((1, host.layout.size))
        H[0, 0:3] = direction
        slow = self.bias_sigma**2
        R = max(measurement.variance - slow, self.noise_m**2) + self.curvature(measurement, host, direction, predicted)
        bias = self.slots.index(measurement.station)
        if bias is None:
            R += slow if self._rows is not None else slow * self._repetition(measurement, host.core.speed_mps)
        else:
            H[0, bias] = 1.0
            predicted += host.core.estimate[bias]
        y = np.array([measurement.range_m - predicted])
        return Innovation(y, H, np.array([[R]]), np.array([measurement.range_m]), self.free(measurement.stamp_ns, host))

    def free(self, stamp_ns: int, host: Host) -> np.ndarray | None:
        """What a range may move; biases that are only considered stay."""
        free: np.ndarray | None = host.core.ranging
        if self.settings.bias != "consider" or self._rows is None:
            return free
        free = np.ones(host.layout.size) if free is None else free.copy()
        free[self._rows] = 0.0
        return free

    def _seen(self, measurement: SlantRange, host: Host) -> tuple[float, np.ndarray]:
        station, nav = self.stations[measurement.station], host.core.nav
        return range_and_direction(nav[0], nav[1], nav[2], station.lat, station.lon, station.height)

    def _repetition(self, measurement: SlantRange, speed_mps: float) -> float:
        """Factor on the variance of a range bias that is not a state, for the time since the station's last reply."""
        tau_s = self.bias_distance_m / max(speed_mps, SLOWEST_MPS)
        return correlation_factor(self.since_station_s(measurement), tau_s)


def _curvature(P: np.ndarray, direction: np.ndarray, range_m: float) -> float:
    """Variance, m^2, that the curvature of the range circle adds when position is known poorly against the range."""
    across = np.array([-direction[1], direction[0]])
    variance = float(across @ P[0:2, 0:2] @ across)
    return 0.75 * (variance / range_m) ** 2  # mean square of d^2 / (2 R) for a Gaussian cross-range error d


DME = AIDS.register("dme", Sensor("dme", DmeSettings, each(DmeAid)), __name__)
