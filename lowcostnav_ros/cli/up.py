"""The up job: a graph of nodes on a terminal."""

import argparse
from pathlib import Path

from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.graph import up as graph_up
from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.graph.wiring import completed


def add_arguments(up: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    up.add_argument("graph", help="name of a graph of the package, or a YAML file")
    up.add_argument("--out", metavar="DIR", help="where the graph's recorder writes")
    up.add_argument("--until-finished", action="store_true", help="stop when the flight is over")
    up.add_argument("--no-table", action="store_true", help="print events line by line, even on a terminal")


EXAMPLE = "example: lowcostnav up livermore --until-finished --out runs/1"


@job("Start a graph of nodes, watch it, stop it with Ctrl-C.", add_arguments, EXAMPLE)
def up(arguments: argparse.Namespace) -> int:
    """Start a graph and keep it up."""
    out = Path(arguments.out) if arguments.out else None
    show = False if arguments.no_table else None
    return graph_up.up(completed(load_graph(arguments.graph)), out=out, show=show, until_finished=arguments.until_finished)
