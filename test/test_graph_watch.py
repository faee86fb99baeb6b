"""What a runner makes of the reports and the silence of its nodes: foreign and defective rows change nothing, hung nodes are named."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.graph import monitor as monitoring
from lowcostnav_ros.graph import runner as running
from lowcostnav_ros.graph.description import parse_graph
from lowcostnav_ros.graph.monitor import Reports
from lowcostnav_ros.graph.process import NodeProcess, What
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.graph.table import table
from lowcostnav_ros.graph.watchdog import Watchdog

GRAPH = parse_graph({"nodes": ["truth_source", "gps_simulator", "recorder"]}, "graph")


def line(name: str, pid: object = 7, level: object = 0, message: str = "", **values: str) -> str:
    return json.dumps({"name": name, "level": level, "message": message, "values": values, "hardware_id": f"/x {pid}"})


def reports() -> Reports:
    return Reports({"gps_simulator": 7, "truth_source": 8, "recorder": 9}.get)


def test_rows_are_taken_from_the_processes_of_the_graph_only():
    own = reports()
    own.take(line("gps_simulator: input truth/odometry", count="5", rate_hz="20.0"))
    own.take(line("truth_source: source", pid=7, state="failed"))
    own.take(line("truth_source: source", pid=99, state="failed"))
    own.take(line("stranger: navigator", pid="none"))
    assert list(own.rows) == ["gps_simulator: input truth/odometry"] and own.ignored["row of another graph"] == 3
    assert own.silent_s("gps_simulator") < 1.0 and own.silent_s("truth_source") is None
    assert own.counts() == {"truth/odometry": {"sent": 0, "gps_simulator": 5}}


@pytest.mark.parametrize("level", [7, -1, "bad", None, [1]])
def test_a_level_that_is_none_is_refused(level):
    own = reports()
    own.take(line("gps_simulator: x", level=level))
    assert not own.rows and own.ignored == {"malformed row": 1}
    own.take(line("gps_simulator: x", level=3))
    assert own.rows["gps_simulator: x"]["level"] == Level.ERROR


@given(st.text() | st.recursive(st.none() | st.floats() | st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)))
def test_no_line_raises(content):
    own = reports()
    own.take(content if isinstance(content, str) else json.dumps(content))
    own.take(json.dumps({"name": content, "level": 0, "message": content, "values": content, "hardware_id": content}))
    assert not own.rows


def test_a_flood_of_names_is_bounded(monkeypatch):
    monkeypatch.setattr(monitoring, "MOST_ROWS", 50)
    own = reports()
    for k in range(1000):
        own.take(line(f"gps_simulator: station {k}"))
        own.take(line(f"stranger {k}: x"))
    assert len(own.rows) == 50 and len(own.ignored) == 2


def test_a_pause_of_the_monitor_is_no_silence_of_the_nodes(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(monitoring.time, "monotonic", lambda: now[0])
    own = reports()
    own.take(line("gps_simulator: x"))
    now[0] += 60.0
    own.take(line("recorder: x", pid=9))
    assert own.silent_s("gps_simulator") == 0.0
    for _ in range(3):
        now[0] += 1.0
        own.take(line("recorder: x", pid=9))
    assert own.silent_s("gps_simulator") == 3.0
    now[0] += 1.0  # the monitor has stopped: who else has is not known
    assert own.silent_s("gps_simulator") == 3.0


def test_a_monitor_started_again_is_given_time_to_find_the_nodes(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(monitoring.time, "monotonic", lambda: now[0])
    own = reports()
    own.take(line("gps_simulator: x"))
    own.take(line("recorder: x", pid=9))
    own.forget(monitoring.MONITOR)
    for _ in range(5):
        now[0] += 1.0
        own.take(line("recorder: x", pid=9))
    assert own.silent_s("recorder") == 0.0 and own.silent_s("gps_simulator") == -1.0
    for _ in range(3):  # one that was stopped meanwhile is found silent all the same
        now[0] += 1.0
        own.take(line("recorder: x", pid=9))
    assert own.silent_s("gps_simulator") == 2.0


def runner_with(tmp_path, rows: list[str]) -> GraphRunner:
    runner = GraphRunner(GRAPH, log_dir=tmp_path)
    runner.domain = 7
    for pid, node in enumerate(GRAPH.nodes, 7):
        process = NodeProcess(node.name, node.executable, [], {}, tmp_path / "log")
        process.process = SimpleNamespace(pid=pid, poll=lambda: None)
        runner.processes[node.name] = process
    for row in rows:
        runner.reports.take(row)
    return runner


def test_the_table_draws_rows_without_the_values_it_shows(tmp_path):
    rows = [line("gps_simulator: input a", 8), line("gps_simulator: input b", 8, 2, "[red]no[/blue]", rate_hz="often", count="many")]
    runner = runner_with(tmp_path, [*rows, line("truth_source: source", 7)])
    assert table(runner).row_count == 3
    assert runner.counts() == {} and runner._source_state("truth_source") == ""


def test_a_recording_that_fails_is_said_once_by_the_runner(tmp_path):
    runner = runner_with(tmp_path, [line("recorder: recording", 9, 2, "cannot write to out: No space left on device")])
    for _ in range(3):
        runner.watch()
    assert [str(event) for event in runner.events] == ["recorder fails: cannot write to out: No space left on device."]
    assert runner.events[0].is_trouble


class Process:
    """A process whose processor time the test sets."""

    def __init__(self, respawn: bool = True) -> None:
        self.name, self.alive, self.respawn, self.cpu, self.killed = "ins_gps", True, respawn, 1.0, 0
        self.process = SimpleNamespace(kill=self._kill)

    def _kill(self) -> None:
        self.killed += 1

    def cpu_seconds(self) -> float:
        return self.cpu

    def is_stopped(self) -> bool:
        return True


def test_a_hung_process_is_named_then_killed_and_one_that_works_is_given_longer():
    still, busy, dog = Process(), Process(), Watchdog(is_lossless=False)
    assert dog.look(still, 1.6) is None and dog.look(still, None) is None
    said = dog.look(still, 1.9)
    assert str(said) == "ins_gps does not answer: no report for 1.9 s (the process is stopped)." and said.is_trouble
    assert dog.look(still, 2.4) is None and not still.killed
    assert dog.look(still, 3.1).what is What.KILLED and still.killed == 1
    assert dog.look(still, 3.2) is None
    other = Watchdog(is_lossless=False)
    other.look(busy, 2.0)
    busy.cpu += 0.1
    assert other.look(busy, 14.0) is None and not busy.killed
    answer = other.look(busy, 0.1)
    assert str(answer) == "ins_gps answers again." and not answer.is_trouble
    other.look(busy, 2.0)
    busy.cpu += 0.1
    assert other.look(busy, 15.1).what is What.KILLED and busy.killed == 1
    stops, other = Process(), Watchdog(is_lossless=False)
    other.look(stops, 1.8)
    stops.cpu += 0.1
    assert other.look(stops, 2.0) is other.look(stops, 2.7) is None  # it was at work when it was named
    assert other.look(stops, 2.9).what is What.KILLED and stops.killed == 1


def test_what_must_not_start_again_is_not_killed_and_neither_is_anything_lossless():
    source, dog = Process(respawn=False), Watchdog(is_lossless=False)
    said = [str(event) for silent in (2.0, 4.0, 5.0, 60.0) if (event := dog.look(source, silent))]
    assert len(said) == 2 and "still no report for 4.0 s" in said[1] and not source.killed
    waiting, lossless = Process(), Watchdog(is_lossless=True)
    assert lossless.look(waiting, 15.0) is None
    assert lossless.look(waiting, 21.0).what is lossless.look(waiting, 22.0).what is What.SILENT and not waiting.killed


def test_log_folders_do_not_pile_up_and_recordings_stay(tmp_path, monkeypatch):
    monkeypatch.setattr(running, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(running, "mkdtemp", lambda prefix: running.Path(__import__("tempfile").mkdtemp(prefix=prefix, dir=tmp_path)))
    gone = subprocess.Popen([sys.executable, "-S", "-c", ""])
    gone.wait()
    for k in range(30):
        folder = running._new_log_folder("graph")
        (folder / "runner.pid").write_text(str(gone.pid))
        if k == 0:
            (folder / "recording").mkdir()
    left = list(tmp_path.iterdir())
    assert len(left) == running.KEPT_LOGS + 2 and sum((folder / "recording").exists() for folder in left) == 1


PARENT = """
import os, subprocess, sys, time
from lowcostnav_ros.graph.parent import RUNNER
child = subprocess.Popen([sys.executable, "-c", sys.argv[1]], env={**os.environ, RUNNER: str(os.getpid())}, start_new_session=True)
print(child.pid, flush=True)
time.sleep(60)
"""
CHILD = """
import signal, time
from lowcostnav_ros.graph import parent
parent.GRACE_S = 1.0
if {deaf}: signal.signal(signal.SIGINT, signal.SIG_IGN)
parent.end_with_runner()
time.sleep(60)
"""


@pytest.mark.parametrize("deaf", [False, True])
def test_a_node_ends_when_its_runner_is_killed(deaf):
    parent = subprocess.Popen([sys.executable, "-c", PARENT, CHILD.format(deaf=deaf)], stdout=subprocess.PIPE, text=True)
    child = int(parent.stdout.readline())
    time.sleep(0.3)
    assert Path(f"/proc/{child}").exists()
    os.kill(parent.pid, signal.SIGKILL)
    parent.communicate()
    deadline = time.monotonic() + 5.0
    while alive(child) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(child)


def alive(pid: int) -> bool:
    """Whether a process runs; one that nobody has waited for yet does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
