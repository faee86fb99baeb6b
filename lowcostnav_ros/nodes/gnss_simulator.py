"""Simulate a receiver of satellite observations: gnss/raw."""

import sys

from lowcostnav_ros.ros.run_simulator import run_simulator

OUTPUTS = ("gnss/raw",)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_simulator("gnss_simulator", "gnss", OUTPUTS, args)


if __name__ == "__main__":
    sys.exit(main())
