"""The replay job: options in, tables and files out, verdict as exit status."""

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.catalogue.config_files import vehicle_dir
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_reading, check_files, check_folder
from lowcostnav_ros.cli.progress import progress_bar

if TYPE_CHECKING:  # what flies is imported by those that fly: the options show at once
    from lowcostnav_ros.replay.baseline import Verdict
    from lowcostnav_ros.replay.result import ReplayResult

NOTES = """\
withholding: 'gps/fix,gps/vel@290-350' keeps these sources from the navigators from 290 s to 350 s, @290- to the end; without @ all flight.
  Seconds count from the bag's start; a window that starts after its first stamp (t_s) is read as stamps.
example: lowcostnav replay flight --withhold gps/fix,gps/vel@60-120 --out result
errors: against truth/odometry (or --truth) where the bag has it, else against the withheld fixes."""


def add_arguments(replay: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    replay.add_argument("bag", help="bag directory, .mcap or .db3 file")
    add_common(replay)
    replay.add_argument("--truth", metavar="TOPIC", help="odometry topic to compare with (default: truth/odometry)")
    text = "write <navigator>.csv, _aids.csv, _errors.csv, _states.csv, _smoothed.csv and summary.json there"
    replay.add_argument("--out", metavar="DIR", help=text)
    replay.add_argument("--json", metavar="FILE", help="write the result as JSON")
    replay.add_argument("--baseline", metavar="FILE", help="compare with this baseline; exit status 1 when worse")
    replay.add_argument("--write-baseline", metavar="FILE", help="write a baseline from this replay")


def add_common(parser: argparse.ArgumentParser, note: str = "") -> None:
    """Add the options that ``replay`` and ``report`` share."""
    parser.add_argument("--navigators", metavar="A,B", help=f"which to run (default: all whose required inputs the bag has){note}")
    parser.add_argument("--config", metavar="DIR", help=f"directory with <navigator>.yaml (default: the package's own){note}")
    text = f"fly the settings of a vehicle: its name in config/vehicles or a folder{note}"
    parser.add_argument("--vehicle", metavar="NAME", help=text)
    text = f"keep sources back; repeatable{note}"
    parser.add_argument("--withhold", action="append", default=[], metavar="SRC[,SRC][@A-[B]]", help=text)
    add_reading(parser)
    parser.add_argument("--smooth", action="store_true", help=f"smooth the whole flight backwards as well{note}")


@job("Run the navigators over a bag, offline and repeatable to the last bit, and judge them.", add_arguments, NOTES)
def replay(arguments: argparse.Namespace) -> int:
    """Replay a bag; 0 when nothing is worse than the baseline, 1 when something is."""
    from lowcostnav_ros.replay import baseline
    from lowcostnav_ros.replay.tables import verdict_table
    from lowcostnav_ros.report.terminal import print_result, print_table, result_console

    expected = baseline.load_baseline(Path(arguments.baseline)) if arguments.baseline else None
    check_files(arguments.json, arguments.write_baseline)
    check_folder(arguments.out)
    out = Path(arguments.out) if arguments.out else None
    result = replay_with_progress(arguments, out, arguments.truth)
    found = result.recording.bag.sha256 if result.recording else ""
    if expected is not None and expected[0] not in (None, found):
        text = f"Baseline {arguments.baseline} belongs to another bag (sha256 {expected[0][:16]}, this one is {found[:16]})."
        raise baseline.BaselineError(text)
    console, verdicts = result_console(), list[baseline.Verdict]()
    print_result(result, console)
    if expected is not None:
        judged = [e for e in expected[1] if not arguments.navigators or e.navigator in result.navigators]
        verdicts = baseline.judge(judged, result.to_mapping())
        noted = tuple({"metric": f"{v.navigator}.{v.metric}", "verdict": v.verdict} for v in verdicts)
        result = dataclasses.replace(result, verdicts=noted)
        print_table(verdict_table(verdicts), console)
        console.print(_verdict_sentence(verdicts), highlight=False)
    for line in _write(arguments, out, result.to_mapping()):
        console.print(line, highlight=False)
    return Exit.WORSE if any(v.verdict == baseline.WORSE for v in verdicts) else Exit.OK


def replay_with_progress(arguments: argparse.Namespace, out: Path | None, truth: str | None = None) -> "ReplayResult":
    """Replay as the common options of ``replay`` and ``report`` say, with a progress bar on a terminal."""
    from lowcostnav_ros.messages.foreign import parse_maps
    from lowcostnav_ros.replay import bag_replay
    from lowcostnav_ros.replay.withhold import parse_withhold

    names = tuple(n.strip() for n in arguments.navigators.split(",") if n.strip()) if arguments.navigators else None
    withhold = tuple(parse_withhold(text) for text in arguments.withhold)
    if arguments.config and arguments.vehicle:
        raise SettingsError("--config and --vehicle both name settings; give one of them.")
    config = Path(arguments.config) if arguments.config else vehicle_dir(arguments.vehicle) if arguments.vehicle else None
    with progress_bar("replay") as advance:
        reading = parse_maps(arguments.map), tuple(arguments.frame)
        options = bag_replay.ReplayOptions(names, config, withhold, truth, out, arguments.registry, advance, arguments.smooth, *reading)
        return bag_replay.replay_bag(arguments.bag if "bag" in arguments else arguments.source, options)


def _verdict_sentence(verdicts: "Sequence[Verdict]") -> str:
    from lowcostnav_ros.replay.baseline import BETTER, SAME, WORSE

    count = {v: sum(1 for x in verdicts if x.verdict == v) for v in (BETTER, SAME, WORSE)}
    return f"{'WORSE' if count[WORSE] else 'PASS'}: {', '.join(f'{n} {verdict}' for verdict, n in count.items())}"


def _write(arguments: argparse.Namespace, out: Path | None, mapping: dict[str, Any]) -> list[str]:
    """Write the files that were asked for; return a line about each."""
    from lowcostnav_ros.replay.baseline import write_baseline

    lines = []
    text = json.dumps(mapping, indent=1, allow_nan=False) + "\n"
    if arguments.json:
        write_text(arguments.json, text)
    if out is not None:
        write_text(out / "summary.json", text)
        lines.append(f"results in {out}")
    if arguments.write_baseline:
        count = write_baseline(Path(arguments.write_baseline), mapping)
        lines.append(f"baseline of {count} metrics in {arguments.write_baseline}")
    return lines
