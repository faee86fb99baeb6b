"""Simulate the magnetometer: imu/mag."""

import sys

from lowcostnav_ros.ros.run_simulator import run_simulator

OUTPUTS = ("imu/mag",)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_simulator("magnetometer_simulator", "magnetometer", OUTPUTS, args)


if __name__ == "__main__":
    sys.exit(main())
