"""The run job: one node in this process."""

import argparse
import importlib

from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.list import names_of


def add_arguments(run: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    run.add_argument("node", help=f"one of {names_of('nodes')}")
    run.add_argument("ros_args", nargs=argparse.REMAINDER, help="passed on to the node, usually --ros-args ...")


@job("Run one node in this process.", add_arguments, "example: lowcostnav run ahrs --ros-args --params-file ahrs.yaml")
def run(arguments: argparse.Namespace) -> int:
    """Run one node in this process; returns the node's exit status."""
    # by name: the command line itself imports no ROS
    return importlib.import_module("lowcostnav_ros.nodes.dispatch").run_executable(arguments.node, arguments.ros_args)
