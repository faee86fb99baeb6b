"""Simulate the inertial measurement unit: imu/data_raw."""

import sys

from lowcostnav_ros.ros.run_simulator import run_simulator

OUTPUTS = ("imu/data_raw",)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_simulator("imu_simulator", "imu", OUTPUTS, args)


if __name__ == "__main__":
    sys.exit(main())
