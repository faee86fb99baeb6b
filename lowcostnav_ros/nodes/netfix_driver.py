"""The avionics bus of an amateur-built aircraft, through its NetFIX gateway, onto the air data and GPS topics."""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.formats.netfix import NetfixParser
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.driver_node import DriverNode, PortSettings


@dataclass(frozen=True)
class NetfixSettings(PortSettings):
    """Where the gateway is, and the time of what comes from it."""

    source: str = setting("tcp:127.0.0.1:3490", "tcp:HOST:PORT of the gateway.")


@executable("netfix_driver", kind="driver", Settings=NetfixSettings, compiled=False)
class NetfixDriver(DriverNode):
    """Publish what the bus carries."""

    def make_parser(self) -> Parser:
        """Values of the gateway."""
        return NetfixParser()
