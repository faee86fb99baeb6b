"""The open job: any log becomes a page, without a profile or a question."""

import argparse
import json
import os
import sys
import tempfile
import webbrowser
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from lowcostnav_ros.base.tables import Column, Table
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_tracks, check_files
from lowcostnav_ros.cli.progress import progress_bar

if TYPE_CHECKING:  # what works is imported by those that work: the options show at once
    from lowcostnav_ros.convert.opened import Opened
    from lowcostnav_ros.studies.outages.study import StudyAlong

OUTAGES, LENGTHS_S, FIRST_S = 12, (10.0, 30.0, 60.0), 40.0
"""Losses of GPS that are studied at most, how long each lasts, and the first after the start, s."""
LEAST_EVERY_S = 15.0
NO_STUDY_S = 1.5 * FIRST_S
"""A log shorter than this has no room for an outage study."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    from lowcostnav_ros.cli.convert import angles

    parser.add_argument("log", help="a log of any format that 'convert' reads, or a bag; a table needs --profile")
    parser.add_argument("--out", metavar="HTML", help="page to write (default: LOG.html in this folder)")
    parser.add_argument("--no-browser", action="store_true", help="write the page and do not show it")
    parser.add_argument("--no-outages", action="store_true", help="leave the study of GPS outages out")
    parser.add_argument("--all", action="store_true", help="fly also the navigators that add nothing; else the page says which and why")
    parser.add_argument("--withhold", action="append", default=[], metavar="SRC[,SRC][@A-[B]]", help="keep sources back, as in 'replay'")
    add_tracks(parser)
    parser.add_argument("--profile", metavar="NAME|FILE", help="column profile of a table, as in 'convert'")
    parser.add_argument("--date", type=date.fromisoformat, metavar="YYYY-MM-DD", help="day of a log that holds times of day alone")
    text = "rotation from the axes of the inertial sensor to those of the aircraft, deg"
    parser.add_argument("--mounting", type=angles, metavar="ROLL,PITCH,YAW", help=text)


EXAMPLES = """examples:
  lowcostnav open flight.ulg
  lowcostnav open flight.bin --withhold gps/fix,gps/vel@300-420 --kml flight.kml"""


@job("Any log as it comes off the aircraft, to a page: what it holds, our solutions beside its own, GPS outages.", add_arguments, EXAMPLES)
def open(arguments: argparse.Namespace) -> int:
    """Convert, replay, study, write the page, show it; returns 0."""
    from lowcostnav_ros.convert.opened import open_log
    from lowcostnav_ros.convert.recognise import Options
    from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
    from lowcostnav_ros.replay.withhold import parse_withhold
    from lowcostnav_ros.report.flight.figures import axis_of
    from lowcostnav_ros.report.flight.findings import findings
    from lowcostnav_ros.report.flight.page import page_of
    from lowcostnav_ros.report.flight.result_folder import read_result
    from lowcostnav_ros.report.flight.track_files import write_track
    from lowcostnav_ros.report.flight.vibration import vibration_section

    log = Path(arguments.log)
    output = Path(arguments.out or f"{log.resolve().name.removesuffix('.gz')}.html")
    check_files(str(output), arguments.kml, arguments.gpx)
    _say(f"reading {log}")
    opened = open_log(log, Options(arguments.date, arguments.mounting), arguments.profile)
    _say(opened.heading)
    study = _study(opened) if not arguments.no_outages and arguments.registry is None else None
    with tempfile.TemporaryDirectory(prefix="lowcostnav-open-") as name:
        folder = Path(name)
        withhold = tuple(parse_withhold(text) for text in arguments.withhold)
        with progress_bar("replay", in_lines=True) as advance:
            given = _reference(opened), folder, arguments.registry, advance
            watch = study.begin if study is not None else None
            summary = replay_bag(opened.bag, ReplayOptions(None, None, withhold, *given, sparing=not arguments.all, watch=watch))
        (folder / "summary.json").write_text(json.dumps(summary.to_mapping(), allow_nan=False), encoding="utf-8")
        result = read_result(folder)
    found, outages = _outages(study, summary.duration_s) if any(one.solutions for one in summary.navigators.values()) else ("", "")
    after = [outages, vibration_section(Path(opened.bag), axis_of(summary))]
    page = page_of(result, log.name, before=[_sensors(opened)], after=after, outages=found, bag=Path(opened.bag))
    output.write_text(page, encoding="utf-8")
    for path in filter(None, (arguments.kml, arguments.gpx)):
        write_track(result, Path(path))
    for line in findings(summary, found):
        print(line)
    print(f"{output} ({len(page.encode()) / 1e6:.1f} MB)")
    if not arguments.no_browser:
        _show(output)
    return 0


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _reference(opened: "Opened") -> str | None:
    """The log's own autopilot where there is no truth: beside ours, not above it."""
    from lowcostnav_ros.formats.log import AUTOPILOT
    from lowcostnav_ros.messages.bag import BagReader
    from lowcostnav_ros.replay.bag_replay import DEFAULT_TRUTH

    with BagReader(opened.bag) as bag:
        own = f"{AUTOPILOT}/odometry"
        return own if DEFAULT_TRUTH not in bag.types and own in bag.types and f"{AUTOPILOT}/origin" in bag.types else None


def _study(opened: "Opened") -> "StudyAlong":
    """A study of GPS outages, not more than :data:`OUTAGES` of them."""
    from lowcostnav_ros.messages.bag import BagReader
    from lowcostnav_ros.studies.outages.study import Plan, StudyAlong

    with BagReader(opened.bag) as bag:
        return StudyAlong(Plan(LENGTHS_S, max(LEAST_EVERY_S, (bag.duration_s - FIRST_S) / OUTAGES), FIRST_S))


def _outages(along: "StudyAlong | None", duration_s: float) -> tuple[str, str]:
    """The study of GPS outages in a sentence and a section; why not where there can be none."""
    from lowcostnav_ros.report.outages.page import outage_finding, outage_section
    from lowcostnav_ros.studies.outages.study import OutageError

    if along is None:
        return "", ""
    if duration_s < NO_STUDY_S:
        return "", _note(f"A study of GPS outages needs {NO_STUDY_S:.0f} s of flight, here are {duration_s:.0f} s.")
    try:
        study = replace(along.study(), left_out={})  # the page says it already
    except OutageError as error:
        return "", _note(str(error))
    return outage_finding(study), outage_section(study)


def _note(text: str) -> str:
    from lowcostnav_ros.report.document import section
    from lowcostnav_ros.report.svg import escape

    return section("Had GPS been lost", f'<p class="note">{escape(text)}</p>')


def _sensors(opened: "Opened") -> str:
    """What the log holds, and what was decided about it."""
    from lowcostnav_ros.report.document import html_table, section

    heads = ("topic", "messages", "rate [Hz]", "longest gap [s]", "made of")
    columns = tuple(Column(head, lambda row, k=k: row[k], left=k in (0, 4)) for k, head in enumerate(heads))  # type: ignore[misc]
    table = Table.of(opened.heading, columns, opened.rows, notes=tuple(opened.notes))
    return section("What the log holds", html_table(table))


def _show(page: Path) -> None:
    """Open the page where there is a screen to open it on."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        _say("There is no screen here; open the page in a browser.")
    elif not webbrowser.open(page.resolve().as_uri()):
        _say("No browser could be started; open the page in one.")
