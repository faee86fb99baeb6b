"""The faults job: inject the faults of the catalogue into a flight, and judge what every navigator makes of them."""

import argparse
import dataclasses
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_workers, check_files, check_folder, workers_of

if TYPE_CHECKING:  # what works is imported by those that work: the options show at once
    from lowcostnav_ros.studies.faults.judge import Row


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    parser.add_argument(
        "--fault", action="append", default=[], metavar="NAME", help="fault to inject, 'gps_*' for many (default: all); repeatable"
    )
    parser.add_argument("--navigator", action="append", default=[], metavar="NAME", help="navigator to judge (default: all); repeatable")
    parser.add_argument("--seed", type=int, action="append", default=[], metavar="S", help="seed of the flight (default: 1); repeatable")
    parser.add_argument("--quick", action="store_true", help="a handful of faults")
    parser.add_argument("--live", action="store_true", help="play the faults (default: a dozen) to a live graph, and replay its recording")
    parser.add_argument("--list", action="store_true", help="print the faults that would be injected, and end")
    add_workers(parser)
    parser.add_argument("--read", action="append", default=[], metavar="JSON", help="results of earlier runs instead of flying; repeatable")
    parser.add_argument("--out", metavar="DIR", help="folder for faults.json and faults.html")
    parser.add_argument("--docs", metavar="FILE", help="write the page of the documentation, docs/faults.md")


EXAMPLE = "example: lowcostnav faults --fault 'gps_*' --out result"


@job("Inject faults into a flight and judge what every navigator makes of them.", add_arguments, EXAMPLE)
def faults(arguments: argparse.Namespace) -> int:
    """Fly, judge, print; 1 when a navigator is wrong and sure."""
    from lowcostnav_ros.report.faults.page import markdown, page
    from lowcostnav_ros.report.faults.tables import bad, fault_table, row_table, summary_table
    from lowcostnav_ros.report.terminal import print_table, result_console
    from lowcostnav_ros.studies.faults.study import chosen, study

    names = chosen(arguments.fault, arguments.quick)
    console = result_console()
    if arguments.list:
        print_table(fault_table(names), console)
        return Exit.OK
    if arguments.live:
        return _live(arguments, names if arguments.fault else None)
    check_files(arguments.docs)
    check_folder(arguments.out)
    rows = read_rows(arguments.read) or study(names, arguments.navigator, arguments.seed or [1], workers_of(arguments))
    wrong = bad(rows)
    print_table(row_table("Wrong and sure", wrong) if len(rows) > 60 else row_table("Faults", rows), console)
    print_table(summary_table(rows), console)
    if arguments.out:
        folder = Path(arguments.out)
        folder.mkdir(exist_ok=True)
        (folder / "faults.json").write_text(json.dumps([dataclasses.asdict(row) for row in rows], indent=1, allow_nan=False) + "\n")
        (folder / "faults.html").write_text(page(rows), encoding="utf-8")
        console.print(f"results in {arguments.out}: faults.html, faults.json", highlight=False)
    if arguments.docs:
        Path(arguments.docs).write_text(markdown(rows, "lowcostnav faults --docs docs/faults.md"), encoding="utf-8")
    return Exit.WORSE if wrong else Exit.OK


def _live(arguments: argparse.Namespace, names: list[str] | None) -> int:
    """Fly live; 1 when a replay differs from the flight."""
    from lowcostnav_ros.graph.faults import DOZEN, live_table, study_live
    from lowcostnav_ros.report.terminal import print_table, result_console

    out = Path(arguments.out or "out/faults")
    seed = arguments.seed[0] if arguments.seed else 1
    rows = study_live(names or DOZEN, out, seed, on_fault=lambda name: print(f"flying {name}", file=sys.stderr))
    print_table(live_table(rows), result_console())
    return Exit.WORSE if any(row.equal is False for row in rows) else Exit.OK


def read_rows(paths: Iterable[str]) -> "list[Row]":
    """Read what ``--out`` has written; of a fault, navigator and seed the last counts.

    Raises
    ------
    SettingsError
        For a file that is none of this command's.
    """
    from lowcostnav_ros.studies.faults.judge import Row, Verdict

    rows: dict[tuple[str, str, int], Row] = {}
    for path in paths:
        try:
            for entry in json.loads(Path(path).read_text(encoding="utf-8")):
                row = Row(**{**entry, "verdict": Verdict(entry["verdict"])})
                rows[row.fault, row.navigator, row.seed] = row
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise SettingsError(f"{path} holds no results of this command ({error}); give a faults.json.") from error
    return list(rows.values())
