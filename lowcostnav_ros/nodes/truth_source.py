"""Fly a true flight in real time: /clock, truth/imu, truth/odometry, truth/wind, truth/origin."""

from collections.abc import Iterable
from typing import Any

from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.messages import encode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.ros.scenario import flight_bases
from lowcostnav_ros.ros.source_node import SourceNode
from lowcostnav_ros.simulation.truth_states import TruthStates
from lowcostnav_ros.trajectory import TruthSettings, build


@executable("truth_source", kind="source", Settings=TruthSettings)
class TruthSource(SourceNode):
    """Publish the truth in real time, of one stamp the inertial sample first."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("truth_source", flight_bases, **kwargs)

    def make_outputs(self) -> None:
        """Make the publishers of the truth."""
        self._imu = self.output("truth/imu")
        for part in ("odometry", "wind", "origin"):
            self.output(f"truth/{part}")

    def publish_all(self) -> None:
        """Fly."""
        truth, flight = self.parameters.settings[:2]
        states = TruthStates()
        for block in build(truth, flight.seed).blocks():
            self._send(states.begin(block))
            for row, stamp_ns in enumerate(block.stamps_ns.tolist()):
                if not self.at(stamp_ns):
                    return
                self._imu.send(to_cdr(encode.truth_imu(block, row)))
                self._send(states.at(block, row))

    def _send(self, messages: Iterable[tuple[str, Any]]) -> None:
        for topic, message in messages:
            self.output(topic).send(to_cdr(message))
