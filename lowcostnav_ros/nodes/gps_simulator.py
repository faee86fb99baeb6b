"""Simulate the GPS receiver: gps/fix, gps/vel."""

import sys

from lowcostnav_ros.ros.run_simulator import run_simulator

OUTPUTS = ("gps/fix", "gps/vel")


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_simulator("gps_simulator", "gps", OUTPUTS, args)


if __name__ == "__main__":
    sys.exit(main())
