"""``/tf_static`` live: how the sensors of a navigator stand, where its settings say nothing of that.

The frame of a sensor is known with its first message, so until then everything that a navigator was fed is kept; once the frame is found in
the tree, a navigator with the settings that follow from it takes its place and is fed the same, as a replay of the recording feeds it.
"""

import struct
import time
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.messages.frames import TF_STATIC, TF_TYPE, FrameTree
from lowcostnav_ros.messages.store import from_cdr
from lowcostnav_ros.replay.mountings import SETTINGS, Mountings

TOPIC = f"/{TF_STATIC}"
QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""One message of each of several publishers, latched."""
DISCOVERY_S, LONGEST_S = 0.3, 2.0
"""At the start a publisher is looked for this long, and one that is there is waited for."""
EARLY_NS, EARLY = 10_000_000_000, 50_000
"""What a navigator was fed is kept so long, and no more of it than so many measurements."""
UNREADABLE = f"{TOPIC} is published, but the ROS package tf2_msgs is not installed here: give imu.mounting_deg, imu.lever_arm_m, "
UNREADABLE += "magnetometer.mounting_deg and gps.lever_arm_b_m (a replay of a recording that holds it prints them)"


def tf_class() -> type | None:
    """The message class of the topic; None where it is not installed (it is no part of the pip wheels of ROS)."""
    from lowcostnav_ros.ros.publishing import message_class

    try:
        return message_class(TF_TYPE)
    except (ImportError, AttributeError):
        return None


def header_frame(cdr: bytes) -> str:
    """The frame id of a serialised message that begins with a header; raises ValueError when it has none."""
    try:
        (size,) = struct.unpack_from("<I" if cdr[1] & 1 else ">I", cdr, 12)
        return cdr[16 : 16 + size].rstrip(b"\0").decode()
    except (struct.error, IndexError) as error:
        raise ValueError("message too short for a header") from error


class StaticFrames:
    """What a node knows of how its sensors stand.

    Parameters
    ----------
    node : NodeBase
    sources : iterable of str
        What it listens to.

    Attributes
    ----------
    early : list of Measurement or None
        What it fed its navigator as long as a sensor's frame may still be told; None: from now on settings stay.
    """

    def __init__(self, node: Any, sources: Any) -> None:
        self._node, self._tree, self._mountings = node, FrameTree(), Mountings()
        self._open, self._first_ns = {source for source in sources if source in SETTINGS}, 0
        self._kind = tf_class()
        self.early: list[Measurement] | None = None if self._kind is None else []
        self._said = self._kind is not None
        if self._kind is not None and self._open:
            node.subscribe(self._kind, TOPIC, self._arrived, QOS)

    def wait(self) -> None:
        """Wait for the topic where something publishes it."""
        began = time.monotonic()
        while self._kind is not None and self._open and not self._tree.beside:
            waited_s = time.monotonic() - began
            if waited_s > (LONGEST_S if self._node.count_publishers(TOPIC) else DISCOVERY_S):
                return
            self._node.poll()
            time.sleep(0.005)

    def look(self) -> None:
        """Say, once, that the topic is there and cannot be read."""
        if not self._said and self._open and self._node.count_publishers(TOPIC):
            self._said = True
            self._node.get_logger().warning(UNREADABLE)

    def fed(self, measurement: Measurement) -> None:
        """Keep what the navigator is fed while a frame may still be told."""
        if self.early is None:
            return
        self._first_ns = self._first_ns or measurement.stamp_ns
        self.early.append(measurement)
        if not self._open or measurement.stamp_ns - self._first_ns > EARLY_NS or len(self.early) > EARLY:
            self.early = None

    def settings_by(self, source: str, raw: bytes, settings: Any) -> Any:
        """Settings of the navigator by the frame of a message; as they were where it tells nothing, or nothing more."""
        if source not in self._open:
            return settings
        frame, rules = header_frame(raw), self._node.decoder.rules
        stand = self._tree.stand(frame)
        kind = rules.kind_of(source)
        if stand is None:
            if kind is None or not kind.frames or frame in kind.frames:
                self._open.discard(source)
            return settings
        self._open.discard(source)
        self._mountings.stands[source], self._mountings.frames[source] = stand, (frame,)
        adapted = self._mountings.adapted(settings)
        if adapted is not settings and self.early is None:
            self._node.get_logger().warning(f"{source} came too late for {TOPIC} to say how it stands: start this node again")
            return settings
        rules.allow({source: (frame,)})
        for remark in self._mountings.remarks:
            self._node.get_logger().info(remark)
        self._mountings.remarks.clear()
        return adapted

    def _arrived(self, raw: bytes) -> None:
        try:
            self._tree.add(from_cdr(raw, TF_TYPE).transforms)
        except Exception:  # what is no message tells nothing
            self._node.get_logger().warning(f"a message of {TOPIC} cannot be read")
