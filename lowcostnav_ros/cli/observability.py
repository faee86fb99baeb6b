"""The observability job: rank and singular values of a navigator's measurements along a recording.

lowcostnav observability flight --navigator ins_gnss --period 5 --page observability.html
lowcostnav observability flight --navigator dead_reckoning --ranges 300
"""

import argparse
import json
from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import check_files

if TYPE_CHECKING:  # what works is imported by those that work: the options show at once
    from lowcostnav_ros.navigators.base import Navigator
    from lowcostnav_ros.report.terminal import Told
    from lowcostnav_ros.studies.observability import Observability
    from lowcostnav_ros.studies.range_observability import RangeWindow

WEAK = 0.5
"""A state counts as weakly observable when less than this share of it lies in the observable space."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    parser.add_argument("bag", help="bag directory, .mcap or .db3 file")
    parser.add_argument("--navigator", default="ins_gps", metavar="NAME", help="which to run (default: %(default)s)")
    parser.add_argument("--config", metavar="DIR", help="directory with <navigator>.yaml (default: the package's own)")
    parser.add_argument("--period", type=float, default=5.0, metavar="S", help="seconds between two looks (default: %(default)g)")
    parser.add_argument("--json", metavar="FILE", help="write rank, singular values and shares of the states over time as JSON")

    parser.add_argument("--page", metavar="HTML", help="write a page with ranks, singular values and the share of each state over time")
    text = "also what the ranges, taken one at a time, determine in windows of this length"
    parser.add_argument("--ranges", type=float, metavar="S", help=text)


EXAMPLE = "example: lowcostnav observability flight --navigator ins_gps"


@job("Which states of a navigator are observable, along a recording.", add_arguments, EXAMPLE)
def observability(arguments: argparse.Namespace) -> int:
    """Replay the bag through one navigator and print which of its states were observable."""
    from lowcostnav_ros.report.observability import drawings
    from lowcostnav_ros.report.plan_folder import page_of
    from lowcostnav_ros.report.terminal import print_report

    if not 0.0 < arguments.period <= 3600.0:
        raise SettingsError(f"--period must be above 0 and at most 3600 s, got {arguments.period:g}.")
    if arguments.ranges is not None and not 1.0 <= arguments.ranges <= 86400.0:
        raise SettingsError(f"--ranges must lie between 1 and 86400 s, got {arguments.ranges:g}.")
    check_files(arguments.json, arguments.page)
    navigator, found, windows = watch_bag(Path(arguments.bag), arguments.navigator, arguments.config, arguments.period, arguments.ranges)
    if not found:
        raise SettingsError(f"{arguments.navigator} fused nothing in {arguments.bag}: it ended {navigator.mode}, {navigator.reason}.")
    told = _told(navigator, found)
    print_report(*told)
    if arguments.ranges is not None:
        _print_ranges(windows, found[0].stamp_ns)
    if arguments.page:
        title = f"What {navigator.name} observes in {Path(arguments.bag).name}"
        write_text(arguments.page, page_of((title, *told[1:]), drawings(navigator.core.layout.labels, found, windows)))
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(as_plain(navigator, found, windows), indent=1) + "\n", encoding="utf-8")
    return 0


def watch_bag(
    bag: Path, name: str, config: str | None, period_s: float, window_s: float | None = None
) -> "tuple[Navigator, list[Observability], list[RangeWindow]]":
    """Run a navigator over a recording and look every ``period_s`` seconds, and at its ranges in windows of ``window_s`` seconds.

    Raises
    ------
    ValueError
        (BagError, SettingsError) when the recording lacks what the navigator needs.
    """
    from lowcostnav_ros.catalogue.building import build_navigators
    from lowcostnav_ros.messages.bag import BagReader
    from lowcostnav_ros.navigators.registry import NAVIGATORS
    from lowcostnav_ros.replay.selection import check_names
    from lowcostnav_ros.replay.session import Session
    from lowcostnav_ros.studies.observability import Watch
    from lowcostnav_ros.studies.range_observability import RangeWatch

    check_names([name], list(NAVIGATORS))
    kind: Any = NAVIGATORS[name]
    if reason := kind.not_observable:
        raise SettingsError(f"Observability of {name} is not offered: {reason}.")

    with BagReader(bag) as reader:
        folders = Path(config) if config else None, reader.settings_folder
        navigator = build_navigators([name], NAVIGATORS, *folders)[name]
        reader.decoder.rules.accept(navigator)
        others = _sources(navigator, reader.types)
        reader.require(s for s, required in navigator.inputs.items() if required and s not in others.values())
        flown = {**build_navigators(others, NAVIGATORS, *folders), name: navigator}
        session = Session(flown, rules=reader.decoder.rules)
        watch = Watch(navigator, period_s)
        ranges = None if window_s is None else RangeWatch(navigator, window_s)
        taken = {source for one in flown.values() for source in one.inputs}
        for measurement in reader.measurements(s for s in taken if s in reader.types):
            session.feed(measurement)
            if ranges is not None:
                ranges.see(measurement)
        session.finish()
    return navigator, watch.finish(), [] if ranges is None else ranges.windows()


def _sources(navigator: "Navigator", recorded: Collection[str]) -> dict[str, str]:
    """Navigators that must run beside, by name, each with the topic it publishes, which the recording lacks and the navigator needs."""
    from lowcostnav_ros.navigators.registry import NAVIGATORS
    from lowcostnav_ros.replay.links import output_topic

    lacking = {source for source, required in navigator.inputs.items() if required and source not in recorded}
    return {name: output_topic(name) for name in NAVIGATORS if output_topic(name) in lacking}


def as_plain(navigator: "Navigator", found: "list[Observability]", windows: "Sequence[RangeWindow]" = ()) -> dict[str, Any]:
    """Everything as plain numbers: states, and for each instant rank, singular values and the share of each state."""
    from lowcostnav_ros.gnss.operation_count import operations
    from lowcostnav_ros.radionav.observability import STATES

    instants = [
        {
            "t_s": o.stamp_ns / 1e9,
            "rows": o.rows,
            "operations": operations(navigator.core.layout.size, o.rows),
            "rank": o.rank,
            "singular_values": o.singular_values.tolist(),
            "share": o.share.tolist(),
        }
        for o in found
    ]
    plain = {"navigator": navigator.name, "states": list(navigator.core.layout.labels), "instants": instants}
    if windows:
        plain["range_states"] = list(STATES)
        plain["range_windows"] = [{**asdict(w), "singular_values": w.singular_values.tolist()} for w in windows]
    return plain


def _told(navigator: "Navigator", found: "list[Observability]") -> "Told":
    from lowcostnav_ros.gnss.operation_count import operations
    from lowcostnav_ros.report.flight.figures import name_of

    size, labels = navigator.core.layout.size, navigator.core.layout.labels
    heads = ("t [s]", "rows", "rank", f"unobservable, of {size}", "largest and smallest counted singular value")
    rows, start_ns = [], found[0].stamp_ns
    for o in found[:: max(1, len(found) // 20)]:
        values = f"{o.singular_values[0]:.2g}, {o.singular_values[o.rank - 1]:.2g}"
        rows.append((f"{(o.stamp_ns - start_ns) / 1e9:.1f}", str(o.rows), str(o.rank), str(size - o.rank), values))
    share = np.mean([o.share for o in found], axis=0)
    weak = [name_of(label) for label, part in zip(labels, share, strict=True) if part < WEAK]
    ranks = [o.rank for o in found]
    ranked = f"{navigator.name}: rank {min(ranks)} to {max(ranks)} of {size} at single instants, mean {sum(ranks) / len(ranks):.1f}."
    most = max(o.rows for o in found)
    load = f"A dense cycle of {size} states takes {operations(size, most):,} multiplications and additions with {most} rows, "
    load += f"{operations(size, 1):,} with one; what is flown uses the sparse dynamics, and takes less."
    weakly = f"Weakly observable within an instant: {', '.join(weak) or 'none'}."
    return "", (Table.plain("", heads, rows, left=0),), (ranked, weakly, load)


def _print_ranges(windows: "list[RangeWindow]", start_ns: int) -> None:
    from lowcostnav_ros.report.terminal import print_report

    heads = ("t [s]", "ranges", "stations", "position, of 2", "wind too, of 4", "heading, airspeed too, of 6", "singular values, scaled")
    rows = []
    for w in windows:
        values = " ".join(f"{v:.2g}" for v in w.singular_values)
        rows.append((f"{(w.start_ns - start_ns) / 1e9:.0f}", str(w.ranges), " ".join(w.stations), *map(str, w.ranks), values))
    note = "Ranks are those of noise-free ranges; a combination with the singular value s takes on 1/s of the error of one range."
    print_report("", [Table.plain("ranges taken one at a time", heads, rows, left=0)], [note if rows else "No window holds two ranges."])
