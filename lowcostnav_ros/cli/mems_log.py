"""The mems_log job: every signal of the MEMS navigator over a recording, as a table with tabs."""

import argparse
import math
from pathlib import Path
from typing import Any, TextIO

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_reading

EXAMPLE = "example: lowcostnav mems_log flight -o flight.txt --config my_settings   positions, offsets, biases, rates; a row a solution"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    parser.add_argument("bag", help="bag directory, .mcap or .db3 file")
    parser.add_argument("-o", "--output", required=True, metavar="FILE", type=Path, help="table to write")
    parser.add_argument("--config", type=Path, metavar="DIR", help="directory with mems_ins.yaml (default: the package's own)")
    add_reading(parser)


@job("Every signal of the MEMS navigator over a recording, as a table with tabs.", add_arguments, EXAMPLE)
def mems_log(arguments: argparse.Namespace) -> int:
    """Replay, and write a row for each solution; a live flight's solutions are those of its recording."""
    from lowcostnav_ros.messages.foreign import parse_maps
    from lowcostnav_ros.navigators.registry import NAVIGATORS
    from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
    from lowcostnav_ros.replay.selection import SelectionError

    with arguments.output.open("w", encoding="utf-8") as file:
        logged = logging_to(file)
        options = ReplayOptions(config=arguments.config, maps=parse_maps(arguments.map), frames=tuple(arguments.frame))
        registry: dict[str, Any] = {"ahrs": NAVIGATORS["ahrs"], "mems_ins": logged}
        try:
            replay_bag(arguments.bag, ReplayOptions(**{**vars(options), "registry": registry, "navigators": ("ahrs", "mems_ins")}))
        except SelectionError:  # no inertial samples: the recording must have the attitude
            replay_bag(arguments.bag, ReplayOptions(**{**vars(options), "registry": registry, "navigators": ("mems_ins",)}))
    print(f"{logged.rows} rows in {arguments.output}")
    return Exit.OK if logged.rows else Exit.WORSE


def logging_to(file: TextIO) -> Any:
    """The navigator, writing what it gives out."""
    from lowcostnav_ros.navigators.mems_ins.log import row_of
    from lowcostnav_ros.navigators.mems_ins.navigator import MemsIns


    class Logged(MemsIns):
        """As its base; the header is that of the first row."""

        rows = 0
        columns: tuple[str, ...] = ()
        first_ns = 0

        def publish(self, solution: NavSolution) -> None:
            super().publish(solution)
            kind = Logged
            kind.first_ns = kind.first_ns or solution.stamp_ns
            row = row_of(self, solution, kind.first_ns)
            if not kind.columns:
                kind.columns = tuple(row)
                file.write("\t".join(kind.columns) + "\n")
            file.write("\t".join(_shown(row.get(name, math.nan)) for name in kind.columns) + "\n")
            kind.rows += 1

    return Logged


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else "" if math.isnan(value) else f"{value:.9g}"
