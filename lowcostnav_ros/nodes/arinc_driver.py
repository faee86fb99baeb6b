"""ARINC 429 words, framed by a microcontroller, onto the GPS, inertial and DME topics; an AHRS's attitude where it is asked for."""

import math
from dataclasses import dataclass

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.formats.arinc429 import ArincParser
from lowcostnav_ros.formats.dme import parse_stations
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.driver_node import DriverNode, PortSettings


@dataclass(frozen=True)
class ArincSettings(PortSettings):
    """Port and what the bus carries."""

    dme_stations: list[str] = setting([], "DME stations by frequency, as 'OAK:116.80': the bus carries no ident.")
    attitude: bool = setting(False, "Publish the AHRS's attitude as imu/data and imu/data_fused: not beside the node ahrs.")
    declination_deg: float = setting(0.0, "Declination, added to a magnetic heading.", unit="deg", minimum=-180.0, maximum=180.0)
    gravity_positive: bool = setting(False, "The accelerations read +1 g on the axis that points down.")

    def __post_init__(self) -> None:
        super().__post_init__()
        parse_stations(self.dme_stations)


@executable("arinc_driver", kind="driver", Settings=ArincSettings, compiled=False)
class ArincDriver(DriverNode):
    """Publish what a bus carries."""

    def make_parser(self) -> Parser:
        """Words."""
        s = self.settings
        return ArincParser(parse_stations(s.dme_stations), math.radians(s.declination_deg), s.gravity_positive)
