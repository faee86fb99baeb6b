"""The convert job: a recorded log becomes a bag with the standard topics."""

import argparse
from datetime import date
from pathlib import Path

from lowcostnav_ros import convert as conversion
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.progress import progress_bar
from lowcostnav_ros.convert.profile import ConvertError, shipped_profile_for
from lowcostnav_ros.convert.recognise import Options, convert_log, recognise
from lowcostnav_ros.convert.rinex import convert_rinex
from lowcostnav_ros.convert.rinex_files import is_rinex


def add_arguments(convert: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    convert.add_argument("source", help="file or directory of the log, or a RINEX observation file")
    convert.add_argument("-o", "--output", required=True, metavar="BAG", help="bag to create")
    convert.add_argument("--profile", metavar="NAME|FILE", help="column profile: a shipped one or a YAML file (default: the one that fits)")
    text = "day of a log that holds times of day alone"
    convert.add_argument("--date", type=date.fromisoformat, metavar="YYYY-MM-DD", help=text)
    text = "RINEX navigation files: SOURCE is then an observation file, and the bag gets gnss/raw"
    convert.add_argument("--navigation", nargs="+", metavar="NAV", help=text)
    convert.add_argument("--at-rest", action="store_true", help="RINEX: the header's coordinates are the truth, recorded as truth/odometry")


@job("Turn a recorded log (CSV, or RINEX files) into a bag with the standard topics.", add_arguments)
def convert(arguments: argparse.Namespace) -> int:
    """Turn a recorded log into a bag."""
    if arguments.navigation:
        return _convert_rinex(arguments)
    if is_rinex(arguments.source):
        raise ConvertError(f"{arguments.source} is a RINEX file; name the file of its ephemerides with --navigation.")
    if arguments.at_rest:
        raise ConvertError("--at-rest is for RINEX files; give --navigation too, or leave it out.")
    path = Path(arguments.source)
    if not arguments.profile and path.is_file() and (form := recognise(path)) is not None:
        print(convert_log(path, form, arguments.output, Options(arguments.date)))
        return 0
    profile = arguments.profile or shipped_profile_for(arguments.source)
    report = conversion.convert(arguments.source, profile, arguments.output)
    if report is not None:
        print(report)
    return 0


def _convert_rinex(arguments: argparse.Namespace) -> int:
    if arguments.profile:
        raise ConvertError("--profile is for tables and --navigation for RINEX files; leave one of them out.")
    with progress_bar("convert") as advance:
        report = convert_rinex(
            arguments.source, arguments.navigation, arguments.output, at_rest=arguments.at_rest, on_progress=advance
        )
    print(report)
    return 0
