"""The recover job: a clean copy of a recording whose recorder was killed."""

import argparse
from pathlib import Path

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.cli.jobs import job


def add_arguments(recover: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    recover.add_argument("bag", help="bag directory, .mcap or .db3 file")
    recover.add_argument("-o", "--out", metavar="DIR", help="where the copy goes (default: <bag>_recovered)")


@job("Write a clean copy of a recording whose recorder was killed.", add_arguments, "example: lowcostnav recover recording -o flight")
def recover(arguments: argparse.Namespace) -> int:
    """Copy every whole message, and the settings beside them; returns the exit status."""
    from lowcostnav_ros.messages import bag

    path = Path(arguments.bag)
    out = Path(arguments.out) if arguments.out else path.with_name(f"{path.stem}_recovered")
    written = bag.recover(path, out)
    print(f"{out}: {sum(written.counts.values())} messages on {len(written.counts)} topics.")
    return Exit.OK
