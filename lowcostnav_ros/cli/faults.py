"""The faults job: inject the faults of the catalogue into a flight, and judge what every navigator makes of them."""

import argparse
import dataclasses
import json
from pathlib import Path

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import check_folders
from lowcostnav_ros.report.faults.tables import bad, fault_table, row_table, summary_table
from lowcostnav_ros.report.terminal import print_table, result_console
from lowcostnav_ros.studies.faults.study import chosen, study


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    parser.add_argument(
        "--fault", action="append", default=[], metavar="NAME", help="fault to inject, 'gps_*' for many (default: all); repeatable"
    )
    parser.add_argument("--navigator", action="append", default=[], metavar="NAME", help="navigator to judge (default: all); repeatable")
    parser.add_argument("--seed", type=int, action="append", default=[], metavar="S", help="seed of the flight (default: 1); repeatable")
    parser.add_argument("--quick", action="store_true", help="a handful of faults")
    parser.add_argument("--list", action="store_true", help="print the faults that would be injected, and end")
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: every core)")
    parser.add_argument("--out", metavar="DIR", help="folder for faults.json")
    parser.add_argument("--json", metavar="FILE", help="write all rows as JSON")


@job("Inject faults into a flight and judge what every navigator makes of them.", add_arguments)
def faults(arguments: argparse.Namespace) -> int:
    """Fly, judge, print; 1 when a navigator is wrong and sure."""
    names = chosen(arguments.fault, arguments.quick)
    console = result_console()
    if arguments.list:
        print_table(fault_table(names), console)
        return Exit.OK
    if arguments.workers is not None and arguments.workers < 1:
        raise SettingsError(f"--workers must be at least 1, got {arguments.workers}.")
    check_folders(arguments.json, arguments.out)
    rows = study(names, arguments.navigator, arguments.seed or [1], arguments.workers)
    wrong = bad(rows)
    print_table(row_table("Wrong and sure", wrong) if len(rows) > 60 else row_table("Faults", rows), console)
    print_table(summary_table(rows), console)
    text = json.dumps([dataclasses.asdict(row) for row in rows], indent=1, allow_nan=False) + "\n"
    if arguments.json:
        Path(arguments.json).write_text(text, encoding="utf-8")
    if arguments.out:
        Path(arguments.out).mkdir(exist_ok=True)
        (Path(arguments.out) / "faults.json").write_text(text, encoding="utf-8")
        console.print(f"results in {arguments.out}", highlight=False)
    return Exit.WORSE if wrong else Exit.OK
