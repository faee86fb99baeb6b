"""A node that watches a graph to show it: it hears what the nodes report, then listens to what can be drawn, best effort."""

import contextlib
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.catalogue.equipment import load_stations
from lowcostnav_ros.graph.page.picture import Picture
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.messages.store import from_cdr
from lowcostnav_ros.messages.topics import DIAGNOSTICS
from lowcostnav_ros.radionav.station_cells import StationError
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.node_base import NodeBase
from lowcostnav_ros.ros.publishing import message_class

LOOK_S = 1.0
DEPTH = 10  # the newest is what is shown


class WatchingNode(NodeBase):
    """Keep a :class:`~lowcostnav_ros.graph.page.picture.Picture` of the graph; a graph flies the same with it or without.

    Parameters
    ----------
    name : str
    settings : sequence of settings objects
        The first names ``stations``, tables of what is drawn on the map.
    """

    poll_period_s = 0.04

    def __init__(self, name: str, settings: Sequence[Any], **kwargs: Any) -> None:
        super().__init__(name, settings, **kwargs)
        self._watched: set[str] = set()
        self._look_at, self._cause = 0.0, ""
        try:
            tables: Iterable[str] = self.parameters.settings[0].stations
            self.picture = Picture({station.ident: station for table in tables for station in load_stations(table)}.values())
        except (SettingsError, StationError, OSError) as error:
            self.destroy_node()
            raise SettingsError(f"{name}: {error}") from error
        self.subscribe(DiagnosticArray, "/diagnostics", self._report, qos.sensor_subscription())

    def poll(self) -> int:
        """Take what has come; once a second look for what is new."""
        count = super().poll()
        if (now := time.monotonic()) >= self._look_at:
            self._look_at = now + LOOK_S
            self.guarded(self.look_around)
        return count

    def look_around(self) -> None:
        """Listen to what is new and draw the tracks on; a subclass shows what changes slowly."""
        for topic, kind in self.picture.wanted():
            if topic not in self._watched:
                self._watched.add(topic)
                self._listen_to(topic, kind)
        self.picture.follow()

    def guarded(self, work: Callable[[], None]) -> None:
        """Do what shows something; what cannot be shown is no reason to stop showing the rest."""
        try:
            work()
        except Exception as error:
            if not self.context.ok():
                raise
            if (cause := type(error).__name__) != self._cause:
                self._cause = cause
                self.get_logger().error(f"part of the picture cannot be drawn: {cause}: {error}")

    def _listen_to(self, topic: str, kind: Kind) -> None:
        profile = qos.latched() if kind.latched else QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.subscribe(message_class(kind.msgtype), topic, partial(self.picture.take, topic.lstrip("/"), kind), profile)

    def _report(self, raw: bytes) -> None:
        with contextlib.suppress(Exception):  # what is no message tells nothing
            for status in from_cdr(raw, DIAGNOSTICS).status:
                values = {pair.key: pair.value for pair in status.values}
                self.picture.report(status.name, int(status.level), status.message, values, status.hardware_id)
