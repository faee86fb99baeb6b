"""Graph files: what they may say, what they are refused for, who must listen before the flight starts."""

from pathlib import Path

import pytest

from lowcostnav_ros.graph import wiring as graph_nodes
from lowcostnav_ros.graph.description import GraphError, graph_names, load_graph, parse_graph
from lowcostnav_ros.graph.domain import discovery, free_domain, node_environment
from lowcostnav_ros.graph.executables import EXECUTABLES


@pytest.mark.parametrize("name", ["livermore", "navigators_only", "sensors_only"])
def test_shipped_graphs_load(name):
    graph = load_graph(name)
    assert graph.name == name and name in graph_names()
    assert all(node.executable in EXECUTABLES for node in graph.nodes)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"nodes": []}, "give at least one node"),
        ({"nodes": ["ins_gsp"]}, "did you mean 'ins_gps'"),
        ({"nodes": ["ahrs", "ahrs"]}, "two nodes are called 'ahrs'"),
        ({"node": ["ahrs"]}, "did you mean 'nodes'"),
        ({"nodes": [{"executable": "ahrs", "respwan": True}]}, "did you mean 'respawn'"),
        ({"nodes": [{"executable": "ahrs", "config": "nowhere.yaml"}]}, "'nowhere.yaml' of ahrs"),
        ({"nodes": [{"executable": "ahrs", "parameters": [1]}]}, "names and values"),
        ({"nodes": ["ahrs"], "domain": 300}, "from 0 to 232"),
        ({"nodes": ["ahrs"], "real_time_factor": 0}, "from 0.01 to 1000"),
        ({"nodes": ["ahrs"], "lossless": "yes"}, "true or false"),
        ([], "expected names and values"),
    ],
)
def test_what_cannot_be_run_is_refused_with_what_to_do(content, sentence):
    with pytest.raises(GraphError, match=sentence):
        parse_graph(content, "test")


def test_a_missing_graph_is_refused_with_the_nearest():
    with pytest.raises(GraphError, match="did you mean 'livermore'"):
        load_graph("livermoore")


def test_a_scenario_sets_its_simulators_and_not_the_files_of_defaults():
    with_scenario = parse_graph({"scenario": "livermore", "nodes": ["gps_simulator", "ahrs"]}, "a")
    without = parse_graph({"nodes": ["gps_simulator"]}, "b")
    assert with_scenario.node("gps_simulator").config is None and with_scenario.node("ahrs").config.name == "ahrs.yaml"
    assert without.node("gps_simulator").config.name == "gps_simulator.yaml"
    assert graph_nodes.shared_parameters(with_scenario, with_scenario.node("gps_simulator"))["scenario"] == "livermore"


def test_sources_stay_dead_and_everything_else_is_started_again():
    graph = load_graph("livermore")
    assert [node.executable for node in graph.nodes if not node.respawn] == ["truth_source"]


def test_listeners_are_counted_topic_by_topic():
    graph = parse_graph(
        {"scenario": "livermore", "nodes": ["truth_source", "imu_simulator", "gps_simulator", "dme_simulator", "recorder"]}, "test"
    )
    expected = dict(entry.rsplit(":", 1) for entry in graph_nodes.expected_subscribers(graph))
    # two simulators and the recorder follow the state; the recorder leaves truth/imu out
    assert expected["truth/odometry"] == "3" and expected["truth/imu"] == "1" and expected["imu/data_raw"] == "1"
    assert not any(topic.startswith(("ins_gps/", "imu/data_fused", "diagnostics", "clock")) for topic in expected)


def test_flying_faster_than_the_clock_lengthens_the_lag_alike():
    graph = parse_graph({"nodes": ["truth_source", "ins_gps"], "real_time_factor": 4.0}, "test")
    node = graph.node("ins_gps")
    assert graph_nodes.shared_parameters(graph, node)["horizon.lag_s"] == pytest.approx(4.0 * graph_nodes.setting_of(node, "horizon.lag_s"))


def test_parameters_of_a_node_can_be_changed_and_nodes_left_out():
    graph = load_graph("livermore").with_parameters("recorder", path="/tmp/x", qos__lossless=True).without("dme_simulator")
    assert graph.node("recorder").parameters == {"path": "/tmp/x", "qos.lossless": True}
    with pytest.raises(GraphError, match="no node 'dme_simulator'"):
        graph.node("dme_simulator")


def test_a_held_domain_is_not_given_twice():
    with free_domain() as first, free_domain() as second:
        assert first != second and 1 <= first <= 100


def test_node_processes_stay_on_this_machine(monkeypatch, tmp_path):
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "1")
    environment = node_environment(7, tmp_path)
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST" and environment["ROS_DOMAIN_ID"] == "7"
    assert "ROS_LOCALHOST_ONLY" not in environment and environment["ROS_LOG_DIR"] == str(tmp_path)


@pytest.mark.parametrize("peers", ["ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"])
def test_who_names_other_machines_is_not_kept_to_this_one(monkeypatch, peers):
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    monkeypatch.setenv(peers, "192.168.1.7")
    assert discovery() == {}
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    assert discovery()["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


@pytest.mark.parametrize(("asked", "range_"), [("", "LOCALHOST"), ("off", "LOCALHOST"), ("SUBNET", "SUBNET")])
def test_nodes_are_discovered_as_the_environment_asks_and_receive_on_the_loopback_where_it_asks_nothing(monkeypatch, asked, range_):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", asked)
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE", raising=False)
    environment = node_environment(7)
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == range_
    profile = environment.get("FASTRTPS_DEFAULT_PROFILES_FILE")
    assert (profile is None) == (range_ == "SUBNET") and (profile is None or "127.0.0.1" in Path(profile).read_text())


@pytest.mark.parametrize("name", ["../x", "a/b", "", "1st", "monitor", "a" * 101, 7, "a.b", "a b"])
def test_a_node_name_that_ros_or_a_folder_would_not_take_is_refused(name):
    with pytest.raises(GraphError, match="the node name"):
        parse_graph({"nodes": [{"executable": "recorder", "name": name}]}, "bad")
