"""Simulator settings from a scenario: its section is the default, ROS parameters go over it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.simulation.scenario import load_scenario


@dataclass(frozen=True)
class ScenarioSettings:
    """Which scenario a simulator takes its defaults from."""

    scenario: str = setting("", "Scenario to take the defaults from: a name in config/scenarios or the path of a file; empty for none.")


@dataclass(frozen=True)
class FlightSettings:
    """Which scenario the flight is from, and its seed."""

    scenario: str = setting("", "Scenario to fly: a name in config/scenarios or a path; empty flies the parameters of this node.")
    seed: int = setting(1, "Seed of wind variation and turbulence.", minimum=0)


def sensor_bases(sensor: str, given: Mapping[str, Any]) -> list:
    """Defaults of a sensor simulator's parameters: its section of the scenario that ``given`` names."""
    name = str(given.get("scenario", ""))
    return [getattr(load_scenario(name), sensor), ScenarioSettings(name)]


def flight_bases(given: Mapping[str, Any]) -> list:
    """Defaults of the truth source's parameters."""
    name = str(given.get("scenario", ""))
    scenario = load_scenario(name)
    return [scenario.truth, FlightSettings(name, scenario.seed)]
