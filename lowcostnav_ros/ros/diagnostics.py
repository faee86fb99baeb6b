"""/diagnostics once a second, and at once when a level rises."""

from __future__ import annotations

import os
import time
import traceback
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.gnss.accuracy import category
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.input_monitor import Status

if TYPE_CHECKING:  # the compiler behind the estimators costs 60 MB that a sensor node does not need
    from lowcostnav_ros.base.measurements import Integrity
    from lowcostnav_ros.estimation.aiding import AidStatus
    from lowcostnav_ros.navigators.base import NavigatorStatus

PERIOD_S = 1.0
CHECK_S = 0.4  # how late a rising level may be noticed


class DiagnosticsPublisher:
    """Publish the rows of one node.

    Parameters
    ----------
    node : rclpy.node.Node
    rows : callable
        Returns the current rows.
    """

    def __init__(self, node: Node, rows: Callable[[], Iterable[Status]]) -> None:
        self._node, self._rows = node, rows
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", qos.output())
        self._levels: dict[str, int] = {}
        self._published_at = 0.0
        # steady: a simulated clock that stops must not stop the diagnostics
        self._timer = node.create_timer(CHECK_S, self.check, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def check(self) -> None:
        """Publish when a second has passed or a level has risen."""
        rows = self._present()
        rising = any(row.level > self._levels.get(row.name, 0) for row in rows)
        if rising or time.monotonic() - self._published_at >= PERIOD_S - 0.5 * CHECK_S:
            self.publish(rows)

    def publish(self, rows: list[Status] | None = None) -> None:
        """Publish now, the present rows where none are given."""
        rows = self._present() if rows is None else rows
        for row in rows:
            if row.level > self._levels.get(row.name, 0):
                self._log(row)
        self._levels = {row.name: row.level for row in rows}
        self._published_at = time.monotonic()
        message = DiagnosticArray(status=[_status(row, f"{self._node.get_fully_qualified_name()} {os.getpid()}") for row in rows])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _present(self) -> list[Status]:
        rows = []
        try:
            for row in self._rows():
                rows.append(row)
        except Exception as error:  # what cannot be reported must not end what flies
            if not self._node.context.ok():
                raise
            message = f"diagnostics incomplete: {type(error).__name__}"
            if self._levels.get(name := f"{self._node.get_name()}: diagnostics", 0) < Level.ERROR:
                self._node.get_logger().error(traceback.format_exc())
            rows.append(Status(name, Level.ERROR, message, {}))
        return rows

    def _log(self, row: Status) -> None:
        # rclpy allows one severity per line of code
        if row.level >= Level.ERROR:
            self._node.get_logger().error(row.message)
        else:
            self._node.get_logger().warning(row.message)


def _status(row: Status, hardware_id: str) -> DiagnosticStatus:
    values = [KeyValue(key=k, value=v) for k, v in row.values.items()]
    return DiagnosticStatus(level=bytes([row.level]), name=row.name, message=row.message, hardware_id=hardware_id, values=values)


def navigator_rows(prefix: str, status: NavigatorStatus) -> list[Status]:
    """Return the rows of a navigator: itself (mode, reason, sigmas), its integrity tests where it has any, then one per aid.

    Sigma names and aid labels carry their units; the age of an aid is judged at the navigator's own time.  ``approach_category`` is the
    strictest precision approach that two of its own sigmas (95 % or more, both ways) allow.  The ``details`` of a status, such as
    ``flying_on`` of the supervisor, are values too, and so is every contradiction that holds.
    """
    values = {"mode": status.mode, "reason": status.reason, **status.details}
    values |= {k: f"{v:.4g}" for k, v in status.sigmas.items()}
    if {"position_horizontal_m", "position_down_m"} <= status.sigmas.keys():
        horizontal, vertical = 2.0 * status.sigmas["position_horizontal_m"], 2.0 * status.sigmas["position_down_m"]
        values["approach_category"] = category(horizontal, vertical) or "none"
    for record in status.inputs:
        values |= {f"rejected[{record.source}: {reason}]": str(n) for reason, n in record.rejected.items()}
    message = f"{status.mode}: {status.reason}" if status.reason else status.mode
    for found in status.contradictions:
        words = found.words(status.stamp_ns or found.since_ns)
        values[f"contradiction[{found.name}: {found.suspect or ', '.join(found.parties)}]"] = words
        message += f"; {words}" if words not in message else ""
    rows = [Status(f"{prefix}: navigator", status.level, message, values)]
    if status.integrity is not None:
        rows.append(_integrity_row(prefix, status.integrity))
    return [*rows, *(_aid_row(prefix, aid, status.stamp_ns) for aid in status.aids)]


def _warn(is_bad: bool) -> Level:
    return Level.WARN if is_bad else Level.OK


def _integrity_row(prefix: str, integrity: Integrity) -> Status:
    """Verdict, protection levels and excluded satellites; an alarm, a contradiction and a test that is not possible are warnings."""
    levels = ("hpl_m", "vpl_m", "lasting_hpl_m", "lasting_vpl_m")
    known = {name: getattr(integrity, name) for name in levels}
    values = {"verdict": integrity.verdict, "reason": integrity.reason, "alarm": integrity.alarm}
    values |= {name: "" if value is None else f"{value:.1f}" for name, value in known.items()}
    values |= {f"excluded[{satellite}]": why for satellite, why in integrity.excluded.items()}
    if integrity.alarm_ns is not None:
        values["alarm_stamp_s"] = f"{1e-9 * integrity.alarm_ns:.1f}"
    message = f"{integrity.verdict}: {integrity.alarm or integrity.reason}" if integrity.alarm or integrity.reason else integrity.verdict
    return Status(f"{prefix}: integrity", _warn(bool(integrity.alarm) or integrity.verdict != "healthy"), message, values)


def _aid_row(prefix: str, aid: AidStatus, now_ns: int | None) -> Status:
    age = None if now_ns is None else aid.age_s(now_ns)
    values = {"test_ratio": f"{aid.test_ratio:.3g}", "accepted": str(aid.accepted).lower(), "reason": aid.reason}
    values |= {"age_s": "" if age is None else f"{age:.2f}", "fused": str(aid.fused), "rejected": str(sum(aid.rejected.values()))}
    if aid.innovation is not None and aid.innovation_variance is not None:
        for label, innovation, variance in zip(aid.labels, aid.innovation, aid.innovation_variance, strict=False):
            values |= {f"innovation_{label}": f"{innovation:.4g}", f"innovation_sigma_{label}": f"{max(variance, 0.0) ** 0.5:.4g}"}
    values |= {f"rejected[{reason}]": str(n) for reason, n in aid.rejected.items()}
    rejecting = not aid.accepted and aid.test_ratio > 1.0
    message = f"{aid.name}: {aid.reason or 'used'}"
    return Status(f"{prefix}: aid {aid.name}", _warn(rejecting), message, values)
