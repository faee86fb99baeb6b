"""Simulate the inertial measurement unit: imu/data_raw."""

import sys
from functools import partial

from lowcostnav_ros.ros.run import run
from lowcostnav_ros.ros.simulator_node import SimulatorNode

make = partial(SimulatorNode, "imu_simulator", "imu", ("imu/data_raw",))


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(make, args)


if __name__ == "__main__":
    sys.exit(main())
