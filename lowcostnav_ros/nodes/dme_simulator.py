"""Simulate the DME interrogator: dme/range."""

import sys

from lowcostnav_ros.ros.run_simulator import run_simulator

OUTPUTS = ("dme/range",)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_simulator("dme_simulator", "dme", OUTPUTS, args)


if __name__ == "__main__":
    sys.exit(main())
