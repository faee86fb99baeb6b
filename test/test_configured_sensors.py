"""Sensors chosen by configuration: their settings, topics and frames reach nodes, graphs, recordings and replays alike."""

from dataclasses import replace

import pytest
from test_any_aid import SCENARIO

from lowcostnav_ros.base.measurements import Pressure
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.graph import wiring
from lowcostnav_ros.graph.description import parse_graph
from lowcostnav_ros.graph.process import write_parameters
from lowcostnav_ros.messages.bag_writer import SETTINGS_FOLDER, BagWriter
from lowcostnav_ros.messages.encode import encode, encode_cdr
from lowcostnav_ros.messages.rules import DecodeRules, parse_further
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

AIDS = ["gps", "baro", "baro2", "dme"]
CABIN = {"aids": AIDS, "baro2.topics": ["cabin/pressure"], "baro2.frames": ["cabin"]}


def graph(**parameters):
    nodes = ["truth_source", {"executable": "ins_gps", "parameters": {**CABIN, **parameters}}, "recorder"]
    return parse_graph({"scenario": "livermore", "nodes": nodes}, "test")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Forty seconds with a barometer in the cabin, whose messages have a frame id of their own."""
    folder = tmp_path_factory.mktemp("cabin") / "bag"
    measurements = Simulation(scenario_from_text(SCENARIO.replace("duration_s: 130.0", "duration_s: 40.0"))).whole()[1]
    records = [record for m in measurements for record in encode_cdr(m)]
    for m in measurements:
        if isinstance(m, Pressure) and m.source == "air/static_pressure":
            message = encode(replace(m, pressure_pa=m.pressure_pa - 430.0))
            message.header.frame_id = "cabin"
            records.append((m.stamp_ns, "cabin/pressure", "sensor_msgs/msg/FluidPressure", to_cdr(message)))
    with BagWriter(folder) as writer:
        for stamp_ns, topic, msgtype, cdr in sorted(records, key=lambda record: record[0]):
            writer.write(topic, msgtype, stamp_ns, cdr)
    (folder / SETTINGS_FOLDER).mkdir()
    write_parameters(folder / SETTINGS_FOLDER / "ins_gps.yaml", wiring.flown_settings(graph())["ins_gps"])
    return folder


def test_settings_flown_in_a_graph_replay_with_their_list_of_sensors(bag):
    result = replay_bag(bag, ReplayOptions(navigators=("ins_gps",)))
    assert result.settings["ins_gps"]["aids"] == AIDS and result.settings["ins_gps"]["baro2.topics"] == ["cabin/pressure"]
    assert result.recording.inputs["cabin/pressure"].rejected == {} and result.recording.inputs["cabin/pressure"].count > 100
    fused = {name: aid.used for name, aid in result.navigators["ins_gps"].aids.items()}
    assert fused["baro2_height"] == fused["baro_height"] > 50


def test_the_observability_of_a_further_sensor_can_be_studied(bag):
    from lowcostnav_ros.cli.observability import watch_bag

    navigator, found, _ = watch_bag(bag, "ins_gps", None, 5.0)
    assert found and navigator.aid("baro2_height").status.fused > 50


def test_listeners_and_recorder_of_a_graph_know_the_further_topics():
    flown = graph(**{"aids": [*AIDS, "gps2"]})
    expected = wiring.expected_subscribers(flown)
    assert {"gps2/fix:2", "gps2/vel:2", "cabin/pressure:2", "gps/fix:2"} <= set(expected)
    further = wiring.shared_parameters(flown, flown.node("recorder"))["further"]
    assert {"cabin/pressure:air/static_pressure", "gps2/fix:gps/fix"} <= set(further)
    assert "further" not in wiring.shared_parameters(parse_graph({"nodes": ["ins_gps", "recorder"]}, "b"), flown.node("recorder"))


def test_two_navigators_cannot_take_one_topic_for_different_things():
    class Other:
        kinds, frames = {"cabin/pressure": "air/temperature"}, {}

    rules = DecodeRules()
    rules.accept(InsGps(from_mapping(InsGps.Settings, {**CABIN, "aids": ["gps", "baro2"]})))
    assert not rules.kind_of("cabin/pressure").frames and rules.frames["cabin/pressure"] == {"cabin"}, "a scalar takes any frame"
    with pytest.raises(SettingsError, match="'cabin/pressure' is configured as air/static_pressure and as air/temperature"):
        rules.accept(Other())


def test_a_further_topic_must_be_like_one_of_the_package():
    with pytest.raises(SettingsError, match="must read 'topic:known topic'"):
        parse_further(["cabin/pressure"])


def test_the_parameter_file_of_a_list(capsys):
    assert cli.main(["parameters", "ins_gps", "--aids", *AIDS]) == 0
    text = capsys.readouterr().out
    assert "    baro2:\n" in text and "aids: [gps, baro, baro2, dme]" in text and "    mag:\n" not in text
    assert cli.main(["parameters", "recorder", "--aids", "gps"]) == 2


def test_a_node_declares_the_groups_of_its_list(ros, tmp_path):
    from sensor_msgs.msg import FluidPressure

    from lowcostnav_ros.graph.executables import parameter_file
    from lowcostnav_ros.ros.navigator_node import navigator_node

    file = tmp_path / "ins_gps.yaml"
    file.write_text(parameter_file("ins_gps"))  # holds groups of sensors that the list omits
    arguments = ["--ros-args", "--params-file", str(file), "-p", "aids:=[gps,baro,baro2]", "-p", "baro2.topics:=[cabin/pressure]"]
    node = ros.make(lambda **kwargs: navigator_node("ins_gps", cli_args=arguments, **kwargs), baro2__frames=["cabin"], baro2__sigma_m=7.0)
    assert node.get_parameter("baro2.sigma_m").value == 7.0 and not node.has_parameter("mag.enabled")
    assert node.navigator.aid("baro2_height").settings.sigma_m == 7.0
    publisher = ros.probe.create_publisher(FluidPressure, "cabin/pressure", 10)
    assert ros.spin_until(lambda: publisher.get_subscription_count() == 1)
    message = FluidPressure(fluid_pressure=90000.0, variance=25.0)
    message.header.stamp.sec, message.header.frame_id = 5, "cabin"
    publisher.publish(message)
    assert ros.spin_until(lambda: node.navigator.input_status["cabin/pressure"].received == 1)


def test_a_node_refuses_a_group_that_its_list_does_not_name(ros):
    from lowcostnav_ros.ros.navigator_node import navigator_node

    with pytest.raises(SettingsError, match="unknown parameter 'baro2.sigma_m'"):
        ros.make(lambda **kwargs: navigator_node("ins_gps", **kwargs), baro2__sigma_m=7.0)


def test_the_recorder_records_a_further_topic(ros, tmp_path):
    from sensor_msgs.msg import FluidPressure

    from lowcostnav_ros.messages.bag import BagReader
    from lowcostnav_ros.nodes.recorder import Recorder

    further = ["cabin/pressure:air/static_pressure"]
    node = ros.make(Recorder, path=str(tmp_path / "bag"), further=further)
    publisher = ros.probe.create_publisher(FluidPressure, "cabin/pressure", 10)
    assert ros.spin_until(lambda: publisher.get_subscription_count() == 1)
    message = FluidPressure(fluid_pressure=90000.0)
    message.header.stamp.sec = 5
    publisher.publish(message)
    assert ros.spin_until(lambda: node.inputs["cabin/pressure"].count == 1)
    ros.executor.remove_node(node)
    node.destroy_node()
    with BagReader(tmp_path / "bag") as reader:
        recorded = {source: kind for source, kind in reader.types.items() if source != "diagnostics"}  # its own, after a slow start
        assert recorded == {"cabin/pressure": "sensor_msgs/msg/FluidPressure"}


def test_a_source_that_an_adapter_reads_keeps_its_own_kind():
    from lowcostnav_ros.navigators.ins_gnss import InsGnss

    navigator = InsGnss(from_mapping(InsGnss.Settings, {"coupling": "loose", "loose_source": "gnss_only"}))
    rules = DecodeRules()
    rules.accept(navigator)
    assert "gnss_only/odometry_fused" in navigator.inputs and "gnss_only/odometry_fused" not in navigator.kinds
    assert rules.kind_of("gnss_only/odometry_fused").msgtype == "nav_msgs/msg/Odometry"
