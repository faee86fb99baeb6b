"""A running graph at a glance: one line a node, the navigators first."""

from typing import TYPE_CHECKING

from lowcostnav_ros.base.kernels import COMPILING
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.base.text import numeric
from lowcostnav_ros.graph.executables import NAVIGATOR, kind_of
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.graph.watchdog import SILENT_S

if TYPE_CHECKING:
    from rich.table import Table

COLOURS = {Level.OK: "green", Level.WARN: "yellow", Level.ERROR: "red"}


def table(runner: GraphRunner) -> "Table":
    """Return a rich table: node, mode or state, inputs with their rates, processor, memory, restarts."""
    from rich.table import Table
    from rich.text import Text

    view = Table(title=runner.title, title_justify="left")
    for title in ("node", "state", "inputs"):
        view.add_column(title)
    for title in ("CPU %", "MB", "restarts"):
        view.add_column(title, justify="right")
    total = 0.0
    for name, process in sorted(runner.processes.items(), key=lambda item: kind_of(item[1].executable) != NAVIGATOR):
        cpu = 100.0 * process.cpu_share()
        total += cpu
        level, state = state_of(runner, name)
        figures = f"{cpu:.1f}", f"{process.rss_mb():.0f}", str(process.restarts)
        view.add_row(name, Text(state, COLOURS[level]), Text(inputs_of(runner, name)), *figures)
    page = f"; the flight is shown at {runner.page}" if runner.page else ""
    view.caption = f"processor together {total:.0f} % of one core; logs in {runner.log_dir}{page}"
    return view


def state_of(runner: GraphRunner, name: str) -> tuple[Level, str]:
    """Return (level, sentence) for a node: dead, its worst row, its mode, or how far it has flown."""
    process = runner.processes[name]
    if not process.alive:
        return Level.ERROR, "stopped" if process.given_up else "dead, starting again"
    rows, silent_s = runner.reports.of(name), runner.unreported_s(name)
    if not rows or silent_s is None:
        line = process.last_line()
        return Level.WARN, line if line.startswith(COMPILING) else "starting"
    if silent_s > SILENT_S:
        return Level.ERROR, f"no report for {silent_s:.0f} s"
    worst = max(rows, key=lambda row: row["level"])
    for row in rows:
        if row["name"].endswith((": navigator", ": source", ": recording")) and row["level"] >= worst["level"]:
            return row["level"], row["message"]
    return worst["level"], worst["message"] if worst["level"] else "ok"


def inputs_of(runner: GraphRunner, name: str) -> str:
    """Return the inputs of a node with their rates, e.g. ``imu/data_raw 100 Hz``."""
    prefix = f"{name}: input "
    rows = [row for row in runner.reports.of(name) if row["name"].startswith(prefix)]
    shown = [f"{row['name'].removeprefix(prefix)} {numeric(row['values'], 'rate_hz') or 0.0:.0f} Hz" for row in rows[:6]]
    return ", ".join(shown) + (f" and {len(rows) - 6} more" if len(rows) > 6 else "")
