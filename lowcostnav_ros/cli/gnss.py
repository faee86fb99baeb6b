"""The gnss job: positions out of a receiver's RINEX files, and which satellites a place will see.

    lowcostnav gnss locate station.05o station.05n --out positions.csv --page positions.html
    lowcostnav gnss plan --almanac current.alm --place 38.7,-9.1,500 --start 2026-06-01T06:00 --hours 12 -o plan
    lowcostnav gnss plan --almanac gps_galileo --place 38.7,-9.1,200 --canyon 1000 1000 250
"""

import argparse
import datetime
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.base.text import counted
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import between, check_files, check_folder, let_values_begin_with_minus, place_of
from lowcostnav_ros.cli.progress import progress_bar

if TYPE_CHECKING:  # what works is imported by those that work: the options show at once
    from lowcostnav_ros.gnss.correction import CorrectionSettings
    from lowcostnav_ros.gnss.rinex_nav import Navigation
    from lowcostnav_ros.gnss.rinex_obs import Observations
    from lowcostnav_ros.gnss.track import Track


def add_arguments(gnss: argparse.ArgumentParser) -> None:
    """Add the sub-commands and their options to the parser of the job."""
    verbs = gnss.add_subparsers(dest="verb", metavar="VERB", required=True)
    _add_locate(verbs)
    _add_plan(verbs)


def _add_locate(verbs: argparse._SubParsersAction) -> None:
    text = "Position of every epoch of a RINEX 2 or 3 file from code alone, with an integrity verdict and what was not used by reason."
    locate = verbs.add_parser("locate", help="positions with integrity out of RINEX files", description=text, epilog=LOCATE_EXAMPLE)
    locate.add_argument("observations", metavar="OBS", help="observation file, plain or gzip")
    locate.add_argument("navigation", metavar="NAV", nargs="+", help="navigation file; several are joined, such as one for each system")
    locate.add_argument("--mask-deg", type=float, default=10.0, metavar="DEG", help="lowest elevation used (default: %(default)g)")
    locate.add_argument("--no-ionosphere", action="store_true", help="do not take off the broadcast ionosphere")
    locate.add_argument("--no-troposphere", action="store_true", help="do not take off the standard troposphere")
    locate.add_argument("--integrity-sigmas", action="store_true", help="state the ionosphere by the bounds of integrity (larger HPL)")
    locate.add_argument("--out", metavar="CSV", help="write one row per epoch there")
    locate.add_argument("--page", metavar="HTML", help="write a page with charts there")


def _add_plan(verbs: argparse._SubParsersAction) -> None:
    text = "Satellites in view and dilutions of precision over some hours; exit status 1 when the position is not good all the time."
    plan = verbs.add_parser("plan", help="satellites in view and their geometry at a place over a day", description=text, epilog=EXAMPLE)
    let_values_begin_with_minus(plan)
    plan.add_argument("--almanac", required=True, metavar="FILE|NAME", help="YUMA almanac, or nominal orbits: gps, galileo, gps_galileo")
    plan.add_argument("--place", required=True, metavar="LAT,LON[,M]", help="degrees, and metres above the ellipsoid (default 0)")
    plan.add_argument("--start", metavar="TIME", help="UTC, such as 2026-06-01T06:00 (default: now)")
    plan.add_argument("--hours", type=float, default=24.0, metavar="N", help="length (default: %(default)g)")
    plan.add_argument("--step-s", type=float, default=60.0, metavar="S", help="time between looks (default: %(default)g)")
    plan.add_argument("--mask-deg", type=float, default=5.0, metavar="DEG", help="lowest elevation (default: %(default)g)")
    axis = ("HEIGHT", "WIDTH", "HEADING")
    plan.add_argument("--canyon", nargs=3, type=float, metavar=axis, help="the place lies midway between cliffs: m, m, deg true")
    plan.add_argument("--above-floor", type=float, default=0.0, metavar="M", help="height above the canyon's floor (default: 0)")
    plan.add_argument("--pdop", type=float, default=6.0, help="PDOP above which a position is not good enough (default: %(default)g)")
    plan.add_argument("-o", "--output", metavar="DIR", help="write plan.json and the page plan.html there")


LOCATE_EXAMPLE = "example: lowcostnav gnss locate station.05o station.05n --page positions.html"
EXAMPLE = "example: lowcostnav gnss plan --almanac gps --place 38.7,-9.1,120"


@job("Positions out of RINEX files; satellites in view and their geometry over a day.", add_arguments, EXAMPLE)
def gnss(arguments: argparse.Namespace) -> int:
    """Run the verb; returns the exit status."""
    return {"locate": _locate, "plan": _plan}[arguments.verb](arguments)


def _locate(arguments: argparse.Namespace) -> int:
    from lowcostnav_ros.convert.rinex_files import read_navigation, read_observations
    from lowcostnav_ros.report.gnss.track import print_track, summarise, write_csv
    from lowcostnav_ros.report.gnss.track_page import write_page

    settings = correction_settings(arguments)
    check_files(arguments.out, arguments.page)
    observations, navigation = read_observations(arguments.observations), read_navigation(arguments.navigation)
    located = located_with_progress(observations, navigation, settings, "locate")
    summary = summarise(Path(arguments.observations).name, observations, navigation, located)
    print_track(summary)
    if arguments.out:
        write_csv(summary, Path(arguments.out))
        print(f"{len(located.located)} epochs in {arguments.out}")
    if arguments.page:
        print(f"{arguments.page} ({write_page(summary, Path(arguments.page)) / 1e6:.1f} MB)")
    return Exit.OK


def correction_settings(arguments: argparse.Namespace) -> "CorrectionSettings":
    """Correction settings of the options, checked."""
    from lowcostnav_ros.gnss.correction import CorrectionSettings

    values = {"mask_deg": arguments.mask_deg, "ionosphere": not arguments.no_ionosphere, "troposphere": not arguments.no_troposphere}
    return from_mapping(CorrectionSettings, {**values, "integrity_sigmas": arguments.integrity_sigmas}, "locate")


def located_with_progress(observations: "Observations", navigation: "Navigation", settings: "CorrectionSettings", label: str) -> "Track":
    """Locate a recording with a bar on a terminal.

    Raises
    ------
    GnssError
        When no epoch at all gives a position.
    """
    from lowcostnav_ros.gnss import GnssError
    from lowcostnav_ros.gnss.track import track

    with progress_bar(label) as advance:
        total = len(observations.epochs)
        located = track(observations.epochs, navigation, settings, advance=advance and (lambda done: advance(done / total)))
    if not any(one.result for one in located.located):
        reasons = f"; satellites not used: {counted(located.rejected)}" if located.rejected else ""
        raise GnssError(f"None of {total} epochs gives a position ({located.located[0].refusal[:-1]}{reasons}).")
    return located


def _plan(arguments: argparse.Namespace) -> int:
    from lowcostnav_ros.gnss.sky_plan import plan_sky
    from lowcostnav_ros.report.gnss.plan import GnssPlan, as_mapping, told
    from lowcostnav_ros.report.gnss.plan_figures import drawings
    from lowcostnav_ros.report.plan_folder import show_plan

    check_folder(arguments.output)
    place = place_of(arguments.place, "--place")
    between("--pdop", arguments.pdop, 1.0, 1000.0)
    between("--hours", arguments.hours, 0.1, 24.0 * 31.0)
    start = _start(arguments.start)
    satellites, start_s, notes = _satellites(arguments.almanac, start)
    lowest, hidden = _lowest(arguments)
    with progress_bar("plan") as advance:
        sky = plan_sky(satellites, place, lowest, arguments.hours, start_s, arguments.step_s, advance)
    lat_deg, lon_deg = math.degrees(place[0]), math.degrees(place[1])
    title = f"{Path(arguments.almanac).name}, {len(satellites)} satellites, from {lat_deg:g}, {lon_deg:g}, {place[2]:g} m"
    plan = GnssPlan(sky, title, hidden, start, arguments.pdop, lowest, notes)
    show_plan(plan, told(plan), arguments.output, as_mapping(plan), drawings)
    return Exit.OK if plan.good_enough() else Exit.WORSE


def _start(text: str | None) -> datetime.datetime:
    if text is None:
        return datetime.datetime.now(datetime.UTC).replace(second=0, microsecond=0)
    try:
        moment = datetime.datetime.fromisoformat(text)
    except ValueError:
        raise SettingsError(f"--start '{text}' is not a time; write it as 2026-06-01T06:00, in UTC.") from None
    return moment.replace(tzinfo=datetime.UTC) if moment.tzinfo is None else moment.astimezone(datetime.UTC)


def _satellites(named: str, start: datetime.datetime) -> tuple[Any, float, list[str]]:
    """The satellites, the time of their constellation at the start, s, and notes on them."""
    from lowcostnav_ros.catalogue.equipment import load_almanac
    from lowcostnav_ros.gnss.constellation import NAMES, TABLE_EPOCH_GPS_S, constellation_named
    from lowcostnav_ros.gnss.gps_time import SECOND, gps_ns

    gps = gps_ns(round(start.timestamp()) * SECOND)
    if named in NAMES:
        note = f"Nominal orbits of '{named}': this is what such a constellation gives on a day, not what is up on this one."
        return constellation_named(named), gps / SECOND - TABLE_EPOCH_GPS_S, [note]
    if not Path(named).suffix and not Path(named).exists():
        raise SettingsError(f"--almanac {named} is neither a file nor one of {', '.join(NAMES)}.")
    almanac = load_almanac(named)
    return almanac.constellation(gps), 0.0, [*almanac.notes(), almanac.dated(gps)]


def _lowest(arguments: argparse.Namespace) -> tuple[Any, str]:
    """Lowest visible elevation by azimuth, rad, and what hides the sky, in words."""
    from lowcostnav_ros.gnss.canyon import CanyonSettings


    between("--mask-deg", arguments.mask_deg, 0.0, 89.0)
    mask = math.radians(arguments.mask_deg)
    if arguments.canyon is None:
        return lambda azimuth: np.full(np.shape(azimuth), mask), f"mask {arguments.mask_deg:g} deg"
    between("--above-floor", arguments.above_floor, 0.0, 20_000.0)
    cliff, width, heading = arguments.canyon
    canyon = from_mapping(CanyonSettings, {"cliff_m": cliff, "width_m": width, "heading_deg": heading}, "--canyon").canyon()
    if canyon is None:
        raise SettingsError("--canyon: cliffs have a height above zero; drop the option under an open sky.")
    words = f"mask {arguments.mask_deg:g} deg, {arguments.above_floor:g} m above the floor of a canyon {cliff:g} m deep, {width:g} m wide"
    return lambda azimuth: np.maximum(mask, canyon.lowest(arguments.above_floor, azimuth)), f"{words}, axis {heading:g} deg"
