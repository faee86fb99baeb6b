"""The generic navigator node, with a navigator so small that everything it says is known."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, NavSatFix
from std_srvs.srv import Trigger
from test_ros_node_base import imu

from lowcostnav_ros.base.measurements import Integrity, NavSolution
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.navigator_node import NavigatorNode


@dataclass(frozen=True)
class StandstillSettings:
    lat_deg: float = setting(37.0, "Latitude.", unit="deg")


class Standstill:
    """Stands where its settings say, fuses every tenth sample."""

    inertial = None

    def __init__(self, settings) -> None:
        self.settings = settings
        self.inputs, self.kinds, self.frames = {"imu/data_raw": True, "gps/fix": False}, {}, {}
        self.lat = np.radians(settings.lat_deg)
        self.origin, self.count, self.stamp_ns, self.mode, self.reason = None, 0, 0, "initialising", "waiting"

    def feed(self, measurement):
        self.count, self.stamp_ns, self.mode, self.reason = self.count + 1, measurement.stamp_ns, "gps", ""
        self.origin = self.origin or LocalFrame(self.lat, 0.1, 100.0)
        return [self.output()] if self.count % 10 == 0 else []

    @property
    def newest_ns(self):
        return self.stamp_ns

    def output(self):
        eye, q = np.eye(3), np.array([1.0, 0.0, 0.0, 0.0])
        place = {"lat": self.lat, "lon": 0.1, "height": 103.0, "vel_n": np.array([1.0, 2.0, 3.0]), "q_nb": q, "mode": self.mode}
        rates = {"angular_rate_b": np.zeros(3), "specific_force_b": np.array([0.0, 0.0, -9.81])}
        covariances = {"cov_pos": 4.0 * eye, "cov_vel": eye, "cov_att": 1e-4 * eye, "cov_wind": np.eye(2)}
        return NavSolution(self.stamp_ns, "standstill", **place, **rates, **covariances, wind_n=np.array([5.0, -7.0]))

    def status(self):
        aid = SimpleNamespace(details={},
            name="gps_position", labels=("north_m",), innovation=np.array([1.5]), innovation_variance=np.array([4.0]), test_ratio=1.7,
            accepted=False, reason="innovation beyond gate", fused=3, rejected={"innovation beyond gate": 2}, age_s=lambda now_ns: 0.5,
        )  # fmt: skip
        integrity = Integrity("excluded", "G11 is left out.", {"G11": "its range contradicts the others'"}, hpl_m=31.26)
        parts = {"sigmas": {"north_m": 2.0}, "inputs": [], "aids": [aid], "integrity": integrity}
        return SimpleNamespace(details={}, contradictions=(), mode=self.mode, reason=self.reason, level=0, stamp_ns=1, **parts)

    def reset(self, reason):
        self.mode, self.reason = "initialising", reason


def fly(ros, samples=100, name="standstill", **parameters):
    node = ros.make(lambda **kwargs: NavigatorNode(name, StandstillSettings(), Standstill, **kwargs), **parameters)
    got = {"odometry": [], "odometry_fused": [], "fix": [], "wind": [], "origin": [], "imu": [], "imu_fused": []}
    types = {"odometry": Odometry, "odometry_fused": Odometry, "fix": NavSatFix, "wind": TwistWithCovarianceStamped}
    for part, kind in types.items():
        ros.probe.create_subscription(kind, f"{name}/{part}", got[part].append, 200)
    for topic, part in (("imu/data", "imu"), ("imu/data_fused", "imu_fused")):
        ros.probe.create_subscription(Imu, topic, got[part].append, 200)
    publisher = ros.probe.create_publisher(Imu, "imu/data_raw", 200)
    assert ros.spin_until(
        lambda: publisher.get_subscription_count() == 1 and all(o.publisher.get_subscription_count() for o in outputs(node))
    )
    for k in range(samples):
        publisher.publish(imu(1000.0 + 0.01 * k))
    assert ros.spin_until(lambda: node.navigator.count == samples)
    # who comes late still gets the origin: it is latched
    ros.probe.create_subscription(NavSatFix, f"{name}/origin", got["origin"].append, qos.latched())
    return node, got


def outputs(node):
    return [o for topic, o in node.outputs.items() if topic.split("/")[1] not in ("origin", "wind_fused", "health")]


def test_outputs_are_decimated_by_stamp_and_every_fused_solution_is_published(ros):
    node, got = fly(ros, output__rate_hz=20.0)
    assert ros.spin_until(
        lambda: len(got["odometry"]) == 20 and len(got["odometry_fused"]) == 10 and got["origin"] and len(got["wind"]) == 20
    )
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in got["odometry"]]
    assert np.allclose(np.diff(stamps), 0.05, atol=1e-9)
    assert len(got["origin"]) == 1 and got["origin"][0].latitude == pytest.approx(37.0, abs=1e-12)


def test_messages_are_east_north_up_and_forward_left_up(ros):
    _, got = fly(ros, samples=10, lat_deg=37)
    assert ros.spin_until(lambda: got["odometry"] and got["fix"] and got["wind"])
    odometry, fix, wind = got["odometry"][0], got["fix"][0], got["wind"][0]
    assert odometry.pose.pose.position.z == pytest.approx(3.0, abs=1e-6)
    # nose north and level: forward is north, left is west, up is minus down
    linear = odometry.twist.twist.linear
    assert (linear.x, linear.y, linear.z) == pytest.approx((1.0, -2.0, -3.0))
    assert (fix.latitude, fix.longitude, fix.altitude) == pytest.approx((37.0, np.degrees(0.1), 103.0))
    assert (wind.twist.twist.linear.x, wind.twist.twist.linear.y) == pytest.approx((-7.0, 5.0))


def test_an_attitude_reference_publishes_imu_data(ros):
    node, got = fly(ros, name="ahrs", output__rate_hz=50.0)
    assert ros.spin_until(lambda: len(got["imu"]) == 50 and len(got["imu_fused"]) == 10)
    assert "ahrs/odometry" not in node.outputs
    q = got["imu"][0].orientation  # nose north in east-north-up is a yaw of 90 deg
    assert (q.x, q.y, q.z, q.w) == pytest.approx((0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)))


def test_diagnostics_name_mode_sigmas_aids_and_the_missing_input(ros):
    table = ros.diagnostics()
    fly(ros, samples=10)
    assert ros.spin_until(lambda: "standstill: aid gps_position" in table and table["standstill: navigator"].message == "gps")
    values = {e.key: e.value for e in table["standstill: aid gps_position"].values}
    assert values["test_ratio"] == "1.7" and values["innovation_north_m"] == "1.5" and values["innovation_sigma_north_m"] == "2"
    assert values["rejected[innovation beyond gate]"] == "2" and table["standstill: aid gps_position"].level == b"\x01"
    assert {e.key: e.value for e in table["standstill: navigator"].values}["north_m"] == "2"
    assert ros.spin_until(lambda: "nothing received yet" in table["standstill: input gps/fix"].message)
    row = table["standstill: integrity"]
    assert row.message == "excluded: G11 is left out." and row.level == b"\x01"
    values = {e.key: e.value for e in row.values}
    assert values["hpl_m"] == "31.3" and values["vpl_m"] == "" and values["excluded[G11]"] == "its range contradicts the others'"


def test_reset_restarts_the_navigator_and_says_so(ros):
    node, _ = fly(ros, samples=10)
    client = ros.probe.create_client(Trigger, "/standstill/reset")
    assert ros.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    assert future.result().message == "standstill was reset: initialising, reset by service."


def test_a_navigator_that_puts_out_nothing_any_more_is_not_ok(ros):
    table = ros.diagnostics()
    fly(ros, samples=10)
    row = lambda: table.get("standstill: navigator")  # noqa: E731
    assert ros.spin_until(lambda: row() is not None and row().message == "gps")
    assert ros.spin_until(lambda: row().level == b"\x02", 6.0)
    assert row().message.startswith("no solution for 2.") and row().message.endswith("; gps")


def ask(ros, client):
    """Call a reset service and return its answer."""
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    return future.result()


def test_resets_are_not_to_follow_one_another(ros):
    fly(ros, samples=10)
    client = ros.probe.create_client(Trigger, "/standstill/reset")
    assert ros.spin_until(client.service_is_ready)
    assert ask(ros, client).success
    again = ask(ros, client)
    assert not again.success
    assert "ago; wait 10 s" in again.message


def test_a_reset_that_costs_the_solution_in_flight_is_asked_for_twice(ros):
    node, _ = fly(ros, samples=10)
    output, node.navigator.mode = node.navigator.output, "coasting"
    node.navigator.output = lambda: replace(output(), vel_n=np.array([50.0, 0.0, 0.0]))
    client = ros.probe.create_client(Trigger, "/standstill/reset")
    assert ros.spin_until(client.service_is_ready)
    first = ask(ros, client)
    assert not first.success and node.navigator.mode == "coasting"
    assert "ask again within 5 s" in first.message
    assert ask(ros, client).success and node.navigator.mode == "initialising"
