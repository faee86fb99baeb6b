"""Crossbow packets, ARINC 429 words, DME sentences, NetFIX values and rows of tables: closed forms, then over Fast DDS."""

import math
import socket

import numpy as np
import pytest
from fuzz_formats import arinc_frames, crossbow_frame, crossbow_frames, dme_frames, netfix_frames, sentence, table_frames
from test_drivers import Terminal, heard_on, state
from test_formats import by_source, parsed

from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.base.units import DEGREE, FOOT, KNOT, NAUTICAL_MILE, STANDARD_GRAVITY
from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.convert.convert import convert
from lowcostnav_ros.convert.profile import load_profile
from lowcostnav_ros.convert.stream import TableParser
from lowcostnav_ros.formats import arinc429 as arinc
from lowcostnav_ros.formats import crossbow, dme, netfix
from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.graph.executables import DRIVER, NODES, kind_of, settings_of
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.physics.rotation import quat_to_euler

NOW_NS = 1_754_049_600 * 10**9


def arriving(parser, frames, every_ns=20_000_000):
    """Measurements of frames that come one after another."""
    out = []
    for k, frame in enumerate(frames):
        parser.arrived_ns = NOW_NS + every_ns * k
        out += parser.feed(frame)
    return out


def test_crossbow_words_are_scaled_as_its_manual_says():
    unit = crossbow.CrossbowUnit("angle", 100.0, 2.0)
    found = by_source(arriving(crossbow.CrossbowParser(unit), crossbow_frames(), 16_000_000))
    block, attitude, field = (found[name][-1] for name in ("imu/data_raw", "imu/data_fused", "imu/mag"))
    np.testing.assert_allclose(block.angular_rate_b[0], np.radians([15, -51, -6]) * 150.0 / 32_768)
    np.testing.assert_allclose(block.specific_force_b[0], -np.array([40, 364, 10_990]) * 3.0 / 32_768 * STANDARD_GRAVITY)
    np.testing.assert_allclose(np.degrees(quat_to_euler(attitude.q_nb)), np.array([350, -50, 18_400]) * 180.0 / 32_768)
    np.testing.assert_allclose(field.field_b, np.array([4000, 0, 7000]) * 1.875e-4 / 32_768)
    # a unit at rest whose attitude and accelerometers agree: gravity-positive accelerometers, turned round
    force_n = np.array([0.0, 0.0, -STANDARD_GRAVITY])
    roll, pitch = quat_to_euler(attitude.q_nb)[:2]
    level = np.array([force_n[2] * -math.sin(pitch), force_n[2] * math.sin(roll) * math.cos(pitch)])
    assert np.abs(block.specific_force_b[0, :2] - level).max() < 0.06
    steps = np.diff([one.stamp_ns for one in found["imu/data_raw"]])
    np.testing.assert_allclose(steps, 20_253 * 790)  # by the unit's own timer, through its turns


@pytest.mark.parametrize("packet", crossbow.LAYOUTS)
def test_every_crossbow_packet(packet):
    words = crossbow.LAYOUTS[packet]
    frames = [crossbow_frame({"z": 10_000, "p": 100, "time": 30_000 - 5000 * k}, packet) for k in range(6)]
    assert len(frames[0]) == {"angle": 30, "scaled": 24, "vertical_gyro": 22, "six_axis": 18}[packet] == 2 * len(words) + 2
    found = by_source(parsed(crossbow.CrossbowParser(crossbow.CrossbowUnit(packet)), b"".join(frames)))
    assert len(found["imu/data_raw"]) == 4  # two confirm the third
    assert ("imu/mag" in found) == (packet in ("angle", "scaled")) and ("imu/data_fused" in found) == ("heading" in words)


def test_lost_crossbow_packets_cost_turns_that_arrivals_bring_back_and_a_stall_does_not():
    period_ns = 20_000 * 790  # 15.8 ms
    parser = crossbow.CrossbowParser(crossbow.CrossbowUnit())
    stamps, sent = [], []
    for k in range(400):
        if 100 <= k < 112:  # 190 ms are lost: three turns of 51.8 ms and the rest
            continue
        held = 80_000_000 if 200 <= k < 203 else 0
        count = (-20_000 * k) % 65_536
        parser.arrived_ns = NOW_NS + period_ns * k + held
        found = parsed_now(parser, crossbow_frame({"z": 10_000, "time": count - 65_536 * (count > 32_767)}))
        stamps += [one.stamp_ns for one in found]
        sent += [period_ns * k] * len(found)
    error = np.array(stamps) - np.array(sent) - (stamps[0] - sent[0])
    assert not error[sent.index(period_ns * 140) :].any() and abs(error).max() < 4 * crossbow.TURN_NS


@pytest.mark.parametrize(("range_g", "is_said"), [(2.0, False), (4.0, True)])
def test_a_range_that_is_not_that_of_the_unit_is_said(range_g, is_said):
    parser = crossbow.CrossbowParser(crossbow.CrossbowUnit("angle", 100.0, range_g))
    parsed(parser, b"".join(crossbow_frames() * 43))
    assert any("range on the label" in remark for remark in parser.account.remarks) == is_said


def parsed_now(parser, data):
    return [one for one in parser.feed(data) if one.source == "imu/data_raw"]


def test_a_false_crossbow_header_does_not_pass():
    good = crossbow_frames()
    parser = crossbow.CrossbowParser(crossbow.CrossbowUnit())
    out = parsed(parser, b"".join(good[:5]) + b"\xff" + b"".join(good[5:]))
    assert sum(one.source == "imu/data_raw" for one in out) == 3 + 5  # two after the gap are not believed
    assert parser.account.refused["Crossbow packet that has none before it to confirm it"] == 4


def test_arinc_resolutions_are_those_of_the_standard():
    assert arinc.LABELS[0o110].value(arinc.word_of(0o110, 1)) / DEGREE == pytest.approx(1.7166e-4, rel=1e-4)
    assert arinc.LABELS[0o120].value(arinc.word_of(0o120, 1 << 7)) / DEGREE == pytest.approx(8.3819e-8, rel=1e-4)
    for label, step in ((0o324, 0.011), (0o320, 0.0055), (0o326, 0.0156), (0o166, 0.125), (0o165, 1.0), (0o076, 0.125), (0o202, 0.0078)):
        kind = arinc.LABELS[label]
        assert kind.scale * 2.0**-kind.bits == pytest.approx(step, rel=0.02), oct(label)


@pytest.mark.parametrize("label", arinc.LABELS)
def test_arinc_words_round_trip_within_half_a_step(label):
    kind, rng = arinc.LABELS[label], np.random.default_rng(label)
    for share in rng.uniform(-1.0, 1.0, 50):
        if isinstance(kind, arinc.Decimal):
            value, step = abs(share) * 79_999 * kind.step * kind.unit, kind.step * kind.unit
        else:
            value, step = 0.999 * share * kind.scale * kind.unit, kind.scale * 2.0**-kind.bits * kind.unit
        word = arinc.encoded(label, value)
        assert arinc.parity_is_odd(word) and word & 0xFF == label and abs(kind.value(word) - value) <= 0.5001 * step


def test_arinc_words_by_hand():
    # pitch -45 deg is minus a quarter of the range: bits 29 down to 11 are 111 0000...
    assert arinc.LABELS[0o324].value(0o324 | 0b111 << 26 | 3 << 29) / DEGREE == -45.0
    # DME 123.45 NM in decimal: the digits 1 2 3 4 5 from bit 29 down
    assert arinc.LABELS[0o201].value(0o201 | 1 << 26 | 2 << 22 | 3 << 18 | 4 << 14 | 5 << 10) / NAUTICAL_MILE == pytest.approx(123.45)
    assert math.isnan(arinc.LABELS[0o201].value(0o201 | 0xF << 22))


def test_both_label_sets_become_measurements():
    found = by_source(arriving(arinc.ArincParser({11_680: "OAK"}, declination=0.2), arinc_frames(), 2_000_000))
    fix, velocity, block, attitude = (found[name][-1] for name in ("gps/fix", "gps/vel", "imu/data_raw", "imu/data_fused"))
    np.testing.assert_allclose([fix.lat, fix.lon], [0.65787 + 1e-6, -2.12616 + 2e-6], atol=1.6e-6)
    assert abs(fix.height - 472.0) < 0.06 * FOOT and fix.cov_n[0, 0] == pytest.approx((20.0 / 2.448) ** 2, rel=0.02)
    np.testing.assert_allclose(velocity.vel_n, [40.0, -30.0, -2.0], atol=0.07 * KNOT)
    np.testing.assert_allclose(block.angular_rate_b[0], [0.01, -0.02, 0.03], atol=0.008 * DEGREE)
    np.testing.assert_allclose(block.specific_force_b[0], [0.2, -0.3, -9.8], atol=0.0006 * STANDARD_GRAVITY)
    np.testing.assert_allclose(quat_to_euler(attitude.q_nb), [0.1, 0.05, 2.0], atol=0.01 * DEGREE)
    assert found["dme/range"][-1].station == "OAK" and abs(found["dme/range"][-1].range_m - 43_429.4) < 0.006 * NAUTICAL_MILE


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        (arinc.encoded(0o166, 10.0) ^ 1 << 31, "ARINC 429 word with even parity"),
        (arinc.word_of(0o166, 100, ssm=1), "ARINC 429 label 166 not in normal operation"),
        (arinc.word_of(0o201, 0xF << 12, ssm=0), "ARINC 429 label 201 with a digit that is none"),
        (arinc.encoded(0o202, 20_000.0), "DME distance without a frequency (label 035) that names a station"),
    ],
)
def test_an_arinc_word_that_may_not_count_is_refused_by_name(word, reason):
    parser = arinc.ArincParser({11_680: "OAK"})
    assert not arriving(parser, [arinc.frame_of(word)]) and parser.account.refused[reason] == 1


def test_words_of_two_epochs_are_not_mixed():
    parser = arinc.ArincParser()
    assert not arriving(parser, [arinc.frame_of(arinc.encoded(label, 10.0)) for label in (0o166, 0o174)], every_ns=300_000_000)


def test_cycles_of_words_are_not_mixed_wherever_the_first_begins():
    labels = (0o327, 0o326, 0o330, 0o331, 0o332, 0o333)
    steps = [arinc.LABELS[label].scale / 128.0 * arinc.LABELS[label].unit for label in labels]
    for first in range(6):
        parser, found = arinc.ArincParser(), []
        for k in range(first, 60):  # 50 cycles a second, a word each millisecond; every word says in which cycle it was sent
            cycle, place = divmod(k, 6)
            parser.arrived_ns = NOW_NS + 20_000_000 * cycle + 1_000_000 * place
            found += parser.feed(arinc.frame_of(arinc.encoded(labels[place], cycle * steps[place])))
        cycles = [{round(x / s) for x, s in zip((*one.angular_rate_b[0], *one.specific_force_b[0]), steps, strict=True)} for one in found]
        assert len(cycles) >= 8 and all(len(numbers) == 1 for numbers in cycles[1:])


def test_dme_sentences():
    parser = dme.DmeParser({11_680: "OAK"})
    wrong = [sentence("PLDME,OAK,xx,A"), sentence("PLDME,OAK,-1,A"), sentence("PLDME,OAK,1e9,A"), sentence("PLDME,TOOLONG,1,A")]
    words = [arinc.frame_of(arinc.encoded(label, value)) for label, value in ((0o035, 16.8), (0o201, 20.0 * NAUTICAL_MILE))]
    ranges = arriving(parser, [*dme_frames(), *wrong, *words])
    miles = [(one.station, round(one.range_m / NAUTICAL_MILE, 2)) for one in ranges]
    assert miles == [("OAK", 23.45), ("SJC", 7.02), ("OAK", 23.46), ("OAK", 20.0)]
    assert ranges[1].variance == pytest.approx((0.05 * NAUTICAL_MILE) ** 2) and ranges[0].stamp_ns == NOW_NS
    assert parser.account.refused == {"no valid distance": 1, "PLDME with a distance or sigma that is none": 3, "PLDME of another form": 1}
    for text in ("OAK", "OAK:90", "TOOLONG:116.8", "O K:116.8"):
        with pytest.raises(SettingsError, match="such as OAK:116.80"):
            dme.parse_stations([text])


def test_netfix_values():
    found = by_source(arriving(netfix.NetfixParser(), netfix_frames(), 1_000_000))
    assert found["air/static_pressure"][0].pressure_pa == 95_460.0 and found["air/dynamic_pressure"][0].pressure_pa == 1400.0
    assert found["air/temperature"][0].temperature_k == pytest.approx(287.65)
    made, stated = (one.vel_b[0] / KNOT for one in found["air/velocity"])
    assert stated == pytest.approx(101.2) and 97.0 < made < 98.6  # 95.1 kt indicated at 1640 ft
    assert len(found["gps/fix"]) == 2 and 461.0 < found["gps/fix"][1].height < 475.0  # TALT, lowered by the geoid
    assert not found["gps/fix"][0].has_height  # before a height came
    np.testing.assert_allclose(np.linalg.norm(found["gps/vel"][0].vel_n), 95.0 * KNOT)


def test_netfix_values_that_are_flagged_or_late_are_not_used():
    parser = netfix.NetfixParser()
    lines = [b"AIRPRESS;95460.0;01000\n", b"AIRPRESS;95460.0;00010\n", b"OAT;nan;00000\n", b"@sXYZ!001\n", b"RPM;2400;00000\n"]
    assert not arriving(parser, lines)
    assert parser.account.refused["NetFIX AIRPRESS flagged old, bad or failed"] == 2 and parser.account.left_out == {"NetFIX RPM": 1}
    assert not arriving(netfix.NetfixParser(), [b"LONG;-121.0;00000\n", b"LAT;37.0;00000\n"], every_ns=200_000_000)


def test_rows_of_a_stream_are_those_of_the_converted_table(tmp_path):
    header, rows = b"t_ms,ax,ay,az,gx,gy,gz\n", b"".join(table_frames())
    (tmp_path / "stream").write_bytes(rows)
    convert(tmp_path / "stream", "imu_stream", tmp_path / "bag")
    with BagReader(tmp_path / "bag") as bag:
        (recorded,) = bag.measurements()  # one block
    streamed = parsed(TableParser(load_profile("imu_stream")), b"# a comment\n" + header + rows + b"1,2\n" + b"1990,a,b,c,d,e,f\n")
    assert len(streamed) == len(recorded) == 12
    np.testing.assert_array_equal([one.stamp_ns for one in streamed], recorded.stamps_ns)
    np.testing.assert_array_equal(np.concatenate([one.specific_force_b for one in streamed]), recorded.specific_force_b)
    np.testing.assert_array_equal(np.concatenate([one.angular_rate_b for one in streamed]), recorded.angular_rate_b)


@pytest.fixture
def terminal(tmp_path):
    one = Terminal(tmp_path / "device")
    yield one
    one.unplug()


@pytest.mark.parametrize(
    ("module", "node_class", "frames", "topics", "settings"),
    [
        ("crossbow_driver", "CrossbowDriver", crossbow_frames, ("imu/data_raw", "imu/mag", "imu/data"), {"attitude": True}),
        ("arinc_driver", "ArincDriver", arinc_frames, ("gps/fix", "imu/data_raw", "dme/range"), {"dme_stations": ["OAK:116.80"]}),
        ("dme_driver", "DmeDriver", dme_frames, ("dme/range",), {}),
        ("csv_driver", "CsvDriver", table_frames, ("imu/data_raw",), {}),
    ],
)
def test_a_bus_through_a_terminal_comes_out_on_the_topics(ros, terminal, module, node_class, frames, topics, settings):
    make = getattr(pytest.importorskip(f"lowcostnav_ros.nodes.{module}"), node_class)
    heard = heard_on(ros, *topics)
    node = ros.make(make, source=str(terminal.path), baud=115_200, **settings)
    assert ros.spin_until(lambda: node._opened == 1)
    now_ns = node.get_clock().now().nanoseconds
    send = b"noise\xff\n" + b"".join(frames())
    assert ros.spin_until(lambda: terminal.write(send) or ros.spin_once() or all(heard.values()), 20.0)
    assert ros.spin_until(lambda: state(node).level == 0 and "messages come" in state(node).message)
    assert abs(heard[topics[0]][-1].stamp_ns - now_ns) < 25 * 10**9


def test_a_gateway_is_asked_and_its_silence_and_its_end_are_said(ros):
    from lowcostnav_ros.nodes.netfix_driver import NetfixDriver

    gateway = socket.create_server(("127.0.0.1", 0))
    heard = heard_on(ros, "air/static_pressure")
    node = ros.make(NetfixDriver, source=f"tcp:127.0.0.1:{gateway.getsockname()[1]}", silent_after_s=0.5, instance=1)
    link = gateway.accept()[0]
    asked = link.recv(4096)
    assert asked.startswith(b"@sLAT\n") and b"@sAIRPRESS\n" in asked
    assert ros.spin_until(lambda: "is open, but no bytes have come" in state(node).message)  # a port that is half open
    assert ros.spin_until(lambda: link.sendall(b"".join(netfix_frames())) or ros.spin_once() or heard["air/static_pressure"], 20.0)
    link.close()
    gateway.close()
    assert ros.spin_until(lambda: state(node).level == 2 and ("closed by" in state(node).message or "check" in state(node).message))


def test_two_of_a_kind_and_a_port_that_is_taken(ros, tmp_path):
    from lowcostnav_ros.nodes.dme_driver import DmeDriver
    from lowcostnav_ros.nodes.netfix_driver import NetfixDriver
    from lowcostnav_ros.ros.port import PortError, open_port

    one, two = Terminal(tmp_path / "one"), Terminal(tmp_path / "two")
    heard = heard_on(ros, "dme/range", "dme2/range")
    nodes = [ros.make(DmeDriver, source=str(t.path), baud=9600, instance=k) for k, t in ((1, one), (2, two))]
    assert ros.spin_until(lambda: all(node._opened == 1 for node in nodes))

    def both():
        for t in (one, two):
            t.write(b"".join(dme_frames()))
        ros.spin_once()
        return all(heard.values())

    assert ros.spin_until(both, 20.0)
    for t in (one, two):
        t.unplug()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("0.0.0.0", 0))
        with pytest.raises(PortError, match="in use by another program"):
            open_port(f"udp:{taken.getsockname()[1]}", 0)
    with pytest.raises(SettingsError, match="carries no time"):
        NetfixDriver(context=ros.context, parameter_overrides=[_parameter("source", "file:/tmp/x")])


def test_a_wrong_rate_is_said_and_a_network_port_needs_none(ros, terminal):
    from lowcostnav_ros.nodes.dme_driver import DmeDriver

    node = ros.make(DmeDriver, source=str(terminal.path), baud=4800, instance=1)
    rubbish = bytes(np.random.default_rng(1).integers(128, 256, 40, np.uint8))
    said = "gives no known message at 4800 baud (0 finds the rate)"
    assert ros.spin_until(lambda: terminal.write(rubbish) or said in state(node).message)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        number = free.getsockname()[1]
    heard = heard_on(ros, "dme3/range")
    ros.make(DmeDriver, source=f"udp:{number}", instance=3)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sent = lambda: sender.sendto(b"".join(dme_frames()), ("127.0.0.1", number))  # noqa: E731
    assert ros.spin_until(lambda: sent() and ros.spin_once() or heard["dme3/range"], 20.0)
    sender.close()


def _parameter(name, value):
    from rclpy.parameter import Parameter

    return Parameter(name, value=value)


@pytest.mark.parametrize("path", sorted((config_dir() / "graphs").glob("real_*.yaml")), ids=lambda path: path.stem)
def test_the_graphs_of_real_aircraft_say_what_their_nodes_know(path):
    pytest.importorskip("rclpy")
    graph = load_graph(path.stem)
    for node in graph.nodes:
        if node.executable in NODES and settings_of(node.executable) is not None:
            from_mapping(settings_of(node.executable), dict(node.parameters), path.stem)
    assert {node.executable for node in graph.nodes} & {name for name in NODES if kind_of(name) == DRIVER}


def test_the_udev_rules_are_installed_and_name_the_ports():
    rules = (config_dir() / "udev" / "99-lowcostnav.rules").read_text()
    lines = [line for line in rules.splitlines() if line and not line.startswith("#")]
    assert all(line.count('"') % 2 == 0 for line in lines) and rules.count("SYMLINK") == 9
    assert '"*.rules"' in (config_dir().parent / "setup.py").read_text()
