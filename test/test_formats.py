"""Parsers of byte streams: values against independent libraries, damage of every kind, what is refused."""

import io
import struct

import numpy as np
import pytest
from fuzz_formats import PARSERS, fuzz, mavlink_frame, mavlink_frames, nmea_frames, sentence, ubx_frames

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.convert.any_log import convert_any
from lowcostnav_ros.formats import mavlink, nmea, ubx
from lowcostnav_ros.formats.mavlink_messages import LAYOUTS
from lowcostnav_ros.formats.parser import Account
from lowcostnav_ros.formats.records import CheckedRecords
from lowcostnav_ros.formats.vehicle import remark_firmware


def parsed(parser, data, piece=7):
    """All measurements of bytes that come in small pieces."""
    out = []
    for at in range(0, len(data), piece):
        out += parser.feed(data[at : at + piece])
    return [*out, *parser.close()]


def by_source(measurements):
    out = {}
    for one in measurements:
        out.setdefault(one.source, []).append(one)
    return out


def test_the_geoid_is_that_of_the_model_at_its_published_points():
    # test values of the model's own interpolation program, m, at (lat, lon) deg
    for lat, lon, published in ((38.6281550, 269.7791550, -31.628), (-14.6212170, 305.0211140, -2.969), (46.8743190, 102.4487290, -43.575)):
        assert abs(float(undulation(np.radians(lat), np.radians(lon))) - published) < 1.5


@pytest.mark.parametrize("piece", [1, 13, 100_000])
def test_nmea_gives_position_velocity_and_pressure_however_it_is_cut(piece):
    found = by_source(parsed(nmea.NmeaParser(), b"".join(nmea_frames()), piece))
    fix, velocity, pressure = (found[name][-1] for name in ("gps/fix", "gps/vel", "air/static_pressure"))
    np.testing.assert_allclose([fix.lat, fix.lon, fix.height], [np.radians(37 + 41.6 / 60), -np.radians(121 + 49.2 / 60), 472.0])
    np.testing.assert_allclose(np.diag(fix.cov_n), [1.21, 1.44, 4.0])  # of GST
    assert fix.stamp_ns == 1_754_049_601 * 10**9 and len(found["gps/fix"]) == 2
    np.testing.assert_allclose(np.linalg.norm(velocity.vel_n), 95.0 * 1852 / 3600)
    assert velocity.cov_n[2, 2] >= UNKNOWN_VARIANCE
    assert abs(pressure.pressure_pa - 95_460.0) < 60.0


def test_nmea_agrees_with_another_parser():
    reader = pytest.importorskip("pynmeagps")
    position = reader.NMEAReader.parse(nmea_frames()[1].decode())
    fix = by_source(parsed(nmea.NmeaParser(), b"".join(nmea_frames())))["gps/fix"][0]
    np.testing.assert_allclose(np.degrees([fix.lat, fix.lon]), [position.lat, position.lon], atol=1e-9)


def test_a_time_of_day_after_midnight_belongs_to_the_next_day():
    place = "3741.6000,N,12149.2000,W,1,09,0.9,500.0,M,-28.0,M,,"
    lines = [f"GPGGA,235959.50,{place}", "GPRMC,235959.50,A,3741.6,N,12149.2,W,1.0,0.0,311224,,,A", f"GPGGA,000000.50,{place}"]
    fixes = by_source(parsed(nmea.NmeaParser(), b"".join(map(sentence, lines))))["gps/fix"]
    assert [fix.stamp_ns / 1e9 for fix in fixes] == [1735689599.5, 1735689600.5]  # the first waited for its date


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("GPGGA,120000.00,3741.6000,N,12149.2000,W,0,00,,,M,,M,,", "no fix"),
        ("GPGGA,120000.00,3741.6000,N,12149.2000,W,6,09,0.9,500.0,M,-28.0,M,,", "position is dead reckoning of the receiver"),
        ("GPGGA,120000.00,3761.6000,N,12149.2000,W,1,09,0.9,500.0,M,-28.0,M,,", "NMEA GGA with a field that is no number"),
        ("GPGGA,126000.00,3741.6000,N,12149.2000,W,1,09,0.9,500.0,M,-28.0,M,,", "NMEA GGA with a field that is no number"),
        ("GPZDA,120001.00,01,08,99999999999999999999,00,00", "NMEA ZDA with a field that is no number"),
        ("GPRMC,120001.00,A,3741.6,N,12149.2,W,9500.0,273.4,010825,,,A", "velocity implausible"),
        ("GPRMC,120001.00,A,3741.6,N,12149.2,W,95.0,273.4,320825,,,A", "NMEA RMC with a field that is no number"),
    ],
)
def test_what_a_receiver_may_not_say_is_refused_by_name(line, reason):
    parser = nmea.NmeaParser()
    parsed(parser, nmea_frames()[0])
    assert not parsed(parser, sentence(line)) and parser.account.refused[reason] == 1


def test_positions_without_a_date_are_refused_at_the_end():
    parser = nmea.NmeaParser()
    assert not parsed(parser, nmea_frames()[1])
    assert parser.account.refused["NMEA GGA without a date: no RMC or ZDA states one"] == 1


def test_ubx_agrees_with_another_parser():
    library = pytest.importorskip("pyubx2")
    found = by_source(parsed(ubx.UbloxParser(), b"".join(ubx_frames())))
    _, pvt = library.UBXReader(io.BytesIO(ubx_frames()[4])).read()
    fix, velocity = found["gps/fix"][1], found["gps/vel"][1]
    np.testing.assert_allclose(np.degrees([fix.lat, fix.lon]), [pvt.lat, pvt.lon], atol=1e-9)
    np.testing.assert_allclose([fix.height, *velocity.vel_n], np.array([pvt.height, pvt.velN, pvt.velE, pvt.velD]) / 1000.0)
    assert fix.stamp_ns == 1_754_049_601 * 10**9 + pvt.nano and fix.cov_n[0, 1] == pytest.approx(0.1)


def test_mavlink_agrees_with_another_parser():
    dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
    library = dialect.MAVLink(None)
    for frame in mavlink_frames():
        theirs = library.parse_char(frame)
        payload = frame[6:-2] if frame[:1] == b"\xfe" else frame[10:-2]
        for name, value in LAYOUTS[theirs.get_msgId()].read(payload).items():
            said = {"satellites": "satellites_visible", "present": "onboard_control_sensors_present", "updated": "fields_updated"}
            assert value == getattr(theirs, said.get(name, name)), (theirs.get_type(), name)


def test_mavlink_uses_the_best_inertial_message_and_one_autopilot():
    parser = mavlink.MavlinkParser()
    other = mavlink_frame(26, struct.pack("<I9h", 10_070, *[1000] * 9), system=9)
    found = by_source(parsed(parser, b"".join(mavlink_frames()) + other))
    assert [one.stamp_ns for one in found["imu/data_raw"]] == [10_000_000_000, 10_100_000_000]
    np.testing.assert_allclose(found["imu/data_raw"][-1].specific_force_b[0], [0.1, 0.2, -9.8], rtol=1e-6)
    left_out = {"SCALED_IMU": 2, "RAW_IMU": 1, "SCALED_IMU3": 2, "VFR_HUD beside AIRSPEED": 1, "another system": 1}
    assert parser.utc_offset_ns == 1_754_049_600 * 10**9 and parser.account.left_out == left_out
    parsed(parser, mavlink_frame(295, struct.pack("<ffhBB", 90.0, 12.0, 2000, 0, 3)))
    assert parser.account.refused == {"AIRSPEED of a sensor reported unhealthy": 1}
    np.testing.assert_allclose(np.diag(found["gps/fix"][0].cov_n), [0.72, 0.72, 3.61])
    assert found["gps/fix"][0].height == 472.0 and found["air/velocity"][0].vel_b[0] > 50.0


def test_an_autopilot_that_was_started_anew_is_followed():
    parser = mavlink.MavlinkParser()
    parsed(parser, b"".join(mavlink_frames()))
    early = mavlink_frame(105, struct.pack("<Q13fH", 1_000_000, 0.1, 0.2, -9.8, *[0.0] * 10, 0x1FFF))
    found = by_source(parsed(parser, early))
    assert found["imu/data_raw"][0].stamp_ns == 10**9 and "stepped back" in parser.account.remarks[0]


@pytest.mark.parametrize(
    ("kind", "said"), [(1, ""), (2, "multicopter"), (4, "helicopter"), (10, "ground vehicle"), (11, "boat"), (12, "submarine"), (20, "")]
)
def test_a_log_of_another_vehicle_is_said_to_be_one(kind, said):
    parser = mavlink.MavlinkParser()
    parsed(parser, 3 * mavlink_frame(0, struct.pack("<IBBBBB", 0, kind, 3, 81, 4, 3)))
    assert len(parser.account.remarks) == bool(said) and said in "".join(parser.account.remarks)


@pytest.mark.parametrize(
    ("firmware", "said"),
    [(b"ArduPlane V4.3", ""), (b"ArduCopter V4.3", "multicopter"), (b"APM:Rover", "ground vehicle"), (b"ArduSub V4", "submarine")]
    + [(b"ATC_RAT_RLL_P", "multicopter"), (b"ArduPlane V4.3 Q_A_RAT_RLL_P", "")],
)
def test_the_firmware_names_the_vehicle(firmware, said):
    account = Account()
    remark_firmware(account, bytes(20) + firmware + bytes(20))
    assert len(account.remarks) == bool(said) and said in "".join(account.remarks)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [("235959.00,060419", "000000.00,220899", "week number rolled over"), ("120020.00,010825", "120003.00,010825", "leap seconds"),
     ("120520.00,010825", "120003.00,010825", "317.0 s; what")],
)  # fmt: skip
def test_a_clock_that_steps_back_is_said_with_what_it_may_be(before, after, said):
    parser = nmea.NmeaParser()
    for written in (before, after):
        time, date = written.split(",")
        parsed(parser, sentence(f"GPRMC,{time},A,3741.6000,N,12149.2000,W,95.0,273.4,{date},,,A"))
    assert said in parser.account.remarks[0]


@pytest.mark.parametrize(("frames", "said"), [(mavlink_frames()[:1], ""), (nmea_frames(), "No inertial samples and no attitude")])
def test_what_a_log_lacks_is_said(tmp_path, frames, said):
    from drivers import inertial

    frames = frames if said else [*frames, *(inertial(1_000_000 + 20_000 * k) for k in range(100))]
    said = said or "No GPS: a navigator has no starting position"
    (tmp_path / "log").write_bytes(b"".join(frames))
    assert said in str(convert_any(tmp_path / "log", tmp_path / "bag"))


@pytest.mark.parametrize("name", PARSERS)
def test_mutated_streams(name):
    result = fuzz(name, 200)
    assert not result["raised"] and result["out_of_step"] == 0 and result["measurements"] > 200


def test_a_value_beyond_what_a_sensor_can_measure_goes_no_further_though_its_check_sum_is_right():
    checked, parser = CheckedRecords(), mavlink.MavlinkParser()
    parsed(parser, mavlink_frames()[0])
    hot = mavlink_frame(105, struct.pack("<Q13fH", 11_000_000, 0.1, 0.2, -9.8, 400.0, *[0.0] * 9, 0x1FFF))
    assert [checked.of(one) for one in parsed(parser, hot)] == [[]]
    assert checked.refused() == {"imu/data_raw: angular rate implausible, degrees per second?": 1}
