"""Simulator of two-way ranging to beacons on the ground: one beacon after the other, with a bias of each and the true troposphere."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import SlantRange
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.radionav.geometry import range_and_direction
from lowcostnav_ros.radionav.stations import StationTable
from lowcostnav_ros.radionav.transmitters import BEACON
from lowcostnav_ros.sensors.pseudolite import AirSettings
from lowcostnav_ros.sensors.reception import ReceiverSettings, outage_windows
from lowcostnav_ros.sensors.registry import simulator
from lowcostnav_ros.sensors.sampling import SampleClock


@dataclass(frozen=True)
class RangingSimulatorSettings(ReceiverSettings):
    """Settings of the simulator of two-way ranges."""

    receiver = "Ranging"
    rate_hz: float = setting(2.0, "Ranges a second, to one beacon after the other.", unit="Hz", minimum=0.01, maximum=50.0)
    stations_file: str = setting("beacons_range.csv", "Station table in the config directory, or a path.")
    noise_m: float = setting(1.0, "White noise, 1 sigma.", unit="m", minimum=0.001)
    bias_m: float = setting(2.0, "Constant error of each beacon, 1 sigma.", unit="m", minimum=0.0)
    missed: float = setting(0.02, "Probability that there is no reply.", minimum=0.0, maximum=1.0)
    air: AirSettings = group(AirSettings)



@simulator("ranging", Settings=RangingSimulatorSettings, truth=("truth/odometry",), topics=("ranging/range",), needs="stations_file")
class RangingSimulator:
    """Turn truth into two-way ranges.

    Parameters
    ----------
    settings : RangingSimulatorSettings
    table : StationTable
        Its beacons answer.
    source : str
        Source name of the measurements.

    Raises
    ------
    SettingsError
        When the table holds no beacon.
    """

    def __init__(self, settings: RangingSimulatorSettings, table: StationTable, source: str = "ranging/range") -> None:
        self.settings, self.source = settings, source
        self._beacons = [s for s in table if s.kind == BEACON]
        if not self._beacons:
            raise SettingsError(f"{settings.stations_file} holds no station of kind {BEACON}; name a table that does.")
        self._clock, self._air, self._turn = SampleClock(settings.rate_hz), settings.air.column(), 0
        self._rng = stream(settings.seed, "ranging.noise")
        self._bias = settings.bias_m * stream(settings.seed, "ranging.bias").standard_normal(len(self._beacons))
        self._start_ns: int | None = None

    def simulate(self, truth: TruthBlock) -> list[SlantRange]:
        """Return the ranges whose time falls in ``truth``."""
        if len(truth) == 0:
            return []
        self._start_ns = int(truth.stamps_ns[0]) if self._start_ns is None else self._start_ns
        return [reply for row in self._clock.rows(truth.stamps_ns) if (reply := self._reply(truth, int(row))) is not None]

    def _reply(self, truth: TruthBlock, row: int) -> SlantRange | None:
        own, k = self.settings, self._turn % len(self._beacons)
        self._turn += 1
        noise, missed, beacon = self._rng.standard_normal(), self._rng.random() < own.missed, self._beacons[k]
        place = float(truth.lat[row]), float(truth.lon[row]), float(truth.height[row])
        range_m, _ = range_and_direction(*place, beacon.lat, beacon.lon, beacon.height)
        t_s = 1e-9 * (int(truth.stamps_ns[row]) - (self._start_ns or 0))
        away = any(start <= t_s < end for start, end in outage_windows(own.outages_s))
        if missed or away or not beacon.reach_m[0] <= range_m <= beacon.reach_m[1]:
            return None
        delay = float(self._air.delays(np.array([beacon.height]), place[2], np.array([range_m]))[0])
        measured = range_m + delay + self._bias[k] + own.noise_m * noise
        return SlantRange(int(truth.stamps_ns[row]), self.source, beacon.ident, float(measured), own.noise_m**2 + own.bias_m**2)
