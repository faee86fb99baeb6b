"""The allan job: from a recording at rest to Allan deviations, coefficients and an IMU profile."""

import argparse
from typing import Any

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.cli import calibrate_rest as rest
from lowcostnav_ros.cli.jobs import job

EXAMPLE = "example: lowcostnav allan still_bag -o result"


@job("Allan deviation of inertial sensors at rest: chart, coefficients, and the numbers of an IMU profile.", rest.add_arguments, EXAMPLE)
def allan(arguments: argparse.Namespace) -> int:
    """Charts and numbers of every column."""
    from lowcostnav_ros.calibration.allan import allan_chart
    from lowcostnav_ros.calibration.allan_fit import fit_chart
    from lowcostnav_ros.cli import calibrate_charts as charts

    columns, rate_hz = rest.inertial(arguments)
    rest.require_rest(columns, rate_hz)
    results: dict[str, Any] = {}
    for name, values in columns.values.items():
        chart = allan_chart(rest.named(values, rate_hz, name), rate_hz)
        results[name] = (chart, fit_chart(chart))
    fits = {name: fit for name, (_, fit) in results.items()}
    rows = [
        (name, f.white_density, f.drift_sigma, f.drift_tau_s, f.bias_instability, f.minimum_s, f.random_walk) for name, f in fits.items()
    ]
    heads = ("column", "white N [u/rtHz]", "drift sigma [u]", "tau [s]", "B [u]", "minimum at [s]", "K [u/s/rtHz]")
    shown = rest.heads_in(columns, heads)
    rest.print_columns(shown, rows, columns)
    sound, verdict = rest.judge({name: fit.misses(chart) for name, (chart, fit) in results.items()})
    said = [charts.data_sheet(name, fit, columns.units[name]) for name, fit in fits.items()]
    long = "the correlation time exceeds a third of the record; only sigma^2/tau is known, record longer."
    said += [f"{name}: {long}" for name, fit in fits.items() if not fit.drift_tau_observed]
    said += [*rest.graded({name: f.drift_sigma for name, f in fits.items()}, columns), verdict]
    print("\n".join(said))
    numbers = {name: (f.white_density, f.drift_sigma, f.drift_tau_s) for name, f in fits.items()}
    out = rest.out_dir(arguments)
    if out is not None:
        drawn = charts.by_unit(columns.units, lambda names, unit: charts.allan_charts({n: results[n] for n in names}, unit))
        charts.write_page(out / "allan.html", f"Allan deviation of {columns.source}", shown, rows, said, drawn)
        rest.write_numbers(out / "allan.csv", shown, rows)
        rest.write_profile(out, "Allan deviation", numbers, columns, rate_hz)
    return Exit.OK if sound else Exit.WORSE
