"""Bring a graph of nodes up, watch it, take it down in order."""

import contextlib
import math
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import gettempdir, mkdtemp
from typing import Any, Self

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.graph.description import Graph, GraphError, GraphNode
from lowcostnav_ros.graph.domain import LOCALHOST, RANGE, free_domain, node_environment, require_ros, users_domain
from lowcostnav_ros.graph.executables import KINDS, MONITOR, RECORDER, SOURCE, kind_of, needs_compiler
from lowcostnav_ros.graph.monitor import MonitorProcess, Reports
from lowcostnav_ros.graph.page.server import TOKEN, with_token
from lowcostnav_ros.graph.process import Event, NodeProcess, What, write_parameters
from lowcostnav_ros.graph.warm_parent import WarmParent
from lowcostnav_ros.graph.watchdog import Watchdog
from lowcostnav_ros.graph.wiring import PAGE, flown_settings, shared_parameters

STOP_S = 5.0
WATCH_S = 0.1
KEPT_LOGS = 10


class GraphRunner:
    """Run a graph; a context manager that leaves no process behind.

    Parameters
    ----------
    graph : Graph
    out : Path, optional
        Where a recording without a path of its own goes (``<out>/recording``); default is the log folder.
    log_dir : Path, optional
        Where the nodes' output goes; default is a new folder in the temporary directory, where the last ten are kept.
    on_event : callable
        Called with every event (a death, a restart, a silence, a full disk); as text an event is a sentence.

    Examples
    --------
    >>> with GraphRunner(load_graph("livermore"), out=Path("out")) as runner:  # doctest: +SKIP
    ...     runner.wait_until_finished()
    """

    def __init__(
        self, graph: Graph, out: Path | None = None, log_dir: Path | None = None, on_event: Callable[[Event], None] = lambda _: None
    ) -> None:
        self.graph, self._on_event = graph, on_event
        self.log_dir = Path(log_dir or _new_log_folder(graph.name))
        self.out = Path(out or self.log_dir)
        self.events: list[Event] = []
        self.title = graph.name
        self.processes: dict[str, NodeProcess] = {}
        self.reports = Reports(self._process_id)
        self._domain = contextlib.ExitStack()
        self._monitor: NodeProcess | None = None
        self._watchdog = Watchdog(graph.lossless)
        self.parents: dict[str, WarmParent] = {}
        self._failing: set[str] = set()

    def __enter__(self) -> Self:
        require_ros()
        self.log_dir.mkdir(parents=True, exist_ok=True)
        if any(n.executable == "recorder" for n in self.graph.nodes) and (self.out / "recording").exists():
            raise GraphError(f"{self.out / 'recording'} exists already; choose another folder or remove it first.")
        environment = self._environment()
        try:
            self._begin_parents(environment)
            self._write_settings(self.log_dir / "settings")
            for parent in self.parents.values():
                parent.prepare(self.log_dir / "settings")
            self._monitor = MonitorProcess(environment, self.log_dir / "monitor.log", self.reports.take, self.parents[_kernels(MONITOR)])
            self._monitor.start()
            self.processes = {node.name: self._process(node, environment) for node in self.graph.nodes}
            for process in sorted(self.processes.values(), key=lambda process: needs_compiler(process.executable)):  # the quick ones first
                process.start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_exception: object) -> None:
        self.stop()

    def _environment(self) -> dict[str, str]:
        """That of the node processes: a graph without sensors of its own flies on the domain of this environment."""
        graph = self.graph
        try:
            wanted = graph.domain if graph.domain is not None or graph.has_source else users_domain()
        except ValueError as error:
            raise GraphError(str(error)) from error
        self.domain = self._domain.enter_context(free_domain(wanted))
        environment = node_environment(self.domain, self.log_dir)
        reach = environment.get(RANGE, "").upper()
        self.title = f"{graph.name} on ROS domain {self.domain}, {'this machine' if reach == LOCALHOST else reach.lower() or 'subnet'}"
        return environment

    def _begin_parents(self, environment: dict[str, str]) -> None:
        """Let those get ready of which the nodes are forked, with the compiler and without."""
        names = dict.fromkeys((MONITOR, *(node.executable for node in self.graph.nodes)))
        for kernels in sorted(set(map(_kernels, names))):
            executables = [name for name in names if _kernels(name) == kernels]
            self.parents[kernels] = WarmParent(executables, environment, self.log_dir / f"parent_{kernels}.log")
            self.parents[kernels].begin()

    def watch(self) -> list[Event]:
        """Look after the processes once: notice deaths, silence and full disks, restart; return what happened."""
        happened: list[Event] = []
        for process in self._running():
            died = process.watch()
            if died is not None:
                self.reports.forget(process.name)
            silence = self._watchdog.look(process, self.reports.silent_s(process.name))
            happened += [event for event in (died, silence, self._failure(process)) if event is not None]
        for event in happened:
            self._note(event)
        for process in self._running():
            only_watched = kind_of(process.executable) == MONITOR and process.restarts > 0  # that no longer can is no reason to land
            if process.given_up and process.exit_code == Exit.CANNOT_RUN and not only_watched:
                raise GraphError(f"{process.name} cannot run: {process.last_line() or f'see {process.log}.'}")
        return happened

    def wait_until_finished(self, timeout_s: float | None = None, each: Callable[[], None] = lambda: None) -> bool:
        """Watch until the source has published everything and it has arrived.

        Parameters
        ----------
        timeout_s : float, optional
            Give up after this long; None never does.
        each : callable
            Called about ten times a second (to draw a table).

        Returns
        -------
        bool
            True when finished; False on time-out.

        Raises
        ------
        GraphError
            When a node cannot run, the source fails or dies, or the graph has no source.
        """
        if not self._sources():
            raise GraphError(f"{self.graph.name} has no truth_source and no player, so it never finishes; stop it instead.")

        def finished() -> bool:
            each()
            return all(state == "finished" for state in [self._source_state(name) for name in self._sources()])

        if not self.wait_for(finished, math.inf if timeout_s is None else timeout_s):
            return False
        self._drain()
        return True

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Watch until ``condition`` holds; return False on time-out."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            self.watch()
            if condition():
                return True
            time.sleep(WATCH_S)
        return False

    def counts(self) -> dict[str, dict[str, int]]:
        """Messages per topic: ``sent`` by its publishers, and received by node, from the last diagnostics."""
        return self.reports.counts()

    @property
    def rows(self) -> dict[str, dict[str, Any]]:
        """The last diagnostics rows by name."""
        return self.reports.rows

    def navigator(self, name: str) -> dict[str, Any]:
        """Last navigator row of a node: level, message, values; empty before the first."""
        return self.rows.get(f"{name}: navigator", {})

    def stop(self) -> None:
        """End all nodes by SIGINT, those that feed before those that are fed, the recorder last; kill what does not end."""
        for kind in KINDS:
            group = [process for process in self._running() if kind_of(process.executable) == kind]
            was_alive = {process.name for process in group if process.alive}
            for process in group:
                process.interrupt()
            deadline = time.monotonic() + STOP_S
            for process in group:
                if not process.wait(max(deadline - time.monotonic(), 0.1)):
                    self._note(Event(process.name, What.KILLED, f"did not end within {STOP_S:g} s"))
                elif kind == RECORDER and process.exit_code == Exit.WORSE and process.name in was_alive - self._failing:
                    self._note(Event(process.name, What.FAILS, process.last_line().rstrip(".")))
        for parent in self.parents.values():
            parent.end()
        self._domain.close()

    @property
    def recording(self) -> Path | None:
        """Where the graph's recorder has written, None without one."""
        recorders = [node.name for node in self.graph.nodes if kind_of(node.executable) == RECORDER]
        paths = (self.rows.get(f"{name}: recording", {}).get("values", {}).get("path") for name in recorders)
        return next((Path(path) for path in paths if path and Path(path).exists()), None)

    @property
    def page(self) -> str:
        """Address of the page that shows the flight, empty before there is one."""
        pages = (self.rows.get(f"{node.name}: page", {}) for node in self.graph.nodes if node.executable == PAGE)
        address: str = next((row["values"].get("address", "") for row in pages if row), "")
        return with_token(address, os.environ.get(TOKEN, ""))

    def _running(self) -> list[NodeProcess]:
        return [*self.processes.values(), *([self._monitor] if self._monitor else [])]

    def _process_id(self, name: str) -> int | None:
        process = next((one for one in self._running() if one.name == name), None)
        return None if process is None or process.process is None else process.process.pid

    def _failure(self, process: NodeProcess) -> Event | None:
        """What keeps a recording from being complete, said once."""
        row = self.rows.get(f"{process.name}: recording")
        if row is None or row["level"] < Level.ERROR:
            self._failing.discard(process.name)
        elif process.name not in self._failing:
            self._failing.add(process.name)
            return Event(process.name, What.FAILS, row["message"])
        return None

    def _note(self, event: Event) -> None:
        self.events.append(event)
        with contextlib.suppress(OSError):  # a terminal that was closed
            self._on_event(event)

    def _sources(self) -> list[str]:
        return [node.name for node in self.graph.nodes if kind_of(node.executable) == SOURCE]

    def _source_state(self, name: str) -> str:
        row = self.rows.get(f"{name}: source")
        state: str = row["values"].get("state", "") if row else "starting"
        if row and state == "failed":
            raise GraphError(f"{name}: {row['message']}")
        if not self.processes[name].alive:
            raise GraphError(f"{name} ended before the flight did; its log is {self.processes[name].log}.")
        return state

    def _drain(self, quiet_s: float = 2.2, longest_s: float = 15.0) -> None:
        """Wait until the counts of two rounds of diagnostics agree: nothing is on its way any more."""
        before: dict[str, Any] = {}
        since = time.monotonic()
        deadline = since + longest_s
        while time.monotonic() < min(since + quiet_s, deadline):
            self.watch()
            now = {topic: entry for topic, entry in self.counts().items() if topic != "diagnostics"}
            if now != before:
                before, since = now, time.monotonic()
            time.sleep(WATCH_S)

    def _process(self, node: GraphNode, environment: dict[str, str]) -> NodeProcess:
        files = [node.config] if node.config else []
        files.append(write_parameters(self.log_dir / f"{node.name}.params.yaml", self._parameters(node)))
        parent = self.parents[_kernels(node.executable)]
        return NodeProcess(node.name, node.executable, files, environment, self.log_dir / f"{node.name}.log", node.respawn, parent)

    def _parameters(self, node: GraphNode) -> dict[str, Any]:
        # a recorder that is started again must not be refused
        recording = {"path": str(self.out / "recording"), "numbered": True, "settings_folder": str(self.log_dir / "settings")}
        return (recording if node.executable == "recorder" else {}) | shared_parameters(self.graph, node)

    def _write_settings(self, folder: Path) -> None:
        """Write what every navigator flies with, one file each: the recording takes them in, a replay reads them."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, values in flown_settings(self.graph).items():
            write_parameters(folder / f"{name}.yaml", values)

    def unreported_s(self, node: str) -> float | None:
        """Seconds since the last diagnostics of a node, None before the first."""
        return self.reports.silent_s(node)


def _kernels(executable: str) -> str:
    """Which of the warm parents an executable is forked of."""
    return "compiled" if needs_compiler(executable) else "interpreted"


def _new_log_folder(name: str) -> Path:
    """Make a log folder in the temporary directory; of earlier ones the last ten are kept, and those that hold a recording."""
    earlier = [path for path in Path(gettempdir()).glob("lowcostnav_*_log_*") if path.is_dir() and path.stat().st_uid == os.getuid()]
    finished = [path for path in earlier if not any(path.glob("recording*")) and not _is_in_use(path)]
    for path in sorted(finished, key=lambda path: path.stat().st_mtime)[:-KEPT_LOGS]:
        shutil.rmtree(path, ignore_errors=True)
    folder = Path(mkdtemp(prefix=f"lowcostnav_{name}_log_"))
    (folder / "runner.pid").write_text(str(os.getpid()))
    return folder


def _is_in_use(folder: Path) -> bool:
    with contextlib.suppress(OSError, ValueError):
        return Path(f"/proc/{int((folder / 'runner.pid').read_text())}").exists()
    return False
