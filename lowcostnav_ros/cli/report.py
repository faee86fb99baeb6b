"""The report job: a bag (replayed first) or a replay's result folder becomes one HTML page."""

import argparse
import json
import tempfile
from pathlib import Path

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_tracks, check_files


def add_arguments(report: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    from lowcostnav_ros.cli.replay import add_common

    report.add_argument("source", help="a bag, which is replayed first, or a directory written by replay --out")
    report.add_argument("-o", "--output", metavar="HTML", help="page to write (default: SOURCE.html)")
    text = "a further result of the same recording, a directory written by replay --out, to stand beside it; repeatable"
    report.add_argument("--beside", action="append", default=[], metavar="RESULT", help=text)
    add_common(report, " (bags only)")
    add_tracks(report)
    report.add_argument("--title", help="heading of the page (default: the name of the bag)")


EXAMPLES = """examples:
  lowcostnav report flight
  lowcostnav report tuned --beside shipped -o both.html       two results of one recording in one page"""


@job("One self-contained HTML page about a flight: map, errors in their sigmas, aids, tables.", add_arguments, EXAMPLES)
def report(arguments: argparse.Namespace) -> int:
    """Write the page; returns 0."""
    from lowcostnav_ros.cli.replay import replay_with_progress
    from lowcostnav_ros.report.flight.compared import side_by_side
    from lowcostnav_ros.report.flight.figures import axis_of
    from lowcostnav_ros.report.flight.page import page_of
    from lowcostnav_ros.report.flight.result_folder import read_result
    from lowcostnav_ros.report.flight.track_files import write_track
    from lowcostnav_ros.report.flight.vibration import vibration_section

    arguments.output = arguments.output or f"{Path(arguments.source).with_suffix('.html').name}"
    check_files(arguments.output, arguments.kml, arguments.gpx)
    source = Path(arguments.source)
    others = {Path(path).resolve().name: read_result(Path(path)) for path in arguments.beside}
    with tempfile.TemporaryDirectory(prefix="lowcostnav-report-") as folder:
        written, vibration, bag = source, "", None
        if not (source / "summary.json").is_file():
            written = Path(folder)
            summary = replay_with_progress(arguments, written)
            (written / "summary.json").write_text(json.dumps(summary.to_mapping(), allow_nan=False), encoding="utf-8")
            if not arguments.map:
                bag = source
                vibration = vibration_section(source, axis_of(summary))
        result = read_result(written)
    shown = side_by_side({source.resolve().name: result, **others}) if others else result
    page = page_of(shown, arguments.title, after=[vibration], bag=bag)
    write_text(Path(arguments.output), page)
    for path in filter(None, (arguments.kml, arguments.gpx)):
        write_track(shown, Path(path))
    print(f"{arguments.output} ({len(page.encode()) / 1e6:.1f} MB)")
    return 0
