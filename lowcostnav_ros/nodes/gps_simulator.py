"""Simulate the GPS receiver: gps/fix, gps/vel."""

import sys
from functools import partial

from lowcostnav_ros.ros.run import run
from lowcostnav_ros.ros.simulator_node import SimulatorNode

make = partial(SimulatorNode, "gps_simulator", "gps", ("gps/fix", "gps/vel"))


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(make, args)


if __name__ == "__main__":
    sys.exit(main())
