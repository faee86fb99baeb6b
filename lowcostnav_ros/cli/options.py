"""Checks of options that several jobs share."""

import argparse
from pathlib import Path

from lowcostnav_ros.base.settings import SettingsError


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add the options by which a recording of another system is read."""
    text = "read a recorded topic as one of ours (fix=gps/fix; uav1/= drops a namespace); repeatable"
    parser.add_argument("--map", action="append", default=[], metavar="TOPIC=OURS", help=text)
    text = "accept this frame id of every source, 'any' for all; repeatable"
    parser.add_argument("--frame", action="append", default=[], metavar="FRAME", help=text)


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
