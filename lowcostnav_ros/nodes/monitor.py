"""Write every status on /diagnostics to standard output, one JSON object a line: what the graph runner's table is made from.

The runner reads this instead of listening itself, so that it, and the command line behind it, need no ROS in their own process.
"""

import json
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.node_base import NodeBase


@executable("monitor", kind="monitor", compiled=False)
class Monitor(NodeBase):
    """Listen to all nodes and pass on what they say of themselves."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("monitor", **kwargs)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._pass_on, qos.sensor_subscription())

    def _pass_on(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {entry.key: entry.value for entry in status.values}
            line = {"name": status.name, "level": status.level[0], "message": status.message, "values": values}
            sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()
