"""Read columns of numbers for the calibration jobs: from a bag's sensor topics or from a CSV table."""

import argparse
import gzip
import io
import re
import warnings
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.documents import cells_of, delimiter_of, foreign_text
from lowcostnav_ros.base.settings import nearest
from lowcostnav_ros.calibration.record import CalibrationError

_HEADS, _ENDS = ("t", "time", "stamp", "timestamp"), {"": 0.0, "_s": 1.0, "_ms": 1e-3, "_us": 1e-6, "_ns": 1e-9}
TIME_NAMES = {head + end: unit for head in _HEADS for end, unit in _ENDS.items()} | {"t": 1.0, "time": 0.0, "seconds": 1.0}
"""Names of a time column and what one unit of it is in seconds; 0 where the name does not say."""
_NO_RATE = re.compile(
    r"temp|press|baro|humid|alt|lat\b|lon|volt|mag|count|seq|index|unnamed|date|quat|status|valid|^id$|^$|\[(degc|k|pa|hpa|ut)\]"
)
"""Names of columns that hold neither a rate nor a specific force."""
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
    notes : tuple of str
        What a reader should know of the choice of columns.
    """

    source: str
    values: dict[str, np.ndarray]
    units: dict[str, str]
    stamps_s: np.ndarray | None
    place: tuple[float, float, float] | None = None
    decimal_year: float | None = None
    notes: tuple[str, ...] = ()


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
    from lowcostnav_ros.messages.bag import BagReader
    from lowcostnav_ros.messages.decode import Decoder
    from lowcostnav_ros.messages.foreign import parse_maps
    from lowcostnav_ros.messages.rules import DecodeRules
    from lowcostnav_ros.physics.geomagnetism import year_of_stamp

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
    names, delimiter, rows_text = _split(path)
    lower = [name.lower() for name in names]
    time = next((k for k, name in enumerate(lower) if name.partition("[")[0].strip() in TIME_NAMES), None)
    notes: tuple[str, ...] = ()
    if wanted is None:
        other = [name for name in names if _NO_RATE.search(name.lower())]
        wanted = [name for k, name in enumerate(names) if k != time and name not in other]
        notes = (f"not looked at: {', '.join(n or '(no name)' for n in other)}; name columns with --column",) if other else ()
    for name in wanted:
        if name not in names:
            raise CalibrationError(f"{path} has no column '{name}'{nearest(name, names)}.")
    places = [names.index(name) for name in wanted] + ([] if time is None else [time])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty table is refused below, in our words
            given = None if delimiter == "whitespace" else delimiter
            rows = np.loadtxt(io.StringIO(rows_text), delimiter=given, usecols=places, ndmin=2, quotechar='"')
    except (ValueError, OverflowError) as error:
        raise CalibrationError(f"{path}: a cell is not a number ({error}); correct it, or choose other columns with --column.") from error
    if len(rows) == 0:
        raise CalibrationError(f"{path} holds no rows below its header; check the recording.")
    stamps_s = None if time is None else (rows[:, -1] - rows[0, -1]) * _time_unit(path, names[time], rows[:, -1])
    values = {name: rows[:, k] for k, name in enumerate(wanted)}
    return Columns(Path(path).name, values, dict.fromkeys(wanted, unit), stamps_s, notes=notes)


def _time_unit(path: str, name: str, values: np.ndarray) -> float:
    """Seconds in one unit of a time column, by its name, or else by the size that a time since 1970 has."""
    plain, _, bracket = name.lower().partition("[")
    stated = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}.get(bracket.strip(" ]"), TIME_NAMES[plain.strip()])
    if stated:
        return stated
    largest = float(np.max(np.abs(values), initial=0.0))
    by_size = next((unit for least, unit in ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3)) if largest >= least), 1.0)
    if by_size == 1.0 and len(values) > 1 and np.all(values % 1.0 == 0.0) and np.median(np.diff(values)) >= 2.0:
        raise CalibrationError(f"{path}: the unit of '{name}' is not clear; call the column t_s, t_ms, t_us or t_ns.")
    return by_size


def _split(path: str) -> tuple[list[str], str, str]:
    """Names of the columns, what separates them, and the text of the rows."""
    from lowcostnav_ros.convert.table import is_number

    try:
        raw = Path(path).read_bytes()
        text = foreign_text(gzip.decompress(raw) if path.endswith(".gz") else raw)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise CalibrationError(f"{path}: the compressed file is damaged ({error}); get it again.") from error
    at, header = 0, ""
    for line in text.splitlines(keepends=True):
        plain = line.strip()
        if plain and not plain.startswith("#"):
            if not any(is_number(cell) for cell in cells_of(plain, delimiter_of(plain))):
                header, at = plain, at + len(line)
            break
        at += len(line)
        header = plain.lstrip("#").strip() or header
    delimiter = delimiter_of(header)
    names = cells_of(header, delimiter)
    if not header or any(is_number(name) for name in names):
        raise CalibrationError(f"{path} needs a header line with the names of its columns, separated by commas.")
    return names, delimiter, text[at:].replace(",", ".") if delimiter == ";" else text[at:]
