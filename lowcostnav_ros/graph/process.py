"""One node process: started, watched, started again when it dies, stopped by SIGINT."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import yaml

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.graph.parent import RUNNER
from lowcostnav_ros.graph.warm_parent import Forked, WarmParent

FIRST_BACKOFF_S, LONGEST_BACKOFF_S, HEALTHY_S = 0.5, 10.0, 30.0  # after the first new start, which is at once
LAST_BYTES = 4096
TICKS = os.sysconf("SC_CLK_TCK")
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20


class What(StrEnum):
    """What happened to a node."""

    DIED = "died"
    STARTED_AGAIN = "started again"
    KILLED = "killed"
    SILENT = "silent"
    ANSWERS = "answers"
    FAILS = "fails"


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened to a node; as text it is a sentence.

    Attributes
    ----------
    node : str
    what : What
    cause : str
        Why it died, in words, or what it was killed for.
    retry_s : float or None
        Time until a dead node is started again, s; None for never.
    restarts : int
        How often it has been started again.
    stamp_s : float
        Wall time, s since 1970.
    """

    node: str
    what: What
    cause: str = ""
    retry_s: float | None = None
    restarts: int = 0
    stamp_s: float = field(default_factory=time.time)

    @property
    def is_trouble(self) -> bool:
        """Whether something went wrong, as a new start or a new answer does not."""
        return self.what not in (What.STARTED_AGAIN, What.ANSWERS)

    def __str__(self) -> str:
        """The event as a sentence."""
        if self.what is What.STARTED_AGAIN:
            return f"{self.node} started again (restart {self.restarts})."
        if self.what is What.KILLED:
            return f"{self.node} {self.cause} and was killed."
        if self.what is What.SILENT:
            return f"{self.node} does not answer: {self.cause}."
        if self.what is What.ANSWERS:
            return f"{self.node} answers again."
        if self.what is What.FAILS:
            return f"{self.node} fails: {self.cause}."
        again = "" if self.retry_s is None else f"; starting again{f' in {self.retry_s:.1f} s' if self.retry_s else ' at once'}"
        return f"{self.node} died: {self.cause}{again}."


class NodeProcess:
    """One node of a graph.

    Parameters
    ----------
    name, executable : str
    params_files : sequence of Path
        In order; later ones win.
    environment : mapping
    log : Path
        Where its output goes.
    respawn : bool
    parent : WarmParent, optional
        Of which it is forked where that can be.
    """

    def __init__(
        self,
        name: str,
        executable: str,
        params_files: list[Path],
        environment: Mapping[str, str],
        log: Path,
        respawn: bool = True,
        parent: WarmParent | None = None,
    ) -> None:
        self.name, self.executable, self.log, self.respawn = name, executable, log, respawn
        self._environment = {**environment, RUNNER: str(os.getpid())}
        self._parent = parent
        self._command = [sys.executable, "-m", "lowcostnav_ros.nodes.dispatch", executable, "--ros-args", "-r", f"__node:={name}"]
        for path in params_files:
            self._command += ["--params-file", str(path)]
        self.process: subprocess.Popen | Forked | None = None
        self.restarts, self.given_up = 0, False
        self.exit_code: int | None = None
        self._backoff_s, self._started_at = 0.0, 0.0
        self._restart_at: float | None = None
        self._cpu_last = (0.0, 0.0)

    def start(self, stdout: int | None = None) -> None:
        """Start the process; its output goes to the log unless ``stdout`` is given."""
        with self.log.open("ab") as log:
            out, errors = log.fileno() if stdout is None else stdout, log.fileno()
            self.process = self._parent.fork(self._command, out, errors) if self._parent else None
            if self.process is None:
                self.process = subprocess.Popen(self._command, stdout=out, stderr=errors, env=self._environment, start_new_session=True)
            # its own session: Ctrl-C in the terminal reaches the runner, which stops the nodes in order
        self._started_at, self._restart_at = time.monotonic(), None
        self._cpu_last = (0.0, self._started_at)

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        return self.process is not None and self.process.poll() is None

    def watch(self) -> Event | None:
        """Notice a death, start again when it is time; return what happened, if anything did."""
        now = time.monotonic()
        if self.process is None or self.alive or self.given_up:
            return None
        if self._restart_at is not None:
            if now < self._restart_at:
                return None
            try:
                self.start()
            except OSError as error:  # no memory, no processes left: others fly on
                self._restart_at = now + LONGEST_BACKOFF_S
                return Event(self.name, What.DIED, f"it cannot be started ({error.strerror})", LONGEST_BACKOFF_S, self.restarts)
            self.restarts += 1
            return Event(self.name, What.STARTED_AGAIN, restarts=self.restarts)
        self.exit_code = code = self.process.wait()
        words = self.last_line().rstrip(".") if code > 0 else ""
        cause = f"{describe_exit(code)} ({words})" if words else describe_exit(code)
        if not self.respawn or (code == Exit.CANNOT_RUN and not self.restarts):  # once it has flown, what keeps it from running may pass
            self.given_up = True
            return Event(self.name, What.DIED, cause, restarts=self.restarts)
        self._backoff_s = 0.0 if now - self._started_at > HEALTHY_S else self._backoff_s
        self._restart_at = now + self._backoff_s
        died = Event(self.name, What.DIED, cause, self._backoff_s, self.restarts)
        self._backoff_s = min(max(2.0 * self._backoff_s, FIRST_BACKOFF_S), LONGEST_BACKOFF_S)
        return died

    def interrupt(self) -> None:
        """Ask it to end (SIGINT) and never start it again."""
        self.given_up = True
        if self.process is not None and self.alive:
            self.process.send_signal(signal.SIGINT)

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end; when it does not come, kill.  Return True when it ended by itself."""
        if self.process is None:
            return True
        try:
            self.exit_code = self.process.wait(timeout_s)
            return True
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.exit_code = self.process.wait()
            return False

    def cpu_seconds(self) -> float:
        """Processor time used since its start, s (0 when it does not run)."""
        fields = self._proc("stat").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICKS if fields else 0.0

    def cpu_share(self) -> float:
        """Share of one core since the last call."""
        used, now = self.cpu_seconds(), time.monotonic()
        before, then = self._cpu_last
        self._cpu_last = (used, now)
        return max(used - before, 0.0) / (now - then) if now > then else 0.0

    def is_stopped(self) -> bool:
        """Whether a signal or a debugger has stopped it."""
        return self._proc("stat").rpartition(")")[2].split()[:1] in (["T"], ["t"])

    def rss_mb(self) -> float:
        """Resident memory, MB (0 when it does not run)."""
        fields = self._proc("statm").split()
        return int(fields[1]) * PAGE_MB if fields else 0.0

    def _proc(self, file: str) -> str:
        """Content of a file of the kernel on this process, empty when it does not run."""
        with contextlib.suppress(OSError):
            return "" if self.process is None else Path(f"/proc/{self.process.pid}/{file}").read_text()
        return ""

    def last_line(self) -> str:
        """Last line of its log that is not blank, empty where there is none."""
        with contextlib.suppress(OSError), self.log.open("rb") as log:
            log.seek(-min(log.seek(0, os.SEEK_END), LAST_BYTES), os.SEEK_END)
            return log.read().decode(errors="replace").strip().rpartition("\n")[2].strip()
        return ""


def describe_exit(code: int) -> str:
    """Return an exit status in words."""
    if code < 0:
        return f"killed by {signal.Signals(-code).name}"
    return "it ended by itself with exit code 0" if code == 0 else f"exit code {code}"


def write_parameters(path: Path, values: Mapping[str, Any]) -> Path:
    """Write parameter values as a ROS parameter file for whatever node reads it."""
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(values)}}, default_flow_style=None, sort_keys=True))
    return path
