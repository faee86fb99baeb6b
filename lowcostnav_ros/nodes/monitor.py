"""Write every status on /diagnostics to standard output, one JSON object a line: what the graph runner's table is made from.

The runner reads this instead of subscribing itself, so that the process of the command line needs no ROS.
"""

import json
import sys
from collections.abc import Iterable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.input_monitor import OK, Status
from lowcostnav_ros.ros.node_base import NodeBase


@executable("monitor", kind="monitor", compiled=False)
class Monitor(NodeBase):
    """Subscribe to /diagnostics and write every status out."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("monitor", **kwargs)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._pass_on, qos.sensor_subscription())

    def rows(self) -> Iterable[Status]:
        """One row of its own: that it comes through shows that the monitor hears what is reported."""
        yield Status(f"{self.get_name()}: monitor", OK, "passes reports on", {})

    def _pass_on(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {entry.key: entry.value for entry in status.values}
            line = {"name": status.name, "level": status.level[0], "message": status.message, "values": values}
            line["hardware_id"] = status.hardware_id
            sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()
