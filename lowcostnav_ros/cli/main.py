"""The ``lowcostnav`` command: one word per job, exit status 0 pass, 1 worse or failed, 2 cannot run."""

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any

from lowcostnav_ros import __version__
from lowcostnav_ros.base import interrupts
from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.cli.jobs import JOBS, summary

_EPILOG = """\
exit status: 0 pass, 1 worse than the baseline or a failed check, 2 cannot run (one sentence on stderr says what to do)

examples:
  lowcostnav open flight.ulg                               any log, as it is, to a page in the browser
  lowcostnav demo                                          a whole mission with a GPS outage, and its report
  lowcostnav simulate livermore -o flight                  a simulated flight as a bag
  lowcostnav replay flight --withhold gps/fix,gps/vel@60-120 --out result
  lowcostnav replay flight --baseline flight.baseline.yaml
  lowcostnav report flight -o report.html
  lowcostnav list                                          scenarios, graphs, navigators, nodes, profiles by name
"""


def parser(wanted: str = "") -> argparse.ArgumentParser:
    """Build the command line; only the job that is ``wanted`` is imported and has its options, the others are listed."""
    shape = argparse.RawDescriptionHelpFormatter
    description = "Low-cost aircraft navigation, with GPS and without."
    top = argparse.ArgumentParser(prog="lowcostnav", description=description, epilog=_EPILOG, formatter_class=shape)
    top.add_argument("--version", action="version", version=f"lowcostnav_ros {__version__}")
    jobs = top.add_subparsers(dest="job", metavar="JOB", required=True)
    for name in JOBS:
        text = summary(name)
        below = jobs.add_parser(name, help=text, description=text, formatter_class=shape)
        if name == wanted:
            below.epilog = JOBS[name].epilog
            JOBS[name].add_arguments(below)
    return top


def main(argv: Sequence[str] | None = None, registry: Any = None) -> int:
    """Run the command line; return the exit status.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the program's name; those of the process where None.
    registry : mapping, optional
        Navigators by name for ``replay`` and ``report``, the package's own where None.
    """
    interrupts.holds = True
    try:
        given = list(sys.argv[1:] if argv is None else argv)
        if argv is None and not {"-h", "--help"}.isdisjoint(given):
            os.environ["LOWCOSTNAV_KERNELS"] = "interpreted"  # a process that only shows its options needs no compiler
        arguments = parser(given[0] if given else "").parse_args(given, argparse.Namespace(registry=registry))
        return JOBS[arguments.job].run(arguments)
    except SystemExit as leaving:
        return leaving.code if isinstance(leaving.code, int) else Exit.CANNOT_RUN
    except KeyboardInterrupt:
        print(f"{given[0]} was interrupted; what was not finished has not been written.", file=sys.stderr)
        return Exit.INTERRUPTED
    except ValueError as error:
        if not type(error).__module__.startswith("lowcostnav_ros"):
            raise  # one of ours is a sentence for the user; any other is a defect and must show its traceback
        print(error, file=sys.stderr)
    except BrokenPipeError:  # what it was piped into has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return Exit.OK
    except OSError as error:
        print(f"{error.filename or arguments.job}: {error.strerror or error}; check the path and its permissions.", file=sys.stderr)
    return Exit.CANNOT_RUN


if __name__ == "__main__":
    sys.exit(main())
