"""Simulate the air data computer: air/static_pressure, air/dynamic_pressure, air/temperature, air/velocity."""

import sys

from lowcostnav_ros.ros.run_simulator import run_simulator

OUTPUTS = ("air/static_pressure", "air/dynamic_pressure", "air/temperature", "air/velocity")


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_simulator("air_data_simulator", "air_data", OUTPUTS, args)


if __name__ == "__main__":
    sys.exit(main())
