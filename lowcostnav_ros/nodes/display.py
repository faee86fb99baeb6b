"""Publish a running graph for the tools that draw standard messages: Foxglove, RViz, PlotJuggler.

Everything that plots is a ``std_msgs/Float64`` of its own, ``display/<node>/<quantity>``; what is drawn is in one map frame, that of the
solution that is flown: ``display/<navigator>/path``, ``display/stations``, ``display/ellipses``, and where ``tf2_msgs`` is installed its
transform to ``base_link`` on ``/tf``.
"""

import importlib.util
import json
import math
import re
import socket
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from nav_msgs.msg import Path
from rclpy.publisher import Publisher
from std_msgs.msg import Float64
from visualization_msgs.msg import Marker, MarkerArray

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.physics.earth import LocalFrame, geodetic_to_ecef
from lowcostnav_ros.physics.rotation import euler_to_quat
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.input_monitor import OK, Status
from lowcostnav_ros.ros.watching_node import WatchingNode

MOST_SCALARS = 400
PATH_POINTS = 500
STATION_M = 300.0
BOUNDS = ("height_bound", "heading_bound", "speed_bound", "tilt_bound", "wind_bound")
QUANTITIES = ("speed", "climb", "airspeed", "wind", "roll", "pitch", "heading", "msl", "age", *BOUNDS)
"""Of a navigator, published under these names: m, m/s, degrees, seconds; a bound is two sigmas."""


@dataclass(frozen=True)
class DisplaySettings:
    """Settings of the display."""

    stations: list[str] = setting([], "Station tables to draw; a graph gives those of its navigators.")
    udp: str = setting("", "Where the scalars also go as JSON by UDP, '127.0.0.1:9870' for PlotJuggler without ROS; empty: nowhere.")

    def __post_init__(self) -> None:
        if self.udp and not re.fullmatch(r"[\w.-]+:\d{1,5}", self.udp):
            raise SettingsError(f"udp: '{self.udp}' must be a host and a port, such as 127.0.0.1:9870.")


@executable("display", kind="monitor", Settings=DisplaySettings, compiled=False)
class Display(WatchingNode):
    """Once a second, what the graph reports and flies as messages that are drawn and plotted."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("display", [DisplaySettings()], **kwargs)
        self._shown: dict[str, Publisher] = {}
        self._markers = {name: self.create_publisher(MarkerArray, f"display/{name}", qos.latched()) for name in ("stations", "ellipses")}
        host, _, port = self.parameters.settings[0].udp.rpartition(":")
        self._udp = (host, int(port)) if host else None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._tf = self._transforms()

    def destroy_node(self) -> None:
        """Close the socket, then the node."""
        if hasattr(self, "_socket"):
            self._socket.close()
        super().destroy_node()

    def rows(self) -> Iterable[Status]:
        """One row: how much is shown."""
        shown = len(getattr(self, "_shown", ()))
        yield Status(f"{self.get_name()}: display", OK, f"{shown} quantities shown", {"quantities": str(shown)})

    def look_around(self) -> None:
        """Publish all of it."""
        super().look_around()
        flight, tables = self.picture.flight()["navigators"], self.picture.tables()
        scalars = dict(scalars_of(flight, tables))
        for name, value in scalars.items():
            self._publish(name, Float64, Float64(data=value))
        self._send(scalars)
        flown = _flown(flight, tables)
        if flown:
            self._draw(flight, flown)

    def _publish(self, name: str, kind: type, message: Any) -> None:
        if name not in self._shown and len(self._shown) < MOST_SCALARS:
            self._shown[name] = self.create_publisher(kind, f"display/{name}", qos.output())
        if name in self._shown:
            self._shown[name].publish(message)

    def _send(self, scalars: dict[str, float]) -> None:
        if self._udp is None:
            return
        content = {"timestamp": 1e-9 * self.get_clock().now().nanoseconds, **scalars}
        try:
            self._socket.sendto(json.dumps(content).encode(), self._udp)
        except OSError:  # nobody listens, or the network is gone
            return

    def _draw(self, flight: dict[str, Any], flown: str) -> None:
        frame = self.picture.frame_of(flown)
        if frame is None:
            return
        stamp = self.get_clock().now().to_msg()
        chart = self.picture.chart()
        for name, track in chart["tracks"].items():
            path = Path()
            path.header.frame_id, path.header.stamp = "map", stamp
            for lat, lon in track[:: 1 + len(track) // PATH_POINTS]:
                pose = PoseStamped(header=path.header)
                pose.pose.position = _point(frame, lat, lon)
                path.poses.append(pose)
            self._publish(f"{name}/path", Path, path)
        self._markers["stations"].publish(MarkerArray(markers=[*_stations(frame, chart["stations"], stamp)]))
        self._markers["ellipses"].publish(MarkerArray(markers=[*_ellipses(frame, flight, stamp)]))
        if self._tf is not None:
            self._tf(frame, flight[flown], stamp)

    def _transforms(self) -> Any:
        """What publishes the transform of the flown solution, None where no package has its message."""
        if importlib.util.find_spec("tf2_msgs") is None:
            return None
        from geometry_msgs.msg import TransformStamped
        from tf2_msgs.msg import TFMessage

        publisher = self.create_publisher(TFMessage, "/tf", qos.output())

        def publish(frame: LocalFrame, shown: dict[str, Any], stamp: Any) -> None:
            transform = TransformStamped(child_frame_id="base_link")
            transform.header.frame_id, transform.header.stamp = "map", stamp
            place, at = _point(frame, shown["lat"], shown["lon"], shown["height"]), transform.transform.translation
            at.x, at.y, at.z = place.x, place.y, place.z
            if "roll" in shown:
                transform.transform.rotation = _orientation(shown)
            publisher.publish(TFMessage(transforms=[transform]))

        return publish


def scalars_of(flight: dict[str, Any], tables: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield everything that is a number: (``<node>/<quantity>``, value)."""
    for node, shown in flight.items():
        yield from ((f"{node}/{name}", float(shown[name])) for name in QUANTITIES if name in shown)
        if "ellipse" in shown:
            yield f"{node}/horizontal_bound", float(shown["ellipse"][0])
        yield f"{node}/level", float(shown.get("level", 2))
    for node, entry in tables["nodes"].items():
        for aid in entry["aids"]:
            named = (("test_ratio", aid["ratio"]), ("since_used_s", aid["age"]), ("refused", aid["rejected"]))
            yield from ((f"{node}/{name}/{_plain(aid['aid'])}", float(value)) for name, value in named if value is not None)
        for one in entry["inputs"]:
            named = (("rate_hz", one["rate"]), ("latency_s", one["age"]), ("refused", one["rejected"]))
            yield from ((f"{node}/{name}/{_plain(one['topic'])}", float(value)) for name, value in named if value is not None)


def _plain(name: str) -> str:
    return re.sub(r"\W+", "_", name, flags=re.ASCII)


def _flown(flight: dict[str, Any], tables: dict[str, Any]) -> str:
    """The navigator in whose map frame things are drawn: the supervisor, or the first with a position."""
    placed = [node for node, shown in flight.items() if "lat" in shown]
    return next((node for node in placed if tables["nodes"].get(node, {}).get("flying_on")), placed[0] if placed else "")


def _point(frame: LocalFrame, lat_deg: float, lon_deg: float, height: float | None = None) -> Point:
    """A place in the map frame, on the height of its origin where none is given."""
    at = geodetic_to_ecef(lat_deg * DEGREE, lon_deg * DEGREE, frame.height if height is None else height)
    north, east, down = (frame.C_le @ (np.asarray(at) - frame.origin_e)).tolist()
    return Point(x=east, y=north, z=-down if height is not None else 0.0)


def _orientation(shown: dict[str, Any]) -> Quaternion:
    from lowcostnav_ros.messages.conversions import quat_to_ros

    x, y, z, w = quat_to_ros(np.asarray(euler_to_quat(shown["roll"] * DEGREE, shown["pitch"] * DEGREE, shown["heading"] * DEGREE)))
    return Quaternion(x=float(x), y=float(y), z=float(z), w=float(w))


def _marker(kind: int, number: int, space: str, stamp: Any, colour: tuple[float, float, float, float]) -> Marker:
    marker = Marker(ns=space, id=number, type=kind, action=Marker.ADD)
    marker.header.frame_id, marker.header.stamp = "map", stamp
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = colour
    marker.pose.orientation.w = 1.0
    return marker


def _stations(frame: LocalFrame, stations: list[dict[str, Any]], stamp: Any) -> Iterator[Marker]:
    for number, station in enumerate(stations):
        place = _point(frame, station["lat"], station["lon"])
        for space, kind in (("stations", Marker.CYLINDER), ("idents", Marker.TEXT_VIEW_FACING)):
            marker = _marker(kind, number, space, stamp, (0.1, 0.4, 0.8, 1.0))
            marker.pose.position = place
            marker.scale.x = marker.scale.y = marker.scale.z = STATION_M
            marker.text = station["ident"]
            yield marker


def _ellipses(frame: LocalFrame, flight: dict[str, Any], stamp: Any) -> Iterator[Marker]:
    """The horizontal ellipses of two sigmas, as flat discs."""
    for number, shown in enumerate(flight.values()):
        if "ellipse" in shown:
            major, minor, bearing = shown["ellipse"]
            marker = _marker(Marker.CYLINDER, number, "ellipses", stamp, (0.1, 0.7, 0.4, 0.35))
            marker.pose.position = _point(frame, shown["lat"], shown["lon"], shown["height"])
            turn = 0.5 * (math.pi / 2 - bearing * DEGREE)
            marker.pose.orientation = Quaternion(x=0.0, y=0.0, z=math.sin(turn), w=math.cos(turn))
            marker.scale.x, marker.scale.y, marker.scale.z = 2.0 * major, 2.0 * minor, 1.0
            yield marker
