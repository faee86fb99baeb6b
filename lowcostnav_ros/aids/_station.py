"""What aids of ground stations share: the station table, an error of each station as a state, and when each was used."""

import math
from typing import Any

from lowcostnav_ros.cores.views import Place
from lowcostnav_ros.estimation.aiding import Aid, Host, Innovation, Reason
from lowcostnav_ros.estimation.station_slots import StationSlots
from lowcostnav_ros.radionav.stations import Station


class StationAid(Aid):
    """One reading of one station at a time; its slow error is a state while there are states enough.

    A new station is tested with its slow error as noise; once its reading is to be used, it takes the state of the one idle for longest.
    """

    views, keeps_slots = (Place,), True
    bias_block: str
    _used_ns: dict[str, int] = {}

    @property
    def bias_sigma(self) -> float:
        """Sigma of a station's slow error, in the unit of its states."""
        raise NotImplementedError

    def attach(self, host: Host) -> None:
        """Find the states of the stations' errors."""
        self._rows = host.layout.get(self.own(self.bias_block))
        super().attach(host)

    def restart(self) -> None:
        """Forget which station has which state, and when each was used."""
        super().restart()
        self.slots = StationSlots(self._rows, self.bias_sigma)
        self._used_ns = {}

    def words(self, now_ns: int) -> str:
        """The stations used lately."""
        stations = self.used_lately(now_ns)
        return f"{self.name.upper()} {', '.join(stations)}" if stations else ""

    def used_lately(self, now_ns: int) -> list[str]:
        """Stations with a reading used within the time-out, by ident."""
        return sorted(name for name, stamp_ns in self._used_ns.items() if 0 <= now_ns - stamp_ns <= 1e9 * self.settings.timeout_s)

    def station_of(self, measurement: Any) -> Station | str:
        """The station of a reading, or the reason why there is none."""
        if self.stations is None:
            return "no station table"
        if measurement.station not in self.stations:
            return Reason("station unknown", measurement.station)
        return self.stations[measurement.station]

    def refusal(self, measurement: Any, host: Host) -> str:
        """Why a reading cannot be used at all; empty when it can."""
        station = self.station_of(measurement)
        return station if isinstance(station, str) else ""

    def prepare(self, measurement: Any, innovation: Innovation, host: Host) -> Innovation:
        """Assign a state to a station that has none, and form the innovation with it: only a reading that is used takes another's state."""
        is_new = self._rows is not None and self.slots.index(measurement.station) is None
        self.slots.take(measurement.station, measurement.stamp_ns, host.P, host.core.estimate, host.core.history)
        again = self.innovation(measurement, host) if is_new else innovation
        self._used_ns[measurement.station] = measurement.stamp_ns
        return innovation if isinstance(again, str) else again

    def since_station_s(self, measurement: Any) -> float:
        """Seconds since a reading of this station was used; ``inf`` before the first and after a start at an earlier time."""
        last_ns = self._used_ns.get(measurement.station)
        if last_ns is None or last_ns > measurement.stamp_ns:
            return math.inf
        return 1e-9 * (measurement.stamp_ns - last_ns)

