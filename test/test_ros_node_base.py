"""What every node does: counts and names bad messages, answers reset, reports a sensor that stops or cannot be heard."""

import math
import time

import pytest

pytest.importorskip("rclpy")

from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from lowcostnav_ros.ros.node_base import NodeBase


class Listener(NodeBase):
    """Keeps the inertial samples it gets."""

    def __init__(self, **kwargs) -> None:
        super().__init__("listener", **kwargs)
        self.samples = []
        self.listen("imu/data_raw", self.samples.append, required=True)


def imu(stamp_s: float, frame: str = "imu_link", rate_x: float = 0.01, force_z: float = 9.81) -> Imu:
    message = Imu()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = int(stamp_s), round(1e9 * (stamp_s % 1.0))
    message.orientation_covariance[0] = -1.0
    message.angular_velocity.x, message.linear_acceleration.z = rate_x, force_z
    return message


def wired(ros, **parameters):
    node = ros.make(Listener, **parameters)
    publisher = ros.probe.create_publisher(Imu, "imu/data_raw", 50)
    assert ros.spin_until(lambda: publisher.get_subscription_count() == 1)
    return node, publisher


def test_a_message_becomes_a_measurement_in_frd(ros):
    node, publisher = wired(ros)
    publisher.publish(imu(12.5))
    assert ros.spin_until(lambda: node.samples)
    block = node.samples[0]
    assert block.stamp_ns == 12_500_000_000 and block.source == "imu/data_raw"
    assert block.specific_force_b[0].tolist() == [0.0, -0.0, -9.81] and block.angular_rate_b[0, 0] == 0.01


def test_bad_messages_are_counted_and_named_on_diagnostics_and_the_node_lives(ros):
    table = ros.diagnostics()
    node, publisher = wired(ros)
    for bad in (imu(1.0, rate_x=math.nan), imu(1.1, frame="map"), imu(1.2, rate_x=60.0)):
        publisher.publish(bad)
    assert ros.spin_until(lambda: node.inputs["imu/data_raw"].count == 3)
    assert not node.samples
    publisher.publish(imu(1.3))
    assert ros.spin_until(lambda: node.samples)
    assert ros.spin_until(lambda: dict_of(table.get("listener: input imu/data_raw")).get("rejected") == "3")
    values = dict_of(table["listener: input imu/data_raw"])
    reasons = " ".join(key for key in values if key.startswith("rejected["))
    assert "degrees" in reasons and "frame" in reasons and ("finite" in reasons or "NaN" in reasons)
    assert table["listener: input imu/data_raw"].level == b"\x01"


def dict_of(status) -> dict:
    return {entry.key: entry.value for entry in status.values} if status else {}


def test_a_sensor_that_stops_is_an_error_on_diagnostics_within_two_seconds(ros):
    table = ros.diagnostics()
    node, publisher = wired(ros)
    for k in range(40):
        publisher.publish(imu(1.0 + 0.01 * k))
        ros.spin_once()
    stopped = time.monotonic()
    name = "listener: input imu/data_raw"
    assert ros.spin_until(lambda: name in table and table[name].level == b"\x02", 3.0)
    assert time.monotonic() - stopped < 2.0
    assert table[name].message.startswith("imu/data_raw timed out: no data for ")


def test_reset_answers_with_a_sentence(ros):
    ros.make(Listener)
    client = ros.probe.create_client(Trigger, "/listener/reset")
    assert ros.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    assert future.result().success and future.result().message == "listener keeps no state: nothing to reset."


def test_a_best_effort_sensor_is_heard_by_default_and_named_where_lossless_cannot_hear_it(ros):
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = ros.probe.create_publisher(Imu, "imu/data_raw", best_effort)
    plain = ros.make(Listener)
    assert ros.spin_until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(imu(1.0))
    assert ros.spin_until(lambda: plain.samples)
    ros.executor.remove_node(plain)
    plain.destroy_node()
    strict = ros.make(Listener, qos__lossless=True)
    assert ros.spin_until(lambda: strict.inputs["imu/data_raw"].trouble)
    assert "reliab" in strict.inputs["imu/data_raw"].trouble.lower() and "qos.lossless" in strict.inputs["imu/data_raw"].trouble


def test_lossless_carries_every_message_of_a_flood(ros):
    node = ros.make(Listener, qos__lossless=True)
    sender = ros.make(lambda **kwargs: NodeBase("sender", **kwargs), qos__lossless=True)
    output = sender.output("imu/data_raw")
    assert ros.spin_until(lambda: output.publisher.get_subscription_count() == 1)
    from rclpy.serialization import serialize_message

    for k in range(2000):
        output.send(serialize_message(imu(1.0 + 0.01 * k)))
    assert ros.spin_until(lambda: len(node.samples) == 2000)
    assert node.inputs["imu/data_raw"].gaps == 0 and output.count == 2000


def test_a_topic_that_is_published_with_another_type_is_named(ros, domain):
    import rclpy
    from geometry_msgs.msg import Vector3Stamped

    table = ros.diagnostics()
    elsewhere = rclpy.Context()  # one participant knows one type of a topic
    rclpy.init(context=elsewhere, domain_id=domain)
    driver = rclpy.create_node("driver", context=elsewhere)
    driver.create_publisher(Vector3Stamped, "gps/vel", 10)
    node = ros.make(Listener)
    node.listen("gps/vel", node.samples.append)
    name = "listener: input gps/vel"
    assert ros.spin_until(lambda: name in table and "is published as" in table[name].message)
    expected = "gps/vel is published as geometry_msgs/msg/Vector3Stamped, expected geometry_msgs/msg/TwistWithCovarianceStamped"
    assert table[name].message.startswith(expected)
    driver.destroy_node()
    elsewhere.try_shutdown()


def test_a_handler_that_raises_is_counted_by_kind_logged_once_and_does_not_end_the_node(ros):
    node, publisher = wired(ros)
    logged = []
    node.get_logger().error = logged.append

    def fail(monitor, raw):
        raise TypeError(f"number {monitor.count}")

    node.listen_raw("imu/data_raw", fail)
    for k in range(20):
        publisher.publish(imu(1.0 + 0.01 * k))
    assert ros.spin_until(lambda: node.inputs["imu/data_raw"].count == 20)
    assert dict(node.inputs["imu/data_raw"].rejected) == {"error in handling: TypeError": 20}


def test_diagnostics_that_cannot_be_made_are_reported_and_end_nothing(ros):
    class Broken(Listener):
        def rows(self):
            yield from super().rows()
            raise KeyError("gyro_bias")

    table = ros.diagnostics()
    ros.make(Broken)
    assert ros.spin_until(lambda: "listener: diagnostics" in table)
    assert table["listener: diagnostics"].level == b"\x02" and table["listener: diagnostics"].message == "diagnostics incomplete: KeyError"
    assert "listener: input imu/data_raw" in table
