"""Publishers of serialised messages, which count and, lossless, wait."""

import importlib
import time

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from lowcostnav_ros.messages import topics
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.input_monitor import OK, Status

NO_PUBLISHER_EVENTS = PublisherEventCallbacks(use_default_callbacks=False)  # each is one more thing to wait for
MATCH_S = 15.0  # longest wait for expected listeners; one that has died must not stop the rest
RCLError = rclpy_implementation.RCLError


class Output:
    """One publisher of serialised messages that counts what it sent and, lossless, waits for slow listeners."""

    def __init__(self, node: Node, spec: topics.TopicSpec, name: str, is_lossless: bool, listeners: int = 0) -> None:
        self.topic, self.count, self.waited = spec.name, 0, 0
        self._is_lossless, self._ok = is_lossless, node.context.ok
        self._listeners = listeners if is_lossless else 0
        profile = qos.for_publisher(spec, is_lossless)
        self.publisher = node.create_publisher(message_class(spec.msgtype), name, profile, event_callbacks=NO_PUBLISHER_EVENTS)

    def send(self, cdr: bytes) -> None:
        """Publish serialised bytes; lossless, try again for as long as the history of a listener is full."""
        if self._listeners:
            self._match()
        while self._ok():
            try:
                self.publisher.publish(cdr)
            except RCLError:  # lossless: a listener's history stayed full for 100 ms
                if not self._is_lossless and self._ok():
                    raise
                self.waited += 1
                continue
            self.count += 1
            return

    def _match(self) -> None:
        """Wait, once, until every expected listener is matched: a discovered but unmatched subscriber would miss the first messages."""
        deadline = time.monotonic() + MATCH_S
        while self._ok() and self.publisher.get_subscription_count() < self._listeners and time.monotonic() < deadline:
            time.sleep(0.005)
        self._listeners = 0

    def status(self, prefix: str) -> Status:
        """Return the diagnostics row."""
        values = {"count": str(self.count), "waited": str(self.waited)}
        return Status(f"{prefix}: output {self.topic}", OK, f"{self.topic}: {self.count} sent", values)


def message_class(msgtype: str) -> type:
    """Return the rclpy class of a type such as ``sensor_msgs/msg/Imu``, importing only that package."""
    package, _, name = msgtype.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)
