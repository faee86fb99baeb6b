"""Simulate the air data computer: air/static_pressure, air/dynamic_pressure, air/temperature, air/velocity."""

import sys
from functools import partial

from lowcostnav_ros.ros.run import run
from lowcostnav_ros.ros.simulator_node import SimulatorNode

make = partial(
    SimulatorNode, "air_data_simulator", "air_data", ("air/static_pressure", "air/dynamic_pressure", "air/temperature", "air/velocity")
)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(make, args)


if __name__ == "__main__":
    sys.exit(main())
