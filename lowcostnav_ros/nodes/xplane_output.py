"""A navigator to tablets as a flight simulator's text, to UDP port 49002, for those that do not take GDL 90."""

from dataclasses import dataclass

from lowcostnav_ros.formats.xplane_text import XPlaneText
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.output_node import Encoder, OutputNode, OutputSettings, destination_setting


@dataclass(frozen=True)
class XPlaneSettings(OutputSettings):
    """What is shown, and where it goes."""

    destination: str = destination_setting("udp:127.0.0.1:49002")


@executable("xplane_output", Settings=XPlaneSettings, compiled=False)
class XPlaneOutput(OutputNode):
    """Send XGPS and XATT."""

    def make_encoder(self) -> Encoder:
        """Lines."""
        return XPlaneText()
