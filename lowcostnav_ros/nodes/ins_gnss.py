"""INS/GNSS, live."""

import sys

from lowcostnav_ros.ros.run_navigator import run_navigator


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_navigator("ins_gnss", args)


if __name__ == "__main__":
    sys.exit(main())
