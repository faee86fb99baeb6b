"""Bring a graph of nodes up, watch it, take it down in order."""

import contextlib
import json
import math
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Self

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.graph.description import Graph, GraphError, GraphNode
from lowcostnav_ros.graph.domain import free_domain, node_environment
from lowcostnav_ros.graph.executables import KINDS, SOURCE, kind_of
from lowcostnav_ros.graph.process import Event, NodeProcess, What, write_parameters
from lowcostnav_ros.graph.wiring import flown_settings, shared_parameters

STOP_S = 5.0
WATCH_S = 0.1


class GraphRunner:
    """Run a graph; a context manager that leaves no process behind.

    Parameters
    ----------
    graph : Graph
    out : Path, optional
        Where a recording without a path of its own goes (``<out>/recording``); default is the log folder.
    log_dir : Path, optional
        Where the nodes' output goes; default is a new folder in the temporary directory.
    on_event : callable
        Called with every event (a death, a restart); as text an event is a sentence.

    Examples
    --------
    >>> with GraphRunner(load_graph("livermore"), out=Path("out")) as runner:  # doctest: +SKIP
    ...     runner.wait_until_finished()
    """

    def __init__(
        self, graph: Graph, out: Path | None = None, log_dir: Path | None = None, on_event: Callable[[Event], None] = lambda _: None
    ) -> None:
        self.graph, self._on_event = graph, on_event
        self.log_dir = Path(log_dir or mkdtemp(prefix=f"lowcostnav_{graph.name}_"))
        self.out = Path(out or self.log_dir)
        self.rows: dict[str, dict[str, Any]] = {}
        self.events: list[Event] = []
        self.processes: dict[str, NodeProcess] = {}
        self._domain = contextlib.ExitStack()
        self._monitor: NodeProcess | None = None
        self._reported_at: dict[str, float] = {}

    def __enter__(self) -> Self:
        self.log_dir.mkdir(parents=True, exist_ok=True)
        if any(n.executable == "recorder" for n in self.graph.nodes) and (self.out / "recording").exists():
            raise GraphError(f"{self.out / 'recording'} exists already; choose another folder or remove it first.")
        self._write_settings(self.log_dir / "settings")
        self.domain = self._domain.enter_context(free_domain(self.graph.domain))
        environment = node_environment(self.domain, self.log_dir)
        try:
            self._start_monitor(environment)
            for node in self.graph.nodes:
                self.processes[node.name] = self._process(node, environment)
                self.processes[node.name].start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_exception: object) -> None:
        self.stop()

    def watch(self) -> list[Event]:
        """Look after the processes once: notice deaths, restart; return what happened."""
        happened = [event for process in self.processes.values() if (event := process.watch())]
        for event in happened:
            self._note(event)
        for process in self.processes.values():
            if process.given_up and process.exit_code == Exit.CANNOT_RUN:
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
        table: dict[str, dict[str, int]] = {}
        for name, row in self.rows.items():
            node, _, what = name.partition(": ")
            kind, _, topic = what.partition(" ")
            if kind == "output":
                entry = table.setdefault(topic, {"sent": 0})
                entry["sent"] += int(row["values"]["count"])
            elif kind == "input":
                table.setdefault(topic, {"sent": 0})[node] = int(row["values"]["count"])
        return table

    def navigator(self, name: str) -> dict[str, Any]:
        """Last navigator row of a node: level, message, values; empty before the first."""
        return self.rows.get(f"{name}: navigator", {})

    def stop(self) -> None:
        """End all nodes by SIGINT, those that feed before those that are fed, the recorder last; kill what does not end."""
        running = [*self.processes.values(), *([self._monitor] if self._monitor else [])]
        for kind in KINDS:
            group = [process for process in running if kind_of(process.executable) == kind]
            for process in group:
                process.interrupt()
            deadline = time.monotonic() + STOP_S
            for process in group:
                if not process.wait(max(deadline - time.monotonic(), 0.1)):
                    self._note(Event(process.name, What.KILLED, f"did not end within {STOP_S:g} s"))
        if self._monitor is not None and self._monitor.process is not None and self._monitor.process.stdout:
            self._reader.join(2.0)
            self._monitor.process.stdout.close()
        self._domain.close()

    def _note(self, event: Event) -> None:
        self.events.append(event)
        self._on_event(event)

    def _sources(self) -> list[str]:
        return [node.name for node in self.graph.nodes if kind_of(node.executable) == SOURCE]

    def _source_state(self, name: str) -> str:
        row = self.rows.get(f"{name}: source")
        state: str = row["values"]["state"] if row else "starting"
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
        return NodeProcess(node.name, node.executable, files, environment, self.log_dir / f"{node.name}.log", node.respawn)

    def _parameters(self, node: GraphNode) -> dict[str, Any]:
        # a recorder that is started again must not be refused
        recording = {"path": str(self.out / "recording"), "numbered": True, "settings_folder": str(self.log_dir / "settings")}
        return (recording if node.executable == "recorder" else {}) | shared_parameters(self.graph, node)

    def _write_settings(self, folder: Path) -> None:
        """Write what every navigator flies with, one file each: the recording takes them in, a replay reads them."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, values in flown_settings(self.graph).items():
            write_parameters(folder / f"{name}.yaml", values)

    def _start_monitor(self, environment: dict[str, str]) -> None:
        self._monitor = NodeProcess("monitor", "monitor", [], environment, self.log_dir / "monitor.log")
        self._monitor.start(stdout=subprocess.PIPE)
        self._reader = threading.Thread(target=self._read, args=(self._monitor.stdout,), daemon=True)
        self._reader.start()

    def _read(self, lines: Any) -> None:
        for line in lines:
            with contextlib.suppress(ValueError, KeyError):  # a line cut off by the end of the process
                row = json.loads(line)
                self.rows[row["name"]] = row
                self._reported_at[row["name"].partition(":")[0]] = time.monotonic()

    def unreported_s(self, node: str) -> float | None:
        """Seconds since the last diagnostics of a node, None before the first."""
        reported = self._reported_at.get(node)
        return None if reported is None else time.monotonic() - reported
