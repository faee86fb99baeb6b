"""A node that publishes from its own thread, while the main thread answers services and reports."""

import struct
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.ros.flow import FlowGate, FlowSettings
from lowcostnav_ros.ros.input_monitor import ERROR, OK, Status
from lowcostnav_ros.ros.node_base import Bases
from lowcostnav_ros.ros.pacing import Pacer, StartSettings, wait_for_subscribers
from lowcostnav_ros.ros.publishing import Output
from lowcostnav_ros.ros.threaded_node import ThreadedNode

CLOCK_PERIOD_NS = 50_000_000


@dataclass(frozen=True)
class SourceSettings:
    """Pace and start of a source."""

    real_time_factor: float = setting(1.0, "Simulated seconds per second; 0 is as fast as listeners allow.", minimum=0.0, maximum=1000.0)
    start: StartSettings = group(StartSettings)
    flow: FlowSettings = group(FlowSettings)


class SourceNode(ThreadedNode):
    """Base of the truth source and the player.

    A subclass gives ``make_outputs()`` (publishers must exist before listeners are counted) and ``publish_all()``, which publishes all
    there is and returns; it calls ``self.at(stamp_ns)`` before each message and stops when that returns False.
    """

    def __init__(self, name: str, settings: Bases, **kwargs: Any) -> None:
        super().__init__(name, lambda given: [*(settings(given) if callable(settings) else settings), SourceSettings()], **kwargs)
        self.source_settings: SourceSettings = self.parameters.settings[-2]
        self.state, self.trouble = "starting", ""
        self._pacer = Pacer(self.source_settings.real_time_factor)
        self._gate = FlowGate(self.subscribe, self.source_settings.flow, self.get_logger())
        self._clock_output: Output = self.output("clock", "/clock")
        self._next_clock_ns = self._stamp_ns = self._first_ns = 0
        self.make_outputs()
        self._begin("publish")

    def make_outputs(self) -> None:
        """Make the publishers."""

    def publish_all(self) -> None:
        """Publish everything, in order."""

    def at(self, stamp_ns: int) -> bool:
        """Wait until ``stamp_ns`` is due, publish /clock when it is time; return False when the node is to stop."""
        if not self._first_ns:
            self._first_ns = stamp_ns
        self._pacer.wait(stamp_ns)
        self._gate.wait(stamp_ns, self.running)
        self._stamp_ns = stamp_ns
        if stamp_ns >= self._next_clock_ns:
            self._clock_output.send(clock_cdr(stamp_ns))
            self._next_clock_ns = stamp_ns + CLOCK_PERIOD_NS
        return self.running()

    def rows(self) -> Iterable[Status]:
        """Add the state of the flight to the rows of every node."""
        yield from super().rows()
        flown = 1e-9 * (self._stamp_ns - self._first_ns)
        values = {"state": self.state.split(":")[0], "stamp_s": f"{1e-9 * self._stamp_ns:.3f}", "flown_s": f"{flown:.1f}"}
        values["held_up_s"] = f"{self._pacer.late_s:.1f}"
        values["waited_for_listeners_s"] = f"{self._gate.waited_s:.1f}"
        message = self.trouble or f"{self.state}, {flown:.0f} s played"
        yield Status(f"{self.get_name()}: source", ERROR if self.trouble else OK, message, values)

    def reset(self, reason: str) -> str:
        """A source cannot be reset."""
        return f"{self.get_name()} cannot be reset; start the node again."

    def _run(self) -> None:
        try:
            wait_for_subscribers(self, self.source_settings.start, self.running, self._report)
            if not self.running():
                return
            self._report("flying")
            began = time.monotonic()
            self.publish_all()
            if self.running():
                self._report("finished")
                self.get_logger().info(f"{self.get_name()} finished after {time.monotonic() - began:.1f} s; Ctrl-C ends it.")
        except Exception as error:
            if self.running():
                self.state, self.trouble = "failed", f"{type(error).__name__}: {error}"
                self.get_logger().error(self.trouble)

    def _report(self, state: str) -> None:
        self.state = state


def clock_cdr(stamp_ns: int) -> bytes:
    """Serialise a rosgraph_msgs/Clock."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return b"\x00\x01\x00\x00" + struct.pack("<iI", seconds, nanoseconds)
