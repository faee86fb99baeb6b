"""A navigator onto the avionics bus of an amateur-built aircraft: values written to a NetFIX gateway, TCP port 3490."""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.formats.netfix import NetfixLines
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.output_node import Encoder, OutputNode, OutputSettings


@dataclass(frozen=True)
class NetfixOutputSettings(OutputSettings):
    """What is shown, and where it goes."""

    destination: str = setting("tcp:127.0.0.1:3490", "udp:HOST:PORT, tcp:HOST:PORT, a serial port, or file:PATH that is appended to.")


@executable("netfix_output", Settings=NetfixOutputSettings, compiled=False)
class NetfixOutput(OutputNode):
    """Write values."""

    def make_encoder(self) -> Encoder:
        """Lines."""
        return NetfixLines()
