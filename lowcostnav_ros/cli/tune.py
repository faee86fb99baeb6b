"""The tune job: noise numbers of one's own aircraft from one's own recordings.

lowcostnav tune flight --navigator dead_reckoning --vehicle my_aircraft
"""

import argparse
from pathlib import Path

from lowcostnav_ros.base.documents import write_text
from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.settings import SettingsError, nearest
from lowcostnav_ros.catalogue.config_files import config_dir, vehicle_dir
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import add_workers, between, check_files, check_folder, workers_of
from lowcostnav_ros.cli.progress import progress_bar

NOTES = """\
The numbers that the innovations of the navigator make most likely, each held near its declared value by a prior; fitted on the first half
of each recording and judged on the second, then fitted on all.  What the recordings do not tell stays as it is and is not written.
example: lowcostnav tune flight --navigator ins_gps --vehicle my_aircraft; lowcostnav replay flight --vehicle my_aircraft"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    parser.add_argument("bag", nargs="+", help="bag directories, .mcap or .db3 files, all of one aircraft")
    parser.add_argument("--navigator", default="ins_gps", metavar="NAME", help="whose numbers (default: %(default)s)")
    text = "navigators that feed it, where the recording does not hold their solutions"
    parser.add_argument("--fed-by", default="", metavar="A,B", help=text)
    parser.add_argument("--vehicle", required=True, metavar="NAME", help="write config/vehicles/NAME, or this folder where it has a /")
    parser.add_argument("--page", metavar="HTML", help="write a page: numbers before and after, and the outages that judge them")
    parser.add_argument("--start", metavar="NAME", help="begin with the settings of a vehicle or folder (default: the shipped ones)")
    parser.add_argument(
        "--every", type=float, default=15.0, metavar="S", help="seconds between the outages that judge (default: %(default)g)"
    )
    add_workers(parser)


@job("Tune noise numbers of a navigator to recordings of one's own aircraft, and write a vehicle.", add_arguments, NOTES)
def tune(arguments: argparse.Namespace) -> int:
    """Tune, print before and after, write; 1, and nothing written, when the numbers are not better on what they were not fitted on."""
    from lowcostnav_ros.navigators.registry import NAVIGATORS
    from lowcostnav_ros.report.outages.tuning import tuning_page
    from lowcostnav_ros.report.terminal import print_table, result_console
    from lowcostnav_ros.studies.outages.tables import outage_table
    from lowcostnav_ros.studies.tuning.likelihood import Source
    from lowcostnav_ros.studies.tuning.study import tune as tune_study
    from lowcostnav_ros.studies.tuning.study import tuning_table, write_vehicle

    name = arguments.navigator
    if name not in NAVIGATORS:
        raise SettingsError(f"Unknown navigator '{name}'{nearest(name, list(NAVIGATORS))}.")
    folder = Path(arguments.vehicle) if "/" in arguments.vehicle else config_dir() / "vehicles" / arguments.vehicle
    check_folder(str(folder))
    check_files(arguments.page)
    start = vehicle_dir(arguments.start) if arguments.start else config_dir()
    chain = (*(n.strip() for n in arguments.fed_by.split(",") if n.strip()), name)
    sources = [Source(Path(bag), name, chain, start) for bag in arguments.bag]
    every_s = between("--every", arguments.every, 1.0, 3600.0)
    with progress_bar("tune") as bar:
        tuned = tune_study(sources, every_s, workers_of(arguments), bar)
    if arguments.page:
        write_text(arguments.page, tuning_page(tuned))
    console = result_console()
    print_table(tuning_table(tuned), console)
    for study in tuned.outages:
        print_table(outage_table(study), console)
    if not tuned.is_better:
        console.print("Nothing is written: the numbers are not better on what they were not fitted on.", highlight=False)
        return Exit.WORSE
    console.print(f"{write_vehicle(folder, tuned)} written; fly it by --vehicle {arguments.vehicle}.", highlight=False)
    return Exit.OK
