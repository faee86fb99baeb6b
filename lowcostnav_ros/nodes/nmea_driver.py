"""An NMEA 0183 receiver onto gps/fix and gps/vel; the pressure height of a glider's recorder onto air/static_pressure."""

from lowcostnav_ros.formats.nmea import NmeaParser
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.driver_node import DriverNode, PortSettings


@executable("nmea_driver", kind="driver", Settings=PortSettings, compiled=False)
class NmeaDriver(DriverNode):
    """Publish what an NMEA receiver says."""

    def make_parser(self) -> Parser:
        """Sentences."""
        return NmeaParser()
