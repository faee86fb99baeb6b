"""The report job: a bag (replayed first) or a replay's result folder becomes one HTML page."""

import argparse
import json
import tempfile
from pathlib import Path

from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_tracks, check_files
from lowcostnav_ros.cli.replay import add_common, replay_with_progress
from lowcostnav_ros.report.flight.page import write_page
from lowcostnav_ros.report.flight.result_folder import read_result
from lowcostnav_ros.report.flight.track_files import write_track


def add_arguments(report: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    report.add_argument("source", help="a bag, which is replayed first, or a directory written by replay --out")
    report.add_argument("-o", "--output", metavar="HTML", help="page to write (default: SOURCE.html)")
    add_common(report, " (bags only)")
    add_tracks(report)
    report.add_argument("--title", help="heading of the page (default: the name of the bag)")


EXAMPLE = "example: lowcostnav report flight"


@job("One self-contained HTML page about a flight: map, errors in their sigmas, aids, tables.", add_arguments, EXAMPLE)
def report(arguments: argparse.Namespace) -> int:
    """Write the page; returns 0."""
    arguments.output = arguments.output or f"{Path(arguments.source).with_suffix('.html').name}"
    check_files(arguments.output, arguments.kml, arguments.gpx)
    source = Path(arguments.source)
    with tempfile.TemporaryDirectory(prefix="lowcostnav-report-") as folder:
        if not (source / "summary.json").is_file():
            source = Path(folder)
            mapping = replay_with_progress(arguments, source).to_mapping()
            (source / "summary.json").write_text(json.dumps(mapping, allow_nan=False), encoding="utf-8")
        size = write_page(source, Path(arguments.output), arguments.title)
        for path in filter(None, (arguments.kml, arguments.gpx)):
            write_track(read_result(source), Path(path))
    print(f"{arguments.output} ({size / 1e6:.1f} MB)")
    return 0
