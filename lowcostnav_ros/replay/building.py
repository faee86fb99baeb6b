"""Navigators as configured: settings from the same YAML files the nodes read."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from lowcostnav_ros import config_files
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.settings import SettingsError

Registry = Mapping[str, tuple[type, type[Navigator]]]
"""Name to (settings class, navigator class), as :data:`lowcostnav_ros.navigators.registry.NAVIGATORS`."""


def build_navigators(names: Iterable[str], registry: Registry, config: Path | None) -> dict[str, Navigator]:
    """Make fresh navigators.

    Parameters
    ----------
    names : iterable of str
        Names in the registry.
    registry : mapping
    config : Path or None
        Directory that holds ``<name>.yaml`` for each; None takes the package's own, and defaults where it has no file.

    Raises
    ------
    SettingsError
        When the directory or a file in it is missing or holds what cannot be used.
    """
    if config is not None and not config.is_dir():
        raise SettingsError(f"Configuration directory {config} does not exist; give one that holds <navigator>.yaml files.")
    return {name: _build(name, *registry[name], config) for name in names}


def _build(name: str, settings_class: type, navigator_class: type[Navigator], config: Path | None) -> Navigator:
    path = (config or config_files.config_dir()) / f"{name}.yaml"
    if config is None and not path.exists():
        return navigator_class(settings_class())
    return navigator_class(config_files.load_settings(settings_class, path, name))
