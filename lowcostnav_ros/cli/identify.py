"""The identify job: error model of sensors at rest by mean, scatter and autocorrelation."""

import argparse
import math
from collections.abc import Mapping
from functools import partial

import numpy as np

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.cli import calibrate_input as files
from lowcostnav_ros.cli import calibrate_rest as rest
from lowcostnav_ros.cli.jobs import job

EXAMPLE = """examples:
  lowcostnav identify flight                   what the IMU shows: rate, jitter, noise, units, axes; at rest its error model
  lowcostnav identify bench --topic gps/fix    variance of the fixes
  lowcostnav identify bench --topic imu/data   nine channels of an attitude reference, and the sign of its accelerometers"""


@job("What an IMU shows: rate, noise, units, axes; at rest its error model, as numbers of a profile.", rest.add_arguments, EXAMPLE)
def identify(arguments: argparse.Namespace) -> int:
    """Mean, scatter, correlation time of every column."""
    from lowcostnav_ros.calibration.identification import identify_static
    from lowcostnav_ros.cli import calibrate_charts as charts
    from lowcostnav_ros.cli.calibrate_reference import identified

    other = None if files.is_table(arguments.source) or arguments.topic == "imu/data_raw" else identified(arguments)
    if other is not None:
        return other
    columns, rate_hz = rest.inertial(arguments)
    look = rest.look(columns)
    if look is not None:
        print("\n".join([look.words(), *(f"note: {finding}" for finding in look.findings)]))
    if look is not None and not look.is_at_rest and arguments.output is None:
        print("in motion: the white noise is an upper bound, vibration included; a drift shows in a recording at rest.")
        return Exit.WORSE if look.findings else Exit.OK
    rest.require_rest(columns, rate_hz)
    found = {name: identify_static(rest.named(values, rate_hz, name), rate_hz) for name, values in columns.values.items()}
    rows = [
        (n, f.mean, f.mean_sigma, f.white_sigma, f.drift_sigma, f.correlation_time_s or 0.0, f.long_term_sigma or math.nan)
        for n, f in found.items()
    ]
    heads = ("column", "mean [u]", "+- [u]", "white sigma/sample [u]", "drift sigma [u]", "tau [s]", "1-min sigma [u]")
    shown = rest.heads_in(columns, heads)
    rest.print_columns(shown, rows, columns)
    fits, verdict = rest.judge({name: f.coloured for name, f in found.items()})
    unsure = [name for name, f in found.items() if f.correlation_time_s is not None and not f.correlation_time_sure]
    said = [f"{name}: the record holds fewer than 20 correlation times; expect the true one to be longer." for name in unsure]
    said += [verdict, *rest.graded({name: f.drift_sigma for name, f in found.items()}, columns)]
    print("\n".join(said))
    out = rest.out_dir(arguments)
    if out is not None:
        drawn = charts.by_unit(columns.units, partial(_charts, columns.values, rate_hz))
        said = ([look.words(), *look.findings] if look is not None else []) + said
        charts.write_page(out / "identify.html", f"{columns.source} at rest", shown, rows, said, drawn)
        numbers = {n: (f.white_density, f.drift_sigma, f.correlation_time_s or 0.0) for n, f in found.items()}
        rest.write_numbers(out / "identify.csv", shown, rows)
        rest.write_profile(out, "mean, scatter and autocorrelation", numbers, columns, rate_hz)
    return Exit.OK if fits and not (look is not None and look.findings) else Exit.WORSE


def _charts(values: Mapping[str, np.ndarray], rate_hz: float, names: list[str], unit: str) -> list[str]:
    from lowcostnav_ros.cli import calibrate_charts as charts

    return charts.identification_charts({name: values[name] for name in names}, rate_hz, unit)
