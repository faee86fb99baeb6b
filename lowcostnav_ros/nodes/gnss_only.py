"""Satellites alone, live."""

import sys

from lowcostnav_ros.ros.run_navigator import run_navigator


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_navigator("gnss_only", args)


if __name__ == "__main__":
    sys.exit(main())
