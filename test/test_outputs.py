"""Outputs to the cockpit: bytes against the published examples, other parsers and our own; what is not known is never shown."""

import math
import socket

import numpy as np
import pytest
from test_formats import by_source, parsed

from lowcostnav_ros.base.measurements import AirVelocity, Health, NavSolution, Pressure
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.base.units import FOOT, KNOT
from lowcostnav_ros.formats.cockpit import Cockpit, CockpitLimits, Picture
from lowcostnav_ros.formats.gdl90 import NACP_M, NIC_M, Gdl90, ahrs, category, check_sum, framed, geometric_altitude, heartbeat
from lowcostnav_ros.formats.netfix import NetfixLines, NetfixParser
from lowcostnav_ros.formats.nmea import NmeaParser
from lowcostnav_ros.formats.nmea_sentences import NmeaSentences
from lowcostnav_ros.formats.xplane_text import XPlaneText
from lowcostnav_ros.physics import atmosphere
from lowcostnav_ros.physics.rotation import euler_to_quat

NOW_NS = 1_754_049_600 * 10**9  # 2025-08-01 12:00:00 UTC
LAT, LON = math.radians(37.6933), math.radians(-121.82)


def solution(stamp_ns=NOW_NS, sigma_m=2.0, **changes):
    q = euler_to_quat(math.radians(-12.0), math.radians(4.0), math.radians(310.0))
    state = {"vel_n": np.array([40.0, -30.0, -2.0]), "q_nb": q, "cov_pos": np.diag([sigma_m**2, sigma_m**2, 9.0])}
    state |= {"cov_vel": 0.04 * np.eye(3), "cov_att": np.radians(0.5) ** 2 * np.eye(3)}
    return NavSolution(stamp_ns, "nav", LAT, LON, 472.0, **(state | changes))


def health(level=0, stamp_ns=NOW_NS):
    return Health(stamp_ns, "nav/health", "gps", level, "why", 0, 0)


def picture(level=0, now_s=0.1, limits=None, **changes):
    cockpit = Cockpit(limits or CockpitLimits())
    for one in (solution(**changes), health(level), Pressure(NOW_NS, "air/static_pressure", 95_460.0, 1.0)):
        cockpit.take(one, 0.0)
    cockpit.take(AirVelocity(NOW_NS, "air/velocity", np.array([55.0, 0.0, 0.0]), np.eye(3)), 0.0)
    return cockpit.picture(now_s)


def unframed(frame):
    """Message of a frame whose check sum is right."""
    assert frame[0] == frame[-1] == 0x7E
    raw, out = frame[1:-1], bytearray()
    while raw:
        escaped = raw[0] == 0x7D
        out.append(raw[1] ^ 0x20 if escaped else raw[0])
        raw = raw[1 + escaped :]
    assert 0x7E not in frame[1:-1] and check_sum(bytes(out[:-2])) == int.from_bytes(out[-2:], "little")
    return bytes(out[:-2])


def test_the_frame_of_the_specifications_example():
    assert framed(bytes.fromhex("008141DBD00802")).hex().upper() == "7E008141DBD00802B38B7E"  # section 2.2.4
    assert unframed(framed(b"\x7e\x7d\x20")) == b"\x7e\x7d\x20"


def test_the_report_of_the_specifications_example():
    # section 3.5.4: N825V at 44.90708 N, 122.99488 W, 5000 ft, NIC 10, NACp 9, 123 kt, 64 ft/min, track 45
    shown = Picture(
        NOW_NS, lat=math.radians(44.90708), lon=math.radians(-122.99488), radius_95_m=20.0, height_95_m=30.0, hpl_m=20.0, vpl_m=30.0,
        speed_mps=123 * KNOT,
        track=math.radians(45.0), vel_n=np.array([1.0, 1.0, -64 * FOOT / 60.0]), pressure_height_m=5000 * FOOT,
    )  # fmt: skip
    ours, theirs = Gdl90(0xAB4549, "N825V").ownship(shown), bytes.fromhex("0A00AB45491FEF15A889780F09A907B00120014E3832355620202000")
    assert ours[:5] + ours[11:] == theirs[:5] + theirs[11:]
    for part in (slice(5, 8), slice(8, 11)):  # the example cuts the last digit off, ours is rounded
        assert abs(int.from_bytes(ours[part], "big") - int.from_bytes(theirs[part], "big")) <= 1


@pytest.mark.parametrize(("size_m", "nacp", "nic"), [(2.9, 11, 11), (10.0, 9, 10), (185.0, 7, 8), (3e3, 3, 4), (4e4, 0, 0), (None, 0, 0)])
def test_categories(size_m, nacp, nic):
    assert (category(size_m, 1.0, NACP_M), category(size_m, 1.0, NIC_M)) == (nacp, nic)
    assert category(size_m, 20.0, NACP_M) == min(nacp, 9) and category(size_m, None, NIC_M) == min(nic, 8)


def test_gdl90_of_a_healthy_navigator():
    shown = picture()
    frames = [unframed(frame) for frame in Gdl90().frames(shown, True)]
    assert [frame[0] for frame in frames] == [0, 10, 11, 0x65, 0x65] and len(Gdl90().frames(shown, False)) == 1
    assert frames[0][1] & 0x80 and int.from_bytes(frames[0][3:5], "little") == 43_200
    assert frames[1][13] == 0x0A  # no protection level, so no NIC; 4.9 m make NACp 10
    assert frames[1][1:5] == bytes([1, 0, 0, 0])  # no address: self-assigned
    assert int.from_bytes(frames[2][1:3], "big") == round(472.0 / FOOT / 5.0) and frames[2][3:] == (6).to_bytes(2, "big")
    angles = np.frombuffer(frames[4], ">i2", 3, 2)
    np.testing.assert_array_equal(angles, [-120, 40, 3100])
    cas, tas = np.frombuffer(frames[4], ">u2", 2, 8)
    assert tas == round(55.0 / KNOT) and cas == round(float(atmosphere.tas_to_cas(55.0, 95_460.0, atmosphere.temperature(500.3))) / KNOT)
    assert len(frames[3]) == 39 and len(frames[4]) == 12


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"now_s": 1.2}, "the solution is stale"),
        ({"level": 2}, "the navigator has failed: why"),
        ({"sigma_m": 800.0}, "the 95 % radius of the position, 1958 m, is beyond the limit"),
        ({"cov_pos": None}, "the navigator has no position"),
    ],
)
def test_a_position_that_is_not_known_is_not_shown_in_any_format(changes, reason):
    shown = picture(**changes)
    assert shown.lat is None and shown.reason == reason
    assert not heartbeat(shown)[1] & 0x80 and Gdl90().ownship(shown)[5:11] == bytes(6) and Gdl90().ownship(shown)[13] == 0
    assert geometric_altitude(shown)[3:] == b"\xff\xff"
    gga, rmc, vtg, gst = NmeaSentences().frames(shown, True)
    assert b",,,,,0," in gga and b",V," in rmc and vtg.split(b",")[-1][:1] in b"NAE" and b",,,,,," in gst
    assert not any(line.startswith(b"XGPS") for line in XPlaneText().frames(shown, True))
    assert b"LAT;0.0;0010\n" in NetfixLines().frames(shown, True)
    parser = NmeaParser()
    assert not [one for one in parsed(parser, gga + rmc + gst) if one.source == "gps/fix"]
    if changes.get("level") == 2 or "now_s" in changes:
        assert shown.roll is None and ahrs(shown)[2:8] == bytes.fromhex("7FFF7FFFFFFF")


def test_a_stamp_that_stands_still_is_stale_and_a_clock_that_starts_anew_is_taken():
    cockpit = Cockpit(CockpitLimits())
    for k in range(40):
        cockpit.take(solution(), 0.1 * k)
        cockpit.take(health(), 0.1 * k)
        assert (cockpit.picture(0.1 * k).lat is None) == (10 < k <= 30)  # after 3 s a standing clock counts as a new one, once
    cockpit = Cockpit(CockpitLimits())
    cockpit.take(solution(), 0.0)
    assert cockpit.picture(0.0).reason == "the navigator reports no health"


def test_a_protection_level_makes_nic_until_it_is_withdrawn_or_old():
    cockpit = Cockpit(CockpitLimits())
    for at_s, hpl, vpl, nic in ((0.0, 60.0, 80.0, 9), (0.1, None, None, 0), (0.2, 60.0, 120.0, 8)):
        cockpit.take(solution(NOW_NS + round(1e9 * at_s)), at_s)
        cockpit.take(health(), at_s)
        cockpit.protect(hpl, vpl, at_s)
        assert Gdl90().ownship(cockpit.picture(at_s))[13] >> 4 == nic
    cockpit.protect(2000.0, 80.0, 0.3)
    assert "protection level" in cockpit.picture(0.3).reason


def test_what_the_limits_forbid_is_left_out_alone():
    shown = picture(cov_att=np.diag(np.radians([0.5, 0.5, 30.0]) ** 2), cov_vel=100.0 * np.eye(3))
    assert shown.lat is not None and shown.roll is not None and shown.heading is None and shown.vel_n is None
    assert Gdl90().ownship(shown)[14:17] == bytes.fromhex("FFF800") and ahrs(shown)[6:8] == b"\xff\xff"
    assert picture(vel_n=np.array([1.0, 0.5, 0.0])).track is None  # a taxiing aircraft has no track


def test_nmea_round_trips_through_our_own_parser_and_another():
    sentences = NmeaSentences("GN").frames(picture(), True)
    found = by_source(parsed(NmeaParser(), b"".join([*sentences[1:2], sentences[3], sentences[0], sentences[1]])))
    fix, velocity = found["gps/fix"][-1], found["gps/vel"][-1]
    np.testing.assert_allclose([fix.lat, fix.lon], [LAT, LON], atol=2e-9)
    assert abs(fix.height - 472.0) < 0.11 and fix.stamp_ns == NOW_NS
    np.testing.assert_allclose(np.diag(fix.cov_n), [4.0, 4.0, 9.0])
    np.testing.assert_allclose(velocity.vel_n[:2], [40.0, -30.0], atol=0.01)
    reader = pytest.importorskip("pynmeagps")
    gga, rmc, vtg, gst = (reader.NMEAReader.parse(one.decode()) for one in sentences)
    np.testing.assert_allclose(np.radians([gga.lat, gga.lon, rmc.lat, rmc.lon]), [LAT, LON, LAT, LON], atol=2e-9)
    assert (gga.quality, rmc.status, rmc.posMode, vtg.posMode) == (1, "A", "A", "A")
    assert (gst.stdMajor, gst.stdLat, gst.stdAlt) == (2.0, 2.0, 3.0) and abs(vtg.cogt - 323.13) < 0.01


def test_dead_reckoning_is_told_from_gps():
    shown = picture(level=1)
    gga, rmc, vtg, _ = NmeaSentences().frames(shown, True)
    assert gga.split(b",")[6] == b"6" and rmc.split(b",")[2] == b"A" and rmc[-6:-5] == vtg[-6:-5] == b"E"
    parser = NmeaParser()
    parsed(parser, rmc + gga)
    assert parser.account.refused["position is dead reckoning of the receiver"] == 1
    assert Gdl90().ownship(shown)[12] & 0x04 and NetfixLines().frames(shown, True)[0] == b"LAT;37.6933000;0100\n"


def test_minutes_never_read_sixty():
    gga = NmeaSentences().frames(picture(), True)[0]
    assert gga.split(b",")[2:6] == [b"3741.59800", b"N", b"12149.20000", b"W"]
    shown = Picture(NOW_NS, lat=math.radians(12.0 - 1e-12), lon=math.radians(-5e-9), cov_pos=np.eye(3))
    assert NmeaSentences().frames(shown, True)[0].split(b",")[2:6] == [b"1200.00000", b"N", b"00000.00000", b"W"]


def test_the_text_of_a_simulator():
    gps, attitude = XPlaneText().frames(picture(), True)
    name, *numbers = gps.decode().split(",")
    assert name == "XGPSlowcostnav" and abs(float(numbers[2]) - 472.0) < 40.0
    np.testing.assert_allclose([float(numbers[k]) for k in (0, 1, 3, 4)], [-121.82, 37.6933, 323.13, 50.0], atol=0.01)
    assert attitude == b"XATTlowcostnav,310.0,4.0,-12.0"


def test_netfix_round_trips_through_our_own_parser():
    parser = NetfixParser()
    parser.arrived_ns = NOW_NS
    found = by_source(parsed(parser, b"".join(NetfixLines().frames(picture(), True))))
    fix, velocity = found["gps/fix"][0], found["gps/vel"][0]
    np.testing.assert_allclose([fix.lat, fix.lon], [LAT, LON], atol=1e-8)
    np.testing.assert_allclose(velocity.vel_n[:2], [40.0, -30.0], atol=0.06)
    heading = next(float(line.split(b";")[1]) for line in NetfixLines().frames(picture(), False) if line.startswith(b"HEAD"))
    assert 296.0 < heading < 298.0  # 13 degrees of east declination there


def test_destinations_are_checked():
    pytest.importorskip("rclpy")
    from lowcostnav_ros.nodes.gdl90_output import Gdl90Settings
    from lowcostnav_ros.ros.port import parse_destination

    assert parse_destination("udp:192.168.1.5:4000") == ("udp", "192.168.1.5:4000") and parse_destination("/dev/ttyS0")[0] == "serial"
    for wrong in ("udp:4000", "udp:host:x", "nowhere", "file:"):
        with pytest.raises(SettingsError, match="destination: "):
            parse_destination(wrong)
    for wrong in ({"address": "12345"}, {"call_sign": "d-eabc"}, {"navigator": "a/b"}):
        with pytest.raises(SettingsError):
            Gdl90Settings(**wrong)


def test_a_navigator_reaches_a_tablet(ros):
    from lowcostnav_ros.messages.encode import health_from, odometry_from_solution, origin_fix
    from lowcostnav_ros.messages.store import to_cdr
    from lowcostnav_ros.messages.topics import spec
    from lowcostnav_ros.nodes.gdl90_output import Gdl90Output
    from lowcostnav_ros.physics.earth import LocalFrame
    from lowcostnav_ros.ros import qos
    from lowcostnav_ros.ros.publishing import message_class

    tablet = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    tablet.bind(("127.0.0.1", 0))
    tablet.setblocking(False)
    node = ros.make(Gdl90Output, destination=f"udp:127.0.0.1:{tablet.getsockname()[1]}", navigator="ins_gps", rate_hz=20.0)
    out = {}
    for part in ("odometry", "health", "origin"):
        kind = spec(f"ins_gps/{part}")
        out[part] = ros.probe.create_publisher(message_class(kind.msgtype), kind.name, qos.latched() if kind.latched else qos.output())
    origin, heard = LocalFrame(LAT, LON, 400.0), []

    def published(k=[0]):  # noqa: B006 - the count of the calls
        k[0] += 1
        now_ns = NOW_NS + 10**8 * k[0]
        out["origin"].publish(to_cdr(origin_fix(NOW_NS, origin)))
        out["odometry"].publish(to_cdr(odometry_from_solution(solution(now_ns), origin)))
        out["health"].publish(to_cdr(health_from(health(stamp_ns=now_ns))))
        ros.spin_once()
        try:
            while True:
                heard.append(unframed(tablet.recv(100)))
        except BlockingIOError:
            return any(message[0] == 0 and message[1] & 0x80 for message in heard)

    assert ros.spin_until(published, 90.0)  # the decoder may be compiled first
    reports = [message for message in heard if message[0] == 10]
    assert abs(int.from_bytes(reports[-1][5:8], "big") / 2**23 * math.pi - LAT) < 1e-6
    row = lambda: next(row for row in node.rows() if row.name.endswith(": output"))  # noqa: E731
    assert row().message == "position shown" and int(row().values["sent"]) >= len(heard)
    assert ros.spin_until(lambda: row().message == "position not shown: the solution is stale", 10.0)
    tablet.close()


def test_a_destination_that_is_not_there_is_said_and_taken_up_once_it_is(ros):
    from lowcostnav_ros.nodes.netfix_output import NetfixOutput

    with socket.create_server(("127.0.0.1", 0)) as free:
        number = free.getsockname()[1]
    node = ros.make(NetfixOutput, destination=f"tcp:127.0.0.1:{number}", rate_hz=20.0)
    row = lambda: next(row for row in node.rows() if row.name.endswith(": output"))  # noqa: E731
    assert ros.spin_until(lambda: row().level == 2 and "cannot be opened" in row().message)
    with socket.create_server(("127.0.0.1", number)) as gateway:
        link = gateway.accept()[0]
        assert link.makefile("rb").readline() == b"LAT;0.0;0010\n"  # nothing is known, and so it says
        assert ros.spin_until(lambda: row().message == "position not shown: no solution has come")
        link.close()
    assert ros.spin_until(lambda: row().level == 2)
