"""A DME receiver, through a small microcontroller that writes sentences or ARINC 429 words, onto dme/range."""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.formats.dme import DmeParser, parse_stations
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.driver_node import DriverNode, PortSettings


@dataclass(frozen=True)
class DmeDriverSettings(PortSettings):
    """Port of a DME receiver."""

    dme_stations: list[str] = setting([], "Stations by frequency, as 'OAK:116.80', for ARINC words, which carry no ident.")

    def __post_init__(self) -> None:
        super().__post_init__()
        parse_stations(self.dme_stations)


@executable("dme_driver", kind="driver", Settings=DmeDriverSettings, compiled=False)
class DmeDriver(DriverNode):
    """Publish the distances of a DME receiver."""

    def make_parser(self) -> Parser:
        """Sentences and words."""
        return DmeParser(parse_stations(self.settings.dme_stations))
