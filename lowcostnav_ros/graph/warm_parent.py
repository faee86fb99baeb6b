"""Processes forked from one that has imported all they need: ready in a tenth of the time, and in memory that they share.

A warm parent (:mod:`lowcostnav_ros.nodes.forking`) imports, loads kernels, then forks on request.  What it forks is no child of it but of
this process, which adopts orphans (Linux: PR_SET_CHILD_SUBREAPER): a node is waited for and ends with its runner as any other, and
nothing happens to it when its warm parent is killed.  Where there is none, and until there is a new one, nodes are started as commands.
"""

import ctypes
import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from lowcostnav_ros.base.kernels import on_stderr
from lowcostnav_ros.graph.parent import RUNNER

READY = b"ready"
FIRST_S, REPLY_S = 20.0, 2.0  # until a parent is ready, anew whenever it says that it compiles; until one that is gives an answer
TITLE_BYTES = 4096  # room for the command lines of those that are forked
_SET_SUBREAPER, _GET_SUBREAPER = 36, 37  # PR_..._CHILD_SUBREAPER of linux/prctl.h


@contextmanager
def _adopting() -> Iterator[None]:
    """Adopt orphans meanwhile: for longer, this process would keep those of others that it never waits for; raises OSError."""
    prctl, before = ctypes.CDLL(None).prctl, ctypes.c_int()
    prctl.argtypes = [ctypes.c_int, *4 * [ctypes.c_ulong]]
    prctl(_GET_SUBREAPER, ctypes.addressof(before), 0, 0, 0)
    if prctl(_SET_SUBREAPER, 1, 0, 0, 0) != 0:
        raise OSError("this kernel lets no process adopt orphans")
    try:
        yield
    finally:
        prctl(_SET_SUBREAPER, before.value, 0, 0, 0)


class Forked:
    """A process that a warm parent has forked, with the interface of :class:`subprocess.Popen`."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit status, negative for a signal, None while it runs."""
        if self.returncode is None:
            try:
                pid, status = os.waitpid(self.pid, os.WNOHANG)
                self.returncode = os.waitstatus_to_exitcode(status) if pid else None
            except ChildProcessError:  # somebody else has waited for it
                self.returncode = 0
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end and return the exit status; raises subprocess.TimeoutExpired."""
        if self.poll() is None:
            handle = os.pidfd_open(self.pid)
            try:
                select.select([handle], [], [], timeout)
            finally:
                os.close(handle)
        if (code := self.poll()) is None:
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal, while it runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it."""
        self.send_signal(signal.SIGKILL)


class WarmParent:
    """The parent of nodes that need the compiler, or of those that do not.

    Parameters
    ----------
    executables : sequence of str
        What it gets ready for; empty where it is never asked.
    environment : mapping
        Of the nodes.
    log : Path
        Where its own output goes.
    """

    def __init__(self, executables: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        self._executables, self._environment, self._log = executables, environment, log
        self._settings: Path | None = None
        self._process: subprocess.Popen | None = None
        self._socket: socket.socket | None = None
        self._is_ready = False
        self._wait_s = FIRST_S

    @property
    def pid(self) -> int | None:
        """Its process id, None where it does not run."""
        return None if self._process is None or self._process.poll() is not None else self._process.pid

    def begin(self) -> None:
        """Start it, if it does not run: it imports while others work."""
        if self.pid is not None:
            return
        self.end()
        if not sys.platform.startswith("linux"):
            return
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "lowcostnav_ros.nodes.forking", str(theirs.fileno()), *self._executables, " " * TITLE_BYTES]
        with theirs, self._log.open("ab") as log:
            self._process = subprocess.Popen(
                command,
                stdout=log,
                stderr=log,
                # no thread survives a fork, and those of an algebra library gain nothing here
                env={"OPENBLAS_NUM_THREADS": "1", **self._environment, RUNNER: str(os.getpid())},
                start_new_session=True,
                pass_fds=[theirs.fileno()],
            )
        self._socket, self._is_ready = ours, False
        if self._settings is not None:
            self.prepare(self._settings)

    def prepare(self, settings: Path) -> None:
        """Let it fly its navigators warm, by the files of a folder, one a navigator; then it is ready."""
        self._settings = settings
        if self._socket is not None:
            with suppress(OSError):  # one that has ended is found out by the next that asks
                self._socket.send(str(settings).encode())

    def fork(self, command: Sequence[str], stdout: int, stderr: int) -> Forked | None:
        """Return a new process that does what a command line of :mod:`lowcostnav_ros.nodes.dispatch` does;
        None where there is no parent that is ready.

        Only the first call, before anything flies, waits for it to get ready.
        """
        wait_s, self._wait_s = self._wait_s, 0.0
        permit, permission = os.pipe()
        try:
            self.begin()
            if self._socket is None or not self._get_ready(self._socket, wait_s):
                return None
            self._socket.settimeout(REPLY_S)
            with _adopting():
                socket.send_fds(self._socket, [json.dumps(list(command)).encode()], [stdout, stderr, permit])
                forked = Forked(int(self._socket.recv(100)))
            os.write(permission, b"go")  # one whose id comes too late ends instead: it has been replaced
            return forked
        except (OSError, ValueError):
            self.end()
            return None
        finally:
            os.close(permit)
            os.close(permission)

    def _get_ready(self, own: socket.socket, wait_s: float) -> bool:
        """Wait for it; one that compiles is given more time, since nodes of their own would all compile the same."""
        while not self._is_ready and select.select([own], [], [], wait_s)[0]:
            said = own.recv(200)
            if said in (READY, b""):  # or gone
                self._is_ready = said == READY
                break
            on_stderr(said.decode())
        return self._is_ready

    def end(self) -> None:
        """End it; those that it has forked go on."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._process is not None:
            self._process.kill()  # it holds nothing but memory
            self._process.wait()
            self._process = None
