"""What a navigator says live and what the same measurements from the recording give are the same bytes."""

import pytest

pytest.importorskip("rclpy")

from lowcostnav_ros.graph.description import load_graph, parse_graph
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.graph.wiring import navigator_of
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.encode import odometry_from_solution
from lowcostnav_ros.messages.store import to_cdr

TRUTH = {"executable": "truth_source", "parameters": {"kind": "segments", "name": "straight", "duration_s": 8.0}}
SENSORS = ["imu_simulator", "magnetometer_simulator", "air_data_simulator", "gps_simulator", "vor_simulator"]
AIDS = ["gps", "baro", "magnetic", "airdata", "wheels", "vor", "dme"]  # as the shipped graphs
RADIO = {"aids": AIDS, "vor.enabled": True, "dme.stations_file": "dme_stations_bay_area.csv"}
INS = {"executable": "ins_gps", "parameters": {"horizon.lag_s": 2.0, **RADIO}}
GRAPH = {"scenario": "livermore", "lossless": True, "nodes": [TRUTH, *SENSORS, "dme_simulator", INS, "recorder"]}


LIVERMORE = parse_graph(GRAPH, "live")
RANGE = load_graph("pseudolite_range").with_parameters("truth_source", duration_s=8.0)
CARRIED = {"executable": "mems_ins", "parameters": {"horizon.lag_s": 3.0}}
AHRS = {"executable": "ahrs", "parameters": {"horizon.lag_s": 2.0}}
MEMS = parse_graph({**GRAPH, "nodes": [TRUTH, *SENSORS[:2], SENSORS[3], AHRS, CARRIED, "recorder"]}, "mems")
MEMS = MEMS.with_parameters("truth_source", duration_s=16.0)
CANYON = load_graph("gnss_canyon").with_parameters("truth_source", duration_s=16.0)


@pytest.mark.parametrize(
    ("graph", "navigators"),
    [(LIVERMORE, ["ins_gps"]), (CANYON, ["gnss_only", "ins_gnss"]), (RANGE, ["pseudolite_ins"]), (MEMS, ["mems_ins"])],
    ids=["gps", "gnss", "pseudolite", "mems"],
)
def test_the_fused_solution_is_the_same_to_the_last_bit(tmp_path, graph, navigators):
    with GraphRunner(graph, out=tmp_path, log_dir=tmp_path / "log") as runner:
        assert runner.wait_until_finished(90.0)
    counts = runner.counts()  # after the end: every node says its last counts as it goes
    assert runner.events == []
    for name in navigators:
        navigator = navigator_of(graph.node(name))
        with BagReader(tmp_path / "recording") as bag:
            for source in set(navigator.inputs) & set(bag.types):
                heard = {"sent": counts[source]["sent"], "heard": counts[source][name], "recorded": bag.counts[source]}
                assert len(set(heard.values())) == 1, (source, heard)
            replayed = navigator.feed_all(bag.measurements([s for s in navigator.inputs if s in bag.types]))
            live = [bytes(raw) for _, _, raw in bag.stream([f"{name}/odometry_fused"])]
        assert len(live) > 30
        assert [to_cdr(odometry_from_solution(solution, navigator.origin)) for solution in replayed] == live
        if "vor/bearing" in counts:
            assert counts["vor/bearing"][name] == 16  # two receivers, eight seconds
            assert counts["dme/range"]["ins_gps"] == navigator.aid("dme").status.fused >= 1
            assert navigator.aid("vor").status.fused >= 2 and navigator.aid("vor").used_lately(navigator.core.t_ns) == ["OAK", "SJC"]
