"""The pseudolite job: how well ground transmitters fix a position over an area, and where the next one helps most.

lowcostnav pseudolite plan --height-m 5550
lowcostnav pseudolite plan --stations my_network.csv --height-m 3000 --half-width-km 20 -o plan
"""

import argparse

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import between

DEFAULT_STATIONS = "pseudolites_range.csv"


def add_arguments(pseudolite: argparse.ArgumentParser) -> None:
    """Add the sub-command and its options to the parser of the job."""
    verbs = pseudolite.add_subparsers(dest="verb", metavar="VERB", required=True)
    text = "Dilutions over a square about the network at one height; exit status 1 where the PDOP is not good everywhere."
    plan = verbs.add_parser("plan", help="dilutions over an area and the best next transmitter", description=text, epilog=EXAMPLE)
    plan.add_argument("--stations", metavar="FILE", default=DEFAULT_STATIONS, help="station table (default: %(default)s)")
    plan.add_argument("--height-m", type=float, required=True, metavar="M", help="of the aircraft above the ellipsoid")
    plan.add_argument("--half-width-km", type=float, default=13.0, metavar="KM", help="half the side of the square (default: %(default)g)")
    plan.add_argument("--pdop", type=float, default=6.0, help="PDOP above which a position is not good enough (default: %(default)g)")
    plan.add_argument("--beacons", action="store_true", help="plan the table's two-way ranging beacons, which need no receiver clock")
    plan.add_argument("-o", "--output", metavar="DIR", help="write plan.json and the page plan.html there")


EXAMPLE = "example: lowcostnav pseudolite plan --stations my_network.csv --height-m 3000 --half-width-km 20 -o plan"


@job("Dilutions of ground transmitters over an area, and where the next one helps most.", add_arguments, EXAMPLE)
def pseudolite(arguments: argparse.Namespace) -> int:
    """Plan; returns the exit status."""
    from lowcostnav_ros.catalogue.equipment import load_stations
    from lowcostnav_ros.radionav.transmitters import BEACON, PSEUDOLITE
    from lowcostnav_ros.report.plan_folder import show_plan
    from lowcostnav_ros.report.transmitters import as_mapping, drawings, plan_transmitters, told

    between("--height-m", arguments.height_m, -400.0, 30_000.0)
    between("--half-width-km", arguments.half_width_km, 0.1, 500.0)
    between("--pdop", arguments.pdop, 1.0, 1000.0)
    kind = BEACON if arguments.beacons else PSEUDOLITE
    stations = [s for s in load_stations(arguments.stations) if s.kind == kind]
    if not stations:
        raise SettingsError(f"{arguments.stations} holds no station of kind {kind}; name a table that does.")
    plan = plan_transmitters(stations, arguments.height_m, 1e3 * arguments.half_width_km, arguments.pdop)
    show_plan(plan, told(plan), arguments.output, as_mapping(plan), drawings)
    return Exit.OK if plan.good_enough() else Exit.WORSE
