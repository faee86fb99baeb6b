"""Start of a sensor simulator process."""

import os
from collections.abc import Sequence
from functools import partial

from lowcostnav_ros.ros.run import run


def run_simulator(name: str, sensor: str, outputs: Sequence[str], args: Sequence[str] | None = None) -> int:
    """Run one sensor simulator until it is told to stop; see :func:`run` for the exit status.

    A simulator works on one row of truth at a time, where compiled kernels gain nothing, and without the compiler the process needs half
    the memory.  So the kernels run as plain Python here, unless the environment says otherwise.
    """
    os.environ.setdefault("LOWCOSTNAV_KERNELS", "interpreted")
    from lowcostnav_ros.ros.simulator_node import SimulatorNode  # after the line above: kernels are made on import

    return run(partial(SimulatorNode, name, sensor, outputs), args)
