"""Checks of options that several jobs share."""

import argparse
import math
import os
import re
from pathlib import Path

from lowcostnav_ros.base.settings import SettingsError


def add_reading(parser: argparse.ArgumentParser) -> None:
    """Add the options by which a recording of another system is read."""
    text = "read a recorded topic as one of ours (fix=gps/fix; uav1/= drops a namespace); repeatable"
    parser.add_argument("--map", action="append", default=[], metavar="TOPIC=OURS", help=text)
    text = "accept this frame id of every source, 'any' for all; repeatable"
    parser.add_argument("--frame", action="append", default=[], metavar="FRAME", help=text)


def add_tracks(parser: argparse.ArgumentParser) -> None:
    """Add the options that write tracks for other viewers."""
    parser.add_argument("--kml", metavar="FILE", help="write the tracks as KML, for Google Earth, too")
    parser.add_argument("--gpx", metavar="FILE", help="write the tracks as GPX too")


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add the option that says who shares the work of a study."""
    text = "processes, or the address of a dask scheduler, such as tcp://host:8786 (default: every core); the numbers do not depend on it"
    parser.add_argument("--workers", metavar="N|ADDRESS", help=text)


def workers_of(arguments: argparse.Namespace) -> int | str | None:
    """Return who shares the work, None for every core.

    Raises
    ------
    SettingsError
        When the option is neither a number of processes nor an address.
    """
    from lowcostnav_ros.studies.campaign import parse_workers

    return None if arguments.workers is None else parse_workers(arguments.workers)


def check_files(*paths: str | None) -> None:
    """Refuse, before the work, files that cannot be written.

    Raises
    ------
    SettingsError
    """
    for path in filter(None, paths):
        folder = Path(path).resolve().parent
        if not folder.is_dir():
            raise SettingsError(f"The folder of {path} does not exist; create it first.")
        if Path(path).is_dir():
            raise SettingsError(f"{path} is a folder; name a file in it.")
        if not os.access(path if Path(path).exists() else folder, os.W_OK):
            raise SettingsError(f"{path} cannot be written; check its permissions.")


def check_folder(path: str | None) -> None:
    """Refuse, before the work, a folder that cannot be made or written into.

    Raises
    ------
    SettingsError
    """
    if path:
        there = next(p for p in (Path(path).resolve(), *Path(path).resolve().parents) if p.exists())
        if not there.is_dir():
            raise SettingsError(f"{there} is no folder; give another place for {path}.")
        if not os.access(there, os.W_OK):
            raise SettingsError(f"{path} cannot be written; check the permissions of {there}.")


def let_values_begin_with_minus(parser: argparse.ArgumentParser) -> None:
    """Let ``--place -33.97,18.6`` be a value: argparse takes only plain negative numbers for one, and half the world is south."""
    parser._negative_number_matcher = re.compile(r"-\.?\d[-\d.,;\s]*$")


def place_of(text: str, option: str) -> tuple[float, float, float]:
    """Return latitude, longitude (rad) and height (m, 0 where none is given) of a place: ``LAT,LON[,M]``, degrees, or ``KLVK[,M]``.

    Raises
    ------
    SettingsError
    """
    head, comma, rest = text.strip().partition(",")
    if re.fullmatch("[A-Z]{4}", head):
        from lowcostnav_ros.catalogue.background import airport_named

        airport = airport_named(head)
        if airport is None:
            raise SettingsError(f"{option}: no airport {head} is known here; write LAT,LON[,M] in degrees and metres.")
        text = f"{airport.lat_deg},{airport.lon_deg}{comma}{rest}"
    try:
        lat_deg, lon_deg, height, *further = [*map(float, text.split(",")), *([0.0] * (text.count(",") == 1))]
    except ValueError:
        further = [0.0]
    if further:
        how = "write LAT,LON[,M] in degrees and metres, as in 37.4,-122.1, or KLVK[,M]"
        raise SettingsError(f"{option}: '{text.strip()}' is not a place; {how}.")
    between(option, lat_deg, -90.0, 90.0)
    between(option, lon_deg, -180.0, 360.0)
    return math.radians(lat_deg), math.radians(lon_deg), between(option, height, -1000.0, 20_000.0)


def between(option: str, value: float, low: float, high: float) -> float:
    """Return a value that lies between two.

    Raises
    ------
    SettingsError
    """
    if not low <= value <= high:
        raise SettingsError(f"{option}: {value:g} must lie between {low:g} and {high:g}.")
    return value
