"""Magnetic headings beside known ones, for a swing: from a table, or from a bag with attitudes."""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, MagneticField
from lowcostnav_ros.calibration.record import CalibrationError

if TYPE_CHECKING:  # what works is imported by those that work: the options show at once
    from lowcostnav_ros.cli.calibrate_input import Columns

LEVEL_DEG, NEAR_S, SECTOR_DEG = 5.0, 0.05, 2.0
"""A swing is of level attitudes; a field belongs to an attitude this near in time; attitudes are averaged over sectors of this width, so
that a heading at which the aircraft stood long counts once."""


@dataclass(frozen=True, eq=False)
class Swung:
    """Known and measured magnetic headings (n,), rad, and where and when they were taken."""

    heading: np.ndarray
    measured: np.ndarray
    columns: "Columns"


def read_swing(arguments: argparse.Namespace) -> Swung:
    """Read a swing as ``magcal`` was asked to.

    A table has the columns ``heading``, magnetic, and ``measured``, degrees; or ``heading`` and the field forward, right, down, level.
    A bag has fields and the attitudes of :attr:`arguments.reference`, true; declination is that of the magnetic model.

    Raises
    ------
    CalibrationError, BagError
        For missing columns, topics, place or date.
    """
    from lowcostnav_ros.cli.calibrate_input import is_table, read_table
    from lowcostnav_ros.cli.calibrate_rest import split

    if not is_table(arguments.source):
        return _of_bag(arguments)
    wanted = split(arguments.column or "heading,measured")
    columns = read_table(arguments.source, wanted)
    values = list(columns.values.values())
    if len(values) not in (2, 4):
        raise CalibrationError("A swing needs the columns heading,measured or heading,x,y,z; name them with --column.")
    heading, measured = np.radians(values[0]), np.radians(values[1]) if len(values) == 2 else np.arctan2(-values[2], values[1])
    if arguments.last_heading is not None and len(heading):  # equal turns from an unknown heading (Gebre 2004, equations 3.54 and 3.55)
        heading = heading + (math.radians(arguments.last_heading) - heading[-1])
    return Swung(heading, measured, columns)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Known and measured magnetic headings (n,), rad, at the stamps of the attitudes, s, with the larger of roll and pitch, rad."""

    stamps_s: np.ndarray
    known: np.ndarray
    measured: np.ndarray
    tilt: np.ndarray
    columns: "Columns"


def read_pairs(arguments: argparse.Namespace, apply: Callable[[np.ndarray], np.ndarray] = lambda field: field) -> Pairs:
    """Headings of a bag's fields, levelled by the attitudes of :attr:`arguments.reference` nearest in time, beside theirs.

    Parameters
    ----------
    arguments : Namespace
        With ``source``, ``topic``, ``reference``, ``place``, ``date`` and the options of reading.
    apply : callable
        Calibration of the fields.
    """
    from lowcostnav_ros.cli.calibrate_input import Columns
    from lowcostnav_ros.messages.bag import BagReader
    from lowcostnav_ros.messages.decode import Decoder
    from lowcostnav_ros.messages.foreign import parse_maps
    from lowcostnav_ros.messages.rules import DecodeRules
    from lowcostnav_ros.physics.geomagnetism import declination_of, field_n, year_of_stamp
    from lowcostnav_ros.physics.magnetic_heading import magnetic_heading
    from lowcostnav_ros.physics.rotation import quat_to_euler

    rules, maps = DecodeRules(everywhere=tuple(arguments.frame)), parse_maps(arguments.map)
    with BagReader(arguments.source, Decoder(rules), maps) as reader:
        reader.require((arguments.topic, arguments.reference))
        read: list[Any] = list(reader.measurements((arguments.topic, arguments.reference)))
        fix: Any = next(reader.measurements(["gps/fix"]), None) if "gps/fix" in reader.decodable() else None
    fields, attitudes = [m for m in read if isinstance(m, MagneticField)], [m for m in read if isinstance(m, Attitude)]
    if not fields or not attitudes:
        found = f"{len(fields)} fields on {arguments.topic} and {len(attitudes)} attitudes on {arguments.reference}"
        raise CalibrationError(f"Headings need fields and attitudes to compare; the bag holds {found}.")
    place = arguments.place or (None if fix is None else (fix.lat, fix.lon, fix.height))
    year = arguments.date or year_of_stamp(fields[0].stamp_ns)
    if place is None or year is None:
        raise CalibrationError("Attitudes are true and fields magnetic: give --place, or --date, which the bag does not hold.")
    try:
        declination = declination_of(field_n(place[0], place[1], place[2], year))
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    stamps, rows = np.array([m.stamp_ns for m in fields]), []
    for attitude in attitudes:
        field = fields[int(np.argmin(np.abs(stamps - attitude.stamp_ns)))]
        if abs(attitude.stamp_ns - field.stamp_ns) <= 1e9 * NEAR_S:
            roll, pitch, true = quat_to_euler(attitude.q_nb)
            measured = magnetic_heading(roll, pitch, apply(field.field_b), 0.0)
            rows.append((1e-9 * (attitude.stamp_ns - attitudes[0].stamp_ns), true - declination, measured, max(abs(roll), abs(pitch))))
    if not rows:
        raise CalibrationError(f"No field of {arguments.topic} lies within {NEAR_S:g} s of an attitude of {arguments.reference}.")
    stamps_s, known, levelled, tilt = np.array(rows).T
    return Pairs(stamps_s, known, levelled, tilt, Columns(Path(arguments.source).name, {}, {}, None, place, year))


def _of_bag(arguments: argparse.Namespace) -> Swung:
    """Level headings of a bag, averaged by sector."""
    from lowcostnav_ros.physics.rotation import wrap

    pairs = read_pairs(arguments)
    level = pairs.tilt < math.radians(LEVEL_DEG)
    if not np.any(level):
        raise CalibrationError(f"No attitude is level to {LEVEL_DEG:g} deg; stand level at each heading.")
    known, error = wrap(pairs.known[level]), wrap(pairs.measured - pairs.known)[level]
    sector = np.floor(np.degrees(known) / SECTOR_DEG)
    heading, mean = np.array([[values[sector == one].mean() for one in np.unique(sector)] for values in (known, error)])
    return Swung(heading, heading + mean, pairs.columns)
