"""Run any executable by its name: ``python -m lowcostnav_ros.nodes.dispatch ins_gps --ros-args ...``."""

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise

from lowcostnav_ros.base.documents import read_yaml
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.graph.domain import discovery, require_ros
from lowcostnav_ros.graph.executables import EXECUTABLES, NAVIGATOR, NODES, SIMULATOR, kind_of, needs_compiler, sensor_of
from lowcostnav_ros.graph.parent import end_with_runner


def run_executable(name: str, args: Sequence[str]) -> int:
    """Run an executable with its command line until it is stopped; return the exit status (:func:`lowcostnav_ros.ros.run.run`).

    Raises
    ------
    SettingsError
        When there is no such executable, or a parameter file is none.
    """
    if not needs_compiler(name):
        os.environ.setdefault("LOWCOSTNAV_KERNELS", "interpreted")  # kernels are made on import, so this comes before all others
    for option, path in pairwise(args):
        if option == "--params-file":  # rcl flies on the defaults where a file holds none, and ends in a traceback where it is no YAML
            _check_parameter_file(path)
    if not os.environ.get("ROS_LOCALHOST_ONLY"):  # which overrides the range
        os.environ.update(discovery())
    require_ros()
    make = maker(name)
    from lowcostnav_ros.ros.run import run

    return run(make, args)


def _check_parameter_file(path: str) -> None:
    def holds(content: object) -> bool:
        return isinstance(content, Mapping) and ("ros__parameters" in content or any(map(holds, content.values())))

    if not holds(read_yaml(path)):
        raise SettingsError(f"{path} is not a parameter file; it needs '/**:' or a node name, then 'ros__parameters:', then values.")


def maker(name: str) -> Callable:
    kind = kind_of(name)
    if kind == SIMULATOR:
        from lowcostnav_ros.ros.simulator_node import SimulatorNode

        return partial(SimulatorNode, sensor_of(name))
    if kind == NAVIGATOR:
        from lowcostnav_ros.ros.navigator_node import navigator_node

        return partial(navigator_node, name)
    return NODES[name]


def main(name: str, args: Sequence[str]) -> int:
    """Run an executable as a process; a name that does not exist is one sentence on stderr and exit status 2."""
    end_with_runner()
    try:
        return run_executable(name, args)
    except SettingsError as error:
        print(error, file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]) if len(sys.argv) > 1 else f"give the name of an executable: {', '.join(EXECUTABLES)}")
