"""The report job: a bag (replayed first) or a replay's result folder becomes one HTML page."""

import argparse
import json
import tempfile
from pathlib import Path

from lowcostnav_ros.cli.replay import replay_with_progress
from lowcostnav_ros.report.flight.page import write_page


def report(arguments: argparse.Namespace) -> int:
    """Write the page; returns 0."""
    source = Path(arguments.source)
    if (source / "summary.json").is_file():
        size = write_page(source, Path(arguments.output), arguments.title)
    else:
        with tempfile.TemporaryDirectory(prefix="lowcostnav-report-") as folder:
            out = Path(folder)
            summary = replay_with_progress(arguments, out)
            (out / "summary.json").write_text(json.dumps(summary, allow_nan=False), encoding="utf-8")
            size = write_page(out, Path(arguments.output), arguments.title)
    print(f"{arguments.output} ({size / 1e6:.1f} MB)")
    return 0
