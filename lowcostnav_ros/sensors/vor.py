"""VOR simulator: radials as one or more navigation receivers read them, tuned to stations of the table.

``radial = true bearing - declination of the station + alignment error + course bends + white noise``.  The three errors of the default add
up to the 1 degree of Gebre-Egziabher (2004), table of sensor errors (VOR bearing 1 deg, range 1 to 5 deg); how they share it is an
assumption: a constant left over from the station's alignment, bends from what stands around it (Gauss-Markov over the *distance* flown),
receiver noise.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import VorBearing
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.radionav.stations import BEARING, Station, StationTable
from lowcostnav_ros.radionav.vor import bearing_view, nearest_vors, out_of_service, radial_of
from lowcostnav_ros.sensors.reception import ReceiverSettings, Reception
from lowcostnav_ros.sensors.registry import simulator
from lowcostnav_ros.sensors.sampling import SampleClock
from lowcostnav_ros.sensors.station_drift import DistanceFlown, StationDrift


@dataclass(frozen=True)
class VorSimulatorSettings(ReceiverSettings):
    """Settings of the VOR simulator."""

    receiver = "VOR"
    rate_hz: float = setting(1.0, "Output rate of each receiver.", unit="Hz", minimum=0.01, maximum=20.0)
    receivers: int = setting(2, "Receivers aboard, each tuned to one station at a time.", minimum=1, maximum=4)
    stations_file: str = setting("dme_stations_bay_area.csv", "Station table in the config directory, or a path.")
    stations: str = setting("", "Idents to tune in turn, separated by commas; empty takes the nearest on the way.")
    dwell_s: float = setting(60.0, "A receiver is retuned after this time.", unit="s", minimum=1.0)
    settle_s: float = setting(3.0, "Time without a bearing after a change of station.", unit="s", minimum=0.0)
    bias_deg: float = setting(0.6, "Constant error of each station (alignment), 1 sigma.", unit="deg", minimum=0.0, maximum=10.0)
    bend_deg: float = setting(0.75, "Course bends of each station, 1 sigma.", unit="deg", minimum=0.0, maximum=10.0)
    bend_distance_m: float = setting(3704.0, "Distance flown over which bends decorrelate (2 NM).", unit="m", minimum=1.0)
    noise_deg: float = setting(0.3, "White noise of the receiver, 1 sigma.", unit="deg", minimum=0.001, maximum=10.0)
    latency_s: float = setting(0.0, "Time from validity to availability.", unit="s", minimum=0.0, maximum=10.0)

    @property
    def variance(self) -> float:
        """Variance of the whole error of a radial, rad^2."""
        return float(np.radians(1.0) ** 2 * (self.bias_deg**2 + self.bend_deg**2 + self.noise_deg**2))


@simulator("vor", Settings=VorSimulatorSettings, truth=("truth/odometry",), topics=("vor/bearing",), needs="stations_file")
class VorSimulator:
    """Turn truth into radials; keeps tuning, errors and what is on its way from call to call.

    A station below the horizon, outside its service volume or too steeply below (cone of confusion) flags: no radial.

    Parameters
    ----------
    settings : VorSimulatorSettings
    table : StationTable
        Stations that exist.
    source : str
        Source name of the measurements.

    Raises
    ------
    StationError
        When a station asked for is not in the table or has no VOR.
    """

    def __init__(self, settings: VorSimulatorSettings, table: StationTable, source: str = "vor/bearing") -> None:
        self.settings, self.source, self._table = settings, source, table
        self._fixed = table.named(settings.stations, BEARING)
        self._clock, self._flown = SampleClock(settings.rate_hz), DistanceFlown()
        self._reception: Reception[VorBearing] = Reception(settings.latency_s, settings.outages_s)
        self._errors: dict[str, StationDrift] = {}
        self._tuned: list[tuple[Station, int]] = []  # station of each receiver and since when
        self._tune_ns: int | None = None
        self._turn = 0

    def simulate(self, truth: TruthBlock) -> list[VorBearing]:
        """Return the radials that become available during ``truth``; the variance of each is that of its whole error."""
        if len(truth) == 0:
            return []
        self._reception.begin(int(truth.stamps_ns[0]))
        flown_m = self._flown.at(truth)
        for row in self._clock.rows(truth.stamps_ns):
            stamp_ns = int(truth.stamps_ns[row])
            place = float(truth.lat[row]), float(truth.lon[row]), float(truth.height[row])
            self._tune(stamp_ns, place)
            if not self._reception.in_outage(stamp_ns):
                self._reception.send(*self._radials(stamp_ns, place, float(flown_m[row])))
        return self._reception.arrived(int(truth.stamps_ns[-1]))

    def _tune(self, stamp_ns: int, place: tuple[float, float, float]) -> None:
        """Tune the receivers anew when it is time; a receiver that keeps its station continues without a gap."""
        if self._tune_ns is not None and stamp_ns < self._tune_ns:
            return
        first = self._tune_ns is None
        self._tune_ns = stamp_ns + round(1e9 * self.settings.dwell_s)
        since = {station.ident: since_ns for station, since_ns in self._tuned}
        fresh_ns = stamp_ns + (0 if first else round(1e9 * self.settings.settle_s))  # the crew tuned before the flight
        self._tuned = [(station, since.get(station.ident, fresh_ns)) for station in self._next_stations(place)]

    def _next_stations(self, place: tuple[float, float, float]) -> list[Station]:
        count = self.settings.receivers
        if not self._fixed:
            return nearest_vors(self._table, *place, count)
        first, self._turn = self._turn * count, self._turn + 1
        turns = range(first, first + min(count, len(self._fixed)))
        return [self._fixed[turn % len(self._fixed)] for turn in turns]

    def _radials(self, stamp_ns: int, place: tuple[float, float, float], flown_m: float) -> Iterator[VorBearing]:
        for station, since_ns in self._tuned:
            if stamp_ns >= since_ns and not out_of_service(station, *place):
                bearing = bearing_view(station, *place).bearing + self._error_of(station).draw(flown_m)
                radial = radial_of(bearing, station.declination)
                yield VorBearing(stamp_ns, self.source, station.ident, radial, self.settings.variance)

    def _error_of(self, station: Station) -> StationDrift:
        if station.ident not in self._errors:
            own, rng = self.settings, stream(self.settings.seed, f"vor.{station.ident}")
            sigmas = np.radians([own.bias_deg, own.bend_deg, own.noise_deg]).tolist()
            self._errors[station.ident] = StationDrift(rng, sigmas[0], sigmas[1], own.bend_distance_m, sigmas[2])
        return self._errors[station.ident]
