"""A warm parent of node processes: ``python -m lowcostnav_ros.nodes.forking SOCKET EXECUTABLE...``.

It imports what the executables need; told where the settings are, it flies the navigators for half a minute in memory, so that their
kernels are loaded; then it forks on request (:mod:`lowcostnav_ros.graph.warm_parent`), until the runner closes the socket.  It has no
thread, no ROS context and no signal handler of its own: what it forks begins as a fresh process does.
"""

import ctypes
import gc
import json
import os
import socket
import sys
import threading
import traceback
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from lowcostnav_ros.base import kernels
from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.graph.description import takes_scenario
from lowcostnav_ros.graph.executables import NAVIGATOR, kind_of, needs_compiler
from lowcostnav_ros.graph.warm_parent import READY
from lowcostnav_ros.nodes.dispatch import main, maker


def take_in(executables: Sequence[str]) -> None:
    """Import what the executables will; what cannot be had is left for the node to say."""
    import rclpy.executors  # noqa: F401
    from rcl_interfaces import msg, srv
    from rclpy.type_support import check_for_type_support
    from std_srvs.srv import Trigger

    from lowcostnav_ros.messages.topics import DIAGNOSTICS, TOPICS
    from lowcostnav_ros.ros import run  # noqa: F401
    from lowcostnav_ros.ros.publishing import message_class
    from lowcostnav_ros.simulation.scenario import scenario_class

    for name in executables:
        with suppress(Exception):
            maker(name)
            if takes_scenario(name):
                scenario_class()
    msgtypes = {DIAGNOSTICS, *(kind.msgtype for kind in TOPICS.values())}
    for kind in (*vars(srv).values(), msg.ParameterEvent, Trigger, *map(message_class, msgtypes)):
        with suppress(Exception):
            check_for_type_support(kind)


def fly(executables: Sequence[str], settings: Path) -> None:
    """Fly the navigators among the executables, as they are set."""
    for name in executables:
        if kind_of(name) == NAVIGATOR:
            with suppress(Exception):
                _fly(name, settings / f"{name}.yaml")


def _fly(name: str, file: Path) -> None:
    from lowcostnav_ros.catalogue.building import complete_settings, is_of_node, make_navigator
    from lowcostnav_ros.catalogue.config_files import read_parameters
    from lowcostnav_ros.messages.inputs import is_of_input
    from lowcostnav_ros.navigators.registry import NAVIGATORS
    from lowcostnav_ros.ros.warm_up import warm_up

    given = read_parameters(file).items()
    values = {key: value for key, value in given if not is_of_node(key) and not is_of_input(key)}
    warm_up(make_navigator(complete_settings(NAVIGATORS[name].Settings, values, name), NAVIGATORS[name]))


def serve(requests: socket.socket) -> list[str] | None:
    """Fork for every request; return its command line in the new process, None in this one once there are no more."""
    requests.send(READY)
    gc.collect()
    gc.freeze()  # what nobody writes to stays shared
    while True:
        request, given, _, _ = socket.recv_fds(requests, 1 << 16, 3)
        if not request:
            return None
        pid = _adopted()
        if pid == 0:
            requests.close()
            os.setsid()
            stdout, stderr, permit = given
            if not os.read(permit, 1):
                os._exit(1)
            os.dup2(stdout, 1)
            os.dup2(stderr, 2)
        for handle in given:
            os.close(handle)
        if pid == 0:
            command: list[str] = json.loads(request)
            _call_it(command)
            return command
        requests.send(str(pid).encode())


def _adopted() -> int:
    """Fork a process that has lost its parent, so that the runner adopts it; return 0 in it, else its id."""
    number, tell = os.pipe()
    between = os.fork()
    if between == 0:
        try:
            pid = os.fork()
        except OSError:
            os._exit(1)
        if pid:
            os.write(tell, str(pid).encode())
            os._exit(0)
    os.close(tell)
    if between:
        os.waitpid(between, 0)
        pid = int(os.read(number, 20))
    os.close(number)
    return pid


def _call_it(command: Sequence[str]) -> None:
    """Write a command line over that of this process, for ``ps``."""
    with suppress(OSError, ValueError):
        start, end = map(int, Path("/proc/self/stat").read_text().rpartition(")")[2].split()[45:47])
        ctypes.memmove(start, b"\0".join(part.encode() for part in command)[: end - start - 1].ljust(end - start, b"\0"), end - start)


def _begin(number: int, *executables: str) -> int:
    if not any(map(needs_compiler, executables)):
        os.environ.setdefault("LOWCOSTNAV_KERNELS", "interpreted")
    requests = socket.socket(fileno=number)

    def tell(words: str) -> None:
        with suppress(OSError):  # nobody listens any more
            requests.send(words.encode())

    kernels.tell = tell
    take_in(executables)
    if settings := requests.recv(1 << 12):
        fly(executables, Path(os.fsdecode(settings)))
    kernels.tell = kernels.on_stderr  # of the nodes
    if threading.active_count() > 1:
        print("something imported has started a thread, which no fork survives: nodes are started one by one", file=sys.stderr)
        return 0
    command = serve(requests)
    if command is None:
        return 0
    status = 1
    try:
        status = main(command[3], command[4:])  # python, -m and the module before
    except KeyboardInterrupt:  # before the node has a handler of its own
        status = Exit.INTERRUPTED
    except Exception:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)  # the node has been closed; to take down what is shared would first copy all of it


if __name__ == "__main__":
    sys.exit(_begin(int(sys.argv[1]), *sys.argv[2:-1]))
