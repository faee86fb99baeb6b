"""The calibrate job: what temperature makes of a gyro, and what is left of a magnetic heading, as numbers that profiles and nodes load."""

import argparse
import math
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.calibration.record import CalibrationError, regular_rate
from lowcostnav_ros.catalogue.config_files import load_settings
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_reading, check_files, let_values_begin_with_minus, place_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the sub-commands and their options."""
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    text = "Slope of a gyro's scale factor: runs on a rate table at one rate, one row for each temperature, biases taken off."
    slope = verbs.add_parser("temperature", help="scale factor against temperature", description=text)
    slope.add_argument("source", metavar="CSV", help="table with the temperature and the mean output of each run")
    slope.add_argument("--column", metavar="T,OUT", default="temperature_c,output", help="its columns (default: %(default)s)")
    slope.add_argument("--input", type=float, required=True, metavar="RATE", help="rate of the table, unit of the output")
    text = "Transient of a gyro's bias after power-up: averages at rest, from power-up until it has settled."
    warm = verbs.add_parser("warm-up", help="bias after power-up", description=text)
    warm.add_argument("source", metavar="CSV", help="table with a time column, from power-up, and the output, deg/s")
    warm.add_argument("--column", metavar="OUT", default="output", help="column of the output (default: %(default)s)")
    text = "Slow error and white noise of a magnetic heading against known ones, for the navigators' magnetic settings."
    heading = verbs.add_parser("heading", help="error model of a magnetic heading", description=text)
    let_values_begin_with_minus(heading)
    heading.add_argument("source", metavar="BAG|CSV", help="bag with field and attitudes, or table with a time column")
    heading.add_argument("--column", metavar="ERROR", default="error", help="column of measured minus true, degrees (default: %(default)s)")
    heading.add_argument("--topic", default="imu/mag", help="magnetometer topic of a bag (default: %(default)s)")
    heading.add_argument("--reference", metavar="TOPIC", default="gps/attitude", help="attitudes to compare with (default: %(default)s)")
    heading.add_argument("--calibration", metavar="FILE.yaml", help="magnetometer calibration to apply first, as magcal writes it")
    heading.add_argument("--place", metavar="LAT,LON[,M]", help="degrees and metres, for the declination (default: the bag's first fix)")
    heading.add_argument("--date", type=float, metavar="YEAR", help="decimal year for the declination (default: of the bag)")
    add_reading(heading)
    heading.add_argument("-o", "--output", metavar="FILE.yaml", help="write the settings there")


EXAMPLE = """examples:
  lowcostnav calibrate temperature runs.csv --input 60
  lowcostnav calibrate heading flight --calibration magnetometer.yaml -o heading.yaml"""


@job("What temperature makes of a gyro, and the error model of a magnetic heading, fitted.", add_arguments, EXAMPLE)
def calibrate(arguments: argparse.Namespace) -> int:
    """Run the verb; returns the exit status."""
    return {"temperature": _temperature, "warm-up": _warm_up, "heading": _heading}[arguments.verb](arguments)


def _temperature(arguments: argparse.Namespace) -> int:
    from lowcostnav_ros.calibration.temperature import fit_scale_factor
    from lowcostnav_ros.cli.calibrate_input import read_table
    from lowcostnav_ros.cli.calibrate_rest import split

    wanted = split(arguments.column)
    if len(wanted) != 2:
        raise CalibrationError("A slope needs two columns, temperature and output; name them with --column.")
    temperature_c, output = read_table(arguments.source, wanted).values.values()
    slope = fit_scale_factor(temperature_c, output, arguments.input)
    low, high, ppm = float(temperature_c.min()), float(temperature_c.max()), 1e6 * slope.slope_per_k
    sigma_ppm = 1e6 * slope.slope_sigma_per_k
    change = 100.0 * slope.change(low, high)
    print(
        f"scale factor: {ppm:.1f} +- {sigma_ppm:.1f} ppm/K about {slope.reference_c:.1f} degC, {change:.2f} % from {low:g} to {high:g} degC"
    )
    print(f"in a profile:  gyro.scale_factor_ppm_per_k: [{ppm:.1f}, {ppm:.1f}, {ppm:.1f}]  and  gyro.reference_c: {slope.reference_c:.1f}")
    return 0


def _warm_up(arguments: argparse.Namespace) -> int:
    from lowcostnav_ros.calibration.temperature import fit_warm_up
    from lowcostnav_ros.cli.calibrate_input import read_table
    from lowcostnav_ros.cli.calibrate_rest import split

    columns = read_table(arguments.source, split(arguments.column))
    if columns.stamps_s is None or len(columns.values) != 1:
        raise CalibrationError("A warm-up needs a time column such as t_s, and one column of output; name it with --column.")
    fit = fit_warm_up(columns.stamps_s, next(iter(columns.values.values())))
    print(f"bias: {fit.settled:.5g} deg/s settled, {fit.transient:+.5g} deg/s at power-up, gone with {fit.tau_s:.0f} s")
    print(f"in a profile:  gyro.warm_up_bias_deg_per_s: {fit.transient:.5g}  and  gyro.warm_up_tau_s: {fit.tau_s:.0f}.0")
    return 0


def _heading(arguments: argparse.Namespace) -> int:
    from lowcostnav_ros.calibration.heading_error import fit_heading_error

    check_files(arguments.output)
    arguments.place = None if arguments.place is None else place_of(arguments.place, "--place")
    stamps_s, error = _residuals(arguments)
    rate_hz = regular_rate(stamps_s, arguments.source)
    fit = fit_heading_error(error, rate_hz)
    slow, mean_deg = fit.model.slow, math.degrees(fit.mean)
    slow_deg, noise_deg = math.degrees(slow.sigma), math.degrees(fit.model.white_sigma)
    print(f"heading error, measured minus true: mean {mean_deg:+.2f} deg, slow {slow_deg:.2f} deg with {slow.tau:.0f} s,")
    print(f"white {noise_deg:.2f} deg in one sample at {rate_hz:.3g} Hz; {len(error)} headings over {stamps_s[-1] - stamps_s[0]:.0f} s")
    if not fit.tau_observed:
        print("note: the correlation time exceeds a third of the record; only sigma^2/tau is known, record longer.")
    if arguments.output:
        write_text(Path(arguments.output), _heading_text(Path(arguments.source).name, mean_deg, slow_deg, slow.tau, noise_deg))
        print(f"settings in {arguments.output}")
    return 0


def _residuals(arguments: argparse.Namespace) -> tuple[np.ndarray, np.ndarray]:
    """Time, s, and measured minus true heading, rad."""
    from lowcostnav_ros.cli.calibrate_input import is_table, read_table
    from lowcostnav_ros.cli.calibrate_rest import split
    from lowcostnav_ros.cli.calibrate_swing import read_pairs
    from lowcostnav_ros.navigators.ahrs.navigator import AhrsSettings
    from lowcostnav_ros.physics.rotation import wrap

    if is_table(arguments.source):
        columns = read_table(arguments.source, split(arguments.column))
        if columns.stamps_s is None or len(columns.values) != 1:
            raise CalibrationError("A heading error needs a time column such as t_s, and one column of errors; name it with --column.")
        return columns.stamps_s, np.radians(next(iter(columns.values.values())))
    calibration = load_settings(AhrsSettings, Path(arguments.calibration)).magnetometer if arguments.calibration else None
    pairs = read_pairs(arguments, *([] if calibration is None else [calibration.apply]))
    return pairs.stamps_s, wrap(pairs.measured - pairs.known)


def _heading_text(source: str, mean_deg: float, slow_deg: float, tau_s: float, noise_deg: float) -> str:
    bias_deg = math.hypot(slow_deg, mean_deg)
    return "\n".join(
        [
            f"# Error model of the magnetic heading, from {source}: mean {mean_deg:+.2f} deg, slow {slow_deg:.2f} deg.",
            "# The mean is counted as slow error: no navigator takes a constant off.",
            "/**:",
            "  ros__parameters:",
            "    magnetic:",
            f"      noise_deg: {max(noise_deg, 0.01):.3f}",
            f"      bias_deg: {bias_deg:.3f}",
            *([f"      bias_tau_s: {max(tau_s, 1.0):.1f}"] if slow_deg > 0.0 else []),
            "",
        ]
    )
