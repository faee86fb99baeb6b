"""The ``lowcostnav`` command: one word per job, exit status 0 pass, 1 worse or failed, 2 cannot run.

Imports are made by the job that needs them, so that ``lowcostnav --help`` answers at once.
"""

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import Any

from lowcostnav_ros import __version__
from lowcostnav_ros.cli import calibrate as cli_calibrate
from lowcostnav_ros.cli import dme as cli_dme
from lowcostnav_ros.cli import gnss as cli_gnss
from lowcostnav_ros.cli import observability as cli_observability
from lowcostnav_ros.cli import profiles as cli_profiles
from lowcostnav_ros.cli import reproduce as cli_reproduce

EXIT_OK, EXIT_WORSE, EXIT_CANNOT_RUN, EXIT_INTERRUPTED = 0, 1, 2, 130

_EPILOG = """\
exit status: 0 pass, 1 worse than the baseline or a failed check, 2 cannot run (one sentence on stderr says what to do)

examples:
  lowcostnav demo                                          a whole mission with a GPS outage, and its report
  lowcostnav simulate livermore -o flight                  a simulated flight as a bag
  lowcostnav replay flight --withhold gps/fix,gps/vel@290-350 --out result
  lowcostnav replay flight --baseline flight.baseline.yaml
  lowcostnav report flight -o report.html
"""

_JOBS = {
    "run": "system",
    "up": "system",
    "parameters": "system",
    "doctor": "system",
    "demo": "system",
    "convert": "system",
    "simulate": "simulate",
    "replay": "replay",
    "report": "report",
    "reproduce": "reproduce",
    "allan": "calibrate",
    "identify": "calibrate",
    "magcal": "calibrate",
    "dme": "dme",
    "gnss": "gnss",
    "observability": "observability",
    "profiles": "profiles",
}


def parser() -> argparse.ArgumentParser:
    """The command line as argparse knows it."""
    top = argparse.ArgumentParser(
        prog="lowcostnav", description="Low-cost aircraft navigation, with GPS and without.", epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    top.add_argument("--version", action="version", version=f"lowcostnav_ros {__version__}")
    jobs = top.add_subparsers(dest="job", metavar="JOB", required=True)
    _add_system_jobs(jobs)
    _add_simulate(jobs)
    _add_replay(jobs)
    _add_report(jobs)
    cli_reproduce.add_parsers(jobs)
    cli_calibrate.add_parsers(jobs)
    cli_dme.add_arguments(_job(jobs, "dme", "Plan how DME stations carry a flight without GPS; turn navaid lists into station tables."))
    cli_gnss.add_arguments(_job(jobs, "gnss", "Positions out of RINEX files; satellites in view and their geometry over a day."))
    cli_profiles.add_arguments(_job(jobs, "profiles", "IMU profiles with their grade, and the numbers a filter takes from one."))
    text = "Which states of a navigator its measurements can tell, along a recording."
    cli_observability.add_arguments(_job(jobs, "observability", text))
    return top


def _job(jobs: argparse._SubParsersAction, name: str, text: str, epilog: str = "") -> argparse.ArgumentParser:
    return jobs.add_parser(name, help=text, description=text, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter)


def _add_system_jobs(jobs: argparse._SubParsersAction) -> None:
    run = _job(jobs, "run", "Run one node in this process.", "example: lowcostnav run ahrs --ros-args --params-file ahrs.yaml")
    run.add_argument("node", help="name of the node, such as ahrs or recorder")
    run.add_argument("ros_args", nargs=argparse.REMAINDER, help="passed on to the node, usually --ros-args ...")
    text = "Print the parameter file of an executable: every parameter with its meaning, unit and range."
    parameters = _job(jobs, "parameters", text, "example: lowcostnav parameters ins_gps > ins_gps.yaml")
    parameters.add_argument("node", help="name of the executable")
    example = "example: lowcostnav up livermore --until-finished --out runs/1"
    up = _job(jobs, "up", "Start a graph of nodes, watch it, stop it with Ctrl-C.", example)
    up.add_argument("graph", help="name of a graph of the package, or a YAML file")
    up.add_argument("--out", metavar="DIR", help="where the graph's recorder writes")
    up.add_argument("--until-finished", action="store_true", help="stop when the flight is over")
    up.add_argument("--no-table", action="store_true", help="print events line by line, even on a terminal")
    _job(jobs, "doctor", "Check that this machine can run the nodes; every line says ok or what to do.")
    demo = _job(jobs, "demo", "Fly a whole simulated mission with a GPS outage and make its report.")
    demo.add_argument("--out", default="out/demo", metavar="DIR", help="folder of the results, replaced (default: out/demo)")
    demo.add_argument("--graph", default="demo", metavar="GRAPH", help="lossless graph to fly, with a recorder (default: demo)")
    demo.add_argument("--real-time-factor", type=float, metavar="X", help="simulated seconds per second (default: the graph's)")
    convert = _job(jobs, "convert", "Turn a recorded log (CSV, or RINEX files) into a bag with the standard topics.")
    convert.add_argument("source", help="file or directory of the log, or a RINEX observation file")
    convert.add_argument("-o", "--output", required=True, metavar="BAG", help="bag to create")
    convert.add_argument("--profile", metavar="NAME|FILE", help="column profile: a shipped one or a YAML file (default: the one that fits)")
    text = "RINEX navigation files: SOURCE is then an observation file, and the bag gets gnss/raw"
    convert.add_argument("--navigation", nargs="+", metavar="NAV", help=text)
    convert.add_argument("--at-rest", action="store_true", help="RINEX: the header's coordinates are the truth, recorded as truth/odometry")


def _add_simulate(jobs: argparse._SubParsersAction) -> None:
    simulate = _job(jobs, "simulate", "Fly a scenario offline and record truth and sensors as the nodes would publish them.")
    simulate.add_argument("scenario", help="name of a scenario of the package, or a YAML file")
    simulate.add_argument("-o", "--output", required=True, metavar="BAG", help="bag to create")
    simulate.add_argument("--seed", type=int, help="seed instead of the scenario's")
    simulate.add_argument("--duration", type=float, metavar="S", help="seconds to fly instead of the scenario's")
    simulate.add_argument("--storage", choices=("mcap", "sqlite3"), default="mcap", help="storage of the bag (default: mcap)")


def _add_replay(jobs: argparse._SubParsersAction) -> None:
    text = "Run the navigators over a bag, offline and repeatable to the last bit, and judge them."
    notes = """\
withholding: 'gps/fix,gps/vel@290-350' keeps these sources from the navigators from 290 s to 350 s, @290- to the end; without @ all flight.
  A window that starts before the bag's first stamp counts from the bag's start, any other is read as stamps (t_s).
errors: against truth/odometry (or --truth) where the bag has it, else against the withheld fixes."""
    replay = _job(jobs, "replay", text, notes)
    replay.add_argument("bag", help="bag directory, .mcap or .db3 file")
    replay.add_argument("--navigators", metavar="A,B", help="which to run (default: all whose required inputs the bag has)")
    replay.add_argument("--config", metavar="DIR", help="directory with <navigator>.yaml (default: the package's own)")
    replay.add_argument("--withhold", action="append", default=[], metavar="SRC[,SRC][@A-[B]]", help="keep sources back; repeatable")
    replay.add_argument("--truth", metavar="TOPIC", help="odometry topic to compare with (default: truth/odometry)")
    replay.add_argument("--out", metavar="DIR", help="write <navigator>.csv, _aids.csv, _errors.csv, _states.csv and summary.json there")
    replay.add_argument("--json", metavar="FILE", help="write the result as JSON")
    replay.add_argument("--baseline", metavar="FILE", help="compare with this baseline; exit status 1 when worse")
    replay.add_argument("--write-baseline", metavar="FILE", help="write a baseline from this replay")


def _add_report(jobs: argparse._SubParsersAction) -> None:
    report = _job(jobs, "report", "One self-contained HTML page about a flight: map, errors in their sigmas, aids, tables.")
    report.add_argument("source", help="a bag, which is replayed first, or a directory written by replay --out")
    report.add_argument("-o", "--output", required=True, metavar="HTML", help="page to write")
    report.add_argument("--navigators", metavar="A,B", help="which to run (bags only)")
    report.add_argument("--config", metavar="DIR", help="directory with <navigator>.yaml (bags only)")
    report.add_argument("--withhold", action="append", default=[], metavar="SRC[,SRC][@A-[B]]", help="keep sources back (bags only)")
    report.add_argument("--title", help="heading of the page (default: the name of the bag)")


def main(argv: Sequence[str] | None = None, registry: Any = None) -> int:
    """Run the command line; return the exit status.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the program's name; those of the process where None.
    registry : mapping, optional
        Navigators by name for ``replay`` and ``report``, the package's own where None.
    """
    try:
        arguments = parser().parse_args(argv, argparse.Namespace(registry=registry))
    except SystemExit as leaving:
        return leaving.code if isinstance(leaving.code, int) else EXIT_CANNOT_RUN
    try:
        module = importlib.import_module(f"lowcostnav_ros.cli.{_JOBS[arguments.job]}")
        return getattr(module, arguments.job)(arguments)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except ValueError as error:
        if not type(error).__module__.startswith("lowcostnav_ros"):
            raise  # one of ours is a sentence for the user; any other is a defect and must show its traceback
        print(error, file=sys.stderr)
    except OSError as error:
        print(f"{error.filename or arguments.job}: {error.strerror or error}; check the path and its permissions.", file=sys.stderr)
    return EXIT_CANNOT_RUN


if __name__ == "__main__":
    sys.exit(main())
