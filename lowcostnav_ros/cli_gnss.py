"""The gnss job: positions out of a receiver's RINEX files, and which satellites a place will see.

    lowcostnav gnss locate station.05o station.05n --out positions.csv --page positions.html
    lowcostnav gnss plan --almanac current.alm --place 38.7 -9.1 500 --start 2026-06-01T06:00 --hours 12 -o plan
    lowcostnav gnss plan --almanac gps_galileo --place 38.7 -9.1 200 --canyon 1000 1000 250
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from lowcostnav_ros.settings import SettingsError

EXIT_OK, EXIT_WORSE, EXIT_CANNOT_RUN = 0, 1, 2


def add_arguments(gnss: argparse.ArgumentParser) -> None:
    """Add the sub-commands and their options to the parser of the job."""
    verbs = gnss.add_subparsers(dest="verb", metavar="VERB", required=True)
    _add_locate(verbs)


def _add_locate(verbs: argparse._SubParsersAction) -> None:
    text = "Position of every epoch of a RINEX 2 or 3 file from code alone, with an integrity verdict and what was left out by reason."
    locate = verbs.add_parser("locate", help="positions with integrity verdicts out of RINEX files", description=text)
    locate.add_argument("observations", metavar="OBS", help="observation file, plain or gzip")
    locate.add_argument("navigation", metavar="NAV", nargs="+", help="navigation file; several are joined, such as one for each system")
    locate.add_argument("--mask-deg", type=float, default=10.0, metavar="DEG", help="lowest elevation used (default: %(default)g)")
    locate.add_argument("--no-ionosphere", action="store_true", help="do not take off the broadcast ionosphere")
    locate.add_argument("--no-troposphere", action="store_true", help="do not take off the standard troposphere")
    locate.add_argument("--integrity-sigmas", action="store_true", help="state the ionosphere by the bounds of integrity (larger HPL)")
    locate.add_argument("--out", metavar="CSV", help="write one row per epoch there")
    locate.add_argument("--page", metavar="HTML", help="write a page with charts there")


def gnss(arguments: argparse.Namespace) -> int:
    """Do what the verb says; returns the exit status."""
    return {"locate": _locate}[arguments.verb](arguments)


def _locate(arguments: argparse.Namespace) -> int:
    from lowcostnav_ros.convert.rinex_files import read_navigation, read_observations
    from lowcostnav_ros.report.gnss_track import print_track, summarise, write_csv

    settings = correction_settings(arguments)
    for path in (arguments.out, arguments.page):
        if path and not Path(path).resolve().parent.is_dir():
            raise SettingsError(f"The folder of {path} does not exist; create it first.")
    observations, navigation = read_observations(arguments.observations), read_navigation(arguments.navigation)
    located = located_with_progress(observations, navigation, settings, "locate")
    summary = summarise(Path(arguments.observations).name, observations, navigation, located)
    print_track(summary)
    if arguments.out:
        write_csv(summary, Path(arguments.out))
        print(f"{len(located.located)} epochs in {arguments.out}")
    if arguments.page:
        from lowcostnav_ros.report.gnss_track_page import write_page

        print(f"{arguments.page} ({write_page(summary, Path(arguments.page)) / 1e6:.1f} MB)")
    return EXIT_OK


def correction_settings(arguments: argparse.Namespace):
    """Correction settings as the options say, checked."""
    from lowcostnav_ros.gnss.correction import CorrectionSettings
    from lowcostnav_ros.settings import from_mapping

    values = {"mask_deg": arguments.mask_deg, "ionosphere": not arguments.no_ionosphere, "troposphere": not arguments.no_troposphere}
    return from_mapping(CorrectionSettings, {**values, "integrity_sigmas": arguments.integrity_sigmas}, "locate")


def located_with_progress(observations, navigation, settings, label: str):
    """Locate a recording with a bar on a terminal.

    Raises
    ------
    GnssError
        When no epoch at all gives a position.
    """
    from lowcostnav_ros.cli_replay import progress_bar
    from lowcostnav_ros.gnss import GnssError
    from lowcostnav_ros.gnss.track import track
    from lowcostnav_ros.report.words_gnss import counted

    with progress_bar(label) as advance:
        total = len(observations.epochs)
        located = track(observations.epochs, navigation, settings, advance=advance and (lambda done: advance(done / total)))
    if not any(one.result for one in located.located):
        reasons = f"; satellites left out: {counted(located.rejected)}" if located.rejected else ""
        raise GnssError(f"None of {total} epochs gives a position ({located.located[0].refusal[:-1]}{reasons}).")
    return located


def main(argv: Sequence[str] | None = None) -> int:
    """Run this job alone; return the exit status."""
    from lowcostnav_ros import cli

    return cli.main(["gnss", *(sys.argv[1:] if argv is None else argv)])


if __name__ == "__main__":
    sys.exit(main())
