"""A scenario: one flight and the sensors aboard, as YAML text."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import yaml

from lowcostnav_ros.base.settings import SettingsError, from_mapping, group, nearest, setting
from lowcostnav_ros.physics.geomagnetism import decimal_year
from lowcostnav_ros.sensors.airdata import AirDataSimulatorSettings
from lowcostnav_ros.sensors.dme import DmeSimulatorSettings
from lowcostnav_ros.sensors.gnss_raw import GnssRawSimulatorSettings
from lowcostnav_ros.sensors.gps import GpsSimulatorSettings
from lowcostnav_ros.sensors.gps_attitude import GpsAttitudeSimulatorSettings
from lowcostnav_ros.sensors.imu import ImuSimulatorSettings
from lowcostnav_ros.sensors.magnetometer import MagnetometerSimulatorSettings
from lowcostnav_ros.sensors.vor import VorSimulatorSettings
from lowcostnav_ros.simulation.equipment import SENSORS, USUAL
from lowcostnav_ros.trajectory import TruthSettings


@dataclass(frozen=True)
class Scenario:
    """One simulated flight.

    A sensor's section takes the seed of the scenario and, for the magnetometer, the date of the flight, unless it gives its own.
    """

    name: str = setting("scenario", "Name of the scenario.")
    description: str = setting("", "What the flight is for.")
    seed: int = setting(1, "Seed of everything random in the flight.", minimum=0)
    sensors: list = setting(list(USUAL), "Sensors aboard.", choices=SENSORS)
    truth: TruthSettings = group(TruthSettings)
    imu: ImuSimulatorSettings = group(ImuSimulatorSettings)
    magnetometer: MagnetometerSimulatorSettings = group(MagnetometerSimulatorSettings)
    air_data: AirDataSimulatorSettings = group(AirDataSimulatorSettings)
    gps: GpsSimulatorSettings = group(GpsSimulatorSettings)
    dme: DmeSimulatorSettings = group(DmeSimulatorSettings)
    gps_attitude: GpsAttitudeSimulatorSettings = group(GpsAttitudeSimulatorSettings)
    gnss: GnssRawSimulatorSettings = group(GnssRawSimulatorSettings)
    vor: VorSimulatorSettings = group(VorSimulatorSettings)

    def __post_init__(self) -> None:
        if len(set(self.sensors)) < len(self.sensors):
            raise SettingsError(f"Scenario '{self.name}': a sensor is listed twice in 'sensors'; name each once.")
        ratio = self.truth.rate_hz / self.imu.rate_hz
        if "imu" in self.sensors and (ratio < 1.0 or abs(ratio - round(ratio)) > 1e-9):
            raise SettingsError(
                f"Scenario '{self.name}': imu.rate_hz of {self.imu.rate_hz:g} must divide truth.rate_hz of {self.truth.rate_hz:g}."
            )
        for name in ("magnetometer", "air_data", "gps", "gps_attitude", "gnss", "vor"):
            rate_hz = getattr(self, name).rate_hz
            if name in self.sensors and rate_hz > self.truth.rate_hz:
                raise SettingsError(
                    f"Scenario '{self.name}': {name}.rate_hz of {rate_hz:g} is above truth.rate_hz of {self.truth.rate_hz:g}; lower it."
                )


def scenario_from_text(text: str, where: str = "scenario", **changes: Any) -> Scenario:
    """Read a scenario from YAML text.

    Parameters
    ----------
    text : str
        YAML mapping with the fields of :class:`Scenario`; the ``outages_s`` of a section may be a list of pairs.
    where : str
        What to call the source in a refusal.
    **changes
        Values that replace those of the text, e.g. ``seed=3`` or, dotted, ``**{"truth.duration_s": 60.0}``.

    Raises
    ------
    SettingsError
        When the text is not YAML, a name is unknown, or a value does not fit.
    """
    try:
        values = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise SettingsError(f"{where}: not readable as YAML; correct it near {getattr(error, 'problem_mark', 'its start')}.") from error
    if not isinstance(values, Mapping):
        raise SettingsError(f"{where}: a scenario is a list of names and values; begin with 'name:'.")
    nested = {name: value for name, value in changes.items() if "." in name}
    plain = {name: value for name, value in changes.items() if "." not in name}
    return from_mapping(Scenario, {**_completed({**values, **plain}, where), **nested}, where)  # the last of two equal names counts


def _completed(values: dict[str, Any], where: str) -> dict[str, Any]:
    """Fill in what sections inherit from the scenario, so that from here on every section stands alone."""
    truth = _section(values, "truth", where)
    stamp_s = truth.get("start_stamp_s", TruthSettings().start_stamp_s)
    for name in SENSORS:
        values[name] = {"seed": values.get("seed", 1), **_section(values, name, where)}
    if isinstance(stamp_s, int | float):
        values["magnetometer"] = {"decimal_year": decimal_year(datetime.fromtimestamp(stamp_s, UTC)), **values["magnetometer"]}
    for name in ("gps", "gps_attitude", "vor"):
        outages = values[name].get("outages_s")
        if isinstance(outages, list):
            pairs = [pair if isinstance(pair, list) else [pair] for pair in outages]
            values[name] = {**values[name], "outages_s": [time for pair in pairs for time in pair]}
    for sensor in values.get("sensors") or ():
        if sensor not in SENSORS:
            raise SettingsError(f"{where}: there is no sensor '{sensor}'{nearest(str(sensor), SENSORS)}.")
    return values


def _section(values: Mapping[str, Any], name: str, where: str) -> dict[str, Any]:
    section = values.get(name)
    if section is None:
        return {}
    if not isinstance(section, Mapping):
        raise SettingsError(f"{where}: section '{name}' must hold names and values, got {section!r}.")
    return dict(section)
