"""Any text stream of rows, by a column profile of ``lowcostnav convert``, onto the topics that the profile names."""

from dataclasses import dataclass

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.convert.profile import ConvertError, load_profile
from lowcostnav_ros.convert.stream import TableParser
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.driver_node import DriverNode, PortSettings


@dataclass(frozen=True)
class CsvSettings(PortSettings):
    """Port and profile of a stream."""

    profile: str = setting("imu_stream", "Column profile of the stream: a file, or the name of a shipped one.")

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            TableParser(load_profile(self.profile))
        except ConvertError as error:
            raise SettingsError(str(error)) from error


@executable("csv_driver", kind="driver", Settings=CsvSettings, compiled=False)
class CsvDriver(DriverNode):
    """Publish the rows of a stream."""

    def make_parser(self) -> Parser:
        """Rows by the profile."""
        return TableParser(load_profile(self.settings.profile))
