"""Receiver of ground transmitters: code and carrier of a synchronised network, the troposphere modelled from the weather at each."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.aids._carrier import CarrierAid, CarrierSettings
from lowcostnav_ros.aids._carrier_watch import OUT_OF_STEP
from lowcostnav_ros.base.measurements import CarrierEpoch, StationWeather
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.views import Place
from lowcostnav_ros.estimation.aiding import Aid, Host, Innovation, Reason, Sensor
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov
from lowcostnav_ros.physics.earth import ecef_to_geodetic, geodetic_to_ecef
from lowcostnav_ros.radionav.stations import Station
from lowcostnav_ros.radionav.transmitters import PSEUDOLITE
from lowcostnav_ros.radionav.troposphere import MODELS, air_of
from lowcostnav_ros.radionav.weather import Weather, standard_weather


@dataclass(frozen=True)
class TroposphereSettings:
    """Delay along the path, which lies in the lower troposphere."""

    model: str = setting("hopfield", "None, ray-traced modified Hopfield, Bouska and Raquet, index of refraction.", choices=MODELS)
    scale: float = setting(0.03, "Sigma of a factor on all delays that is estimated; 0: no state.", minimum=0.0, maximum=1.0)
    scale_tau_s: float = setting(3600.0, "Correlation time of the factor.", unit="s", minimum=1.0)
    weather_s: float = setting(7200.0, "A report of the weather holds for so long.", unit="s", minimum=1.0)


@dataclass(frozen=True)
class PseudoliteSettings(CarrierSettings):
    """Ground transmitters."""

    stations_file: str = setting(
        "", "Station table; the file name is resolved where the configuration is read.", shipped="pseudolites_range.csv"
    )
    troposphere: TroposphereSettings = group(TroposphereSettings)


class Network:
    """The transmitters of a table: places (n, 3) ECEF, weather, and what the models of the troposphere need of it, (n, 6)."""

    def __init__(self, stations: Any) -> None:
        self.stations: list[Station] = [] if stations is None else [s for s in stations if s.kind == PSEUDOLITE]
        self.number = {s.ident: k for k, s in enumerate(self.stations)}
        self.pos_e = np.array([geodetic_to_ecef(s.lat, s.lon, s.height) for s in self.stations]).reshape(-1, 3)
        self.restart()

    def restart(self) -> None:
        """Take the weather of the table, or the standard atmosphere."""
        self.reported_ns: dict[int, int] = {}
        self.standard = [s.ident for s in self.stations if s.weather is None]
        self.air = np.array([self._listed(s) for s in self.stations]).reshape(-1, 6)

    @staticmethod
    def _listed(station: Station) -> np.ndarray:
        return air_of(station.weather or standard_weather(station.height), station.height)

    def report(self, number: int, weather: Weather, stamp_ns: int) -> None:
        """Take a report of the weather at a transmitter."""
        self.reported_ns[number] = stamp_ns
        self.air[number] = air_of(weather, self.stations[number].height)

    def forget(self, before_ns: int) -> None:
        """Go back to the table where a report is too old."""
        for number in [k for k, stamp_ns in self.reported_ns.items() if stamp_ns < before_ns]:
            del self.reported_ns[number]
            self.air[number] = self._listed(self.stations[number])


class PseudoliteAid(CarrierAid):
    """Code and carrier of ground transmitters."""

    name, topic = "pseudolite", "pseudolite/raw"

    def __init__(self, settings: PseudoliteSettings, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self.network, self._idents = Network(stations), b""
        self._latches = {s.ident: Latch(OUT_OF_STEP, (s.ident, "the other transmitters"), "m", 0.0) for s in self.network.stations}
        self.latches = [*self.latches, *self._latches.values()]

    @property
    def model(self) -> int:
        """Index of the troposphere's model."""
        return MODELS.index(self.settings.troposphere.model)

    @property
    def slots(self) -> int:
        """One state for each transmitter of the table, unless set."""
        return self.settings.slots or len(self.network.stations) or self.few_slots

    @property
    def remark(self) -> str:
        """For which transmitters the standard atmosphere is taken."""
        missing = [s for s in self.network.standard if self.network.number[s] not in self.network.reported_ns]
        return f"no weather for {', '.join(missing)}: standard atmosphere" if missing and self.model else ""

    def blocks(self) -> list[Block]:
        """As every receiver's; and the factor on the delays."""
        troposphere, name = self.settings.troposphere, f"{self.own(self.name)}_troposphere"
        factor = [gauss_markov(name, [f"{name}_scale"], Kind.FREE, troposphere.scale, troposphere.scale_tau_s)]
        return super().blocks() + (factor if troposphere.scale > 0.0 else [])

    def restart(self) -> None:
        """Forget what was received; the weather is that of the table again."""
        super().restart()
        self._numbered = 0
        self.network.restart()

    def place_of(self, epoch: CarrierEpoch) -> tuple[np.ndarray, np.ndarray, list[tuple[int, str]]]:
        """Transmitters of the table, and others that say themselves where they are."""
        if (idents := epoch.ident.tobytes()) != self._idents:  # they hardly ever change
            self._idents = idents
            self._places = np.array([self.network.number.get(ident, -1) for ident in epoch.ident.tolist()], dtype=np.int64)
        known = self._places >= 0
        if known.all():
            return np.arange(len(epoch)), self.network.pos_e[self._places], []
        pos_e = np.zeros((len(epoch), 3))
        pos_e[known] = self.network.pos_e[self._places[known]]
        if epoch.pos_e is not None:
            pos_e[~known] = epoch.pos_e[~known]
            known = known | epoch.pos_e.any(axis=1)
        others: list[tuple[int, str]] = [(int(row), Reason("transmitter unknown", str(epoch.ident[row]))) for row in np.flatnonzero(~known)]
        return np.flatnonzero(known), pos_e[known], others

    def air_of(self, epoch: CarrierEpoch, rows: np.ndarray) -> np.ndarray:
        """Of the weather at each; the standard atmosphere at one that is not in the table."""
        self.network.forget(epoch.stamp_ns - round(1e9 * self.settings.troposphere.weather_s))
        places = self._places[rows]
        if (places >= 0).all():
            return self.network.air[places]
        heights = [0.0 if epoch.pos_e is None else float(ecef_to_geodetic(epoch.pos_e[row])[2]) for row in rows.tolist()]
        listed = zip(places.tolist(), heights, strict=True)
        return np.array([self.network.air[k] if k >= 0 else air_of(standard_weather(height), height) for k, height in listed])

    def _channels_of(self, idents: np.ndarray) -> np.ndarray:
        channel = super()._channels_of(idents)
        if self._numbered != len(self._number):
            self._numbered = len(self._number)
            self.watch.latches = {number: self._latches[ident] for ident, number in self._number.items() if ident in self._latches}
        return channel


class WeatherAid(Aid):
    """Weather at the transmitters: moves no state, but what the delays are computed from."""

    name, labels = "pseudolite_weather", ("stations",)
    measurement, topic, views = StationWeather, "pseudolite/weather", (Place,)
    network: Network

    def innovation(self, measurement: StationWeather, host: Host) -> Innovation | str:
        """There is none."""
        return "weather is no measurement of a state"

    def process(self, measurement: StationWeather, host: Host) -> bool:
        """Take what can be the weather of a transmitter."""
        status, taken = self.status, 0
        status.stamp_ns = measurement.stamp_ns
        columns = measurement.ident, measurement.pressure_pa, measurement.temperature_k, measurement.humidity
        for ident, *values in zip(*(column.tolist() for column in columns), strict=True):
            number, weather = self.network.number.get(ident), Weather(*values)
            if number is None:
                self.refuse(Reason("transmitter unknown", ident))
                continue
            absurd = weather.absurdity(self.network.stations[number].height)
            if absurd:
                self.refuse(Reason("weather absurd", f"{ident}: {absurd}"))
                continue
            self.network.report(number, weather, measurement.stamp_ns)
            taken += 1
        if not taken:
            return False
        status.observation = np.array([float(taken)])
        status.accepted, status.reason, status.accepted_ns = True, "", measurement.stamp_ns
        status.fused += 1
        return True


def pseudolite_aids(settings: PseudoliteSettings, key: str, stations: Any) -> list[Aid]:
    """The receiver, and the weather at its transmitters."""
    receiver, weather = PseudoliteAid(settings, key, stations), WeatherAid(settings, key, stations)
    weather.network = receiver.network
    return [receiver, weather]


PSEUDOLITE_AID = AIDS.register("pseudolite", Sensor("pseudolite", PseudoliteSettings, pseudolite_aids), __name__)
