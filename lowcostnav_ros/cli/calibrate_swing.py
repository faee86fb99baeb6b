"""Magnetic headings beside known ones, for a swing: from a table, or from a bag with attitudes."""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, MagneticField
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.cli.calibrate_input import Columns, read_table
from lowcostnav_ros.cli.calibrate_rest import split
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.decode import Decoder
from lowcostnav_ros.messages.foreign import parse_maps
from lowcostnav_ros.messages.rules import DecodeRules
from lowcostnav_ros.physics.geomagnetism import declination_of, field_n, year_of_stamp
from lowcostnav_ros.physics.magnetic_heading import magnetic_heading
from lowcostnav_ros.physics.rotation import quat_to_euler, wrap

LEVEL_DEG, NEAR_S, SECTOR_DEG = 5.0, 0.05, 2.0
"""A swing is of level attitudes; a field belongs to an attitude this near in time; attitudes are averaged over sectors of this width, so
that a heading at which the aircraft stood long counts once."""


@dataclass(frozen=True, eq=False)
class Swung:
    """Known and measured magnetic headings (n,), rad, and where and when they were taken."""

    heading: np.ndarray
    measured: np.ndarray
    columns: Columns


def read_swing(arguments: argparse.Namespace) -> Swung:
    """Read a swing as ``magcal`` was asked to.

    A table has the columns ``heading``, magnetic, and ``measured``, degrees; or ``heading`` and the field forward, right, down, level.
    A bag has fields and the attitudes of :attr:`arguments.reference`, true; declination is that of the magnetic model.

    Raises
    ------
    CalibrationError, BagError
        For missing columns, topics, place or date.
    """
    if not arguments.source.lower().removesuffix(".gz").endswith((".csv", ".txt", ".dat")):
        return _of_bag(arguments)
    wanted = split(arguments.column or "heading,measured")
    columns = read_table(arguments.source, wanted)
    values = list(columns.values.values())
    if len(values) not in (2, 4):
        raise CalibrationError("A swing needs the columns heading,measured or heading,x,y,z; name them with --column.")
    heading, measured = np.radians(values[0]), np.radians(values[1]) if len(values) == 2 else np.arctan2(-values[2], values[1])
    if arguments.last_heading is not None and len(heading):
        heading = heading + (math.radians(arguments.last_heading) - heading[-1])
    return Swung(heading, measured, columns)


def _of_bag(arguments: argparse.Namespace) -> Swung:
    rules, maps = DecodeRules(everywhere=tuple(arguments.frame)), parse_maps(arguments.map)
    with BagReader(arguments.source, Decoder(rules), maps) as reader:
        reader.require((arguments.topic, arguments.reference))
        read: list[Any] = list(reader.measurements((arguments.topic, arguments.reference)))
        fix: Any = next(reader.measurements(["gps/fix"]), None) if "gps/fix" in reader.decodable() else None
    fields, attitudes = ([m for m in read if isinstance(m, kind)] for kind in (MagneticField, Attitude))
    if not fields or not attitudes:
        raise CalibrationError(f"A swing needs fields on {arguments.topic} and attitudes on {arguments.reference}; got {len(fields)} and "
                               f"{len(attitudes)}.")  # fmt: skip
    place = arguments.place or (None if fix is None else (fix.lat, fix.lon, fix.height))
    year = arguments.date or year_of_stamp(fields[0].stamp_ns)
    if place is None or year is None:
        raise CalibrationError("Attitudes are true and fields magnetic: give --place, or --date, which the bag does not hold.")
    try:
        declination = declination_of(field_n(place[0], place[1], place[2], year))
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    heading, measured = _paired(fields, attitudes, declination)
    return Swung(heading, measured, Columns(Path(arguments.source).name, {}, {}, None, place, year))


def _paired(fields: list[Any], attitudes: list[Any], declination: float) -> tuple[np.ndarray, np.ndarray]:
    """Known and measured magnetic headings by sector, rad."""
    stamps = np.array([a.stamp_ns for a in attitudes])
    sectors: dict[int, list[tuple[float, float]]] = {}
    for field in fields:
        attitude = attitudes[int(np.argmin(np.abs(stamps - field.stamp_ns)))]
        roll, pitch, true = quat_to_euler(attitude.q_nb)
        if abs(attitude.stamp_ns - field.stamp_ns) <= 1e9 * NEAR_S and max(abs(roll), abs(pitch)) < math.radians(LEVEL_DEG):
            known = float(wrap(true - declination))
            error = float(wrap(magnetic_heading(roll, pitch, field.field_b, 0.0) - known))
            sectors.setdefault(int(math.degrees(known) // SECTOR_DEG), []).append((known, error))
    if not sectors:
        raise CalibrationError(f"No field lies within {NEAR_S:g} s of an attitude level to {LEVEL_DEG:g} deg; stand level at each heading.")
    known, error = np.array([np.mean(pairs, axis=0) for _, pairs in sorted(sectors.items())]).T
    return known, known + error
