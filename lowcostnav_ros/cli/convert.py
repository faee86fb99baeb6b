"""The convert job: a recorded log becomes a bag with the standard topics."""

import argparse
import sys
from datetime import date
from pathlib import Path

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.progress import progress_bar

MOST_MALFORMED = 0.2
"""Share of malformed rows beyond which a conversion has failed."""


def add_arguments(convert: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    convert.add_argument("source", help="file or directory of the log, or a RINEX observation file")
    convert.add_argument("-o", "--output", metavar="BAG", help="bag to create; with --guess the profile to write (default: on the screen)")
    convert.add_argument("--guess", action="store_true", help="write a first profile of a table, by names and magnitudes, to be corrected")
    convert.add_argument("--profile", metavar="NAME|FILE", help="column profile: a shipped one or a YAML file (default: the one that fits)")
    text = "day of a log that holds times of day alone"
    convert.add_argument("--date", type=date.fromisoformat, metavar="YYYY-MM-DD", help=text)
    text = "bag of ROS 1, or of another system: read this recorded topic as one of ours; may be given more than once"
    convert.add_argument("--map", action="append", default=[], metavar="RECORDED=OURS", help=text)
    text = "rotation from the axes of the inertial sensor to those of the aircraft, deg"
    convert.add_argument("--mounting", type=angles, metavar="ROLL,PITCH,YAW", help=text)
    text = "RINEX navigation files: SOURCE is then an observation file, and the bag gets gnss/raw"
    convert.add_argument("--navigation", nargs="+", metavar="NAV", help=text)
    convert.add_argument("--at-rest", action="store_true", help="RINEX: the header's coordinates are the truth, recorded as truth/odometry")


def angles(text: str) -> tuple[float, float, float]:
    """Three angles of ROLL,PITCH,YAW, deg."""
    roll, pitch, yaw = (float(part) for part in text.split(","))
    return roll, pitch, yaw


EXAMPLES = """examples:
  lowcostnav convert flight.ulg -o bag                    any known log: ULog, dataflash, tlog, ubx, NMEA, IGC, Garmin, ROS bags
  lowcostnav convert --guess my.csv -o my.yaml            a first profile of a table, to be corrected
  lowcostnav convert my.csv --profile my.yaml -o bag
  lowcostnav convert st.05o --navigation st.05n -o bag    RINEX files"""


@job("Turn a recorded log of any known format into a bag with the standard topics.", add_arguments, EXAMPLES)
def convert(arguments: argparse.Namespace) -> int:
    """Turn a recorded log into a bag."""
    from lowcostnav_ros import convert as conversion
    from lowcostnav_ros.convert.any_log import convert_any
    from lowcostnav_ros.convert.profile import ConvertError, shipped_profile_for
    from lowcostnav_ros.convert.recognise import Options
    from lowcostnav_ros.messages.foreign import parse_maps

    if arguments.guess:
        return _guess(arguments)
    if not arguments.output:
        raise ConvertError("Give the bag to create with -o; only --guess needs none.")
    if arguments.navigation:
        return _convert_rinex(arguments)
    if arguments.at_rest:
        raise ConvertError("--at-rest is for RINEX files; give --navigation too, or leave it out.")
    if not arguments.profile:
        options = Options(arguments.date, arguments.mounting)
        summary = convert_any(Path(arguments.source), arguments.output, options, parse_maps(arguments.map))
        if summary is not None:
            print(summary)
            return 0
    profile = arguments.profile or shipped_profile_for(arguments.source)
    report = conversion.convert(arguments.source, profile, arguments.output)
    print(report)
    if report.malformed_share > MOST_MALFORMED:
        print(f"{report.malformed_share:.0%} of the rows are malformed: correct the profile, or the logger.", file=sys.stderr)
        return 1
    return 0


def _guess(arguments: argparse.Namespace) -> int:
    from lowcostnav_ros.convert.guess import guess

    text = guess(arguments.source)
    if arguments.output:
        write_text(arguments.output, text)
    print(text if not arguments.output else f"{arguments.output} written: correct it, then give it with --profile.")
    return 0


def _convert_rinex(arguments: argparse.Namespace) -> int:
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
