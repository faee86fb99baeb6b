"""What the calibration jobs of sensors at rest share: options, columns out of a recording, and what is printed and written."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.base.settings import nearest
from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.base.units import DEGREE, DEGREE_PER_HOUR, MILLI_G
from lowcostnav_ros.calibration.record import CalibrationError, checked_record, regular_rate
from lowcostnav_ros.cli import calibrate_input as files
from lowcostnav_ros.cli.options import add_reading, check_folder
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

if TYPE_CHECKING:  # what works is imported by those that work: the options show at once
    from lowcostnav_ros.calibration.imu_look import ImuLook
    from lowcostnav_ros.cli.calibrate_input import Columns

STILL_DPS, STILL_MG = 1.0, 30.0
"""One-second means that range over more are of a unit that moves, deg/s and milli-g."""
ACCEL_UNITS = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": MILLI_G}
FITS = 1.6
"""A model that misses by a larger factor is not to be used."""
UNITS = ("rad/s", "deg/s", "deg/h", "m/s^2", "g", "mg")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``allan`` and ``identify``."""
    parser.add_argument("source", metavar="BAG|CSV", help="recording at rest: a bag, or a table with a header line")
    parser.add_argument("--topic", default="imu/data_raw", help="inertial topic of a bag (default: imu/data_raw)")
    add_reading(parser)
    parser.add_argument("--column", metavar="A,B,C", help="columns to use (default: all but the time)")
    parser.add_argument("--unit", choices=UNITS, help="unit of the columns of a table; needed for the profile")
    parser.add_argument("--rate", type=float, metavar="HZ", help="sampling rate of a table without a time column")
    parser.add_argument("-o", "--output", metavar="DIR", help="write chart, numbers and profile there")


def inertial(arguments: argparse.Namespace) -> "tuple[Columns, float]":
    """Columns of a recording and their sampling rate, Hz."""
    check_folder(arguments.output)
    wanted = split(arguments.column) if arguments.column else None
    if not files.is_table(arguments.source):
        columns = files.read_topic(arguments, files.INERTIAL)
        if wanted:
            columns = _chosen(columns, wanted)
    else:
        columns = files.read_table(arguments.source, wanted, arguments.unit or "")
    if columns.stamps_s is not None:
        return columns, regular_rate(columns.stamps_s, arguments.source if files.is_table(arguments.source) else arguments.topic)
    if arguments.rate is None:
        raise CalibrationError(f"{arguments.source} has no time column such as t or time_s; give the sampling rate with --rate.")
    return columns, arguments.rate


def _chosen(columns: "Columns", wanted: list[str]) -> "Columns":
    for name in wanted:
        if name not in columns.values:
            raise CalibrationError(f"The topic has no axis '{name}'{nearest(name, columns.values)}.")
    return replace(columns, values={name: columns.values[name] for name in wanted})


def look(columns: "Columns") -> "ImuLook | None":
    """What a recording of both triads shows at a look; None for anything else."""
    from lowcostnav_ros.calibration.imu_look import look_at

    names = [f"{triad}{axis}" for triad in files.INERTIAL for axis in "xyz"]
    if columns.stamps_s is None or any(name not in columns.values for name in names):
        return None
    values = {triad: np.column_stack([columns.values[f"{triad}{axis}"] for axis in "xyz"]) for triad in files.INERTIAL}
    by_attribute = {attribute: values[triad] for triad, (_, attribute) in files.INERTIAL.items()}
    stamps_ns = np.round(1e9 * columns.stamps_s).astype(np.int64)
    return look_at(ImuBlock.of("imu/data_raw", stamps_ns, by_attribute["specific_force_b"], by_attribute["angular_rate_b"]))


def require_rest(columns: "Columns", rate_hz: float) -> None:
    """Refuse a recording in motion, which an error model would take for drift.

    Raises
    ------
    CalibrationError
    """
    from lowcostnav_ros.calibration.profile_text import GYRO_UNITS

    for name, values in columns.values.items():
        unit = columns.units[name]
        most, factor = (STILL_DPS, GYRO_UNITS[unit] / DEGREE) if unit in GYRO_UNITS else (STILL_MG, ACCEL_UNITS.get(unit, 0.0) / MILLI_G)
        count = max(1, round(rate_hz))
        seconds = values[: len(values) // count * count].reshape(-1, count).mean(axis=1) * factor
        moved = float(np.ptp(np.quantile(seconds, [0.02, 0.98]))) if len(seconds) > 1 else 0.0
        if moved > most:
            words = f"{moved:.3g} {'deg/s' if unit in GYRO_UNITS else 'mg'}"
            raise CalibrationError(
                f"{columns.source} is not at rest: one-second means of {name} range over {words}; take a stretch at rest "
                "(lowcostnav identify shows what can be seen in motion)."
            )


def judge(misses: dict[str, tuple[float, float]]) -> tuple[bool, str]:
    """Return whether a model can be trusted, and a sentence on by how much it misses what was measured."""
    name = max(misses, key=lambda name: misses[name][0])
    factor, at_s = misses[name]
    if factor <= FITS:
        return True, f"verdict: the model holds within {100.0 * (factor - 1.0):.0f} % ({name} at {at_s:.3g} s)"
    words = f"verdict: NOT TO BE USED, the model misses {name} at {at_s:.3g} s by a factor of {factor:.2g}: disturbance, or no white noise."
    return False, words


def named(values: np.ndarray, rate_hz: float, name: str) -> np.ndarray:
    """Values of a column, checked to be usable."""
    return checked_record(values, rate_hz, f"'{name}'")


def split(text: str) -> list[str]:
    """Parts of a list of names."""
    return [part.strip() for part in text.split(",") if part.strip()]


def out_dir(arguments: argparse.Namespace) -> Path | None:
    """The folder to write to, made where it is not there; None when none was asked for."""
    if arguments.output is None:
        return None
    out = Path(arguments.output)
    out.mkdir(parents=True, exist_ok=True)
    return out


def heads_in(columns: "Columns", heads: tuple[str, ...]) -> tuple[str, ...]:
    """Heads of a table with the unit of the columns in place of ``u``, where they have one in common."""
    units = set(columns.units.values())
    return tuple(head.replace("[u", f"[{unit}") for unit in units for head in heads) if len(units) == 1 and "" not in units else heads


def print_columns(heads: tuple[str, ...], rows: list[tuple], columns: "Columns") -> None:
    """Print a row for each column, and what the unit is."""
    from lowcostnav_ros.report.terminal import print_report

    units = ", ".join(sorted({unit for unit in columns.units.values() if unit})) or "the unit of the columns (give it with --unit)"
    told = f"u is {units}; {columns.source}" if any("[u" in head for head in heads) else columns.source
    table = Table.plain("", heads, [(row[0], *(f"{value:.4g}" for value in row[1:])) for row in rows])
    print_report("", [table], [told, *columns.notes])


def graded(drifts: dict[str, float], columns: "Columns") -> list[str]:
    """Of what grade the gyros are by their drift, in a sentence, if there are any; a recording at rest does not show the turn-on bias."""
    from lowcostnav_ros.calibration.profile_text import GYRO_UNITS
    from lowcostnav_ros.sensors.imu_grade import grade

    gyros = {n: sigma * GYRO_UNITS[columns.units[n]] / DEGREE_PER_HOUR for n, sigma in drifts.items() if columns.units[n] in GYRO_UNITS}
    worst = max(gyros, key=lambda name: gyros[name], default=None)
    if worst is None or gyros[worst] <= 0.0:
        return []
    return [f"gyro drift of {gyros[worst]:.3g} deg/h ({worst}): {grade(gyros[worst])} grade at best; the turn-on bias may be larger."]


def write_numbers(path: Path, heads: tuple[str, ...], rows: list[tuple]) -> None:
    """Write the numbers of a table as CSV."""
    lines = [",".join(heads), *(",".join([row[0], *(f"{value:.9g}" for value in row[1:])]) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def quantity(unit: str) -> str:
    """What a unit is of."""
    return {"rad/s": "gyro", "deg/s": "gyro", "deg/h": "gyro", "": "columns"}.get(unit, "accelerometer")


def write_profile(out: Path, how: str, numbers: dict[str, tuple], columns: "Columns", rate_hz: float) -> None:
    """Write what was found as the numbers of an IMU profile."""
    from lowcostnav_ros.calibration.profile_text import profile_text

    source = f"{how} of {columns.source}, {len(next(iter(columns.values.values()))) / rate_hz / 3600.0:.2f} h at {rate_hz:.6g} Hz"
    text = profile_text(numbers, columns.units, rate_hz, source)
    (out / "profile.yaml").write_text(text, encoding="utf-8")
    print(f"chart, numbers and profile in {out}")
