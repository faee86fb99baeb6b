"""A navigator as a receiver: GGA, RMC, VTG and GST for autopilots, loggers and moving maps."""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.formats.nmea_sentences import NmeaSentences
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.output_node import Encoder, OutputNode, OutputSettings, destination_setting


@dataclass(frozen=True)
class NmeaOutputSettings(OutputSettings):
    """What is shown, and where it goes."""

    destination: str = destination_setting("udp:127.0.0.1:10110")
    talker: str = setting(
        "GP", "Talker of the sentences: many instruments take GP alone; IN is integrated navigation.", choices=("GP", "GN", "IN")
    )


@executable("nmea_output", Settings=NmeaOutputSettings, compiled=False)
class NmeaOutput(OutputNode):
    """Send NMEA 0183."""

    def make_encoder(self) -> Encoder:
        """Sentences of the talker."""
        return NmeaSentences(self.settings.talker)
