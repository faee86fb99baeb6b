"""The run job: one node in this process."""

import argparse
import importlib
import pkgutil

from lowcostnav_ros.base.settings import SettingsError, nearest
from lowcostnav_ros.cli.jobs import job


def add_arguments(run: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    run.add_argument("node", help="name of the node, such as ahrs or recorder")
    run.add_argument("ros_args", nargs=argparse.REMAINDER, help="passed on to the node, usually --ros-args ...")


@job("Run one node in this process.", add_arguments, "example: lowcostnav run ahrs --ros-args --params-file ahrs.yaml")
def run(arguments: argparse.Namespace) -> int:
    """Run one node in this process; returns the node's exit status."""
    from lowcostnav_ros import nodes

    known = sorted(m.name for m in pkgutil.iter_modules(nodes.__path__) if not m.name.startswith("_"))
    if arguments.node not in known:
        raise SettingsError(f"There is no node '{arguments.node}'{nearest(arguments.node, known)}.")
    return importlib.import_module(f"lowcostnav_ros.nodes.{arguments.node}").main(arguments.ros_args) or 0
