"""DME simulator: slant ranges as a receiver that keeps to the pulse budget gets them.

``measured = true + bias + slow error + white noise``; the slow error is Gauss-Markov over the *distance* flown, sigma 0.17 NM
with a correlation distance of 0.5 NM, independent per station; white noise 0.004 NM (Gebre-Egziabher 2004, eq. 3.38-3.39).
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import SlantRange
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.radionav.interrogation import SCHEMES, InterrogationSchedule, Slot, answered_share, transponder_load
from lowcostnav_ros.radionav.selection import audible, best_pair, view
from lowcostnav_ros.radionav.stations import RANGING, Station, StationTable
from lowcostnav_ros.sensors.registry import SimulatorSettings, simulator
from lowcostnav_ros.sensors.station_drift import DistanceFlown, StationDrift

CHOOSE_EVERY_S = 60.0
"""How long an automatic choice of stations is kept before it is looked at again."""


@dataclass(frozen=True)
class DmeSimulatorSettings(SimulatorSettings):
    """Settings of the DME simulator."""

    scheme: str = setting("one_receiver", "Receiver: one that alternates, two, or a scanning one.", choices=SCHEMES)
    interval_s: float = setting(15.0, "Time between ranges; 0 takes the shortest the pulse budget allows.", unit="s", minimum=0.0)
    over_budget: bool = setting(False, "Allow an interval over the pulse budget of a station; the cost is reported.")
    tracking_aircraft: int = setting(0, "Other aircraft that track every station.", minimum=0, maximum=10_000)
    searching_aircraft: int = setting(0, "Other aircraft that search for every station.", minimum=0, maximum=10_000)
    stations_file: str = setting("dme_stations_bay_area.csv", "Station table in the config directory, or a path.")
    stations: str = setting("", "Idents to ask, separated by commas; empty chooses the best pair on the way.")
    bias_m: float = setting(0.0, "Constant error per station, 1 sigma (0 once calibrated).", unit="m", minimum=0.0)
    drift_m: float = setting(314.84, "Slow error, 1 sigma (0.17 NM).", unit="m", minimum=0.0)
    correlation_distance_m: float = setting(926.0, "Distance over which the slow error decorrelates (0.5 NM).", unit="m", minimum=1.0)
    noise_m: float = setting(7.4, "White noise, 1 sigma (0.004 NM).", unit="m", minimum=0.1)


def range_error(settings: DmeSimulatorSettings, ident: str) -> StationDrift:
    """Return the error of the ranges to one station, m."""
    rng = stream(settings.seed, f"dme.{ident}")
    return StationDrift(rng, settings.bias_m, settings.drift_m, settings.correlation_distance_m, settings.noise_m)


@simulator("dme", Settings=DmeSimulatorSettings, truth=("truth/odometry",), topics=("dme/range",), needs="stations_file", usual=5)
class DmeSimulator:
    """Turn truth into slant ranges; keeps lock, schedule and errors from call to call.

    Parameters
    ----------
    settings : DmeSimulatorSettings
    table : StationTable
        Stations that exist.
    source : str
        Source name of the measurements.

    Raises
    ------
    ScheduleError
        When the interval is over the pulse budget.
    StationError
        When a station asked for is not in the table or has no DME.
    """

    def __init__(self, settings: DmeSimulatorSettings, table: StationTable, source: str = "dme/range") -> None:
        self.settings, self.source, self._table = settings, source, table
        self._fixed = table.named(settings.stations, RANGING)
        self.schedule = InterrogationSchedule(settings.scheme, len(self._fixed) or 2, settings.interval_s, settings.over_budget)
        load = transponder_load(settings.tracking_aircraft, settings.searching_aircraft) + self.schedule.pulses_per_minute / 60.0
        self._answered, self._traffic_rng = answered_share(load), stream(settings.seed, "dme.traffic")
        overload = f"DME: stations answer {100.0 * self._answered:.0f} % of the questions under {load:.0f} pulses/s."
        self.notes = [note for note in (self.schedule.saturation, overload if self._answered < 1.0 else "") if note]
        self._channels: list[Station | None] = [*self._fixed] or [None, None]
        self._pair: tuple[Station, Station] | None = None
        self._errors: dict[str, StationDrift] = {}
        self._choose_at_s = 0.0
        self._open: list[tuple[Slot, Station]] = []
        self._turn = 0
        self._start_ns = 0
        self._begun = False
        self._flown = DistanceFlown()
        self._variance = settings.bias_m**2 + settings.drift_m**2 + settings.noise_m**2

    def simulate(self, truth: TruthBlock) -> list[SlantRange]:
        """Return the replies that arrive during ``truth``.

        The variance of a reply is that of its whole error, slow part included.  A station below the horizon or outside its
        service volume, at interrogation or reply, does not answer; one that is loaded beyond its capacity answers a share.
        """
        if len(truth) == 0:
            return []
        if not self._begun:
            self._start_ns, self._begun = int(truth.stamps_ns[0]), True
        flown_m = self._flown.at(truth)
        replies: list[SlantRange] = []
        while True:
            due_ns, reply = self._next_event()
            row = int(np.searchsorted(truth.stamps_ns, due_ns))
            if row == len(truth):
                return replies
            if reply:
                slot, station = self._open.pop(0)
                replies += self._reply(truth, row, station, float(flown_m[row]))
            else:
                self._ask(truth, row)

    def _next_event(self) -> tuple[int, bool]:
        """Return when the next event is due and whether it is a reply; a reply comes before a question at the same time."""
        question_ns = self._start_ns + round(self.schedule.slots(self._turn)[0].begin_s * 1e9)
        if self._open:
            reply_ns = self._start_ns + round(self._open[0][0].reply_s * 1e9)
            if reply_ns <= question_ns:
                return reply_ns, True
        return question_ns, False

    def _ask(self, truth: TruthBlock, row: int) -> None:
        place = truth.lat[row], truth.lon[row], truth.height[row]
        slots = self.schedule.slots(self._turn)
        self._turn += 1
        if not self._fixed and slots[0].channel == 0 and slots[0].begin_s >= self._choose_at_s:
            self._pair = best_pair(self._table, *place, keep=self._pair)
            self._channels = list(self._pair or (None, None))
            self._choose_at_s = slots[0].begin_s + (CHOOSE_EVERY_S if self._pair else 0.0)
        for slot in slots:
            station = self._channels[slot.channel]
            if station is not None and audible(station, *place):
                self._open.append((slot, station))

    def _reply(self, truth: TruthBlock, row: int, station: Station, flown_m: float) -> list[SlantRange]:
        place = truth.lat[row], truth.lon[row], truth.height[row]
        answered = self._answered >= 1.0 or self._traffic_rng.random() < self._answered
        if not answered or not audible(station, *place):
            return []
        if station.ident not in self._errors:
            self._errors[station.ident] = range_error(self.settings, station.ident)
        measured = view(station, *place).range_m + self._errors[station.ident].draw(flown_m)
        return [SlantRange(int(truth.stamps_ns[row]), self.source, station.ident, max(measured, 0.0), self._variance)]
