"""The air data computer as a node: pressures and temperature in, ``air/velocity`` out, unless something else publishes that."""

from collections.abc import Iterable
from typing import Any

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.estimation.air_data.computer import AIR, IMPACT, INPUTS, AirDataComputer, AirDataComputerSettings
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.messages.encode import encode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.ros.input_monitor import OK, WARN, Status
from lowcostnav_ros.ros.node_base import NodeBase


@executable(
    "air_data_computer",
    Settings=AirDataComputerSettings,
    compiled=False,
    inputs=("air/static_pressure", "air/dynamic_pressure", "air/temperature", "gps/vel"),
    outputs=("air/velocity",),
)
class AirDataComputerNode(NodeBase):
    """Compute ``air/velocity``; quiet while another node publishes it: one airspeed must not come twice."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("air_data_computer", [AirDataComputerSettings()], **kwargs)
        self.computer = AirDataComputer(self.parameters.settings[0])
        self.output(AIR)
        for source in INPUTS:
            self.listen(source, self._take)  # none is required: an aircraft whose air data computer is fitted has no pressures here

    def rows(self) -> Iterable[Status]:
        """Add what is computed, or why nothing is."""
        yield from super().rows()
        computer = getattr(self, "computer", None)
        if computer is None:
            return
        values = {f"rejected: {reason}": str(count) for reason, count in computer.rejected.items()}
        if computer.latest is not None:
            data = computer.latest
            speeds = {"ias_mps": data.ias, "cas_mps": data.cas, "eas_mps": data.eas, "tas_mps": data.tas, "mach": data.mach}
            speeds |= {"pressure_altitude_m": data.pressure_altitude, "temperature_k": data.temperature_k}
            values |= {name: f"{value:.4g}" if name == "mach" else f"{value:.2f}" for name, value in speeds.items()}
            values["temperature"] = "measured" if data.is_measured else "standard atmosphere"
        others = self._others()
        words = f"quiet: {others} other publisher of {AIR}" if others else computer.sentence()
        is_well = others or not computer.reason or not self.inputs[IMPACT].count
        yield Status(f"{self.get_name()}: air data", OK if is_well else WARN, words, values)

    def reset(self, reason: str) -> str:
        """Forget pressures, temperature and doubts."""
        self.computer.reset()
        return f"{self.get_name()} was reset ({reason})."

    def _others(self) -> int:
        return self.count_publishers(self.outputs[AIR].publisher.topic_name) - 1

    def _take(self, measurement: Measurement) -> None:
        computed = self.computer.feed(measurement)
        if computed and self._others() <= 0:
            for velocity in computed:
                self.output(AIR).send(to_cdr(encode(velocity)))
