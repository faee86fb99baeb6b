"""Jobs that run the system: nodes, graphs, the demo, the self-check, conversion of recorded logs."""

import argparse
import importlib
import sys
from pathlib import Path


def run(arguments: argparse.Namespace) -> int:
    """Run one node in this process; returns the node's exit status."""
    # by name: the command line itself imports no ROS
    return importlib.import_module("lowcostnav_ros.nodes.dispatch").run_executable(arguments.node, arguments.ros_args)


def parameters(arguments: argparse.Namespace) -> int:
    """Print the parameter file of an executable."""
    from lowcostnav_ros.graph.executables import parameter_file

    print(parameter_file(arguments.node), end="")
    return 0


def up(arguments: argparse.Namespace) -> int:
    """Start a graph and keep it up."""
    from lowcostnav_ros.graph import up as graph_up
    from lowcostnav_ros.graph.description import load_graph

    out = Path(arguments.out) if arguments.out else None
    show = False if arguments.no_table else None
    return graph_up.up(load_graph(arguments.graph), out=out, show=show, until_finished=arguments.until_finished)


def doctor(_: argparse.Namespace) -> int:
    """Check the machine."""
    from lowcostnav_ros.cli import doctor as check

    return check.main()


def demo(arguments: argparse.Namespace) -> int:
    """Fly the demonstration mission."""
    from lowcostnav_ros.cli import demo as mission

    return mission.demonstrate(arguments.graph, Path(arguments.out), arguments.real_time_factor)


def convert(arguments: argparse.Namespace) -> int:
    """Turn a recorded log into a bag."""
    from lowcostnav_ros import convert as conversion
    from lowcostnav_ros.convert.profile import ConvertError, shipped_profile_for
    from lowcostnav_ros.convert.rinex_files import is_rinex

    if arguments.navigation:
        return _convert_rinex(arguments)
    if is_rinex(arguments.source):
        raise ConvertError(f"{arguments.source} is a RINEX file; name the file of its ephemerides with --navigation.")
    if arguments.at_rest:
        raise ConvertError("--at-rest is for RINEX files; give --navigation too, or leave it out.")
    profile = arguments.profile or shipped_profile_for(arguments.source)
    report = conversion.convert(arguments.source, profile, arguments.output)
    if report is not None:
        print(report, file=sys.stdout)
    return 0


def _convert_rinex(arguments: argparse.Namespace) -> int:
    from lowcostnav_ros.cli.replay import progress_bar
    from lowcostnav_ros.convert.profile import ConvertError
    from lowcostnav_ros.convert.rinex import convert_rinex

    if arguments.profile:
        raise ConvertError("--profile is for tables and --navigation for RINEX files; leave one of them out.")
    with progress_bar("convert") as advance:
        report = convert_rinex(
            arguments.source, arguments.navigation, arguments.output, at_rest=arguments.at_rest, on_progress=advance
        )
    print(report)
    return 0
