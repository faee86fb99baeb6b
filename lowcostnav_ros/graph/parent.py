"""A node of a graph ends with the runner that started it, however that ends: no orphan flies on."""

import os
import signal
import threading
import time

RUNNER = "LOWCOSTNAV_RUNNER"
"""Environment variable with the process id of the runner."""
LOOK_S, GRACE_S = 0.5, 5.0


def end_with_runner() -> None:
    """In a process that a runner has started: look for it, from a thread of its own, and end like by Ctrl-C once it is gone."""
    runner = os.environ.get(RUNNER, "")
    if runner.isdigit():
        threading.Thread(target=_watch, args=(int(runner),), name="runner", daemon=True).start()


def _watch(runner: int) -> None:
    while os.getppid() == runner:
        time.sleep(LOOK_S)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(GRACE_S)
    os.kill(os.getpid(), signal.SIGKILL)
