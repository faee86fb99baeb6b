"""Every topic against the conventions of ROS: names, frames, SI units, axes (REP-103, 105, 145, 147), covariances of what is not known.

The message of each topic is made of its own sample, a flight straight and level to the north, and read as a stranger would read it.
"""

import math
import re

import numpy as np
import pytest

from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.kind import find
from lowcostnav_ros.messages.samples import Instant
from lowcostnav_ros.messages.store import from_cdr, to_cdr
from lowcostnav_ros.messages.topics import (
    DIAGNOSTICS,
    FLUID_PRESSURE,
    IMU,
    MAGNETIC_FIELD,
    NAV_SAT_FIX,
    ODOMETRY,
    POSE,
    RANGE,
    TEMPERATURE,
    TWIST,
)
from lowcostnav_ros.physics.earth import LocalFrame

NAMES = [*topics.TOPICS, *(f"nav/{part}" for part in topics.NAVIGATOR_TOPICS)]
STANDARD = {"base_link", "map", "imu_link", "gps", ""}
UNITS = {"m", "m/s", "m/s^2", "m^2", "rad", "rad/s", "Pa", "K", "T", "s", "deg", "deg C", ""}
YAW_NORTH = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))  # x y z w: the nose of a level aircraft points to +y of an east-north-up world


def message_of(name):
    """What is published on a topic, through its bytes; None for what has no sample."""
    kind = topics.spec(name)
    if kind.sample is None:
        return kind, None
    at = Instant(0, name)
    sample = kind.sample(at)
    if kind.msgtype == ODOMETRY:
        message = encode.odometry_from_solution(sample, LocalFrame(*at.place))
    elif name.endswith("/origin"):
        message = encode.origin_fix(at.stamp_ns, LocalFrame(*at.place))
    elif kind.encode_many is not None:
        return kind, from_cdr(kind.encode_many(sample)[0], kind.msgtype)
    else:
        message = kind.encode(sample)
    return kind, from_cdr(to_cdr(message), kind.msgtype)


@pytest.mark.parametrize("name", NAMES)
def test_a_topic_has_a_name_a_type_a_unit_and_a_frame_that_other_tools_know(name):
    kind, message = message_of(name)
    assert re.fullmatch(r"[a-z][a-z0-9_]*(/[a-z][a-z0-9_]*)?", name) and kind.msgtype.split("/")[0].endswith("_msgs")
    assert set(kind.unit.split(", ")) <= UNITS and kind.description.endswith(".") and kind.frame in STANDARD
    degrees = {NAV_SAT_FIX: {"deg"}, TEMPERATURE: {"deg C"}}.get(kind.msgtype, set())  # as those messages are defined
    assert {unit for unit in kind.unit.split(", ") if unit.startswith("deg")} == degrees
    if message is not None and kind.msgtype != DIAGNOSTICS:
        stamp = message.header.stamp
        assert 0 <= stamp.nanosec < 10**9 and stamp.sec > 0 and not message.header.frame_id.startswith("/")
        if kind.msgtype in (RANGE, POSE):  # of a station, which it names
            assert message.header.frame_id
        else:
            assert message.header.frame_id == kind.frame


def of_type(msgtype):
    return [name for name in NAMES if topics.spec(name).msgtype == msgtype]


@pytest.mark.parametrize("name", of_type(IMU))
def test_imu_messages_are_forward_left_up_and_say_what_they_do_not_know(name):
    _, imu = message_of(name)
    force, orientation = imu.linear_acceleration, imu.orientation
    if imu.linear_acceleration_covariance[0] != -1.0:  # REP-145: gravity is in it, +9.8 on z at rest
        assert (force.x, force.y) == pytest.approx((0.0, 0.0), abs=0.5) and 9.0 < force.z < 10.6
    if name == "imu/data_raw":
        assert imu.orientation_covariance[0] == -1.0
    else:
        assert imu.orientation_covariance[0] >= 0.0
        q = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
        assert abs(abs(q @ YAW_NORTH) - 1.0) < 1e-9
    for cov in (imu.orientation_covariance, imu.angular_velocity_covariance, imu.linear_acceleration_covariance):
        assert cov[0] == -1.0 or is_covariance(np.reshape(cov, (3, 3)))


@pytest.mark.parametrize("name", of_type(ODOMETRY))
def test_odometry_is_east_north_up_in_map_and_forward_left_up_in_base_link(name):
    _, odometry = message_of(name)
    pose, twist = odometry.pose.pose, odometry.twist.twist
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("map", "base_link")
    q = np.array([pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w])
    assert abs(abs(q @ YAW_NORTH) - 1.0) < 1e-9
    assert (twist.linear.x, twist.linear.y, twist.linear.z) == pytest.approx((50.0, 0.0, 0.0), abs=1e-6)  # forward
    assert all(is_covariance(np.reshape(one.covariance, (6, 6))) for one in (odometry.pose, odometry.twist))


@pytest.mark.parametrize("name", of_type(NAV_SAT_FIX))
def test_fixes_are_in_degrees_above_the_ellipsoid_with_the_kind_of_their_covariance(name):
    _, fix = message_of(name)
    assert (fix.latitude, fix.longitude) == pytest.approx((37.689, -121.822), abs=0.01) and fix.altitude == pytest.approx(500.0, abs=1.0)
    assert fix.status.status >= 0 and is_covariance(np.reshape(fix.position_covariance, (3, 3)))
    assert (fix.position_covariance_type == 0) == (not np.any(fix.position_covariance))


@pytest.mark.parametrize("name", of_type(TWIST))
def test_velocities_have_a_covariance_and_no_rate_that_was_not_measured(name):
    _, twist = message_of(name)
    cov = np.reshape(twist.twist.covariance, (6, 6))
    assert is_covariance(cov) and np.all(np.diag(cov)[3:] >= 1e6)
    wind_or_ground = name.endswith(("wind", "wind_fused"))
    assert wind_or_ground or math.hypot(twist.twist.twist.linear.x, twist.twist.twist.linear.y) > 30.0


def test_pressures_temperatures_and_fields_are_in_the_units_of_their_messages():
    assert all(10_000.0 < message_of(name)[1].fluid_pressure < 110_000.0 for name in ("air/static_pressure",))
    assert 0.0 < message_of("air/dynamic_pressure")[1].fluid_pressure < 10_000.0
    assert {*of_type(FLUID_PRESSURE)} == {"air/static_pressure", "air/dynamic_pressure"}
    assert all(-60.0 < message_of(name)[1].temperature < 60.0 for name in of_type(TEMPERATURE))
    for name in of_type(MAGNETIC_FIELD):
        field = message_of(name)[1].magnetic_field
        assert 2e-5 < math.sqrt(field.x**2 + field.y**2 + field.z**2) < 7e-5
        assert field.x > 0.0 and field.z < 0.0  # to the north and, on the northern half of the earth, into the ground


def test_what_is_not_estimated_is_marked_and_never_a_nan():
    from lowcostnav_ros.base.measurements import NavSolution

    bare = NavSolution(10**18, "nav")
    odometry = encode.odometry_from_solution(bare, LocalFrame(0.6, -2.0, 0.0))
    assert np.diag(np.reshape(odometry.pose.covariance, (6, 6))).min() >= 1e12
    assert np.isfinite(odometry.pose.covariance).all() and np.isfinite(odometry.twist.covariance).all()
    assert encode.fix_from_solution(bare).status.status == -1


def test_a_further_instance_keeps_the_conventions_of_its_kind():
    assert find("gps2/fix", {}) is topics.TOPICS["gps/fix"]


def is_covariance(matrix):
    return np.allclose(matrix, matrix.T) and np.linalg.eigvalsh(matrix).min() > -1e-9 * max(np.abs(matrix).max(), 1.0)


def test_sensors_are_published_reliably_and_taken_best_effort():
    pytest.importorskip("rclpy")
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    from lowcostnav_ros.ros import qos

    sensor, fixed = topics.spec("imu/data_raw"), topics.spec("nav/origin")
    sent, taken = qos.for_publisher(sensor, False), qos.for_subscription(sensor, False)
    assert (sent.reliability, taken.reliability) == (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)  # REP-2003: anybody matches
    assert qos.for_publisher(fixed, False).durability == DurabilityPolicy.TRANSIENT_LOCAL
