"""Decoding: every bad input has its reason, no buffer raises, the fast path equals the careful one to the last bit."""

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.base import measurements as m
from lowcostnav_ros.messages import decode as d
from lowcostnav_ros.messages import encode as e
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.store import STORE, to_cdr
from lowcostnav_ros.physics.earth import LocalFrame

STAMP = 1_700_000_000_123_456_789
EYE = np.eye(3)
ROOT = np.array([[2.0, 0.3, 0.1], [0.0, 1.0, -0.4], [0.0, 0.0, 3.0]])
COV = ROOT @ ROOT.T
Q = np.array([0.8, 0.2, -0.4, 0.4])
RATE, FORCE = np.array([0.1, -0.2, 0.3]), np.array([0.5, -0.6, -9.7])


def again(message, source):
    return d.decode(source, message.__msgtype__, to_cdr(message))


def changed(message, **paths):
    """Set dotted attributes of a message object (``__`` for the dot)."""
    for path, value in paths.items():
        *heads, leaf = path.split("__")
        target = message
        for head in heads:
            target = getattr(target, head)
        object.__setattr__(target, leaf, value)
    return message


def covariance(*diagonal, **entries):
    out = np.diag(np.array(diagonal, float)).ravel()
    for key, value in entries.items():
        out[int(key[1:])] = value
    return out


def yaw_variance(value):
    return np.diag([1e6] * 5 + [value]).ravel()


BUILD = {
    "imu/data_raw": lambda: e.imu_raw(STAMP, FORCE, RATE),
    "imu/data": lambda: e.imu_attitude(m.Attitude(STAMP, "imu/data", Q, 1e-4 * COV, RATE, FORCE)),
    "imu/mag": lambda: e.encode(m.MagneticField(STAMP, "imu/mag", np.array([2e-5, 1e-6, 4e-5]), 1e-14 * COV)),
    "gps/fix": lambda: e.encode(m.GpsPosition(STAMP, "gps/fix", 0.65, -2.1, 500.0, COV)),
    "gps/vel": lambda: e.encode(m.GpsVelocity(STAMP, "gps/vel", np.array([1.0, 2.0, 3.0]), COV)),
    "air/velocity": lambda: e.encode(m.AirVelocity(STAMP, "air/velocity", np.array([50.0, 1.0, 2.0]), COV)),
    "air/static_pressure": lambda: e.encode(m.Pressure(STAMP, "air/static_pressure", 95000.0, 100.0)),
    "air/dynamic_pressure": lambda: e.encode(m.Pressure(STAMP, "air/dynamic_pressure", 1500.0, 100.0)),
    "air/temperature": lambda: e.encode(m.AirTemperature(STAMP, "air/temperature", 280.0, 1.0)),
    "dme/range": lambda: e.encode(m.SlantRange(STAMP, "dme/range", "OAK", 40000.0, 1e5)),
    "vor/bearing": lambda: e.encode(m.VorBearing(STAMP, "vor/bearing", "OAK", 4.0, 3e-4)),
}

BAD = [
    ("imu/data_raw", {"header__stamp__sec": 0, "header__stamp__nanosec": 0}, "stamp is zero"),
    ("imu/data_raw", {"header__stamp__nanosec": 2_000_000_000}, "stamp out of range"),
    ("imu/data_raw", {"header__frame_id": "map"}, "wrong frame id"),
    ("imu/data_raw", {"angular_velocity__x": math.nan}, "angular rate is not finite"),
    ("imu/data_raw", {"angular_velocity__x": 57.3}, "angular rate implausible, degrees per second?"),
    ("imu/data_raw", {"linear_acceleration__z": math.inf}, "specific force is not finite"),
    ("imu/data_raw", {"linear_acceleration__z": 9807.0}, "specific force implausible"),
    ("imu/data_raw", {"linear_acceleration_covariance": covariance(-1, 0, 0)}, "specific force is absent"),
    ("imu/data_raw", {"angular_velocity_covariance": covariance(-1, 0, 0)}, "angular rate is absent"),
    ("imu/data", {"orientation_covariance": covariance(-1, 0, 0)}, "orientation is absent"),
    (
        "imu/data",
        {"orientation__w": 0.0, "orientation__x": 0.0, "orientation__y": 0.0, "orientation__z": 0.0},
        "orientation is a zero quaternion",
    ),
    ("imu/data", {"orientation__w": 1.5}, "orientation is not a unit quaternion"),
    ("imu/data", {"orientation__w": math.nan}, "orientation is not finite"),
    ("imu/mag", {"magnetic_field__x": 0.48}, "magnetic field implausible, gauss instead of tesla?"),
    ("imu/mag", {"magnetic_field__x": 48.0}, "magnetic field implausible, microtesla instead of tesla?"),
    ("imu/mag", {"magnetic_field__x": 480.0}, "magnetic field implausible, milligauss instead of tesla?"),
    ("imu/mag", {"magnetic_field__x": 48000.0}, "magnetic field implausible, nanotesla instead of tesla?"),
    ("gps/fix", {"status__status": -1}, "no fix"),
    ("gps/fix", {"latitude": 91.0}, "latitude out of range"),
    ("gps/fix", {"longitude": -237.0}, "longitude out of range"),
    ("gps/fix", {"altitude": math.inf}, "position is not finite"),
    ("gps/fix", {"altitude": math.nan, "latitude": math.nan}, "position is not finite"),
    ("gps/fix", {"latitude": 0.0, "longitude": 0.0}, "position is exactly 0, 0"),
    ("gps/fix", {"position_covariance": covariance(1, math.nan, 1)}, "position covariance is not finite"),
    ("gps/fix", {"position_covariance": covariance(1, 1e308, 1)}, "position covariance is absurd"),
    ("gps/fix", {"position_covariance": covariance(1, 1, 1, _1=0.5)}, "position covariance is asymmetric"),
    ("gps/fix", {"position_covariance": covariance(1, 1, 1, _1=2, _3=2)}, "position covariance is not positive"),
    ("gps/fix", {"position_covariance": covariance(1, 0, 1)}, "position covariance has a zero variance"),
    ("gps/vel", {"header__frame_id": "base_link"}, "wrong frame id"),
    ("gps/vel", {"twist__twist__linear__x": 1e4}, "velocity implausible"),
    ("air/velocity", {"header__frame_id": "map"}, "wrong frame id"),
    ("air/velocity", {"twist__twist__linear__x": -60.0}, "airspeed is negative"),
    ("air/static_pressure", {"fluid_pressure": -1.0}, "pressure is negative"),
    ("air/static_pressure", {"fluid_pressure": 1013.25}, "pressure implausible, hectopascal instead of pascal?"),
    ("air/static_pressure", {"fluid_pressure": 29.92}, "pressure implausible, kilopascal or inches of mercury instead of pascal?"),
    ("air/static_pressure", {"variance": -4.0}, "pressure variance is negative"),
    ("air/dynamic_pressure", {"fluid_pressure": -5000.0}, "pressure is negative"),
    ("air/temperature", {"temperature": 288.0}, "temperature implausible, kelvin instead of degrees Celsius?"),
    ("dme/range", {"range": -1.0}, "range is negative"),
    ("dme/range", {"range": 500_000.0}, "range is beyond the station's maximum"),
    ("dme/range", {"range": math.nan}, "range is not finite"),
    ("dme/range", {"header__frame_id": ""}, "station ident missing"),
    ("vor/bearing", {"header__frame_id": " "}, "station ident missing"),
    ("vor/bearing", {"pose__pose__orientation__z": 0.0, "pose__pose__orientation__w": 0.0}, "orientation is a zero quaternion"),
    ("vor/bearing", {"pose__pose__orientation__z": math.nan}, "orientation is not finite"),
    ("vor/bearing", {"pose__pose__orientation__w": 1.5}, "orientation is not a unit quaternion"),
    ("vor/bearing", {"pose__pose__orientation__x": 0.05}, "roll or pitch is not zero, not a bearing?"),
    ("vor/bearing", {"pose__pose__position__x": 3.0}, "position is not zero, not a bearing?"),
    ("vor/bearing", {"pose__pose__position__x": math.inf}, "position is not finite"),
    ("vor/bearing", {"pose__covariance": yaw_variance(-1e-4)}, "bearing variance is negative"),
    ("vor/bearing", {"pose__covariance": yaw_variance(0.0)}, "bearing covariance has a zero variance"),
    ("vor/bearing", {"pose__covariance": yaw_variance(math.nan)}, "bearing variance is not finite"),
    ("vor/bearing", {"pose__covariance": yaw_variance(1.0)}, "bearing variance implausible, square degrees instead of square radians?"),
    ("vor/bearing", {"pose__covariance": yaw_variance(1e40)}, "bearing variance is absurd"),
]


def test_longitudes_counted_from_0_to_360_are_those_of_the_west():
    west = again(changed(BUILD["gps/fix"](), longitude=237.5), "gps/fix")
    assert math.degrees(west.lon) == pytest.approx(-122.5)


@pytest.mark.parametrize(("source", "change", "reason"), BAD, ids=[f"{s}: {r}" for s, _, r in BAD])
def test_bad_input_has_its_reason(source, change, reason):
    result = again(changed(BUILD[source](), **change), source)
    assert isinstance(result, d.Rejected), result
    assert (result.source, result.reason) == (source, reason)


FIELDS = {
    "imu/data": ("q_nb", "cov_att", "angular_rate_b", "specific_force_b"),
    "imu/mag": ("field_b", "cov_b"),
    "gps/fix": ("lat", "lon", "height", "cov_n"),
    "gps/vel": ("vel_n", "cov_n"),
    "air/velocity": ("vel_b", "cov_b"),
    "air/static_pressure": ("pressure_pa", "variance"),
    "air/dynamic_pressure": ("pressure_pa", "variance"),
    "air/temperature": ("temperature_k", "variance"),
    "dme/range": ("station", "range_m", "variance"),
    "vor/bearing": ("station", "bearing_rad", "variance"),
}


def test_measurements_survive_the_message():
    sent = [
        m.Attitude(STAMP, "imu/data", Q, 1e-4 * COV, RATE, FORCE),
        m.MagneticField(STAMP, "imu/mag", np.array([2e-5, 1e-6, 4e-5]), 1e-14 * COV),
        m.GpsPosition(STAMP, "gps/fix", 0.65, -2.1, 500.0, COV),
        m.GpsVelocity(STAMP, "gps/vel", np.array([1.0, 2.0, 3.0]), COV),
        m.AirVelocity(STAMP, "air/velocity", np.array([50.0, 1.0, 2.0]), COV),
        m.Pressure(STAMP, "air/static_pressure", 95000.0, 100.0),
        m.AirTemperature(STAMP, "air/temperature", 280.0, 1.0),
        m.SlantRange(STAMP, "dme/range", "OAK", 40000.0, 1e5),
        m.VorBearing(STAMP, "vor/bearing", "OAK", 4.0, 3e-4),
    ]
    for measurement in sent:
        ((stamp, topic, msgtype, raw),) = e.encode_cdr(measurement)
        back = d.decode("/" + topic, msgtype.replace("/msg/", "/"), raw)
        assert (type(back), back.stamp_ns, stamp, back.source) == (type(measurement), STAMP, STAMP, measurement.source)
        for name in FIELDS[measurement.source]:
            value, expected = getattr(back, name), getattr(measurement, name)
            if isinstance(expected, str):
                assert value == expected
            else:
                np.testing.assert_allclose(value, expected, rtol=1e-7 if name == "range_m" else 4e-15, atol=0)


@given(st.floats(0.0, 2.0 * math.pi, exclude_max=True), st.floats(1e-8, 0.1))
def test_every_radial_survives_the_message_and_stays_on_the_compass_rose(radial, variance):
    back = again(e.encode(m.VorBearing(STAMP, "vor/bearing", "OAK", radial, variance)), "vor/bearing")
    assert 0.0 <= back.bearing_rad < 2.0 * math.pi
    assert math.remainder(back.bearing_rad - radial, 2.0 * math.pi) == pytest.approx(0.0, abs=2e-15)
    assert (back.station, back.variance) == ("OAK", variance)


def test_the_yaw_of_a_radial_is_counted_from_east_counter_clockwise():
    for radial_deg, yaw_deg in ((0.0, 90.0), (90.0, 0.0), (180.0, -90.0), (270.0, 180.0), (45.0, 45.0)):
        message = e.encode(m.VorBearing(STAMP, "vor/bearing", "OAK", math.radians(radial_deg), 1e-4))
        q = message.pose.pose.orientation
        assert 2.0 * math.degrees(math.atan2(q.z, q.w)) == pytest.approx(yaw_deg)
        assert (message.header.frame_id, message.pose.covariance[35]) == ("OAK", 1e-4)
        assert min(message.pose.covariance[0], message.pose.covariance[7], message.pose.covariance[14]) >= m.UNKNOWN_VARIANCE


def test_a_bearing_of_unknown_variance_takes_that_of_a_degree():
    decoder = d.Decoder()
    message = changed(BUILD["vor/bearing"](), pose__covariance=np.zeros(36))
    assert math.degrees(math.sqrt(decoder.decode("vor/bearing", topics.POSE, to_cdr(message)).variance)) == pytest.approx(1.0, abs=0.01)
    assert decoder.notes == {"vor/bearing: covariance unknown, default used": 1}


def test_unknown_covariance_takes_the_default_and_says_so():
    decoder = d.Decoder()
    message = changed(BUILD["gps/fix"](), position_covariance=np.zeros(9))
    fix = decoder.decode("gps/fix", topics.NAV_SAT_FIX, to_cdr(message))
    np.testing.assert_array_equal(fix.cov_n, np.diag([9.0, 9.0, 25.0]))
    assert decoder.notes == {"gps/fix: covariance unknown, default used": 1}
    strict = d.decode("gps/fix", topics.NAV_SAT_FIX, to_cdr(message), d.DecodeRules(default_variances={}))
    assert strict.reason == "covariance is unknown and no default is set"


NO_VERTICAL = [
    ({"altitude": math.nan}, "gps/fix: no altitude, horizontal position used", 2.0),
    ({"altitude": math.nan, "position_covariance": covariance(2, 3, math.nan)}, "gps/fix: no altitude, horizontal position used", 3.0),
    ({"altitude": math.nan, "position_covariance_type": 0}, "gps/fix: no altitude, horizontal position used", 9.0),
    ({"position_covariance": covariance(2, 3, 0)}, "gps/fix: no vertical variance, horizontal position used", 3.0),
    ({"position_covariance": covariance(2, 3, 1e6)}, "gps/fix: no vertical variance, horizontal position used", 3.0),
]


@pytest.mark.parametrize(("change", "note", "north"), NO_VERTICAL)
def test_a_fix_without_height_is_a_horizontal_one(change, note, north):
    decoder = d.Decoder()
    fix = decoder.decode("gps/fix", topics.NAV_SAT_FIX, to_cdr(changed(BUILD["gps/fix"](), **change)))
    assert (fix.lat, fix.lon, fix.has_height) == (pytest.approx(0.65), pytest.approx(-2.1), False)
    assert decoder.notes[note] == 1
    assert math.isfinite(fix.height)
    assert np.all(np.linalg.eigvalsh(fix.cov_n) > 0.0)
    if "position_covariance" in change or "position_covariance_type" in change:
        assert fix.cov_n[0, 0] == north


def test_a_covariance_of_unknown_type_is_not_looked_at():
    decoder = d.Decoder()
    message = changed(BUILD["gps/fix"](), position_covariance=np.full(9, math.nan), position_covariance_type=0)
    np.testing.assert_array_equal(decoder.decode("gps/fix", topics.NAV_SAT_FIX, to_cdr(message)).cov_n, np.diag([9.0, 9.0, 25.0]))


@pytest.mark.parametrize("values", [covariance(0.02, 0.02, 0), covariance(1, -2, 1), np.full(9, math.nan), covariance(1, 1, 1e308)])
def test_inertial_covariances_that_no_filter_uses_are_no_reason_to_refuse(values):
    plain = BUILD["imu/data_raw"]()
    odd = changed(BUILD["imu/data_raw"](), angular_velocity_covariance=values, linear_acceleration_covariance=values)
    block, rejected = d.decode_imu_block([to_cdr(plain), to_cdr(odd)])
    assert not rejected
    np.testing.assert_array_equal(block.specific_force_b[0], block.specific_force_b[1])
    np.testing.assert_array_equal(again(odd, "imu/data_raw").angular_rate_b, block.angular_rate_b[1:])
    attitude = changed(BUILD["imu/data"](), angular_velocity_covariance=values)
    np.testing.assert_array_equal(again(attitude, "imu/data").q_nb, again(BUILD["imu/data"](), "imu/data").q_nb)


def test_absent_acceleration_of_a_foreign_ahrs_is_replaced_by_unaccelerated_flight():
    message = e.imu_attitude(m.Attitude(STAMP, "imu/data", np.array([1.0, 0, 0, 0]), EYE, RATE, np.zeros(3)), specific_force_known=False)
    decoder = d.Decoder()
    attitude = decoder.decode("imu/data", topics.IMU, to_cdr(message))
    np.testing.assert_allclose(attitude.specific_force_b, [0, 0, -9.80665], atol=1e-12)
    assert list(decoder.notes) == ["imu/data: specific force absent, that of unaccelerated flight used"]


def test_wrong_type_and_unknown_topic_are_named():
    raw = to_cdr(BUILD["gps/fix"]())
    assert d.decode("gps/vel", topics.NAV_SAT_FIX, raw).reason == "wrong message type"
    assert d.decode("camera/image", "sensor_msgs/msg/Image", raw).reason == "unknown topic"


def test_prefixed_frame_id_is_accepted():
    assert isinstance(again(changed(BUILD["imu/data_raw"](), header__frame_id="uav1/imu_link"), "imu/data_raw"), m.ImuBlock)


@given(st.sampled_from(sorted(BUILD)), st.binary(max_size=400))
def test_random_bytes_never_raise(source, raw):
    result = d.decode(source, BUILD[source]().__msgtype__, raw)
    assert isinstance(result, d.Rejected | m.Measurement)


@given(st.sampled_from(sorted(BUILD)), st.data())
def test_truncated_and_scribbled_messages_never_raise_nor_give_nan(source, data):
    raw = bytearray(to_cdr(BUILD[source]()))
    raw = raw[: data.draw(st.integers(0, len(raw)))]
    for _ in range(data.draw(st.integers(0, 6)) if raw else 0):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    result = d.decode(source, BUILD[source]().__msgtype__, bytes(raw))
    if isinstance(result, m.Measurement):
        for name in FIELDS.get(source, ("specific_force_b", "angular_rate_b")):
            value = getattr(result, name)
            assert isinstance(value, str) or np.all(np.isfinite(value))


ORIGIN = LocalFrame(0.6, -2.0, 10.0)
SOLUTION = m.NavSolution(STAMP, "ins_gps", 0.62, -2.02, 2500.0, np.array([40.0, -30.0, 2.0]), Q, RATE, FORCE, 1e3 * COV, COV, 1e-4 * COV)
NAVIGATION = {
    "ins_gps/odometry_fused": e.odometry_from_solution(SOLUTION, ORIGIN),
    "ins_gps/fix": e.fix_from_solution(SOLUTION),
    "ins_gps/wind": e.wind_message(STAMP, np.array([3.0, -7.0]), np.eye(2)),
    "truth/imu": e.imu_from_solution(SOLUTION),
}


@given(st.sampled_from(sorted(NAVIGATION)), st.data())
def test_scribbled_solutions_never_raise_nor_give_nan(source, data):
    raw = bytearray(to_cdr(NAVIGATION[source]))
    for _ in range(data.draw(st.integers(0, 6))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.sampled_from([0, 1, 63, 127, 128, 191, 240, 255]))
    result = d.decode(source, NAVIGATION[source].__msgtype__, bytes(raw), d.DecodeRules(origins={"ins_gps": ORIGIN}))
    if isinstance(result, d.Rejected):
        return
    for name in ("lat", "lon", "height", "vel_n", "q_nb", "angular_rate_b", "cov_pos", "cov_vel", "cov_att", "wind_n", "cov_wind"):
        value = getattr(result, name, None)
        assert value is None or np.all(np.isfinite(value)), name


def imu_messages(seed, n):
    """Random inertial messages: different frame ids, sometimes big-endian, sometimes bad, with scribbled padding."""
    rng = np.random.default_rng(seed)
    out = []
    for k in range(n):
        message = e.imu_raw(STAMP + k, rng.normal(size=3), rng.normal(size=3), rng.choice(["imu_link", "base_link", "a/imu_link"]))
        kind = rng.integers(8)
        if kind == 0:
            object.__setattr__(message.angular_velocity, "y", rng.choice([np.nan, np.inf, 100.0]))
        elif kind == 1:
            object.__setattr__(message, "angular_velocity_covariance", covariance(*rng.choice([1e-4, -1.0, 0.0], 3)))
        elif kind == 2:
            object.__setattr__(message, "linear_acceleration_covariance", np.tile(rng.choice([1e-4, 1e308]), 9))
        raw = STORE.serialize_cdr(message, message.__msgtype__, little_endian=bool(kind != 3))
        out.append(bytes(raw) + b"\0" * (3 if kind == 4 else 0))
    return out


@pytest.mark.parametrize("seed", range(5))
def test_columns_equal_the_careful_decoder_to_the_bit(seed):
    raws = imu_messages(seed, 60)
    kind = topics.spec("imu/data_raw")
    careful = [d._carefully(raw, kind, d.RULES, Counter()) for raw in raws]
    single = [d.decode("imu/data_raw", topics.IMU, memoryview(raw)) for raw in raws]
    block, rejected = d.decode_imu_block(raws)
    good = [x for x in careful if isinstance(x, m.ImuBlock)]
    assert 10 < len(good) < 60
    assert [(x.reason, x.stamp_ns) for x in rejected] == [(x.reason, x.stamp_ns) for x in careful if isinstance(x, d.Rejected)]
    for name in ("stamps_ns", "specific_force_b", "angular_rate_b"):
        expected = np.concatenate([getattr(x, name) for x in good])
        assert getattr(block, name).tobytes() == expected.tobytes()
        assert np.concatenate([getattr(x, name) for x in single if isinstance(x, m.ImuBlock)]).tobytes() == expected.tobytes()
    assert [type(x) for x in single] == [type(x) for x in careful]


@given(st.floats(0.991, 1.009), st.floats(-0.9, 0.9), st.integers(0, 4))
def test_fast_attitude_equals_the_careful_one_to_the_bit(norm, correlation, kind):
    cov = np.array([[1.0, correlation, 0.0], [correlation, 2.0, 0.0], [0.0, 0.0, 3.0]]) * (np.nan if kind == 1 else 1e-4)
    message = e.imu_attitude(m.Attitude(STAMP, "imu/data", Q, cov, RATE, FORCE), specific_force_known=kind != 2)
    object.__setattr__(message.orientation, "w", message.orientation.w * norm * (1.5 if kind == 3 else 1.0))
    raw = to_cdr(message)
    big = bytes(STORE.serialize_cdr(message, message.__msgtype__, little_endian=False))  # only the careful decoder reads this one
    one, other = d.decode("imu/data", topics.IMU, raw), d.decode("imu/data", topics.IMU, big)
    assert type(one) is type(other)
    if isinstance(one, d.Rejected):
        assert one == other
        return
    for name in FIELDS["imu/data"]:
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


def test_solution_survives_the_odometry_message_far_from_the_origin():
    origin = LocalFrame(0.6, -2.0, 10.0)
    sent = m.NavSolution(STAMP, "ins_gps", 0.62, -2.02, 2500.0, np.array([40.0, -30.0, 2.0]), Q, RATE, FORCE, 1e7 * COV, COV, 1e-4 * COV)
    decoder = d.Decoder()
    raw = to_cdr(e.odometry_from_solution(sent, origin))
    assert decoder.decode("ins_gps/odometry_fused", topics.ODOMETRY, raw).reason == "map origin is not known yet"
    decoder.decode("ins_gps/origin", topics.NAV_SAT_FIX, to_cdr(e.origin_fix(STAMP, origin)))
    back = decoder.decode("ins_gps/odometry_fused", topics.ODOMETRY, raw)
    np.testing.assert_allclose([back.lat, back.lon], [sent.lat, sent.lon], rtol=0, atol=1e-14)
    assert back.height == pytest.approx(2500.0, abs=1e-7)
    np.testing.assert_allclose(back.vel_n, sent.vel_n, atol=1e-12)
    assert abs(back.q_nb @ Q) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_array_equal(back.angular_rate_b, RATE)
    for name in ("cov_pos", "cov_vel", "cov_att"):
        np.testing.assert_allclose(getattr(back, name), getattr(sent, name), rtol=1e-11, atol=1e-13)


def test_what_a_solution_lacks_stays_none():
    origin = LocalFrame(0.6, -2.0, 10.0)
    sent = m.NavSolution(STAMP, "x", 0.6, -2.0, 300.0, np.array([40.0, -30.0, 2.0]), cov_pos=EYE, cov_vel=COV)
    decoder = d.Decoder(d.DecodeRules(origins={"x": origin}))
    back = decoder.decode("x/odometry", topics.ODOMETRY, to_cdr(e.odometry_from_solution(sent, origin)))
    assert back.q_nb is None
    assert back.angular_rate_b is None
    assert back.cov_att is None
    np.testing.assert_allclose(back.vel_n, sent.vel_n, atol=1e-13)
    np.testing.assert_allclose(back.cov_vel, COV, atol=1e-13)


def test_wind_keeps_its_axes():
    message = e.wind_message(STAMP, np.array([3.0, -7.0]), np.array([[1.0, 0.2], [0.2, 2.0]]))
    assert (message.twist.twist.linear.x, message.twist.twist.linear.y) == (-7.0, 3.0)  # from the east: westward, and northward
    back = again(message, "dead_reckoning/wind")
    np.testing.assert_array_equal(back.wind_n, [3.0, -7.0])
    np.testing.assert_array_equal(back.cov_wind, [[1.0, 0.2], [0.2, 2.0]])
    assert back.states is None
    truth = again(e.wind_message(STAMP, np.array([3.0, -7.0, 0.5]), np.zeros((3, 3))), "truth/wind")
    assert truth.states == {"wind_down_mps": (0.5, 0.0)}
