"""Start of a navigator process."""

from collections.abc import Sequence
from functools import partial

from lowcostnav_ros.catalogue.building import make_navigator
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.ros.navigator_node import NavigatorNode
from lowcostnav_ros.ros.run import run


def run_navigator(name: str, args: Sequence[str] | None = None) -> int:
    """Run one navigator until it is told to stop; see :func:`run` for the exit status.

    The navigator is made as a replay makes it, with the station table its settings name.
    """
    settings_class, navigator_class = NAVIGATORS[name]
    return run(partial(NavigatorNode, name, settings_class(), partial(make_navigator, navigator_class=navigator_class)), args)
