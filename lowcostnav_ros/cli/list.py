"""The list job: what there is by name."""

import argparse
from collections.abc import Callable, Iterable

from lowcostnav_ros.base.settings import SettingsError, nearest
from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.graph.executables import EXECUTABLES, kind_of
from lowcostnav_ros.navigators.registry import NAVIGATORS


def shipped(folder: str, pattern: str = "*.yaml") -> tuple[str, ...]:
    """Names of the files in a folder of the shipped configuration."""
    return tuple(sorted(path.stem for path in (config_dir() / folder).glob(pattern)))


KINDS: dict[str, tuple[str, Callable[[], Iterable[str]]]] = {
    "scenarios": ("lowcostnav simulate NAME -o flight", lambda: shipped("scenarios")),
    "graphs": ("lowcostnav up NAME", lambda: shipped("graphs")),
    "navigators": ("lowcostnav replay BAG --navigators NAME", lambda: NAVIGATORS),
    "nodes": ("lowcostnav run NAME; lowcostnav parameters NAME", lambda: sorted(EXECUTABLES, key=lambda name: (kind_of(name), name))),
    "profiles": ("imu.profile: NAME; lowcostnav profiles NAME", lambda: shipped("profiles")),
    "logs": ("lowcostnav convert LOG -o flight --profile NAME", lambda: shipped("convert")),
    "vehicles": ("lowcostnav replay BAG --config config/vehicles/NAME", lambda: shipped("vehicles", "*")),
    "stations": ("lowcostnav dme plan --stations NAME.csv", lambda: shipped(".", "dme_stations_*.csv")),
}
"""Kinds of things: how a name is used, and the names."""


def names_of(kind: str) -> str:
    """Names of one kind, for a help text."""
    return ", ".join(KINDS[kind][1]())


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"one of {', '.join(KINDS)} (default: all)")


@job("What there is by name: scenarios, graphs, navigators, nodes, profiles.", add_arguments, "example: lowcostnav list scenarios graphs")
def list(arguments: argparse.Namespace) -> int:
    """Print names, and how each is used."""
    for kind in arguments.kinds or KINDS:
        if kind not in KINDS:
            raise SettingsError(f"There is no list of '{kind}'{nearest(kind, KINDS)}.")
        print(f"{kind} ({KINDS[kind][0]})\n  {names_of(kind)}")
    return 0
