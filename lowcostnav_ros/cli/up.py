"""The up job: a graph of nodes on a terminal."""

import argparse
import os
from dataclasses import replace
from pathlib import Path

from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.list import names_of
from lowcostnav_ros.cli.options import between
from lowcostnav_ros.graph import up as graph_up
from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.graph.domain import HIGHEST
from lowcostnav_ros.graph.page.server import TOKEN, parse_listen, token_for
from lowcostnav_ros.graph.wiring import completed, with_nodes, with_page


def add_arguments(up: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    up.add_argument("graph", help=f"a graph of the package ({names_of('graphs')}), or a YAML file")
    text = "ROS domain; default: the graph's, else your ROS_DOMAIN_ID, or any free one where the graph simulates its sensors"
    up.add_argument("--domain", type=int, metavar="N", help=text)
    up.add_argument("--out", metavar="DIR", help="where the graph's recorder writes (default: the folder of the logs)")
    up.add_argument("--until-finished", action="store_true", help="stop when the flight is over")
    text = "address and port of the page that shows the flight (default: 127.0.0.1:8040); beyond this machine it asks for a token"
    up.add_argument("--listen", metavar="ADDRESS", default="", help=text)
    up.add_argument("--with", nargs="+", dest="further", metavar="NODE", default=[], help="further nodes: display, foxglove")
    up.add_argument("--no-page", action="store_true", help="without that page")
    up.add_argument("--no-table", action="store_true", help="print events line by line, even on a terminal")


EXAMPLE = """\
examples:
  lowcostnav up livermore --until-finished --out runs/1   a simulated flight, live, with a table
  lowcostnav up livermore --listen 0.0.0.0:8040           the page of the flight for a tablet, too; the address is printed
  lowcostnav up livermore --with display foxglove         for Foxglove, RViz, PlotJuggler: config/layouts
  ROS_DOMAIN_ID=7 lowcostnav up navigators_only           the navigators and a recorder on your own sensors' topics"""


@job("Start a graph of nodes, watch it, stop it with Ctrl-C.", add_arguments, EXAMPLE)
def up(arguments: argparse.Namespace) -> int:
    """Start a graph and keep it up."""
    out = Path(arguments.out) if arguments.out else None
    show = False if arguments.no_table else None
    graph = load_graph(arguments.graph)
    if arguments.domain is not None:
        graph = replace(graph, domain=round(between("--domain", arguments.domain, 0, HIGHEST)))
    if arguments.listen:
        os.environ[TOKEN] = token_for(parse_listen(arguments.listen)[0])  # known here, so that it can be printed
    graph = with_nodes(completed(graph), arguments.further)
    graph = graph if arguments.no_page else with_page(graph, arguments.listen)
    return graph_up.up(graph, out=out, show=show, until_finished=arguments.until_finished)
