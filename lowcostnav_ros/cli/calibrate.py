"""The calibration jobs: allan, identify, magcal; from a recording to numbers, a chart and the YAML a node or profile loads."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerFit
    from lowcostnav_ros.cli.calibrate_input import Columns

METHODS = ("two-step", "batch", "known-strength", "level-turn")
_UNITS = ("rad/s", "deg/s", "deg/h", "m/s^2", "g", "mg")
_MAG_UNITS = ("T", "G", "mG", "uT", "nT")


def add_parsers(jobs: argparse._SubParsersAction) -> None:
    """Declare ``lowcostnav allan``, ``identify`` and ``magcal``."""
    allan_text = "Allan deviation of inertial sensors at rest: chart, coefficients, and the numbers of an IMU profile."
    identify_text = "Error model of sensors at rest by mean, scatter and autocorrelation, as numbers of an IMU profile."
    for name, text in (("allan", allan_text), ("identify", identify_text)):
        job = jobs.add_parser(name, help=text, description=text)
        job.add_argument("source", metavar="BAG|CSV", help="recording at rest: a bag, or a table with a header line")
        job.add_argument("--topic", default="imu/data_raw", help="inertial topic of a bag (default: imu/data_raw)")
        job.add_argument("--column", metavar="A,B,C", help="columns to use (default: all but the time)")
        job.add_argument("--unit", choices=_UNITS, help="unit of the columns of a table; needed for the profile")
        job.add_argument("--rate", type=float, metavar="HZ", help="sampling rate of a table without a time column")
        job.add_argument("-o", "--output", metavar="DIR", help="write chart, numbers and profile there")
    text = "Calibrate a magnetometer from a turn or a flight: hard iron, scale factors, and how far to trust them."
    job = jobs.add_parser("magcal", help=text, description=text)
    job.add_argument("source", metavar="BAG|CSV", help="recording with the attitudes to calibrate from")
    job.add_argument("--topic", default="imu/mag", help="magnetometer topic of a bag (default: imu/mag)")
    job.add_argument("--column", metavar="X,Y,Z", default="x,y,z", help="columns forward, right, down of a table (default: x,y,z)")
    job.add_argument("--unit", choices=_MAG_UNITS, help="unit of a table (default: told from the magnitude)")
    job.add_argument("--strength", type=float, metavar="UT", help="earth field strength, microtesla (level-turn: the horizontal one)")
    job.add_argument("--place", metavar="LAT,LON[,M]", help="degrees and metres, for the magnetic model (default: the bag's first fix)")
    job.add_argument("--date", type=float, metavar="YEAR", help="decimal year for the magnetic model (default: of the bag)")
    job.add_argument("--method", choices=METHODS, default="two-step", help="how to fit (default: two-step)")
    job.add_argument("--min-coverage", type=float, default=15.0, metavar="DEG", help="refuse free fits from less tilt (default: 15)")
    job.add_argument("-o", "--output", metavar="FILE.yaml", help="write the calibration, and a chart beside it")


def allan(arguments: argparse.Namespace) -> int:
    """Charts and numbers of every column."""
    from lowcostnav_ros.calibration.allan import allan_chart
    from lowcostnav_ros.calibration.allan_fit import fit_chart
    from lowcostnav_ros.cli import calibrate_charts as charts

    columns, rate_hz = _inertial(arguments)
    results: dict[str, Any] = {}
    for name, values in columns.values.items():
        chart = allan_chart(_named(values, rate_hz, name), rate_hz)
        results[name] = (chart, fit_chart(chart))
    fits = {name: fit for name, (_, fit) in results.items()}
    rows = [
        (name, f.white_density, f.drift_sigma, f.drift_tau_s, f.bias_instability, f.minimum_s, f.random_walk) for name, f in fits.items()
    ]
    heads = ("column", "white N [u/rtHz]", "drift sigma [u]", "tau [s]", "B [u]", "minimum at [s]", "K [u/s/rtHz]")
    _print_table(heads, rows, columns)
    for name, fit in fits.items():
        if not fit.drift_tau_observed:
            print(f"{name}: the correlation time exceeds a third of the record; only sigma^2/tau is known, record longer.")
    _print_grade({name: f.drift_sigma for name, f in fits.items()}, columns)
    numbers = {name: (f.white_density, f.drift_sigma, f.drift_tau_s) for name, f in fits.items()}
    out = _out_dir(arguments)
    if out is not None:
        for unit in dict.fromkeys(columns.units.values()):
            of_unit = {n: results[n] for n in results if columns.units[n] == unit}
            charts.save(out / f"allan_{_quantity(unit)}.png", charts.allan_figure(of_unit, unit))
        _write_numbers(out / "allan.csv", heads, rows)
        _write_profile(out, "Allan deviation", numbers, columns, rate_hz)
    return 0


def identify(arguments: argparse.Namespace) -> int:
    """Mean, scatter, correlation time of every column."""
    from lowcostnav_ros.calibration.identification import identify_static
    from lowcostnav_ros.cli import calibrate_charts as charts

    columns, rate_hz = _inertial(arguments)
    found = {name: identify_static(_named(values, rate_hz, name), rate_hz) for name, values in columns.values.items()}
    rows = [
        (n, f.mean, f.mean_sigma, f.white_sigma, f.drift_sigma, f.correlation_time_s or 0.0, f.long_term_sigma or math.nan)
        for n, f in found.items()
    ]
    heads = ("column", "mean [u]", "+- [u]", "white sigma/sample [u]", "drift sigma [u]", "tau [s]", "1-min sigma [u]")
    _print_table(heads, rows, columns)
    for name, f in found.items():
        if f.correlation_time_s is not None and not f.correlation_time_sure:
            print(f"{name}: the record holds fewer than 20 correlation times; expect the true one to be longer.")
    _print_grade({name: f.drift_sigma for name, f in found.items()}, columns)
    out = _out_dir(arguments)
    if out is not None:
        for unit in dict.fromkeys(columns.units.values()):
            of_unit = {n: v for n, v in columns.values.items() if columns.units[n] == unit}
            charts.save(out / f"identify_{_quantity(unit)}.png", charts.identification_figure(of_unit, rate_hz, unit))
        numbers = {n: (f.white_density, f.drift_sigma, f.correlation_time_s or 0.0) for n, f in found.items()}
        _write_numbers(out / "identify.csv", heads, rows)
        _write_profile(out, "mean, scatter and autocorrelation", numbers, columns, rate_hz)
    return 0


def magcal(arguments: argparse.Namespace) -> int:
    """Fit, print how far to trust it, write the calibration."""
    import numpy as np

    from lowcostnav_ros.calibration import magnetometer_fit as fits
    from lowcostnav_ros.cli import calibrate_input as files

    table = files.is_table(arguments.source)
    wanted = _split(arguments.column)
    if table:
        columns = files.read_table(arguments.source, wanted, arguments.unit or "")
    else:
        columns = files.read_field(arguments.source, arguments.topic)
    if len(columns.values) != 3:
        raise fits.CalibrationError("A calibration needs three columns, forward, right, down; name them with --column.")
    raw = np.column_stack(list(columns.values.values()))
    finite = raw[np.all(np.isfinite(raw), axis=1)]
    told = next(iter(columns.units.values()))
    unit = told or fits.unit_by_magnitude(finite if len(finite) else raw)
    measured_ut = raw * fits.TESLA_PER[unit] * 1e6
    fit = _fit(arguments, measured_ut, _strength_ut(arguments, columns))
    _print_fit(fit, unit, bool(told))
    if arguments.output:
        _write_calibration(arguments, fit, measured_ut)
    return 0


def _inertial(arguments: argparse.Namespace) -> tuple["Columns", float]:
    from lowcostnav_ros.calibration.record import CalibrationError, regular_rate
    from lowcostnav_ros.cli import calibrate_input as files

    wanted = _split(arguments.column) if arguments.column else None
    if not files.is_table(arguments.source):
        columns = files.read_imu(arguments.source, arguments.topic)
        if wanted:
            columns = _chosen(columns, wanted)
        return columns, regular_rate(columns.stamps_s, arguments.topic)
    columns = files.read_table(arguments.source, wanted, arguments.unit or "")
    if columns.stamps_s is not None:
        return columns, regular_rate(columns.stamps_s, arguments.source)
    if arguments.rate is None:
        raise CalibrationError(f"{arguments.source} has no time column such as t or time_s; give the sampling rate with --rate.")
    return columns, arguments.rate


def _chosen(columns: "Columns", wanted: list[str]) -> "Columns":
    from dataclasses import replace

    from lowcostnav_ros.base.settings import nearest
    from lowcostnav_ros.calibration.record import CalibrationError

    for name in wanted:
        if name not in columns.values:
            raise CalibrationError(f"The topic has no axis '{name}'{nearest(name, columns.values)}.")
    return replace(columns, values={name: columns.values[name] for name in wanted})


def _named(values: "np.ndarray", rate_hz: float, name: str) -> "np.ndarray":
    from lowcostnav_ros.calibration.record import checked_record

    return checked_record(values, rate_hz, f"'{name}'")


def _split(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _out_dir(arguments: argparse.Namespace) -> Path | None:
    if arguments.output is None:
        return None
    out = Path(arguments.output)
    out.mkdir(parents=True, exist_ok=True)
    return out


def _print_table(heads: tuple[str, ...], rows: list[tuple], columns: "Columns") -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(*(escape(head) for head in heads), box=None)
    for row in rows:
        table.add_row(escape(row[0]), *(f"{value:.4g}" for value in row[1:]))
    console = Console(width=None if sys.stdout.isatty() else 120)
    console.print(table)
    known = {unit for unit in columns.units.values() if unit}
    units = ", ".join(sorted(known)) if known else "the unit of the columns (say which with --unit)"
    console.print(f"u is {units}; {columns.source}", highlight=False)


def _print_grade(drifts: dict[str, float], columns: "Columns") -> None:
    """Say of what grade the gyros are by their drift; a recording at rest does not show the turn-on bias."""
    from lowcostnav_ros.base.units import DEGREE_PER_HOUR
    from lowcostnav_ros.calibration.profile_text import GYRO_UNITS
    from lowcostnav_ros.sensors.imu_grade import grade

    gyros = {n: sigma * GYRO_UNITS[columns.units[n]] / DEGREE_PER_HOUR for n, sigma in drifts.items() if columns.units[n] in GYRO_UNITS}
    worst = max(gyros, key=gyros.get, default=None)
    if worst is not None and gyros[worst] > 0.0:
        print(f"gyro drift of {gyros[worst]:.3g} deg/h ({worst}): {grade(gyros[worst])} grade at best; the turn-on bias may be larger.")


def _write_numbers(path: Path, heads: tuple[str, ...], rows: list[tuple]) -> None:
    lines = [",".join(heads), *(",".join([row[0], *(f"{value:.9g}" for value in row[1:])]) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _quantity(unit: str) -> str:
    return {"rad/s": "gyro", "deg/s": "gyro", "deg/h": "gyro", "": "columns"}.get(unit, "accelerometer")


def _write_profile(out: Path, how: str, numbers: dict[str, tuple], columns: "Columns", rate_hz: float) -> None:
    from lowcostnav_ros.calibration.profile_text import profile_text

    source = f"{how} of {columns.source}, {len(next(iter(columns.values.values()))) / rate_hz / 3600.0:.2f} h at {rate_hz:.6g} Hz"
    text = profile_text(numbers, columns.units, rate_hz, source)
    (out / "profile.yaml").write_text(text, encoding="utf-8")
    print(f"chart, numbers and profile in {out}")


def _strength_ut(arguments: argparse.Namespace, columns: "Columns") -> float:
    import numpy as np

    from lowcostnav_ros.calibration.record import CalibrationError
    from lowcostnav_ros.physics.geomagnetism import field_n

    if arguments.strength is not None:
        return arguments.strength
    place, year = _place(arguments.place) or columns.place, arguments.date or columns.decimal_year
    if place is None or year is None:
        raise CalibrationError("The strength of the earth's field is needed: give --strength, or --place and --date.")
    try:
        field = field_n(*place, year)
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    used = field[:2] if arguments.method == "level-turn" else field
    return float(np.linalg.norm(used)) * 1e6


def _place(text: str | None) -> tuple[float, float, float] | None:
    from lowcostnav_ros.calibration.record import CalibrationError

    if text is None:
        return None
    try:
        lat_deg, lon_deg, *height = (float(part) for part in text.split(","))
        return math.radians(lat_deg), math.radians(lon_deg), *(height or [0.0])[:1]
    except ValueError:
        raise CalibrationError(f"'{text}' is not a place; write latitude and longitude in degrees, such as 37.4,-122.1.") from None


def _fit(arguments: argparse.Namespace, measured_ut: "np.ndarray", strength_ut: float) -> "MagnetometerFit":
    from lowcostnav_ros.calibration.magnetometer_batch import batch_fit
    from lowcostnav_ros.calibration.magnetometer_known_strength import known_strength_fit
    from lowcostnav_ros.calibration.magnetometer_two_step import level_turn_fit, two_step_fit

    if arguments.method == "known-strength":
        return known_strength_fit(measured_ut, strength_ut)
    if arguments.method == "level-turn":
        return level_turn_fit(measured_ut, strength_ut)
    if arguments.method == "batch":
        return batch_fit(measured_ut, strength_ut, minimum_strip_deg=arguments.min_coverage)
    return two_step_fit(measured_ut, strength_ut, arguments.min_coverage)


def _print_fit(fit: "MagnetometerFit", unit: str, told: bool) -> None:
    print(f"{fit.method}: {fit.samples} samples in {unit}{'' if told else ' (told from the magnitude)'}, field {fit.strength:.2f} uT")
    print(f"coverage: {fit.coverage}")
    for axis, name in enumerate("xyz"):
        scale, sigma = fit.scale[axis], 100.0 * fit.scale_sigma[axis]
        print(f"  {name}: hard iron {fit.hard_iron[axis]:9.3f} +- {fit.hard_iron_sigma[axis]:.3f} uT, factor {scale:.4f} +- {sigma:.2f} %")
    print(f"residual {fit.residual_rms:.3f} uT RMS, condition {fit.condition:.1f}")
    for warning in fit.warnings:
        print(f"note: {warning}")


def _write_calibration(arguments: argparse.Namespace, fit: "MagnetometerFit", measured_ut: "np.ndarray") -> None:
    from lowcostnav_ros.calibration.magnetometer_fit import calibration_of
    from lowcostnav_ros.calibration.profile_text import calibration_text
    from lowcostnav_ros.cli import calibrate_charts as charts

    path = Path(arguments.output)
    text = calibration_text(calibration_of(fit, "uT"), fit, Path(arguments.source).name)
    path.write_text(text, encoding="utf-8")
    chart = path.with_suffix(".png")
    charts.save(chart, charts.sphere_figure(measured_ut, fit, "uT"), (11.0, 4.0))
    print(f"calibration in {path}, chart in {chart}")
