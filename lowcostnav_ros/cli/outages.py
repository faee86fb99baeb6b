"""The outages job: would it have survived losing GPS here, for every start at once.

lowcostnav outages flight --length 10,60,120 --every 15 --out outages
"""

import argparse
import json
from pathlib import Path

from lowcostnav_ros.base.plain import plain
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.catalogue.config_files import SHIPPED, config_dir, vehicle_dir
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_workers, between, workers_of

NOTES = """\
The recording is flown through once; at every start the navigators are copied as they fly and the copies fly on without GPS.
The numbers equal those of 'replay --withhold' with the same window to the last bit.
errors: against truth/odometry (or --truth) where the bag has it, else the recorded fixes.
example: lowcostnav outages flight --length 10,60 --every 15 --out outages"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    parser.add_argument("bag", help="bag directory, .mcap or .db3 file")
    parser.add_argument("--navigators", metavar="A,B", help="which to run (default: all whose required inputs the bag has)")
    parser.add_argument("--length", default="10,60,120", metavar="S,S", help="lengths of the outages, s (default: %(default)s)")
    parser.add_argument("--every", type=float, default=15.0, metavar="S", help="seconds between two starts (default: %(default)g)")
    parser.add_argument("--after", type=float, default=60.0, metavar="S", help="first start, s into the bag (default: %(default)g)")
    parser.add_argument("--until", type=float, metavar="S", help="end of the last outage of the shortest length (default: end of the bag)")
    text = f"directory with <navigator>.yaml, or '{SHIPPED}'; repeatable, to compare (default: the bag's, else the shipped ones)"
    parser.add_argument("--config", action="append", metavar="DIR", help=text)
    text = "fly the settings of a vehicle: its name in config/vehicles or a folder; repeatable, beside --config"
    parser.add_argument("--vehicle", action="append", default=[], metavar="NAME", help=text)
    parser.add_argument("--withhold", metavar="SRC[,SRC]", help="topics to withhold (default: all of GPS)")
    parser.add_argument("--truth", metavar="TOPIC", help="odometry topic to compare with (default: truth/odometry)")
    parser.add_argument("--out", metavar="DIR", help="write outages.html and outages.json there")
    add_workers(parser)


@job("Would it have survived losing GPS here? For every start of a recording at once.", add_arguments, NOTES)
def outages(arguments: argparse.Namespace) -> int:
    """Fly, print the table and the worst; returns 0."""
    from lowcostnav_ros.report.outages.page import write_page
    from lowcostnav_ros.report.terminal import print_table, result_console
    from lowcostnav_ros.studies.outages.study import Case, Plan, study_outages
    from lowcostnav_ros.studies.outages.tables import outage_table

    lengths_s = tuple(sorted({between("--length", _number(text), 1.0, 3600.0) for text in arguments.length.split(",")}))
    every_s = between("--every", arguments.every, 0.1, 3600.0)
    plan = Plan(lengths_s, every_s, between("--after", arguments.after, 0.0, 1e6), arguments.until, _names(arguments.withhold))
    configs = [config_dir() if text == SHIPPED else Path(text) for text in arguments.config or ()]
    configs += [vehicle_dir(name) for name in arguments.vehicle]
    folder = Path(arguments.out) if arguments.out else None
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    case = Case(Path(arguments.bag), plan, _names(arguments.navigators), truth=arguments.truth)
    study = study_outages(case, configs or (None,), workers_of(arguments))
    console = result_console()
    print_table(outage_table(study), console)
    for line in (line for flown in study.flown for line in flown.worst):
        console.print(line, highlight=False, markup=False)
    if folder is not None:
        (folder / "outages.json").write_text(json.dumps(plain(study), allow_nan=False) + "\n", encoding="utf-8")
        size = write_page(study, folder / "outages.html")
        console.print(f"{folder}: outages.html ({size / 1e6:.1f} MB), outages.json", highlight=False)
    return 0


def _names(text: str | None) -> tuple[str, ...] | None:
    return tuple(name.strip().lstrip("/") for name in text.split(",") if name.strip()) if text else None


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise SettingsError(f"--length: '{text}' is no number; write seconds, like 10,60,120.") from None
