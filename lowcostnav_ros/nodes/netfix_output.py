"""A navigator onto the avionics bus of an amateur-built aircraft: values written to a NetFIX gateway, TCP port 3490."""

from dataclasses import dataclass

from lowcostnav_ros.formats.netfix import NetfixLines
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.output_node import Encoder, OutputNode, OutputSettings, destination_setting


@dataclass(frozen=True)
class NetfixOutputSettings(OutputSettings):
    """What is shown, and where it goes."""

    destination: str = destination_setting("tcp:127.0.0.1:3490")


@executable("netfix_output", Settings=NetfixOutputSettings, compiled=False)
class NetfixOutput(OutputNode):
    """Write values."""

    def make_encoder(self) -> Encoder:
        """Lines."""
        return NetfixLines()
