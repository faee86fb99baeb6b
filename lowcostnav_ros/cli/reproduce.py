"""The reproduce job: results of the theses beside the printed numbers."""

import argparse
import json
import sys
from collections import Counter
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_workers, check_files, check_folder, workers_of
from lowcostnav_ros.report.terminal import print_table
from lowcostnav_ros.reproduce import page, registry, run
from lowcostnav_ros.reproduce.registry import BETTER, CRASHED, DIFFERS, REPRODUCED, VERDICTS, Entry
from lowcostnav_ros.reproduce.run import ONE_SEED, Record
from lowcostnav_ros.studies.campaign import run_campaign

_STYLES = {REPRODUCED: "green", BETTER: "green", DIFFERS: "yellow", CRASHED: "bold red"}
_EPILOG = """\
exit status: 0 when everything ran, whatever the verdicts; 1 when a result crashed; 2 cannot run

examples:
  lowcostnav reproduce gebre --quick
  lowcostnav reproduce GR16 GR17 --out results --json results.json"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    parser.add_argument("results", nargs="*", metavar="STUDY|ID", help="a study such as gebre, or ids such as GR16 (default: all)")
    parser.add_argument("--list", action="store_true", help="list the results and run nothing")
    parser.add_argument("--quick", action="store_true", help="one seed each, all results in about five minutes on two cores")
    parser.add_argument("--seed", type=int, default=1, help="seed of everything random (default: 1)")
    parser.add_argument("--json", metavar="FILE", help="write the results as JSON")
    parser.add_argument("--out", metavar="DIR", help="write a page per study and its figures there")
    add_workers(parser)


@job("Compute the results of the theses again and set them beside the printed numbers, with a verdict each.", add_arguments, _EPILOG)
def reproduce(arguments: argparse.Namespace) -> int:
    """Run, print, write; 1 when a result crashed."""
    entries = registry.selected(arguments.results)
    if arguments.list:
        _list(entries)
        return 0
    check_files(arguments.json)
    check_folder(arguments.out)
    if arguments.seed < 0:
        raise SettingsError("The seed must not be negative.")
    out = Path(arguments.out) if arguments.out else None
    console = _console()
    context = registry.Context(arguments.quick, arguments.seed, partial(run_campaign, workers=workers_of(arguments)))
    records = run.run_results(entries, context, out, lambda record: _print(record, console))
    if arguments.json:
        listed = {"results": [record.as_json(out) for record in records]}
        Path(arguments.json).write_text(json.dumps(listed, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if out is not None:
        for path in page.write_pages(records, out, arguments.quick):
            console.print(f"page in {path}", highlight=False)
    return _conclude(records, console)


def _list(entries: list[Entry]) -> None:
    rows = [(entry.id, entry.study, entry.title, entry.source) for entry in entries]
    print_table(Table.plain("", ("id", "study", "result", "source"), rows, left=4), _console())


def _console() -> Console:
    return Console(width=None if sys.stdout.isatty() else 140, soft_wrap=True, highlight=False)


def _print(record: Record, console: Console) -> None:
    entry, outcome = record.entry, record.outcome
    style = _STYLES.get(outcome.verdict, "cyan")
    flown = f"{record.seeds} seeds, " if record.seeds else ""
    flown = f"1 seed{ONE_SEED}, " if record.seeds == 1 else flown
    console.print(f"{entry.id:<5} [{style}]{outcome.verdict}[/]  {escape(entry.title)}  [dim]{flown}{record.seconds:.1f} s[/]")
    console.print(f"      thesis: {escape(entry.thesis)}")
    console.print(f"      ours:   {escape(outcome.ours)}")
    if outcome.reason:
        console.print(f"      why:    {escape(outcome.reason)}")


def _conclude(records: list[Record], console: Console) -> int:

    count = Counter(record.outcome.verdict for record in records)
    seconds = sum(record.seconds for record in records)
    console.print(", ".join(f"{count[v]} {v}" for v in VERDICTS if count[v]) + f" in {seconds:.0f} s")
    for record in records:
        if record.trace:
            print(record.trace, file=sys.stderr)
    return 1 if count[CRASHED] else 0
