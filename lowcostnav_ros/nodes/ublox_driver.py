"""A u-blox receiver, generation 8 or later, onto gps/fix and gps/vel, and its raw satellites onto gnss/raw."""

from collections.abc import Iterable
from dataclasses import dataclass

from lowcostnav_ros.base.measurements import GnssEpoch, Measurement
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.formats.ubx import UbloxParser
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.driver_node import DriverNode, PortSettings, source_setting


@dataclass(frozen=True)
class UbloxSettings(PortSettings):
    """Port and what is published of a u-blox receiver."""

    source: str = source_setting("/dev/ttyACM0")
    raw: bool = setting(True, "Publish gnss/raw where the receiver gives RXM-RAWX and RXM-SFRBX.")


@executable("ublox_driver", kind="driver", Settings=UbloxSettings)
class UbloxDriver(DriverNode):
    """Publish what a u-blox receiver says."""

    def make_parser(self) -> Parser:
        """Frames; without raw data no satellite is located."""
        parser = UbloxParser()
        parser.is_locating = self.settings.raw
        return parser

    def published(self, measurement: Measurement) -> Iterable[Measurement]:
        """Publish all but raw data that is not asked for."""
        if self.settings.raw or not isinstance(measurement, GnssEpoch):
            yield measurement
