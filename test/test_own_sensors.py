"""Sensors as they come: on the user's own ROS domain, under foreign names, types and frame ids, turned and offset."""

import time

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, ImuBlock, MagneticField
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerCalibration
from lowcostnav_ros.graph.description import GraphError, load_graph, parse_graph
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.graph.wiring import flown_settings, shared_parameters
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.decode import Decoder, DecodeRules, Rejected, decode
from lowcostnav_ros.messages.frames import TO_FRD, FrameTree
from lowcostnav_ros.messages.inputs import Inputs, parse_inputs
from lowcostnav_ros.messages.parts import TYPES, header
from lowcostnav_ros.messages.store import STORE, to_cdr
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs
from lowcostnav_ros.navigators.inertial import at_base
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.earth import EARTH_RATE, STANDARD_GRAVITY, difference_n, displace
from lowcostnav_ros.physics.mounting import mounted, mounting_dcm
from lowcostnav_ros.physics.rotation import dcm_to_quat, euler_to_dcm, euler_to_quat, quat_apply_phi_n, quat_to_euler
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag

PLACE = (0.6578, -2.1262, 500.0)
STEP_NS = 10_000_000
TURN = (90.0, 0.0, 90.0)
"""Roll and yaw: gravity lies along another axis, and the nose is another one, too."""
VELOCITY = np.array([50.0, 0.0, 0.0])


def level_flight(k: int) -> tuple[np.ndarray, np.ndarray, tuple[float, float, float]]:
    """Specific force and rate as sensed by a unit mounted at TURN, and place, in the k-th step of a flight to the north."""
    rate = EARTH_RATE * np.array([np.cos(PLACE[0]), 0.0, -np.sin(PLACE[0])])
    C = mounting_dcm(TURN)
    return C.T @ np.array([0.0, 0.0, -STANDARD_GRAVITY]), C.T @ rate, displace(*PLACE, VELOCITY * 1e-9 * STEP_NS * k)


# names, types, frames ------------------------------------------------------------------------------------------------------------


def test_what_settings_say_of_inputs_is_read_and_refused():
    given = {"input.imu/data_raw.topic": "/mavros/imu/data_raw", "input.imu/data_raw.frames": "any", "input.gps2/fix.frames": ["rover"]}
    inputs = parse_inputs({**given, "input.frames": ["x"], "imu.profile": ""})
    assert inputs == Inputs({"imu/data_raw": "mavros/imu/data_raw"}, {"imu/data_raw": ("any",), "gps2/fix": ("rover",)})
    assert inputs.maps(["/mavros/imu/data_raw", "/gps/fix"]) == {"mavros/imu/data_raw": "imu/data_raw"}
    assert inputs.maps(["/mavros/imu/data_raw", "/imu/data_raw"]) == {}, "ours is there: it is that one"
    for name, value, sentence in (
        ("input.imu/dataraw.topic", "/x", "no source 'imu/dataraw' .did you mean 'imu/data_raw'"),
        ("input.imu/data_raw.topic", 7, "must name a topic"),
        ("input.imu/data_raw.frames", [1], "must list frame ids"),
    ):
        with pytest.raises(SettingsError, match=sentence):
            parse_inputs({name: value})


def test_a_velocity_without_covariance_is_taken_and_counted_as_such():
    twist = TYPES["geometry_msgs/msg/Twist"](*(TYPES["geometry_msgs/msg/Vector3"](x, 2.0, 3.0) for x in (1.0, 0.0)))
    raw = to_cdr(TYPES[topics.TWIST_ALONE](header(10**18, "gps"), twist))
    decoder = Decoder()
    velocity = decoder.decode("gps/vel", topics.TWIST_ALONE, raw)
    assert isinstance(velocity, GpsVelocity) and velocity.vel_n.tolist() == [2.0, 1.0, -3.0] and velocity.cov_n[0, 0] == 0.04
    assert decoder.notes == {"gps/vel: covariance unknown, default used": 1}
    assert decode("gps/vel", "geometry_msgs/msg/Vector3Stamped", raw).reason == "wrong message type"


def test_a_scalar_takes_any_frame_and_a_vector_only_those_it_is_told():
    pressure = TYPES[topics.FLUID_PRESSURE](header(10**18, "bay_3"), 95e3, 0.0)
    assert not isinstance(decode("air/static_pressure", topics.FLUID_PRESSURE, to_cdr(pressure)), Rejected)
    raw, rules = to_cdr(encode.imu_raw(10**18, np.array([0.0, 0.0, -9.8]), np.zeros(3), "imu")), DecodeRules()
    refused = decode("imu/data_raw", topics.IMU, raw, rules)
    assert (refused.reason, refused.detail) == ("wrong frame id", "'imu', expected base_link or imu_link")
    rules.allow({"imu/data_raw": ["imu"]})
    assert isinstance(decode("imu/data_raw", topics.IMU, raw, rules), ImuBlock)


def test_a_recording_is_read_by_the_names_it_carries_and_by_those_of_a_configuration(tmp_path):
    def write(path):
        with BagWriter(path) as bag:
            for k in range(5):
                stamp = 10**18 + STEP_NS * k
                raw = to_cdr(encode.imu_raw(stamp, np.array([0.0, 0.0, -9.8]), np.zeros(3), "imu"))
                bag.write("/mavros/imu/data_raw", topics.IMU, stamp, raw)

    text = "/**: {ros__parameters: {input: {imu/data_raw: {topic: /mavros/imu/data_raw, frames: [imu]}}}}\n"
    for folder, config in ((tmp_path / "carried" / "settings", None), (tmp_path / "config", tmp_path / "config")):
        path = tmp_path / "carried" if config is None else tmp_path / "bare"
        write(path)
        folder.mkdir()
        (folder / "ahrs.yaml").write_text(text)
        if config is None:
            with BagReader(path) as reader:
                assert sum(map(len, reader.measurements(["imu/data_raw"]))) == 5
        else:
            result = replay_bag(path, ReplayOptions(navigators=("ahrs",), config=config))
            assert result.recording.inputs["imu/data_raw"].rejected == {}


# mounting ------------------------------------------------------------------------------------------------------------------------


def test_a_mounting_turns_samples_the_same_way_however_they_are_cut():
    C, values = mounting_dcm(TURN), np.random.default_rng(2).normal(size=(1000, 3))
    assert np.array_equal(C @ C.T, np.eye(3)) and mounting_dcm((0.0, 0.0, 0.0)) is None
    np.testing.assert_allclose(mounting_dcm((*TURN, 10.0, 20.0, 30.0)), euler_to_dcm(*np.radians([10.0, 20.0, 30.0])) @ C, atol=1e-15)
    whole = mounted(C, values)
    np.testing.assert_allclose(whole, values @ C.T, rtol=1e-14)
    assert np.array_equal(whole, np.vstack([mounted(C, values[k : k + 1]) for k in range(len(values))]))
    field = MagnetometerCalibration(mounting_deg=list(TURN)).apply(values[0] * 1e-5)
    np.testing.assert_allclose(field, C @ values[0] * 1e-5, atol=1e-20)
    with pytest.raises(SettingsError, match=r"'imu.mounting_deg' needs three angles"):
        from_mapping(InsGps.Settings, {"imu.mounting_deg": [90.0]})


@pytest.mark.parametrize("kind", [InsGps, Ahrs])
def test_a_turned_unit_gives_the_attitude_of_the_aircraft(kind):
    settings = {"imu.mounting_deg": list(TURN), "magnetometer.mounting_deg": list(TURN)}
    navigator = kind(from_mapping(kind.Settings, settings))
    C, solutions = mounting_dcm(TURN), []
    for k in range(1, 800):
        force, rate, place = level_flight(k)
        stamp = 10**18 + STEP_NS * k
        solutions += navigator.feed(ImuBlock.of("imu/data_raw", np.array([stamp]), force[np.newaxis], rate[np.newaxis]))
        if k % 20 == 0:
            solutions += navigator.feed(GpsPosition(stamp, "gps/fix", *place, 4.0 * np.eye(3)))
            solutions += navigator.feed(GpsVelocity(stamp, "gps/vel", VELOCITY, 0.01 * np.eye(3)))
            field = C.T @ np.array([2.2e-5, 0.5e-5, 4.2e-5])
            solutions += navigator.feed(MagneticField(stamp, "imu/mag", field, 1e-14 * np.eye(3)))
    roll, pitch, heading = np.degrees(quat_to_euler(solutions[-1].q_nb))
    assert abs(roll) < 1.0 and abs(pitch) < 1.0 and abs((heading + 180.0) % 360.0 - 180.0) < 5.0


def transform(parent, child, C_frd, shift_flu):
    """A transform of ``/tf_static``: rotation (3, 3) from the child's to the parent's axes, forward right down; place of the child."""
    w, x, y, z = dcm_to_quat(TO_FRD @ C_frd @ TO_FRD).tolist()
    types = STORE.types
    turn = types["geometry_msgs/msg/Quaternion"](x, y, z, w)
    moved = types["geometry_msgs/msg/Transform"](types["geometry_msgs/msg/Vector3"](*shift_flu), turn)
    return types["geometry_msgs/msg/TransformStamped"](header(10**18, parent), child, moved)


def test_frames_are_walked_either_way_and_end_where_they_end():
    C, tree = mounting_dcm(TURN), FrameTree()
    tree.add([transform("base_link", "plate", C, (1.0, 2.0, 3.0)), transform("imu", "plate", C, (0.0, 0.0, 0.5))])
    stand = tree.stand("/imu")  # the plate is turned and the unit turned back on it
    assert stand.mounting_deg == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(stand.lever_m, [1.0, -2.0, -2.5], atol=1e-9)
    np.testing.assert_allclose(mounting_dcm(tree.stand("plate").mounting_deg), C, atol=1e-12)
    assert tree.stand("nowhere") is None and tree.stand("base_link").lever_m == (0.0, 0.0, 0.0)
    tree.add([transform("base_link", "bent", 2.0 * np.eye(3), (0.0, 0.0, 0.0)), transform("base_link", "lost", C, (np.nan, 0.0, 0.0))])
    assert tree.stand("lost") is None


def test_a_recording_s_tf_static_says_how_its_sensors_stand(tmp_path):
    tf = STORE.types["tf2_msgs/msg/TFMessage"]([transform("base_link", "imu", mounting_dcm(TURN), (0.5, 0.0, -0.2))])
    with BagWriter(tmp_path / "flight") as bag:
        bag.write("/tf_static", "tf2_msgs/msg/TFMessage", 10**18, to_cdr(tf))
        bag.write("/tf_static", "tf2_msgs/msg/TFMessage", 10**18, b"not a message")
        for k in range(1, 500):
            force, rate, place = level_flight(k)
            stamp = 10**18 + STEP_NS * k
            bag.write("/imu/data_raw", topics.IMU, stamp, to_cdr(encode.imu_raw(stamp, force, rate, "imu")))
            for item in (GpsPosition(stamp, "gps/fix", *place, 4.0 * np.eye(3)), GpsVelocity(stamp, "gps/vel", VELOCITY, 0.01 * np.eye(3))):
                for at, source, msgtype, raw in encode.encode_cdr(item) if k % 20 == 0 else ():
                    bag.write(source, msgtype, at, raw)
    result = replay_bag(tmp_path / "flight", ReplayOptions(navigators=("ins_gps",), out=tmp_path / "out"))
    notes = result.recording.assumed
    assert f"'imu.mounting_deg' is {list(TURN)} by /tf_static (frame 'imu')" in notes and "a message of /tf_static cannot be read" in notes
    assert "'imu.lever_arm_m' is [0.5, 0.0, 0.2] by /tf_static (frame 'imu')" in notes
    assert result.recording.inputs["imu/data_raw"].rejected == {}
    rows = (tmp_path / "out" / "ins_gps.csv").read_text().splitlines()
    last = dict(zip(rows[0].split(","), rows[-1].split(","), strict=True))
    assert abs(float(last["roll_deg"])) < 1.0 and abs(float(last["pitch_deg"])) < 1.0
    config = tmp_path / "config"
    config.mkdir()
    (config / "ins_gps.yaml").write_text("ins_gps: {ros__parameters: {imu: {mounting_deg: [0.0, 0.0, 90.0]}}}\n")
    notes = replay_bag(tmp_path / "flight", ReplayOptions(navigators=("ins_gps",), config=config)).recording.assumed
    assert f"'imu.mounting_deg' [0.0, 0.0, 90.0] counts, not {list(TURN)} of /tf_static" in notes


def test_an_offset_unit_states_place_and_velocity_of_the_aircraft_with_their_covariance():
    q, rate, arm = euler_to_quat(0.3, -0.2, 1.0), np.array([0.2, -0.1, 0.4]), np.array([3.0, -1.0, 0.5])
    nav, rng = np.array([*PLACE, 50.0, 10.0, -2.0, *q]), np.random.default_rng(5)
    A = rng.normal(size=(9, 9))
    base, P = at_base(nav, A @ A.T, rate, arm)
    C = euler_to_dcm(0.3, -0.2, 1.0)
    np.testing.assert_allclose(difference_n(*nav[:3], *base[:3]), C @ arm, atol=1e-6)
    np.testing.assert_allclose(nav[3:6] - base[3:6], C @ np.cross(rate, arm), atol=1e-12)
    J = np.zeros((9, 9))
    for k, d in enumerate(1e-3 * np.eye(9)):
        plus, minus = (moved(nav, sign * d, P, rate, arm) for sign in (1.0, -1.0))
        J[:, k] = (*difference_n(*plus[:3], *minus[:3]), *(plus[3:6] - minus[3:6]), *(2.0 * d[6:]))
    np.testing.assert_allclose(P, J @ A @ A.T @ J.T / 2e-3**2, atol=1e-3)


def moved(nav, d, P, rate, arm):
    """State of base_link where the state of the unit is off by a small error (9,)."""
    other = np.array([*displace(*nav[:3], d[:3]), *(nav[3:6] + d[3:6]), *quat_apply_phi_n(nav[6:10], d[6:9])])
    return at_base(other, P, rate, arm)[0]


def test_fixes_that_are_not_begun_with_are_no_fixes_that_do_not_come(monkeypatch):
    navigator = InsGps(InsGps.Settings())
    fix, velocity = GpsPosition(10**18, "gps/fix", *PLACE, np.eye(3)), GpsVelocity(10**18, "gps/vel", VELOCITY, np.eye(3))
    monkeypatch.setattr(navigator.trust, "excludes", lambda item: "position and velocity disagree" if item is fix else "")
    navigator._begin_with(fix)
    navigator._begin_with(velocity)
    assert navigator.reason.startswith("position and velocity disagree: gps/fix is not begun with; are fixes in degrees")
    assert navigator.reason.phrase == "position and velocity disagree"
    monkeypatch.undo()
    navigator._begin_with(fix)
    navigator._begin_with(velocity)
    assert navigator.reason == "waiting for inertial data"


# graphs --------------------------------------------------------------------------------------------------------------------------


def test_inputs_and_parameters_of_a_graph_reach_the_nodes_that_have_them():
    content = {
        "inputs": {"imu/data_raw": {"topic": "/imu", "frames": ["imu"]}},
        "parameters": {"imu.mounting_deg": [0.0, 0.0, 90.0], "magnetometer": {"mounting_deg": [0.0, 0.0, 90.0]}},
        "nodes": ["ins_gps", "dead_reckoning", "recorder"],
    }
    graph = parse_graph(content, "own")
    values = {node.name: shared_parameters(graph, node) for node in graph.nodes}
    assert all(v["input.imu/data_raw.topic"] == "/imu" for v in values.values())
    assert "imu.mounting_deg" in values["ins_gps"]
    assert not any("mounting" in name for name in (*values["dead_reckoning"], *values["recorder"]))
    flown = flown_settings(graph)["ins_gps"]
    assert flown["input.imu/data_raw.frames"] == ["imu"] and flown["imu.mounting_deg"] == [0.0, 0.0, 90.0]
    for wrong, sentence in (
        ({"inputs": {"imu/data_raw": {"topik": "/imu"}}}, "gives sources a topic or frames"),
        ({"inputs": {"imu/raw": {"topic": "/imu"}}}, "no source 'imu/raw'"),
        ({"parameters": {"imu.mounting": [0.0]}}, "no node has the parameter 'imu.mounting' .did you mean 'imu.mounting_deg'"),
    ):
        with pytest.raises((GraphError, SettingsError), match=sentence):
            graph = parse_graph({**content, **wrong}, "own")
            shared_parameters(graph, graph.nodes[0])


def test_a_graph_without_a_simulator_flies_on_the_users_domain_and_records(monkeypatch, tmp_path):
    graph = load_graph("navigators_only")
    assert not graph.has_source and "recorder" in [node.name for node in graph.nodes] and load_graph("livermore").has_source
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    for stated, domain, title in (("", 0, "domain 0, this machine"), ("72", 72, "domain 72, this machine")):
        monkeypatch.setenv("ROS_DOMAIN_ID", stated)
        runner = GraphRunner(graph, log_dir=tmp_path)
        environment = runner._environment()
        assert environment["ROS_DOMAIN_ID"] == str(domain) and title in runner.title
        assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    runner._environment()
    assert runner.title.endswith("domain 72, subnet")
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    with pytest.raises(GraphError, match="ROS_DOMAIN_ID is 'many'"):
        runner._environment()


def test_a_foreign_unit_named_imu_and_turned_by_90_degrees_flies_on_the_users_domain(ros, domain, monkeypatch, tmp_path):
    """Over Fast DDS: names and types of other drivers, GPS without covariance; and the recording replays to the bit."""
    from geometry_msgs.msg import TwistStamped
    from sensor_msgs.msg import Imu, NavSatFix

    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    content = {
        "inputs": {
            "imu/data_raw": {"topic": "/mavros/imu/data_raw", "frames": ["imu"]},
            "gps/fix": {"topic": "/fix"},
            "gps/vel": {"topic": "/vel"},
        },
        "parameters": {"imu.mounting_deg": list(TURN)},
        "nodes": ["ins_gps", "recorder"],
    }
    imu = ros.probe.create_publisher(Imu, "/mavros/imu/data_raw", 200)
    fix = ros.probe.create_publisher(NavSatFix, "/fix", 20)
    velocity = ros.probe.create_publisher(TwistStamped, "/vel", 20)
    with GraphRunner(parse_graph(content, "own"), out=tmp_path, log_dir=tmp_path / "logs") as runner:
        assert runner.domain == domain
        heard = ros.spin_until(lambda: all(p.get_subscription_count() == 2 for p in (imu, fix, velocity)), 60.0)
        assert heard, "both nodes hear all three, the velocity in its own type"
        assert ros.spin_until(lambda: ros.probe.count_subscribers("/ins_gps/odometry_fused") >= 1, 60.0), "the recorder hears the solution"
        k, began = 0, time.monotonic()
        while runner.navigator("ins_gps").get("values", {}).get("mode") != "gps" or k < 600:
            assert k < 3000, runner.rows
            k += 1
            force, rate, place = level_flight(k)
            message = encode.imu_raw(10**18 + STEP_NS * k, force, rate, "imu")
            imu.publish(to_cdr(message))
            if k % 20 == 0:
                fix.publish(to_cdr(encode_fix(10**18 + STEP_NS * k, place)))
                twist = TYPES["geometry_msgs/msg/Twist"](*(TYPES["geometry_msgs/msg/Vector3"](0.0, y, 0.0) for y in (50.0, 0.0)))
                velocity.publish(to_cdr(TYPES[topics.TWIST_ALONE](header(10**18 + STEP_NS * k, "gps"), twist)))
            runner.watch()
            while time.monotonic() - began < 0.004 * k:  # a quarter of the flight's time
                ros.spin_once()
    result = replay_bag(tmp_path / "recording", ReplayOptions(navigators=("ins_gps",)))
    fused = result.navigators["ins_gps"].fused
    assert fused.equals_recorded and fused.count_equal > 20
    with BagReader(tmp_path / "recording") as flown:
        solutions = flown.measurements(["ins_gps/origin", "ins_gps/odometry_fused"])
        attitudes = [solution.q_nb for solution in solutions if solution.source == "ins_gps/odometry_fused"]
    assert np.abs(np.degrees(quat_to_euler(attitudes[-1]))[:2]).max() < 1.0


def encode_fix(stamp_ns: int, place: tuple[float, float, float]):
    """A NavSatFix without covariance, in the frame that its driver calls gps."""
    from lowcostnav_ros.messages.parts import nav_sat_fix

    return nav_sat_fix(stamp_ns, *place, None, "gps")


def test_a_turned_unit_flies_live_by_tf_static(ros, monkeypatch, tmp_path):
    """Over Fast DDS, recorded, on the settings that the numbers give; what came before the frame was known is not lost."""
    import sys
    import types

    from diagnostic_msgs.msg import DiagnosticArray
    from sensor_msgs.msg import Imu, NavSatFix

    from lowcostnav_ros.nodes.recorder import Recorder
    from lowcostnav_ros.ros import static_frames
    from lowcostnav_ros.ros.navigator_node import navigator_node

    # raw bytes pass under any type that both sides agree on, so this stands in where the wheels lack the package
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", types.SimpleNamespace(TFMessage=DiagnosticArray))
    moved = STORE.types["tf2_msgs/msg/TFMessage"]([transform("base_link", "imu", mounting_dcm(TURN), (0.5, 0.0, -0.2))])
    latched = ros.probe.create_publisher(DiagnosticArray, "/tf_static", static_frames.QOS)
    latched.publish(to_cdr(moved))
    imu, fix = ros.probe.create_publisher(Imu, "/imu/data_raw", 200), ros.probe.create_publisher(NavSatFix, "/gps/fix", 20)
    recorder = ros.make(Recorder, path=str(tmp_path / "flight"))
    node = ros.make(lambda **kwargs: navigator_node("ins_gps", **kwargs))
    assert ros.spin_until(lambda: imu.get_subscription_count() == 2 == fix.get_subscription_count())
    given = InsGps(from_mapping(InsGps.Settings, {"imu.mounting_deg": list(TURN), "imu.lever_arm_m": [0.5, 0.0, 0.2]}))
    rules, sent_of = DecodeRules(everywhere=("any",)), {"imu/data_raw": 0, "gps/fix": 0}
    for k in range(1, 100):
        force, rate, place = level_flight(k)
        stamp, sent = 10**18 + STEP_NS * k, []
        if k % 20 == 1:
            sent.append(("gps/fix", topics.NAV_SAT_FIX, fix, to_cdr(encode_fix(stamp, place))))
        if k > 40:
            sent.append(("imu/data_raw", topics.IMU, imu, to_cdr(encode.imu_raw(stamp, force, rate, "imu"))))
        for source, msgtype, publisher, raw in sent:
            publisher.publish(raw)
            given.feed(decode(source, msgtype, raw, rules))
            sent_of[source] += 1
            assert ros.spin_until(lambda: all(node.inputs[s].count == n for s, n in sent_of.items())), node.inputs[source].rejected
    assert node.navigator.settings == given.settings and node.inputs["imu/data_raw"].rejected == {}
    status, expected = node.navigator.status(), given.status()
    assert (status.reason, [i.received for i in status.inputs]) == (expected.reason, [i.received for i in expected.inputs])
    ros.executor.remove_node(recorder)
    recorder.destroy_node()
    with BagReader(tmp_path / "flight") as reader:
        assert reader.types["tf_static"] == static_frames.TF_TYPE


def test_without_its_type_tf_static_is_named(ros):
    from diagnostic_msgs.msg import DiagnosticArray

    from lowcostnav_ros.ros import static_frames
    from lowcostnav_ros.ros.navigator_node import navigator_node

    if static_frames.tf_class() is not None:
        pytest.skip("tf2_msgs is installed: the topic is read")
    said = []
    node = ros.make(lambda **kwargs: navigator_node("ahrs", **kwargs))
    node.get_logger().warning = said.append
    ros.probe.create_publisher(DiagnosticArray, "/tf_static", static_frames.QOS)
    assert ros.spin_until(lambda: static_frames.UNREADABLE in said), said
    assert "imu.mounting_deg" in static_frames.UNREADABLE


def test_a_node_says_what_it_hears_instead_and_why_a_frame_is_refused(ros):
    """On /diagnostics and in its log; and a parameter that there is none of is answered with the nearest that there is."""
    from rclpy.parameter import Parameter
    from sensor_msgs.msg import Imu, NavSatFix

    from lowcostnav_ros.ros.node_base import NodeBase

    table, seen, said = ros.diagnostics(), [], []
    ros.probe.create_publisher(NavSatFix, "/fix", 5)
    imu = ros.probe.create_publisher(Imu, "/imu/data_raw", 5)
    node = ros.make(lambda **kwargs: NodeBase("listener", **kwargs))
    node.get_logger().warning = said.append
    node.listen("gps/fix", seen.append)
    node.listen("imu/data_raw", seen.append)
    assert ros.spin_until(lambda: imu.get_subscription_count() == 1)
    for k in range(1, 4):
        imu.publish(to_cdr(encode.imu_raw(STEP_NS * k, np.array([0.0, 0.0, -9.8]), np.zeros(3), "imu")))
    refused = "wrong frame id 'imu', expected base_link or imu_link"
    rows = {"imu/data_raw": refused, "gps/fix": "is not published; /fix may be it: input.gps/fix.topic: /fix"}
    for source, words in rows.items():
        name = f"listener: input {source}"
        assert ros.spin_until(lambda name=name, words=words: name in table and words in table[name].message), table.get(name)
    assert f"imu/data_raw: {refused}; accept it by input.imu/data_raw.frames: any, if its axes are right" in said and not seen
    answer = node.set_parameters_atomically([Parameter("input.silent_after", value=1.0)])
    assert not answer.successful and answer.reason.endswith("'input.silent_after' (did you mean 'input.silent_after_s'?)")
