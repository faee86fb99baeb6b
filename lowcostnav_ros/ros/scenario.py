"""Simulator settings from a scenario: its section is the default, ROS parameters go over it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from lowcostnav_ros.base.settings import SettingsError, nearest, setting
from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.simulation.scenario import Scenario, scenario_from_text


@dataclass(frozen=True)
class ScenarioSettings:
    """Which scenario a simulator takes its defaults from."""

    scenario: str = setting("", "Scenario to take the defaults from: a name in config/scenarios or the path of a file; empty for none.")


@dataclass(frozen=True)
class FlightSettings:
    """Which scenario the flight is from, and its seed."""

    scenario: str = setting("", "Scenario to fly: a name in config/scenarios or a path; empty flies the parameters of this node.")
    seed: int = setting(1, "Seed of wind variation and turbulence.", minimum=0)


@cache
def load_scenario(name: str) -> Scenario:
    """Read a scenario by name or path; the default one for an empty name.  Raises SettingsError with what exists."""
    if not name:
        return scenario_from_text("name: default")
    path = Path(name) if name.endswith((".yaml", ".yml")) else config_dir() / "scenarios" / f"{name}.yaml"
    if not path.is_file():
        known = [p.stem for p in (config_dir() / "scenarios").glob("*.yaml")]
        raise SettingsError(f"No scenario '{name}'{nearest(name, known)}; or give the path of a YAML file.")
    return scenario_from_text(path.read_text(), path.name)


def sensor_bases(sensor: str, given: Mapping[str, Any]) -> list:
    """Defaults of a sensor simulator's parameters: its section of the scenario that ``given`` names."""
    name = str(given.get("scenario", ""))
    return [getattr(load_scenario(name), sensor), ScenarioSettings(name)]


def flight_bases(given: Mapping[str, Any]) -> list:
    """Defaults of the truth source's parameters."""
    name = str(given.get("scenario", ""))
    scenario = load_scenario(name)
    return [scenario.truth, FlightSettings(name, scenario.seed)]
