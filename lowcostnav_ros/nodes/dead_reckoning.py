"""DME-aided dead reckoning, live."""

import sys
from functools import partial

from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.ros.navigator_node import NavigatorNode
from lowcostnav_ros.ros.run import run


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    settings, navigator = NAVIGATORS["dead_reckoning"]
    return run(partial(NavigatorNode, "dead_reckoning", settings(), navigator), args)


if __name__ == "__main__":
    sys.exit(main())
