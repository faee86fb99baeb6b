"""Simulate the VOR receivers: vor/bearing."""

import sys

from lowcostnav_ros.ros.run_simulator import run_simulator

OUTPUTS = ("vor/bearing",)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_simulator("vor_simulator", "vor", OUTPUTS, args)


if __name__ == "__main__":
    sys.exit(main())
