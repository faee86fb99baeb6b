"""The dme job: plan how DME stations carry a flight without GPS, and turn public navaid lists into station tables.

    lowcostnav dme plan --airport 37.694,-121.820,-23 -o plan
    lowcostnav dme plan --route "36.6,-121.9;37.0,-121.5;37.69,-121.82" --altitude-m 500,1500
    lowcostnav dme import navaids.csv --near 37.7,-121.8 --within-nm 100 --undulation-m -32 -o stations.csv
"""

import argparse
import csv
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.base.documents import foreign_text, write_text
from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.catalogue.config_files import find_config
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import between, check_files, check_folder, let_values_begin_with_minus, place_of

if TYPE_CHECKING:  # what works is imported by those that work: the options show at once
    from lowcostnav_ros.radionav.navaid_import import NavaidList

DEFAULT_STATIONS = "dme_stations_bay_area.csv"


def add_arguments(dme: argparse.ArgumentParser) -> None:
    """Add the sub-commands and their options to the parser of the job."""
    verbs = dme.add_subparsers(dest="verb", metavar="VERB", required=True)
    text = "Coverage, best pairs and expected error without GPS; exit status 1 when it exceeds 0.5 NM at every altitude."
    what = "what the stations around a place or along a route are good for"
    plan = verbs.add_parser("plan", help=what, description=text, epilog=EXAMPLE)
    let_values_begin_with_minus(plan)
    where = plan.add_mutually_exclusive_group(required=True)
    where.add_argument("--airport", metavar="LAT,LON[,M]|KLVK[,M]", help="degrees or location indicator; metres above sea level")
    where.add_argument("--route", metavar="FILE|LAT,LON;LAT,LON...", help="waypoints in degrees, or a CSV with lat_deg, lon_deg")
    plan.add_argument("--stations", metavar="FILE", default=DEFAULT_STATIONS, help="station list, any format (default: %(default)s)")
    plan.add_argument("--altitude-m", metavar="M[,M...]", help="above sea level (default: 500 ft, 1500 ft, 1 km, 2 km above the place)")
    plan.add_argument("--speed-mps", type=float, default=46.3, help="speed over ground (default: %(default)s, 90 kt)")
    plan.add_argument("-o", "--output", metavar="DIR", help="write plan.json and the page plan.html there")
    text, example = "Write a station table near a place.", "example: lowcostnav dme import navaids.csv --near 37.7,-121.8 -o stations.csv"
    table = verbs.add_parser("import", help="station table out of a public navaid list", description=text, epilog=example)
    let_values_begin_with_minus(table)
    table.add_argument("source", help="OurAirports navaids.csv, X-Plane earth_nav.dat, FlightGear nav.dat or our own format")
    table.add_argument("--near", metavar="LAT,LON|KLVK", required=True, help="place in degrees, or a location indicator")
    table.add_argument("--within-nm", type=float, default=130.0, help="distance from it (default: %(default)g NM)")
    table.add_argument("--undulation-m", type=float, default=0.0, help="mean sea level above the ellipsoid there (default: %(default)g m)")
    table.add_argument("-o", "--output", metavar="FILE", required=True, help="table to write")


EXAMPLE = "example: lowcostnav dme plan --airport 37.694,-121.820,122 -o plan"


@job("Plan how DME stations carry a flight without GPS; turn navaid lists into station tables.", add_arguments, EXAMPLE)
def dme(arguments: argparse.Namespace) -> int:
    """Run the verb; returns the exit status."""
    return {"plan": _plan, "import": _import}[arguments.verb](arguments)


def _plan(arguments: argparse.Namespace) -> int:
    from lowcostnav_ros.report.dme.figures import drawings
    from lowcostnav_ros.report.dme.plan import make_plan
    from lowcostnav_ros.report.dme.tables import as_mapping, told
    from lowcostnav_ros.report.plan_folder import show_plan

    check_folder(arguments.output)
    waypoints, elevation = _place(arguments)
    altitudes = _altitudes(arguments.altitude_m, elevation)
    navaids = _read(arguments.stations, 0.0)
    plan = make_plan(navaids, waypoints, altitudes, arguments.speed_mps, arguments.stations)
    show_plan(plan, told(plan), arguments.output, as_mapping(plan), drawings)
    return Exit.OK if plan.good_enough() else Exit.WORSE


def _import(arguments: argparse.Namespace) -> int:

    from lowcostnav_ros.radionav.navaid_import import lost_longitude_signs, select_near, table_as_text

    lat, lon, _ = place_of(arguments.near, "--near")
    if not arguments.within_nm > 0.0:
        raise SettingsError(f"--within-nm must be positive, got {arguments.within_nm:g}.")
    check_files(arguments.output)
    navaids = _read(arguments.source, arguments.undulation_m)
    table, notes = select_near(navaids, np.array([lat]), np.array([lon]), arguments.within_nm * NAUTICAL_MILE, arguments.source)
    write_text(arguments.output, table_as_text(table))
    for reason, count in sorted(navaids.left_out.items()):
        notes.append(f"{count} rows of the list not used: {reason}.")
    for station in lost_longitude_signs(navaids):
        notes.append(f"{station.ident} at longitude {np.degrees(station.lon):.4f} stands alone; the sign of its longitude looks lost.")
    print("\n".join([*notes, f"{len(table)} stations in {arguments.output}"]))
    return Exit.OK


def _read(name: str, undulation_m: float) -> "NavaidList":
    from lowcostnav_ros.radionav.navaid_import import navaids_from_text

    path = find_config(name)
    return navaids_from_text(foreign_text(path.read_bytes()), str(name), undulation_m)


def _place(arguments: argparse.Namespace) -> tuple[list[tuple[float, float]], float]:
    """Waypoints (rad), one for an airport, and the elevation of the place, m above sea level."""
    if arguments.route:
        path = Path(arguments.route)
        if not path.is_file() and not re.search(r"\d", arguments.route.partition(",")[0]) or path.suffix == ".csv" and not path.is_file():
            raise SettingsError(f"--route: the file {path} does not exist; give one, or LAT,LON;LAT,LON in quotes.")
        text = _waypoint_file(path) if path.is_file() else arguments.route
        waypoints = _waypoints(text, "--route")
        if len(waypoints) < 2:
            raise SettingsError(f"--route '{arguments.route}' needs two waypoints or more: a file, or LAT,LON;LAT,LON in quotes.")
        return waypoints, 0.0
    lat, lon, elevation = place_of(arguments.airport, "--airport")
    return [(lat, lon)], elevation


def _waypoint_file(path: Path) -> str:
    with path.open(newline="", encoding="utf-8") as lines:
        rows = csv.DictReader(line for line in lines if not line.lstrip().startswith("#"))
        if not {"lat_deg", "lon_deg"} <= set(rows.fieldnames or ()):
            raise SettingsError(f"{path}: the first line must name the columns lat_deg and lon_deg.")
        return ";".join(f"{row['lat_deg']},{row['lon_deg']}" for row in rows)


def _waypoints(text: str, option: str) -> list[tuple[float, float]]:
    return [place_of(part, option)[:2] for part in text.strip().strip(";").split(";")]


def _altitudes(text: str | None, elevation: float) -> list[float]:
    from lowcostnav_ros.radionav.coverage import altitudes_above

    if text is None:
        return list(altitudes_above(elevation))
    return sorted({_number(cell, "--altitude-m", elevation, 20_000.0) for cell in text.split(",")})


def _number(text: str, option: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        raise SettingsError(f"{option}: '{text.strip()}' must be a number.") from None
    return between(option, value, low, high)
