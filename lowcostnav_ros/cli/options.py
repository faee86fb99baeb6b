"""Checks of options that several jobs share."""

from pathlib import Path

from lowcostnav_ros.base.settings import SettingsError


def check_folders(*paths: str | None) -> None:
    """Refuse files to write whose folder does not exist.

    Raises
    ------
    SettingsError
    """
    for path in paths:
        if path and not Path(path).resolve().parent.is_dir():
            raise SettingsError(f"The folder of {path} does not exist; create it first.")


def between(option: str, value: float, low: float, high: float) -> float:
    """Return a value that lies between two.

    Raises
    ------
    SettingsError
    """
    if not low <= value <= high:
        raise SettingsError(f"{option}: {value:g} must lie between {low:g} and {high:g}.")
    return value
