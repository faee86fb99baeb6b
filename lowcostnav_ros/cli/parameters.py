"""The parameters job: the parameter file of an executable, every parameter with its meaning, unit and range."""

import argparse

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.graph.executables import parameter_file


def add_arguments(parameters: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    parameters.add_argument("node", help="name of the executable")
    words = "sensors of a navigator in place of its usual ones: gps baro baro2"
    parameters.add_argument("--aids", nargs="+", default=(), metavar="SENSOR", help=words)


@job(
    "Print the parameter file of an executable: every parameter with its meaning, unit and range.",
    add_arguments,
    "example: lowcostnav parameters ins_gps > ins_gps.yaml",
)
def parameters(arguments: argparse.Namespace) -> int:
    """Print the parameter file of an executable."""
    print(parameter_file(arguments.node, arguments.aids), end="")
    return Exit.OK
