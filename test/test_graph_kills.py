"""A flying graph, live: what is killed or stopped is named and comes back, and a killed recorder's recording can be read."""

import os
import signal
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from lowcostnav_ros.graph.description import parse_graph
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagError

TRUTH = {"executable": "truth_source", "parameters": {"kind": "dataset", "name": "LD", "duration_s": 300.0}}
FLYING = {"scenario": "ld", "nodes": [TRUTH, "imu_simulator", "gps_simulator", "ins_gps", "recorder"]}


def strike(runner: GraphRunner, name: str, number: int) -> str:
    """Send a signal to a node; return the event that names it, once it is back."""
    process = runner.processes.get(name, runner._monitor)
    first, restarts = len(runner.events), process.restarts
    os.kill(process.process.pid, number)
    assert runner.wait_for(lambda: any(event.node == name for event in runner.events[first:]), 10.0), "not named"
    back = runner.wait_for(lambda: process.restarts > restarts and process.alive and runner.unreported_s(name) is not None, 30.0)
    assert back, "not back"
    return str(next(event for event in runner.events[first:] if event.node == name))


def holds_inertial_data(path: Path) -> bool:
    """Whether a recording that is still being written can be read so far, and has samples of the IMU."""
    try:
        with BagReader(path) as growing:
            return growing.counts.get("imu/data_raw", 0) > 0
    except BagError:  # nothing on the disk yet
        return False


@pytest.mark.timeout(150)
def test_killed_and_stopped_nodes_come_back_and_a_killed_recording_is_readable(tmp_path):
    with GraphRunner(parse_graph(FLYING, "flying"), out=tmp_path, log_dir=tmp_path / "log") as runner:
        flying = runner.wait_for(lambda: runner.navigator("ins_gps").get("values", {}).get("mode") == "gps", 60.0)
        assert flying, runner.rows
        assert strike(runner, "ins_gps", signal.SIGKILL) == "ins_gps died: killed by SIGKILL; starting again at once."
        assert strike(runner, "monitor", signal.SIGKILL).startswith("monitor died: killed by SIGKILL")
        stopped = strike(runner, "imu_simulator", signal.SIGSTOP)
        named = "imu_simulator does not answer: no report for ", "imu_simulator gave no report for "  # killed at once when looked at late
        assert stopped.startswith(named) and "(the process is stopped)" in stopped
        strike(runner, "recorder", signal.SIGKILL)
        assert runner.wait_for(lambda: runner.navigator("ins_gps").get("values", {}).get("mode") == "gps", 30.0)
        assert runner.wait_for(lambda: holds_inertial_data(tmp_path / "recording_2"), 30.0), runner.rows
    with BagReader(tmp_path / "recording") as killed, BagReader(tmp_path / "recording_2") as closed:
        assert not killed.is_closed and closed.is_closed
        assert killed.counts["imu/data_raw"] > 100 and sum(1 for _ in killed.stream()) == sum(killed.counts.values())
        first = next(stamp_ns for _, stamp_ns, _ in closed.stream(["imu/data_raw"]))
        assert 0 < first - killed.end_ns < 20_000_000_000  # the start of a process, and the last second
