"""Navigators as configured: settings from the same YAML files the nodes read."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from lowcostnav_ros.base.settings import SettingsError, from_mapping, to_mapping
from lowcostnav_ros.catalogue import config_files
from lowcostnav_ros.catalogue.imu_by_name import with_imu_profile
from lowcostnav_ros.navigators.base import Navigator

Registry = Mapping[str, type[Navigator]]
"""Navigator classes by name, as :data:`lowcostnav_ros.navigators.registry.NAVIGATORS`."""

S = TypeVar("S")
_NODE_GROUPS = ("output.", "qos.", "input.")


def build_navigators(
    names: Iterable[str], registry: Registry, config: Path | None, flown: Path | None = None, adapt: Callable[[Any], Any] = lambda s: s
) -> dict[str, Navigator]:
    """Make fresh navigators.

    Parameters
    ----------
    names : iterable of str
        Names in the registry.
    registry : mapping
    config : Path or None
        Directory that holds ``<name>.yaml`` for some, the others fly as shipped; None takes ``flown``, then the package's own, and
        defaults where there is no file.
    flown : Path, optional
        Directory of settings that a recording carries, any or none of the files.
    adapt : callable
        Settings to those with what a recording itself states of its sensors.

    Raises
    ------
    SettingsError
        When the directory or a file in it is missing or holds what cannot be used.
    """
    if config is not None and not config.is_dir():
        raise SettingsError(f"Configuration directory {config} does not exist; give one that holds <navigator>.yaml files.")
    if config is not None and not any((config / f"{name}.yaml").is_file() for name in registry):
        raise SettingsError(f"{config} holds no <navigator>.yaml file; those known are {', '.join(sorted(registry))}.")
    return {name: make_navigator(adapt(_settings(name, registry[name], config, flown)), registry[name]) for name in names}


def _settings(name: str, navigator_class: type[Navigator], config: Path | None, flown: Path | None) -> Any:
    path = (config or config_files.config_dir()) / f"{name}.yaml"
    if config is None and flown is not None and (flown / f"{name}.yaml").is_file():
        path = flown / f"{name}.yaml"
    if not path.is_file():
        path = config_files.config_dir() / f"{name}.yaml"
    if not path.exists():
        return navigator_class.Settings()
    values = {key: value for key, value in config_files.read_parameters(path, name).items() if not is_of_node(key)}
    return complete_settings(navigator_class.Settings, values, str(path))


def is_of_node(parameter: str) -> bool:
    """Whether a parameter is of the node around a navigator, so that it changes no fused solution."""
    return parameter.startswith(_NODE_GROUPS) or parameter == "use_sim_time"


def complete_settings(cls: type[S], values: Mapping[str, Any], where: str = "settings") -> S:
    """Build settings as :func:`from_mapping` does, with the numbers of the IMU profile they name in place: what a navigator is made of.

    Raises
    ------
    SettingsError
        For what :func:`from_mapping` refuses, and when there is no such profile or a filter cannot fly on its numbers.
    """
    return with_imu_profile(from_mapping(cls, values, where))


def make_navigator(settings: Any, navigator_class: Callable[..., Navigator]) -> Navigator:
    """Make a navigator from its complete settings, with the station table they name, if any.

    Raises
    ------
    ValueError
        (SettingsError, StationError) when the station table is missing or cannot be flown on.
    """
    stations_file = _stations_file(to_mapping(settings))
    if not stations_file:
        return navigator_class(settings)
    from lowcostnav_ros.catalogue.equipment import load_stations

    return navigator_class(settings, load_stations(stations_file))


def _stations_file(values: dict[str, Any]) -> str:
    """Return the one station table that the sensors name, empty for none; a sensor that is off needs none."""
    sensors = [name.removesuffix(".stations_file") for name in values if name.endswith(".stations_file")]
    named = {f"{key}.stations_file": values[f"{key}.stations_file"] for key in sensors if values.get(f"{key}.enabled", True)}
    named = {setting: name for setting, name in named.items() if name}
    if len(set(named.values())) > 1:
        stated = " and ".join(f"'{setting}' is {name}" for setting, name in named.items())
        raise SettingsError(f"{stated}; put all stations into one table.")
    return next(iter(named.values()), "")
