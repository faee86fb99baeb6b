"""A small graph, live: nothing lost, a killed node comes back, the end is clean."""

import os
import signal
import sys
import time

import pytest

pytest.importorskip("rclpy")

from lowcostnav_ros.graph.description import GraphError, parse_graph
from lowcostnav_ros.graph.process import Event, NodeProcess, What, describe_exit
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.graph.wiring import with_page
from lowcostnav_ros.messages.bag import BagReader

TRUTH = {"executable": "truth_source", "parameters": {"kind": "dataset", "name": "LD", "duration_s": 4.0}}
SMALL = {"scenario": "ld", "lossless": True, "real_time_factor": 2.0, "nodes": [TRUTH, "imu_simulator", "gps_simulator", "recorder"]}


def alive(pid: int) -> bool:
    return os.path.exists(f"/proc/{pid}") and "Z" not in open(f"/proc/{pid}/stat").read().rpartition(")")[2].split()[0]


def test_a_flight_is_recorded_whole_while_a_page_watches_and_nothing_is_left_behind(tmp_path):
    graph = with_page(parse_graph(SMALL, "small"), "127.0.0.1:0")
    with GraphRunner(graph, out=tmp_path, log_dir=tmp_path / "log") as runner:
        assert runner.wait_until_finished(90.0), runner.rows
        assert runner.page.startswith("http://127.0.0.1:")
        pids = [process.process.pid for process in runner.processes.values()]
        counts = runner.counts()
    assert runner.events == [] and not any(alive(pid) for pid in pids)
    assert [process.exit_code for process in runner.processes.values()] == [0] * len(pids)
    assert counts["truth/imu"] == {"sent": 400, "imu_simulator": 400}
    for topic in ("imu/data_raw", "gps/fix", "gps/vel"):
        assert counts[topic]["sent"] == counts[topic]["recorder"] > 0
    with BagReader(tmp_path / "recording") as bag:
        assert bag.counts["imu/data_raw"] == counts["imu/data_raw"]["sent"]
        assert bag.duration_s == pytest.approx(4.0, abs=0.3)
    with pytest.raises(GraphError, match="exists already"), GraphRunner(parse_graph(SMALL, "small"), out=tmp_path):
        pass


def test_a_killed_node_is_named_started_again_and_heard_again(tmp_path):
    graph = parse_graph({"nodes": ["gps_simulator"]}, "one")
    with GraphRunner(graph, log_dir=tmp_path) as runner:
        assert runner.wait_for(lambda: "gps_simulator: input truth/odometry" in runner.rows, 15.0)
        process = runner.processes["gps_simulator"]
        os.kill(process.process.pid, signal.SIGKILL)
        assert runner.wait_for(lambda: process.restarts == 1 and process.alive, 10.0)
        restarted = time.monotonic()
        assert runner.wait_for(lambda: (runner.unreported_s("gps_simulator") or 99.0) < time.monotonic() - restarted, 15.0)
    assert [str(event) for event in runner.events[:2]] == [
        "gps_simulator died: killed by SIGKILL; starting again at once.",
        "gps_simulator started again (restart 1).",
    ]


def test_a_node_that_cannot_run_is_not_started_again_and_its_sentence_is_passed_on(tmp_path):
    graph = parse_graph({"nodes": [{"executable": "gps_simulator", "parameters": {"rate_hz": 900.0}}]}, "bad")
    with GraphRunner(graph, log_dir=tmp_path) as runner, pytest.raises(GraphError, match="gps_simulator cannot run: .*at most 50 Hz"):
        runner.wait_for(lambda: False, 15.0)
    assert runner.processes["gps_simulator"].restarts == 0


def test_back_off_doubles_and_the_exit_status_is_told(tmp_path, monkeypatch):
    process = NodeProcess("x", "monitor", [], dict(os.environ), tmp_path / "x.log")
    process._command = [sys.executable, "-S", "-c", "import sys; sys.exit('engine on fire')"]
    now = [1000.0]
    monkeypatch.setattr("lowcostnav_ros.graph.process.time.monotonic", lambda: now[0])
    process.start()
    said = []
    for wait_s in (0.0, 0.5, 1.0):
        process.process.wait(10.0)
        said.append(str(process.watch()))
        now[0] += wait_s
        assert str(process.watch()) == f"x started again (restart {len(said)})."
    assert said[0] == "x died: exit code 1 (engine on fire); starting again at once."
    assert said[2].endswith("starting again in 1.0 s.")
    process.process.wait(10.0)
    assert describe_exit(-9) == "killed by SIGKILL"


def test_events_are_sentences_only_as_text():
    died = Event("ahrs", What.DIED, "exit code 1", 0.5)
    assert str(died) == "ahrs died: exit code 1; starting again in 0.5 s." and died.is_trouble
    again = Event("ahrs", What.STARTED_AGAIN, restarts=1)
    assert str(again) == "ahrs started again (restart 1)." and not again.is_trouble
    assert str(Event("ahrs", What.KILLED, "did not end within 5 s")) == "ahrs did not end within 5 s and was killed."


def test_a_page_that_no_longer_can_run_ends_no_flight(tmp_path):
    class Gone(NodeProcess):
        def watch(self):
            return None

    runner = GraphRunner(with_page(parse_graph({"nodes": ["gps_simulator"]}, "one")), log_dir=tmp_path)
    page = runner.processes["page"] = Gone("page", "page", [], {}, tmp_path / "page.log")
    page.given_up, page.exit_code, page.restarts = True, 2, 1
    assert runner.watch() == []
    page.restarts = 0  # at the start it is a setting that can be put right
    with pytest.raises(GraphError, match="page cannot run"):
        runner.watch()
