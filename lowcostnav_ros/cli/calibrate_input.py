"""Read columns of numbers for the calibration jobs: from a bag's sensor topics or from a CSV table."""

import argparse
import gzip
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.settings import nearest
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.convert.table import is_number
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.decode import Decoder
from lowcostnav_ros.messages.foreign import parse_maps
from lowcostnav_ros.messages.rules import DecodeRules
from lowcostnav_ros.physics.geomagnetism import year_of_stamp

_SECONDS = dict.fromkeys(("t", "t_s", "time", "time_s", "stamp_s"), 1.0)
TIME_NAMES = _SECONDS | {"stamp_ns": 1e-9, "t_ns": 1e-9, "t_ms": 1e-3, "time_ms": 1e-3}
"""Names of a time column and what one unit of it is in seconds."""
INERTIAL = {"gyro_": ("rad/s", "angular_rate_b"), "accelerometer_": ("m/s^2", "specific_force_b")}
MAGNETIC = {"": ("T", "field_b")}


@dataclass(frozen=True, eq=False)
class Columns:
    """Named columns of one recording.

    Attributes
    ----------
    source : str
        File name, for display.
    values : dict of str to ndarray (n,)
    units : dict of str to str
        Unit of each column, empty where unknown.
    stamps_s : ndarray (n,) or None
    place : (float, float, float) or None
        Latitude, longitude (rad) and height (m) of the first position fix.
    decimal_year : float or None
    """

    source: str
    values: dict[str, np.ndarray]
    units: dict[str, str]
    stamps_s: np.ndarray | None
    place: tuple[float, float, float] | None = None
    decimal_year: float | None = None


def is_table(path: str) -> bool:
    """Whether a path names a text table rather than a bag."""
    return path.lower().removesuffix(".gz").endswith((".csv", ".txt", ".dat"))


def read_topic(arguments: argparse.Namespace, triads: Mapping[str, tuple[str, str]]) -> Columns:
    """Read the axes of a sensor's topic of a bag, with the place of its first position fix, where it has one, and the date.

    Parameters
    ----------
    arguments : Namespace
        With ``source``, the bag, ``topic``, and the options of :func:`~lowcostnav_ros.cli.options.add_reading`.
    triads : mapping of str to (str, str)
        What the names of three columns begin with, to their unit and the attribute of the samples.
    """
    path, topic = arguments.source, arguments.topic
    rules, maps = DecodeRules(everywhere=tuple(arguments.frame)), parse_maps(arguments.map)
    with BagReader(path, Decoder(rules), maps) as reader:
        samples: list[Any] = list(reader.measurements([topic]))
        if not samples:
            raise reader.nothing((topic,))
        fix: Any = next(reader.measurements(["gps/fix"]), None) if "gps/fix" in reader.decodable() else None
    stamps_ns = np.hstack([getattr(s, "stamps_ns", s.stamp_ns) for s in samples])
    values, units = {}, {}
    for triad, (unit, name) in triads.items():
        rows = np.vstack([getattr(s, name) for s in samples])
        for axis, letter in enumerate("xyz"):
            values[triad + letter], units[triad + letter] = rows[:, axis], unit
    place = (fix.lat, fix.lon, fix.height) if fix is not None else None
    return Columns(Path(path).name, values, units, (stamps_ns - stamps_ns[0]) * 1e-9, place, year_of_stamp(int(stamps_ns[0])))


def read_table(path: str, wanted: list[str] | None, unit: str = "") -> Columns:
    """Read columns of a CSV table with a header line (``.gz`` too).

    Parameters
    ----------
    path : str
    wanted : list of str, optional
        Columns to read; all but the time where None.
    unit : str
        Unit of the columns, empty where unknown.

    Raises
    ------
    CalibrationError
        For a missing column or a cell that is not a number, with its line.
    """
    names = _header(path)
    time = next((name for name in names if name.lower() in TIME_NAMES), None)
    wanted = [name for name in names if name != time] if wanted is None else wanted
    for name in wanted:
        if name not in names:
            raise CalibrationError(f"{path} has no column '{name}'{nearest(name, names)}.")
    columns = [names.index(name) for name in [*wanted, *([time] if time else [])]]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty table is refused below, in our words
            rows = np.loadtxt(path, delimiter=",", skiprows=1, usecols=columns, ndmin=2)
    except ValueError as error:
        raise CalibrationError(f"{path}: a cell is not a number ({error}); correct it, or choose other columns with --column.") from error
    if len(rows) == 0:
        raise CalibrationError(f"{path} holds no rows below its header; check the recording.")
    stamps_s = (rows[:, -1] - rows[0, -1]) * TIME_NAMES[time.lower()] if time else None
    values = {name: rows[:, k] for k, name in enumerate(wanted)}
    return Columns(Path(path).name, values, dict.fromkeys(wanted, unit), stamps_s)


def _header(path: str) -> list[str]:
    with gzip.open(path, "rt", encoding="utf-8") if path.endswith(".gz") else open(path, encoding="utf-8") as file:
        first = file.readline().lstrip("#").strip()
    names = [name.strip() for name in first.split(",")]
    if not first or any(is_number(name) for name in names):
        raise CalibrationError(f"{path} needs a header line with the names of its columns, separated by commas.")
    return names
