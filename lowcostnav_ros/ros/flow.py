"""Flow control of lossless flights: the source waits for its slowest listener.

Reliable, keep-all middleware loses nothing, but lets a queue grow to thousands of samples: a minute of flight between what one sensor's
simulator has received and another's, so that a fix would arrive long after the inertial samples it belongs to.  Here every node reports
up to which stamp it has come, and the source flies no further ahead of the slowest than a second of flight.  The speed of a
simulation then adapts to the machine, and the horizon of a navigator can be a fixed, small part of it.
"""

import struct
import time
from collections.abc import Callable
from dataclasses import dataclass

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Header

from lowcostnav_ros.base.settings import setting

TOPIC = "flow/progress"
REPORT_NS = 100_000_000
LOOK_S = 0.005  # as often as the reports are taken
MOST_STRANGERS = 100  # reports of further nodes that are kept, too: a name comes from outside
QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)


def header_stamp_ns(cdr: bytes) -> int:
    """Return the stamp of a serialised message that begins with a header; raises ValueError when it is too short to have one."""
    if len(cdr) < 12:
        raise ValueError("message too short for a header")
    seconds, nanoseconds = struct.unpack_from("<iI" if cdr[1] & 1 else ">iI", cdr, 4)
    return seconds * 1_000_000_000 + nanoseconds


@dataclass(frozen=True)
class FlowSettings:
    """How a source waits for its listeners (lossless only)."""

    listeners: int = setting(0, "Nodes that report how far they have come; 0 does not wait.", minimum=0)
    ahead_s: float = setting(1.0, "Fly at most this far ahead of the slowest of them.", unit="s", minimum=0.05, maximum=60.0)
    patience_s: float = setting(15.0, "Without progress for so long a listener is dropped.", unit="s", minimum=1.0, maximum=600.0)


class ProgressReport:
    """One node's report: up to which stamp it has handled the first of its paced topics that comes (others may have no publisher)."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(Header, TOPIC, QOS)
        self._message = Header(frame_id=node.get_name())
        self._next_ns, self._source = 0, ""

    def passed(self, source: str, stamp_ns: int) -> None:
        """Note a handled message; report to the source every tenth of a second of flight."""
        self._source = self._source or source
        if source != self._source:
            return
        if stamp_ns < self._next_ns and self._next_ns - stamp_ns <= REPORT_NS:
            return
        self._next_ns = stamp_ns + REPORT_NS
        self._message.stamp.sec, self._message.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        self._publisher.publish(self._message)


class FlowGate:
    """The source's side: how far it may fly."""

    def __init__(
        self, subscribe: Callable[[type, str, Callable[[bytes], None], QoSProfile], object], settings: FlowSettings, logger: RcutilsLogger
    ) -> None:
        self._settings, self._logger = settings, logger
        self._passed: dict[str, int] = {}
        self._moved_at: dict[str, float] = {}
        self._dropped: set[str] = set()
        self._first_ns = 0
        self.waited_s = 0.0
        if settings.listeners:
            subscribe(Header, TOPIC, self._on_report, QOS)

    def wait(self, stamp_ns: int, running: Callable[[], bool]) -> None:
        """Block until the slowest listener is near enough to ``stamp_ns``."""
        if not self._settings.listeners:
            return
        self._first_ns = self._first_ns or stamp_ns
        began = time.monotonic()
        while running() and stamp_ns - self._slowest() > 1e9 * self._settings.ahead_s:
            time.sleep(LOOK_S)
            self._drop_stuck(began)
        self.waited_s += time.monotonic() - began

    def _on_report(self, raw: bytes) -> None:
        try:
            name, stamp_ns = raw[16:].rstrip(b"\0").decode(), header_stamp_ns(raw)
        except ValueError:  # none of ours
            return
        if name not in self._passed and len(self._passed) >= self._settings.listeners + MOST_STRANGERS:
            return
        self._passed[name], self._moved_at[name] = stamp_ns, time.monotonic()

    def _slowest(self) -> int:
        waited_for = [stamp for name, stamp in list(self._passed.items()) if name not in self._dropped]
        if len(self._passed) < self._settings.listeners - len(self._dropped - set(self._passed)):
            waited_for.append(self._first_ns)
        return min(waited_for, default=2**62)

    def _drop_stuck(self, began: float) -> None:
        now = time.monotonic()
        if now - began < self._settings.patience_s:
            return
        stuck = [name for name in self._passed if now - max(self._moved_at[name], began) > self._settings.patience_s]
        unknown = [f"listener {k}" for k in range(len(self._passed), self._settings.listeners)]
        for name in [n for n in stuck + unknown if n not in self._dropped]:
            self._dropped.add(name)
            self._logger.warning(f"{name} has made no progress for {self._settings.patience_s:g} s; no longer waiting for it.")
