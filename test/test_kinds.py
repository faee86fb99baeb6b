"""Kinds of messages: each is described whole, a new one takes one file, a second instance or a foreign name takes no code at all."""

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from lowcostnav_ros.base import measurements as m
from lowcostnav_ros.base.registry import RegistryError
from lowcostnav_ros.convert.convert import convert
from lowcostnav_ros.convert.profile import profile_from
from lowcostnav_ros.convert.units_by_name import UNITS
from lowcostnav_ros.estimation.horizon import FusionHorizon
from lowcostnav_ros.graph.wiring import recorded_topics
from lowcostnav_ros.messages import checks, parts, topics
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.decode import Decoder, DecodeRules, Rejected, decode
from lowcostnav_ros.messages.encode import encode, encode_cdr, encode_rows
from lowcostnav_ros.messages.kind import NAVIGATOR_TOPICS, TOPICS, Quantity, TopicSpec, describe
from lowcostnav_ros.messages.rules import ANY
from lowcostnav_ros.messages.samples import Instant, TableRow
from lowcostnav_ros.messages.store import STORE, register_type, to_cdr
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.ros.warm_up import straight_flight

STAMP = 1_700_000_000_123_456_789
FIX = m.GpsPosition(STAMP, "gps/fix", 0.65, -2.1, 500.0, np.eye(3))


@pytest.mark.parametrize("name", TOPICS)
def test_every_kind_has_all_its_parts(name):
    kind = TOPICS[name]
    assert kind.name == name and kind.description and kind.msgtype in STORE.types
    if name in ("clock", "diagnostics"):
        assert kind.decode is None and decode(name, kind.msgtype, b"").reason == "unknown topic"
        return
    assert issubclass(kind.measurement, m.Measurement) and kind.decode and kind.sample
    assert bool(kind.fields) == (kind.from_row is not None) and set(kind.options) <= {"mounting_deg", "station"}
    assert {quantity.dimension for quantity in kind.fields.values()} <= set(UNITS)
    if kind.sensed:
        assert kind.encode and kind.unit and kind.recorded
        assert kind.variances or name == "imu/data_raw" or kind.msgtype == topics.POINT_CLOUD, "no default could stand in for these"
        assert kind.frame in kind.frames or not kind.frames or kind.options == ("station",), "the frame it is published in is accepted"


@pytest.mark.parametrize("name", [*TOPICS, *(f"x/{part}" for part in NAVIGATOR_TOPICS)])
def test_the_sample_of_a_kind_survives_its_message(name):
    kind = topics.spec(name)
    if kind.sample is None or kind.encode is None:
        pytest.skip("not encoded by itself")
    sample = kind.sample(Instant(3, name))
    assert (type(sample), sample.source) == (kind.measurement, name)
    (*_, (stamp_ns, topic, msgtype, raw)) = encode_cdr(sample)
    back = decode(topic, msgtype, raw)
    assert (type(back), back.stamp_ns, back.source, stamp_ns) == (type(sample), sample.stamp_ns, name, sample.stamp_ns)


@pytest.mark.parametrize("name", [name for name, kind in TOPICS.items() if kind.numbers])
def test_rows_of_a_table_become_in_columns_the_messages_that_each_becomes(name):
    kind, rng = topics.spec(name), np.random.default_rng(3)
    values = {field: rng.normal(1e5 if name.startswith("air/static") else 1.0, 0.3, (5, q.size)) for field, q in kind.fields.items()}
    values = {field: column[:, 0] if column.shape[1] == 1 else column for field, column in values.items() if field != "euler"}
    rows = TableRow((STAMP + 10**9 * np.arange(5) + 7, name), values)
    records = encode_rows(rows)
    assert [r[:3] for r in records] == [(int(t), name, kind.msgtype) for t in rows.head[0]]
    one_by_one = [kind.from_row(rows.row(k)) for k in range(5)]
    messages = [encode(one) if isinstance(one, m.Measurement) else one for one in one_by_one]
    assert [r[3] for r in records] == [to_cdr(message) for message in messages]


@dataclass(frozen=True, slots=True, eq=False)
class Turns(m.Measurement):
    """Revolutions of a wheel."""

    wheel: str
    turns: float
    variance: float

    part = property(lambda self: self.wheel)


Message = register_type("toy_msgs/msg/Turns", "std_msgs/Header header\nfloat64 turns\nfloat64 variance")


def _decode(message, received: checks.Received) -> Turns:
    wheel = checks.station(message.header)
    checks.finite((message.turns,), "turns")
    if message.turns < 0.0:
        raise checks.Refusal("turns are negative", f"{message.turns:g}")
    return Turns(*received.head, wheel, message.turns, received.variance(message.variance, "turns"))


@pytest.fixture
def toy():
    """A kind that a plugin would define: a topic, a measurement and a message type that nobody knows."""
    describe(
        __name__,
        TopicSpec("wheel/turns", "toy_msgs/msg/Turns", "Revolutions; frame_id is the wheel.", "", "1"),
        measurement=Turns,
        decode=_decode,
        encode=lambda sent: Message(parts.header(sent.stamp_ns, sent.wheel), sent.turns, sent.variance),
        variances=(0.01,),
        fields={"turns": Quantity(1, "number"), "sigma": Quantity(1, "number")},
        options=("station",),
        from_row=lambda row: Turns(*row.head, row.station, float(row["turns"]), row.variance()),
        sample=lambda at: Turns(*at.head, "LEFT", 10.0 * at.since_s, 0.01),
        sensed=True,
    )
    yield TOPICS["wheel/turns"]
    del TOPICS._things["wheel/turns"]


def test_a_toy_kind_decodes_and_encodes(toy):
    sent = Turns(STAMP, "wheel/turns", "LEFT", 12.5, 0.04)
    ((_, topic, msgtype, raw),) = encode_cdr(sent)
    assert (topic, msgtype) == ("wheel/turns", "toy_msgs/msg/Turns")
    decoder = Decoder()
    back = decoder.decode(topic, msgtype, raw)
    assert (back.stamp_ns, back.source, back.wheel, back.turns, back.variance) == (STAMP, topic, "LEFT", 12.5, 0.04)
    assert decoder.decode(topic, msgtype, to_cdr(encode(replace(sent, variance=0.0)))).variance == 0.01
    assert decoder.notes == {"wheel/turns: covariance unknown, default used": 1}
    assert decoder.decode(topic, msgtype, to_cdr(encode(replace(sent, turns=-1.0)))).reason == "turns are negative"
    assert decoder.decode(topic, msgtype, raw[:9]).reason == "malformed message"
    assert decoder.decode(topic, topics.IMU, raw).reason == "wrong message type"
    assert type(encode(replace(sent, source="somewhere/else"))) is Message


def test_a_toy_kind_is_recorded_played_warmed_up_and_documented(toy, tmp_path):
    assert "wheel/turns" in recorded_topics()
    with BagWriter(tmp_path / "bag") as bag:
        for k, wheel in enumerate(("LEFT", "RIGHT")):
            for stamp_ns, topic, msgtype, raw in encode_cdr(Turns(STAMP + k, "wheel/turns", wheel, 1.0 + k, 0.01)):
                bag.write(topic, msgtype, stamp_ns, raw)
    with BagReader(tmp_path / "bag") as bag:
        assert bag.decodable() == ["wheel/turns"]
        assert [(x.wheel, x.turns) for x in bag.measurements()] == [("LEFT", 1.0), ("RIGHT", 2.0)]
    flight = list(straight_flight(["wheel/turns", "imu/data_raw", "nothing/known"]))
    assert {type(x) for x in flight} == {Turns, m.ImuBlock} and len(flight) == 300
    assert [x.stamp_ns for x in flight[:2]] == [flight[0].stamp_ns] * 2
    sys.path.insert(0, "docs")
    try:
        import make_interfaces
    finally:
        sys.path.pop(0)
    assert "| `wheel/turns` | toy_msgs/Turns | - | 1 | Revolutions; frame_id is the wheel. |" in list(make_interfaces.topic_rows())


def test_the_player_plays_what_sensors_publish(toy):
    pytest.importorskip("rclpy")
    from lowcostnav_ros.nodes.player import Player

    names = ("wheel/turns", "gps2/fix", "truth/odometry", "imu/data", "nav/fix")
    bag = SimpleNamespace(types={name: topics.spec(name).msgtype for name in names})
    assert Player._sensors(SimpleNamespace(_bag=bag, decoder=Decoder())) == ["wheel/turns", "gps2/fix"]


def test_a_table_becomes_a_toy_kind(toy, tmp_path):
    (tmp_path / "log.csv").write_text("t,n\n1700000000,1.5\n1700000001,2.5\n")
    fields = {"turns": {"column": "n"}, "sigma": {"constant": 0.1}, "station": "LEFT"}
    table = {"file": "log.csv", "time": {"column": "t"}, "topics": {"wheel/turns": fields, "wheel2/turns": fields | {"station": "TAIL"}}}
    convert(tmp_path, profile_from({"tables": [table]}), tmp_path / "bag")
    with BagReader(tmp_path / "bag") as bag:
        rows = [(x.source, x.wheel, x.turns, x.variance) for x in bag.measurements()]
    assert sorted(rows) == [(f"wheel{n}/turns", w, t, pytest.approx(0.01)) for n, w in (("", "LEFT"), ("2", "TAIL")) for t in (1.5, 2.5)]


def test_one_stamp_may_hold_several_parts_of_one_source(toy):
    horizon = FusionHorizon(0)
    for wheel, verdict in (("LEFT", ""), ("RIGHT", ""), ("LEFT", "duplicate stamp")):
        assert horizon.push(Turns(STAMP, "wheel/turns", wheel, 1.0, 0.01)) == verdict
    assert m.SlantRange(STAMP, "dme/range", "OAK", 1.0, 1.0).part == "OAK" and FIX.part == ""


def test_further_instances_are_recognised_by_the_number_in_their_first_word():
    for name, like in (("gps2/fix", "gps/fix"), ("air2/static_pressure", "air/static_pressure"), ("imu10/data_raw", "imu/data_raw")):
        kind = topics.spec(f"/{name}")
        assert (kind.name, kind.msgtype, kind.measurement) == (name, TOPICS[like].msgtype, TOPICS[like].measurement)
        assert kind.variances == TOPICS[like].variances
    assert topics.kind_of("nav2/fix").measurement is m.NavSolution  # there is no nav/fix among the sensors, so this is a navigator
    assert topics.kind_of("gps2/fx") is None and topics.kind_of("2/fix").measurement is m.NavSolution


def test_a_name_that_has_a_kind_of_its_own_is_no_further_instance():
    describe(__name__, TopicSpec("gps2/fix", topics.IMU, "Something else."))
    try:
        assert DecodeRules().kind_of("gps2/fix").msgtype == topics.IMU
    finally:
        del TOPICS._things["gps2/fix"]
    assert DecodeRules().kind_of("gps2/fix").msgtype == topics.NAV_SAT_FIX


def test_a_second_receiver_and_a_second_inertial_unit_pass_decoder_and_bag(tmp_path):
    imu = m.ImuBlock.of("imu2/data_raw", STAMP + np.arange(5) * 10**7, np.ones((5, 3)), np.zeros((5, 3)))
    second = replace(FIX, source="gps2/fix", stamp_ns=STAMP + 10**8)
    with BagWriter(tmp_path / "bag") as bag:
        for stamp_ns, topic, msgtype, raw in [*encode_cdr(imu), *encode_cdr(second)]:
            bag.write(topic, msgtype, stamp_ns, raw)
    with BagReader(tmp_path / "bag") as bag:
        assert set(bag.decodable()) == {"imu2/data_raw", "gps2/fix"}
        block, fix = bag.measurements()
    assert (type(block), block.source, len(block)) == (m.ImuBlock, "imu2/data_raw", 5)
    assert (type(fix), fix.source) == (m.GpsPosition, "gps2/fix")


def test_a_kind_and_frames_are_assigned_under_the_rules_of_one_decoder():
    raw = to_cdr(parts.nav_sat_fix(STAMP, 0.65, -2.1, 500.0, np.eye(3), "tail_antenna"))
    decoder, other = Decoder(), Decoder()
    decoder.rules.assign("ublox/position", kind="gps/fix", frames=("tail_antenna",))
    fix = decoder.decode("ublox/position", topics.NAV_SAT_FIX, raw)
    assert (type(fix), fix.source) == (m.GpsPosition, "ublox/position")
    assert decoder.decode("gps/fix", topics.NAV_SAT_FIX, raw).reason == "wrong frame id"
    assert other.decode("ublox/position", topics.NAV_SAT_FIX, raw).reason == "unknown topic"
    assert topics.kind_of("ublox/position", decoder.rules).measurement is m.GpsPosition
    with pytest.raises(RegistryError, match="did you mean 'gps/fix'"):
        decoder.rules.assign("ublox/position", kind="gps/fx")


def test_a_frame_is_mapped_and_any_accepts_all():
    raw = to_cdr(parts.nav_sat_fix(STAMP, 0.65, -2.1, 500.0, np.eye(3), "nose"))
    rules = DecodeRules(frames={"gps/fix": {"nose"}, "gps2/fix": {ANY}})
    assert isinstance(decode("gps/fix", topics.NAV_SAT_FIX, raw, rules), m.GpsPosition)
    assert isinstance(decode("gps2/fix", topics.NAV_SAT_FIX, raw, rules), m.GpsPosition)
    assert decode("gps3/fix", topics.NAV_SAT_FIX, raw, rules).detail.startswith("'nose', expected antenna or")
    (*_, sample) = (raw for *_, raw in encode_cdr(m.ImuBlock.of("imu/data_raw", np.array([STAMP]), np.ones((1, 3)), np.zeros((1, 3)))))
    moved = sample.replace(b"imu_link", b"tail_imu")
    assert isinstance(decode("imu/data_raw", topics.IMU, moved), Rejected)
    assert isinstance(decode("imu/data_raw", topics.IMU, moved, DecodeRules(frames={"imu/data_raw": {ANY}})), m.ImuBlock)


def test_a_node_subscribes_to_a_further_instance_and_to_an_assigned_source(ros):
    from lowcostnav_ros.ros.node_base import NodeBase, message_class

    class Listener(NodeBase):
        def __init__(self, **kwargs) -> None:
            super().__init__("listener", **kwargs)
            self.fixes = []
            self.decoder.rules.assign("ublox/position", kind="gps/fix", frames=("nose",))
            for source in ("gps2/fix", "ublox/position"):
                self.listen(source, self.fixes.append)

    node = ros.make(Listener)
    for source, frame in (("gps2/fix", "gps"), ("ublox/position", "nose")):
        publisher = ros.probe.create_publisher(message_class(topics.NAV_SAT_FIX), source, 10)
        assert ros.spin_until(lambda publisher=publisher: publisher.get_subscription_count() == 1)
        publisher.publish(to_cdr(parts.nav_sat_fix(STAMP, 0.65, -2.1, 500.0, np.eye(3), frame)))
        assert ros.spin_until(lambda source=source: [fix.source for fix in node.fixes][-1:] == [source])
    assert {type(fix) for fix in node.fixes} == {m.GpsPosition}


def test_a_navigator_topic_under_a_foreign_name():
    decoder = Decoder(DecodeRules(origins={"tower": LocalFrame(0.6, -2.0, 10.0)}))
    decoder.rules.assign("tower/track", kind="<navigator>/fix", frames=ANY)
    raw = to_cdr(parts.nav_sat_fix(STAMP, 0.65, -2.1, 500.0, np.eye(3), "radar"))
    assert isinstance(decoder.decode("tower/track", topics.NAV_SAT_FIX, raw), m.NavSolution)


PLUGIN = """
import lowcostnav_ros.messages.encode  # whatever a plugin imports first
from lowcostnav_ros.base.measurements import Pressure
from lowcostnav_ros.messages.kind import TopicSpec, describe

describe(
    __name__,
    TopicSpec("air/total_pressure", "sensor_msgs/msg/FluidPressure", "Total pressure.", "base_link", "Pa"),
    measurement=Pressure,
    decode=lambda message, received: Pressure(*received.head, message.fluid_pressure, received.variance(message.variance, "pressure")),
)
"""
PROGRAM = """
from lowcostnav_ros.messages.topics import TOPICS, spec
from lowcostnav_ros.messages.decode import decode
assert "air/total_pressure" in TOPICS and "gps/fix" in TOPICS and spec("air2/total_pressure").decode
from lowcostnav_ros.graph.wiring import recorded_topics
assert "air/total_pressure" in recorded_topics()
"""


def test_a_plugin_is_found_by_the_environment(tmp_path):
    (tmp_path / "my_kinds.py").write_text(PLUGIN)
    path = os.pathsep.join(filter(None, (str(tmp_path), os.getcwd(), os.environ.get("PYTHONPATH"))))
    settings = {"PYTHONPATH": path, "LOWCOSTNAV_PLUGINS": "my_kinds", "LOWCOSTNAV_KERNELS": "interpreted"}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=os.environ | settings, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
