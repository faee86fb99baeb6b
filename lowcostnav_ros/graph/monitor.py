"""What the nodes of a graph report on /diagnostics, as the monitor process passes it on.

What stands in a report is foreign text: only the rows that a process of this graph has sent are taken, in the form they must have, and
none of them decides whether a process lives.
"""

import contextlib
import json
import os
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.base.tally import Tally
from lowcostnav_ros.base.text import numeric
from lowcostnav_ros.graph.executables import MONITOR
from lowcostnav_ros.graph.process import NodeProcess
from lowcostnav_ros.graph.warm_parent import WarmParent

MOST_ROWS = 2000
STALE = 3  # a level of diagnostic_msgs that nodes of this package do not use
MATCHED_S = 5.0  # a monitor that starts again needs to find every node
PAUSE_S = 1.5  # the nodes report once a second; a longer pause on all lines is one of the monitor, or of this machine


class Reports:
    """The last row of everything that the nodes report.

    Parameters
    ----------
    process_of : callable
        Returns the process id of a node of the graph, None for a name that is none.

    Attributes
    ----------
    rows : dict of name to row
        A row has ``name`` (``node: what``), ``level`` (0, 1, 2), ``message`` and ``values`` (text by name).
    ignored : Tally
        Rows that are not taken, by reason.
    """

    def __init__(self, process_of: Callable[[str], int | None]) -> None:
        self.rows: dict[str, dict[str, Any]] = {}
        self.ignored: Tally[str] = Tally()
        self._process_of = process_of
        self._reported_at: dict[str, float] = {}
        self._last = time.monotonic()
        self._is_new_monitor = False

    def take(self, line: str) -> None:
        """Take a line of the monitor: a status as JSON."""
        now = time.monotonic()
        if self._is_new_monitor or now - self._last > PAUSE_S:  # nobody could be heard, so nobody was silent
            since = now + MATCHED_S * self._is_new_monitor
            self._reported_at = {node: now if node == MONITOR else since for node in self._reported_at}
        self._last, self._is_new_monitor = now, False
        row = _row(line)
        node = "" if row is None else row["name"].partition(": ")[0]
        if row is None:
            self.ignored["malformed row"] += 1
        elif row["process"] is None or row["process"] != self._process_of(node):
            self.ignored["row of another graph"] += 1
        elif row["name"] not in self.rows and len(self.rows) >= MOST_ROWS:
            self.ignored["more rows than a graph has"] += 1
        else:
            self.rows[row["name"]] = row
            self._reported_at[node] = now

    def forget(self, node: str) -> None:
        """A node starts again: until it reports, it is starting."""
        self._reported_at.pop(node, None)
        self._is_new_monitor |= node == MONITOR

    def silent_s(self, node: str) -> float | None:
        """Seconds since the last report of a node, None before the first; while the monitor itself is silent, the others are not judged.

        Negative for nodes that a monitor started again need not have found yet.
        """
        reported = self._reported_at.get(node)
        return None if reported is None else (time.monotonic() if node == MONITOR else self._last) - reported

    def of(self, node: str) -> list[dict[str, Any]]:
        """The rows of a node."""
        return [row for name, row in list(self.rows.items()) if name.startswith(f"{node}: ")]

    def counts(self) -> dict[str, dict[str, int]]:
        """Messages per topic: ``sent`` by its publishers, and received by node."""
        table: dict[str, dict[str, int]] = {}
        for name, row in list(self.rows.items()):
            node, _, what = name.partition(": ")
            kind, _, topic = what.partition(" ")
            count = numeric(row["values"], "count")
            if kind == "output" and count is not None:
                entry = table.setdefault(topic, {"sent": 0})
                entry["sent"] += int(count)
            elif kind == "input" and count is not None:
                table.setdefault(topic, {"sent": 0})[node] = int(count)
        return table


def _row(line: str) -> dict[str, Any] | None:
    """A row in the form it must have, None for what has not."""
    with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError, RecursionError):
        given = json.loads(line)
        values = {str(key): str(value) for key, value in given["values"].items()}
        process = str(given["hardware_id"]).rpartition(" ")[2]
        level = Level({STALE: Level.ERROR}.get(given["level"], given["level"]))
        row = {"name": str(given["name"]), "level": level, "message": str(given["message"]), "values": values}
        return row | {"process": int(process) if process.isdigit() else None}
    return None


class MonitorProcess(NodeProcess):
    """The monitor's process; its lines go to ``take``."""

    def __init__(self, environment: Mapping[str, str], log: Path, take: Callable[[str], None], parent: WarmParent | None = None) -> None:
        super().__init__(MONITOR, MONITOR, [], environment, log, parent=parent)
        self._take = take

    def start(self, stdout: int | None = None) -> None:
        """Start the process and a thread that reads it."""
        lines, written = os.pipe()
        try:
            super().start(written)
        finally:
            os.close(written)
        self._reader = threading.Thread(target=self._read, args=(os.fdopen(lines),), daemon=True)
        self._reader.start()

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end of the process, then for its last lines."""
        ended = super().wait(timeout_s)
        if self.process is not None:
            self._reader.join(2.0)
        return ended

    def _read(self, lines: Any) -> None:
        with lines:
            for line in lines:
                self._take(line)
