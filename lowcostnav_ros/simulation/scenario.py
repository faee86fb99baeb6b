"""A scenario: one flight and the sensors aboard, as YAML text."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, make_dataclass
from functools import cache
from typing import Any

from lowcostnav_ros.base.documents import parse_yaml, read_text
from lowcostnav_ros.base.settings import SettingsError, checked, declared, from_mapping, group, nearest, setting, shown
from lowcostnav_ros.catalogue.config_files import config_dir, find_config
from lowcostnav_ros.physics.geomagnetism import year_of_stamp
from lowcostnav_ros.sensors.registry import SIMULATORS
from lowcostnav_ros.trajectory import TruthSettings


@dataclass(frozen=True)
class Scenario:
    """One simulated flight: of :func:`scenario_class`, which adds one section for every sensor simulator.

    A sensor's section takes the seed of the scenario and, where it has one, the date of the flight, unless it gives its own.
    """

    name: str = setting("scenario", "Name of the scenario.")
    description: str = setting("", "What the flight is for.")
    seed: int = setting(1, "Seed of everything random in the flight.", minimum=0)
    sensors: list = setting([], "Sensors aboard.")
    truth: TruthSettings = group(TruthSettings)

    def __post_init__(self) -> None:
        if len(set(self.sensors)) < len(self.sensors):
            raise SettingsError(f"Scenario '{self.name}': a sensor is listed twice in 'sensors'; name each once.")
        highest_hz = self.truth.rate_hz
        for name in self.sensors:
            rate_hz = getattr(getattr(self, name), "rate_hz", None)
            if rate_hz is None:
                continue
            ratio = highest_hz / rate_hz
            # a sensor that averages over its interval needs whole intervals
            if "truth/imu" in SIMULATORS.label(name).truth and (ratio < 1.0 or abs(ratio - round(ratio)) > 1e-9):
                raise SettingsError(f"Scenario '{self.name}': {name}.rate_hz of {rate_hz:g} must divide truth.rate_hz of {highest_hz:g}.")
            if ratio < 1.0:
                raise SettingsError(
                    f"Scenario '{self.name}': {name}.rate_hz of {rate_hz:g} is above truth.rate_hz of {highest_hz:g}; lower it."
                )


def scenario_class() -> type[Scenario]:
    """Return the class of scenarios: one section for every sensor simulator there is, those of plugins included."""
    return _scenario_class(tuple(SIMULATORS))


@cache
def _scenario_class(sensors: tuple[str, ...]) -> type[Scenario]:
    places = {name: SIMULATORS.label(name).usual for name in sensors}
    usual = sorted((name for name in sensors if places[name]), key=places.__getitem__)
    aboard = ("sensors", list, setting(usual, "Sensors aboard.", choices=sensors))
    sections = [(name, SIMULATORS[name].Settings, field(default_factory=SIMULATORS[name].Settings)) for name in sensors]
    made = make_dataclass("Scenario", [aboard, *sections], bases=(Scenario,), frozen=True)
    made.__doc__ = Scenario.__doc__
    return made


def load_scenario(name: str, seed: int | None = None) -> Scenario:
    """Read a scenario by the name of a shipped one or by path; the default one for an empty name.

    Raises
    ------
    SettingsError
        When there is none, or it holds what cannot be used.
    """
    if not name:
        return scenario_from_text("name: default")
    if "/" in name or name.endswith((".yaml", ".yml")):
        path = find_config(name)
    else:
        path = config_dir() / "scenarios" / f"{name}.yaml"
        if not path.is_file():
            known = [p.stem for p in path.parent.glob("*.yaml")]
            raise SettingsError(f"There is no scenario '{name}'{nearest(name, known)}; or give the path of a YAML file.")
    changes = {} if seed is None else {"seed": seed}
    return scenario_from_text(read_text(path), str(path), **changes)


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
    values = parse_yaml(text, where)
    if not isinstance(values, Mapping):
        raise SettingsError(f"{where}: a scenario is a list of names and values; begin with 'name:'.")
    nested = {name: value for name, value in changes.items() if "." in name}
    plain = {name: value for name, value in changes.items() if "." not in name}
    return from_mapping(scenario_class(), {**_completed({**values, **plain}, where), **nested}, where)  # the last of two equal names counts


def _completed(values: dict[str, Any], where: str) -> dict[str, Any]:
    """Fill in what sections inherit from the scenario, so that from here on every section stands alone."""
    truth = _section(values, "truth", where)
    start = next(entry for entry in declared(TruthSettings) if entry.name == "start_stamp_s")
    stamp_s = checked(start, truth.get("start_stamp_s", start.default), where)
    for name in SIMULATORS:
        known = {f.name for f in fields(SIMULATORS[name].Settings)}
        section = _section(values, name, where)
        if "decimal_year" in known:
            section = {"decimal_year": year_of_stamp(round(stamp_s * 1e9)) or 0.0, **section}
        if isinstance(section.get("outages_s"), list):
            pairs = [pair if isinstance(pair, list) else [pair] for pair in section["outages_s"]]
            section["outages_s"] = [time for pair in pairs for time in pair]
        values[name] = {"seed": values.get("seed", 1), **section} if "seed" in known else section
    sensors = values.get("sensors") or []
    for sensor in sensors if isinstance(sensors, list) else [sensors]:
        if not isinstance(sensor, str) or sensor not in SIMULATORS:
            raise SettingsError(f"{where}: there is no sensor '{sensor}'{nearest(str(sensor), SIMULATORS)}.")
    return values


def _section(values: Mapping[str, Any], name: str, where: str) -> dict[str, Any]:
    section = values.get(name)
    if section is None:
        return {}
    if not isinstance(section, Mapping):
        raise SettingsError(f"{where}: section '{name}' must hold names and values, got {shown(section)}.")
    return dict(section)
