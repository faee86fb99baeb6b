"""The magcal job: a magnetometer calibrated from a turn or a flight."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.cli import calibrate_input as files
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_reading, check_files, let_values_begin_with_minus, place_of

if TYPE_CHECKING:  # what works is imported by those that work: the options show at once
    from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerFit
    from lowcostnav_ros.cli.calibrate_input import Columns

METHODS = ("full", "two-step", "batch", "known-strength", "level-turn", "swing")
UNITS = ("T", "G", "mG", "uT", "nT")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    let_values_begin_with_minus(parser)
    parser.add_argument("source", metavar="BAG|CSV", help="recording with the attitudes to calibrate from")
    parser.add_argument("--topic", default="imu/mag", help="magnetometer topic of a bag (default: imu/mag)")
    add_reading(parser)
    parser.add_argument("--column", metavar="X,Y,Z", help="columns of a table (default: x,y,z; swing: heading,measured)")
    parser.add_argument("--unit", choices=UNITS, help="unit of a table (default: found from the magnitude)")
    parser.add_argument("--strength", type=float, metavar="UT", help="field strength, microtesla (level-turn, swing: horizontal)")
    parser.add_argument("--place", metavar="LAT,LON[,M]", help="degrees and metres, for the magnetic model (default: the bag's first fix)")
    parser.add_argument("--date", type=float, metavar="YEAR", help="decimal year for the magnetic model (default: of the bag)")
    parser.add_argument("--method", choices=METHODS, default="full", help="how to fit (default: full, soft iron too)")
    parser.add_argument("--min-coverage", type=float, default=15.0, metavar="DEG", help="refuse free fits from less tilt (default: 15)")
    text = "swing of a bag: topic of the attitudes that the headings are known from (default: %(default)s)"
    parser.add_argument("--reference", metavar="TOPIC", default="gps/attitude", help=text)
    parser.add_argument("--last-heading", type=float, metavar="DEG", help="swing: the headings are angles turned; this one is the last's")
    parser.add_argument("-o", "--output", metavar="FILE.yaml", help="write the calibration, and its page FILE.html")


EXAMPLE = """examples:
  lowcostnav magcal turns_bag -o magnetometer.yaml
  lowcostnav magcal rose.csv --method swing --place 37.4,-122.1 --date 2026.5 -o magnetometer.yaml"""


@job("Calibrate a magnetometer from a turn or a flight: hard iron, scale factors, and how far to trust them.", add_arguments, EXAMPLE)
def magcal(arguments: argparse.Namespace) -> int:
    """Fit, print how far to trust it, write the calibration."""
    from lowcostnav_ros.calibration import magnetometer_fit as fits
    from lowcostnav_ros.calibration.magnetometer_full import POOREST, weakness
    from lowcostnav_ros.cli import calibrate_charts as charts
    from lowcostnav_ros.cli.calibrate_rest import split

    check_files(arguments.output)
    arguments.place = None if arguments.place is None else place_of(arguments.place, "--place")
    if arguments.method == "swing":
        return _swing(arguments)
    table = files.is_table(arguments.source)
    wanted = split(arguments.column or "x,y,z")
    columns = files.read_table(arguments.source, wanted, arguments.unit or "") if table else files.read_topic(arguments, files.MAGNETIC)
    if len(columns.values) != 3:
        raise CalibrationError("A calibration needs three columns, forward, right, down; name them with --column.")
    raw = np.column_stack(list(columns.values.values()))
    finite = raw[np.all(np.isfinite(raw), axis=1)]
    given = next(iter(columns.units.values()))
    unit = given or fits.unit_by_magnitude(finite if len(finite) else raw)
    measured_ut = raw * fits.TESLA_PER[unit] * 1e6
    fit = _fit(arguments, measured_ut, _strength_ut(arguments, columns))
    if arguments.method != "known-strength" and fit.residual_rms > POOREST * fit.strength:
        share = 100.0 * fit.residual_rms / fit.strength
        raise CalibrationError(f"The samples lie on no ellipsoid along the axes: residual {share:.0f} % of the field; use --method full.")
    missing = weakness(fit, POOREST) if arguments.method in ("two-step", "batch") else ""
    if missing:
        raise CalibrationError(f"The samples do not show {missing}; bank and pitch more in all headings.")
    _print_fit(fit, unit, bool(given))
    if arguments.output:
        _write_calibration(arguments, fit, charts.strength_charts(measured_ut, fit, "uT"))
    return 0


def _swing(arguments: argparse.Namespace) -> int:
    """A deviation curve from known headings, and the level iron behind it, which the nodes take off."""
    from lowcostnav_ros.calibration.magnetometer_swing import swing_calibration, swing_fit
    from lowcostnav_ros.cli import calibrate_charts as charts
    from lowcostnav_ros.cli.calibrate_swing import read_swing
    from lowcostnav_ros.physics.rotation import wrap

    swung = read_swing(arguments)
    fit = swing_calibration(swung.heading, swung.measured, _strength_ut(arguments, swung.columns))
    curve = swing_fit(swung.heading, swung.measured)
    print(f"deviation, measured minus magnetic heading, of {curve.headings} headings, widest gap {np.degrees(curve.widest_gap):.0f} deg:")
    for letter, term, value, sigma in zip("ABCDE", ("1", "sin", "cos", "sin 2", "cos 2"), curve.coefficients, curve.sigma, strict=True):
        print(f"  {letter} ({term:5}) {np.degrees(value):8.3f} +- {np.degrees(sigma):.3f} deg")
    left, before = np.degrees(fit.residual_rms / fit.strength), np.degrees(np.abs(wrap(swung.measured - swung.heading)).max())
    print(f"largest deviation {before:.2f} deg; left by the curve {np.degrees(curve.residual_rms):.3f}, by the iron {left:.3f} deg RMS")
    _print_fit(fit, "headings", True)
    if arguments.output:
        _write_calibration(arguments, fit, charts.swing_charts(swung.heading, swung.measured, curve))
    return 0


def _strength_ut(arguments: argparse.Namespace, columns: "Columns") -> float:

    from lowcostnav_ros.physics.geomagnetism import field_n

    if arguments.strength is not None:
        return arguments.strength
    place, year = arguments.place or columns.place, arguments.date or columns.decimal_year
    if place is None or year is None:
        raise CalibrationError("The strength of the earth's field is needed: give --strength, or --place and --date.")
    try:
        field = field_n(place[0], place[1], place[2], year)
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    used = field[:2] if arguments.method in ("level-turn", "swing") else field
    return float(np.linalg.norm(used)) * 1e6


def _fit(arguments: argparse.Namespace, measured_ut: np.ndarray, strength_ut: float) -> "MagnetometerFit":
    from lowcostnav_ros.calibration.magnetometer_batch import batch_fit
    from lowcostnav_ros.calibration.magnetometer_full import full_fit
    from lowcostnav_ros.calibration.magnetometer_known_strength import known_strength_fit
    from lowcostnav_ros.calibration.magnetometer_two_step import level_turn_fit, two_step_fit

    if arguments.method == "known-strength":
        return known_strength_fit(measured_ut, strength_ut)
    if arguments.method == "level-turn":
        return level_turn_fit(measured_ut, strength_ut)
    if arguments.method == "batch":
        return batch_fit(measured_ut, strength_ut, minimum_strip_deg=arguments.min_coverage)
    if arguments.method == "two-step":
        return two_step_fit(measured_ut, strength_ut, arguments.min_coverage)
    return full_fit(measured_ut, strength_ut, arguments.min_coverage)


def _print_fit(fit: "MagnetometerFit", unit: str, given: bool) -> None:
    print(f"{fit.method}: {fit.samples} samples in {unit}{'' if given else ' (found from the magnitude)'}, field {fit.strength:.2f} uT")
    print(f"coverage: {fit.coverage}")
    for axis, name in enumerate("xyz"):
        scale, sigma = fit.scale[axis], 100.0 * fit.scale_sigma[axis]
        print(f"  {name}: hard iron {fit.hard_iron[axis]:9.3f} +- {fit.hard_iron_sigma[axis]:.3f} uT, factor {scale:.4f} +- {sigma:.2f} %")
    if np.any(fit.cross_sigma):
        yz, xz, xy = (f"{fit.matrix[i, j]:.4f} +- {s:.4f}" for (i, j), s in zip(((1, 2), (0, 2), (0, 1)), fit.cross_sigma, strict=True))
        print(f"  cross terms: xy {xy}, xz {xz}, yz {yz}")
    print(f"residual {fit.residual_rms:.3f} uT RMS, condition {fit.condition:.1f}")
    for warning in fit.warnings:
        print(f"note: {warning}")


def _write_calibration(arguments: argparse.Namespace, fit: "MagnetometerFit", drawn: Sequence[str]) -> None:
    from lowcostnav_ros.calibration.magnetometer_fit import calibration_of
    from lowcostnav_ros.calibration.profile_text import calibration_text
    from lowcostnav_ros.cli import calibrate_charts as charts

    path = Path(arguments.output)
    text = calibration_text(calibration_of(fit, "uT"), fit, Path(arguments.source).name)
    write_text(path, text)
    rows = [(n, fit.hard_iron[k], fit.hard_iron_sigma[k], fit.scale[k], 100.0 * fit.scale_sigma[k]) for k, n in enumerate("xyz")]
    heads = ("axis", "hard iron [uT]", "sigma [uT]", "factor", "sigma [%]")
    said = f"Residual {fit.residual_rms:.3f} uT RMS of {fit.samples} samples, coverage: {fit.coverage}.", *fit.warnings
    page = path.with_suffix(".html")
    charts.write_page(page, f"Magnetometer of {Path(arguments.source).name}", heads, rows, said, drawn)
    print(f"calibration in {path}, page in {page}")
