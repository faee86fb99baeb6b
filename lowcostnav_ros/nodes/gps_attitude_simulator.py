"""Simulate the multi-antenna GPS receiver: gps/attitude."""

import sys

from lowcostnav_ros.ros.run_simulator import run_simulator

OUTPUTS = ("gps/attitude",)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_simulator("gps_attitude_simulator", "gps_attitude", OUTPUTS, args)


if __name__ == "__main__":
    sys.exit(main())
