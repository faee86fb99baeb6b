"""`lowcostnav up` without a terminal: exit statuses, and one interrupt ends it in order."""

import os
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy")

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.graph.description import parse_graph
from lowcostnav_ros.graph.up import up

UP = (
    "import sys; from lowcostnav_ros.graph.description import load_graph; "
    "from lowcostnav_ros.graph.up import up; sys.exit(up(load_graph(sys.argv[1])))"
)


def test_a_graph_that_cannot_run_exits_with_2_and_its_sentence(capsys):
    graph = parse_graph({"nodes": [{"executable": "gps_simulator", "parameters": {"rate_hz": 900.0}}]}, "bad")
    assert up(graph, show=False) == Exit.CANNOT_RUN
    assert "gps_simulator cannot run: gps_simulator: 'rate_hz' must be at least 0.1 and at most 50 Hz, got 900." in capsys.readouterr().err


@pytest.mark.parametrize(
    ("kill_first", "ending", "status"),
    [(False, signal.SIGINT, 0), (True, signal.SIGINT, 1), (False, signal.SIGHUP, 0), (False, signal.SIGKILL, -signal.SIGKILL)],
)
def test_however_the_runner_ends_no_node_stays_and_a_death_on_the_way_is_told(tmp_path, kill_first, ending, status):
    file = tmp_path / "one.yaml"
    file.write_text(yaml.safe_dump({"nodes": ["gps_simulator"]}))
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    process = subprocess.Popen([sys.executable, "-c", UP, str(file)], env=environment, stderr=subprocess.PIPE, text=True)
    children = wait_for_children(process.pid, 2)
    if kill_first:
        os.kill(children["gps_simulator"], signal.SIGKILL)
        time.sleep(0.3)
    time.sleep(2.0)  # children past their start, where an interrupt would be taken for an early one
    process.send_signal(ending)
    _, errors = process.communicate(timeout=15.0)
    deadline = time.monotonic() + (8.0 if ending == signal.SIGKILL else 0.0)
    while time.monotonic() < deadline and any(Path(f"/proc/{pid}").exists() for pid in children.values()):
        time.sleep(0.1)
    assert process.returncode == status, errors
    assert ("gps_simulator died: killed by SIGKILL" in errors) == kill_first
    assert not any(Path(f"/proc/{pid}").exists() for pid in children.values())


def wait_for_children(pid: int, count: int) -> dict[str, int]:
    """Return node name to process id once ``count`` node processes run under ``pid``."""
    deadline = time.monotonic() + 15.0
    while time.monotonic() < deadline:
        found = {}
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
            found |= {name.decode(): int(child) for w, name in pairwise(words) if w == b"lowcostnav_ros.nodes.dispatch"}
        if len(found) >= count:
            return found
        time.sleep(0.05)
    raise AssertionError("the nodes did not start")
