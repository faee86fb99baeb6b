"""What other tools draw: scalars, paths and markers from a flight, the layouts that name them, the bridge."""

import json
import math
import re
import socket
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from test_page import ORIGIN, solution

from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.store import to_cdr

LAYOUTS = Path(__file__).resolve().parents[1] / "config" / "layouts"


def test_the_display_publishes_what_a_flight_shows(ros):
    from nav_msgs.msg import Path as Track
    from std_msgs.msg import Float64
    from visualization_msgs.msg import MarkerArray

    from lowcostnav_ros.nodes.display import Display
    from lowcostnav_ros.ros import qos

    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", 0))
    receiver.setblocking(False)
    display = ros.make(Display, udp=f"127.0.0.1:{receiver.getsockname()[1]}", stations=["dme_stations_bay_area.csv"])
    seen, heard = display.picture, {}
    seen.report("toy: navigator", 0, "gps", {"mode": "gps", "flying_on": "toy"}, "/toy 7")
    seen.report("toy: output toy/odometry", 0, "", {"count": "0"}, "/toy 7")
    seen.report("toy: aid baro height", 0, "used", {"test_ratio": "0.4", "age_s": "0.1", "rejected": "2"}, "/toy 7")
    seen.report("toy: input gps/fix", 0, "", {"rate_hz": "5.0", "age_s": "0.1", "rejected": "0"}, "/toy 7")
    wanted = {"toy/speed": Float64, "toy/test_ratio/baro_height": Float64, "toy/rate_hz/gps_fix": Float64, "toy/path": Track}
    for name, kind in (wanted | {"stations": MarkerArray, "ellipses": MarkerArray}).items():
        profile = qos.latched() if kind is MarkerArray else qos.output()
        ros.probe.create_subscription(kind, f"display/{name}", lambda message, name=name: heard.update({name: message}), profile)
    seen.take("toy/origin", topics.spec("toy/origin"), to_cdr(encode.origin_fix(10**9, ORIGIN)))
    seen.take("toy/odometry", topics.spec("toy/odometry"), to_cdr(encode.odometry_from_solution(solution(north_m=500.0), ORIGIN)))
    assert ros.spin_until(lambda: len(heard) == 6), heard.keys()
    assert heard["toy/speed"].data == pytest.approx(60.03, abs=0.01) and heard["toy/test_ratio/baro_height"].data == 0.4
    (place,) = (pose.pose.position for pose in heard["toy/path"].poses)
    assert heard["toy/path"].header.frame_id == "map" and (place.x, place.y, place.z) == pytest.approx((0.0, 500.0, 0.0), abs=2.0)
    (ellipse,) = heard["ellipses"].markers
    assert (ellipse.scale.x, ellipse.scale.y) == (120.0, 40.0)  # diameters of two sigmas, the long one to the north
    assert 2.0 * math.atan2(ellipse.pose.orientation.z, ellipse.pose.orientation.w) == pytest.approx(math.pi / 2)
    assert ellipse.pose.position.z == pytest.approx(1000.0, abs=1.0)
    idents = {marker.text for marker in heard["stations"].markers}
    assert "OAK" in idents and len(heard["stations"].markers) == 2 * len(idents)
    assert ros.spin_until(lambda: "toy/speed" in json.loads(receiver.recv(65536)))
    receiver.close()


def test_the_layouts_plot_what_is_published():
    from lowcostnav_ros.nodes.display import QUANTITIES

    per_aid, aids = ("test_ratio", "since_used_s", "refused"), {"gps_position", "gps_velocity", "baro_height", "magnetic_heading"}
    layout = json.loads((LAYOUTS / "foxglove.json").read_text())
    paths = [path["value"] for config in layout["configById"].values() for path in config.get("paths", [])]
    names = [path.removesuffix(".data").removeprefix("/display/") for path in paths]
    for file, head, tail in (("plotjuggler.xml", "/display/", "/data"), ("plotjuggler_udp.xml", "/", "")):
        curves = [curve.get("name") for curve in ElementTree.parse(LAYOUTS / file).iter("curve")]
        assert curves and all(curve.startswith(head) and curve.endswith(tail) for curve in curves)
        names += [curve.removesuffix(tail).removeprefix(head) for curve in curves]
    for name in names:
        node, quantity, *of = name.split("/")
        assert node in ("ins_gps", "dead_reckoning", "supervisor"), name
        if of:
            known = aids if quantity in per_aid else {re.sub(r"\W", "_", topic) for topic in topics.TOPICS}
            assert quantity in (*per_aid, "latency_s", "rate_hz") and of[0] in known, name
        else:
            assert quantity in (*QUANTITIES, "horizontal_bound"), name
    panels = set(re.findall(r'"([\w]+![\w]+)"', json.dumps(layout["layout"])))
    assert panels == set(layout["configById"])


def test_the_bridge_serves_this_machine_alone():
    from lowcostnav_ros.base.settings import SettingsError
    from lowcostnav_ros.nodes.foxglove import FoxgloveSettings

    with pytest.raises(SettingsError, match="a port of this machine"):
        FoxgloveSettings("0.0.0.0:8765")
    assert FoxgloveSettings("127.0.0.1:1234").listen == "127.0.0.1:1234"


def test_without_its_library_the_bridge_says_what_to_install(ros, monkeypatch):
    import sys

    from lowcostnav_ros.base.settings import SettingsError
    from lowcostnav_ros.nodes.foxglove import Foxglove

    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(SettingsError, match="extra 'foxglove'"):
        ros.make(Foxglove)


def test_the_bridge_passes_on_what_a_viewer_asks_for_and_only_that(ros):
    pytest.importorskip("foxglove", reason="foxglove-sdk, the extra 'foxglove', is not installed")
    from std_msgs.msg import Float64

    from lowcostnav_ros.nodes.foxglove import Foxglove

    bridge = ros.make(Foxglove, listen="127.0.0.1:18765")
    publisher = ros.probe.create_publisher(Float64, "/speed", 10)
    assert ros.spin_until(lambda: "/speed" in bridge._channels)
    assert publisher.get_subscription_count() == 0
    bridge._wanted.put(("/speed", 1))
    assert ros.spin_until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(Float64(data=3.0))
    assert ros.spin_until(lambda: bridge._count == 1)
    bridge._wanted.put(("/speed", -1))
    assert ros.spin_until(lambda: publisher.get_subscription_count() == 0)
