"""Simulate the DME interrogator: dme/range."""

import sys
from functools import partial

from lowcostnav_ros.ros.run import run
from lowcostnav_ros.ros.simulator_node import SimulatorNode

make = partial(SimulatorNode, "dme_simulator", "dme", ("dme/range",))


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(make, args)


if __name__ == "__main__":
    sys.exit(main())
