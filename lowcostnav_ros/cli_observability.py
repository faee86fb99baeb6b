"""The observability job: rank and singular values of an inertial navigator's measurements along a recording.

lowcostnav observability flight --navigator ins_gnss --period 5 --json observability.json
"""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lowcostnav_ros.settings import SettingsError

if TYPE_CHECKING:
    from lowcostnav_ros.estimation.observability import Observability
    from lowcostnav_ros.navigators.base import Navigator

INERTIAL = ("ins_gps", "ins_gnss")
WEAK = 0.5
"""A state counts as not told when less than this share of it lies in the observable space."""


def add_arguments(job: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    job.add_argument("bag", help="bag directory, .mcap or .db3 file")
    job.add_argument("--navigator", choices=INERTIAL, default=INERTIAL[0], help="which to run (default: %(default)s)")
    job.add_argument("--config", metavar="DIR", help="directory with <navigator>.yaml (default: the package's own)")
    job.add_argument("--period", type=float, default=5.0, metavar="S", help="seconds between two looks (default: %(default)g)")
    job.add_argument("--json", metavar="FILE", help="write rank, singular values and shares of the states over time as JSON")


def observability(arguments: argparse.Namespace) -> int:
    """Replay the bag through one navigator and print what its measurements could tell."""
    if not 0.0 < arguments.period <= 3600.0:
        raise SettingsError(f"--period must be above 0 and at most 3600 s, got {arguments.period:g}.")
    if arguments.json and not Path(arguments.json).resolve().parent.is_dir():
        raise SettingsError(f"The folder of {arguments.json} does not exist; create it first.")
    navigator, found = watch_bag(Path(arguments.bag), arguments.navigator, arguments.config, arguments.period)
    if not found:
        raise SettingsError(f"{arguments.navigator} fused nothing in {arguments.bag}: it ended {navigator.mode}, {navigator.reason}.")
    _print(navigator, found)
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(as_plain(navigator, found), indent=1) + "\n", encoding="utf-8")
    return 0


def watch_bag(bag: Path, name: str, config: str | None, period_s: float) -> "tuple[Navigator, list[Observability]]":
    """Run a navigator over a recording and look every ``period_s`` seconds.

    Raises
    ------
    ValueError
        (BagError, SettingsError) when the recording lacks what the navigator needs.
    """
    from lowcostnav_ros.estimation.observability import Watch
    from lowcostnav_ros.messages.bag import BagReader
    from lowcostnav_ros.navigators.inertial import dynamics_now
    from lowcostnav_ros.navigators.registry import NAVIGATORS
    from lowcostnav_ros.replay.building import build_navigators

    with BagReader(bag) as reader:
        navigator = build_navigators([name], NAVIGATORS, Path(config) if config else None, reader.settings_folder)[name]
        reader.require(source for source, required in navigator.inputs.items() if required)
        watch = Watch(navigator, dynamics_now, period_s)
        for measurement in reader.measurements(s for s in navigator.inputs if s in reader.types):
            navigator.feed(measurement)
    return navigator, watch.finish()


def as_plain(navigator: "Navigator", found: "list[Observability]") -> dict[str, Any]:
    """Everything as plain numbers: states, and for each instant rank, singular values and the share of each state."""
    instants = [
        {
            "t_s": o.stamp_ns / 1e9,
            "rows": o.rows,
            "rank": o.rank,
            "singular_values": o.singular_values.tolist(),
            "share": o.share.tolist(),
        }
        for o in found
    ]
    return {"navigator": navigator.name, "states": list(navigator.layout.labels), "instants": instants}


def _print(navigator: "Navigator", found: "list[Observability]") -> None:
    from rich.console import Console
    from rich.table import Table

    size, labels = navigator.layout.size, navigator.layout.labels
    table = Table("t [s]", "rows", "rank", f"not told, of {size}", "largest and smallest counted singular value", box=None)
    start_ns = found[0].stamp_ns
    for o in found[:: max(1, len(found) // 20)]:
        values = f"{o.singular_values[0]:.2g}, {o.singular_values[o.rank - 1]:.2g}"
        table.add_row(f"{(o.stamp_ns - start_ns) / 1e9:.1f}", str(o.rows), str(o.rank), str(size - o.rank), values)
    console = Console(width=100)
    console.print(table)
    share = sum(o.share for o in found) / len(found)
    weak = [label for label, part in zip(labels, share, strict=True) if part < WEAK]
    ranks = [o.rank for o in found]
    console.print(f"{navigator.name}: rank {min(ranks)} to {max(ranks)} of {size} at single instants, mean {sum(ranks) / len(ranks):.1f}.")
    console.print(f"hardly told within an instant: {', '.join(weak) or 'none'}", highlight=False)
