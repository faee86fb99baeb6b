"""A PX4 or ArduPilot autopilot as the sensor box: inertial, magnetic, pressure, airspeed and GPS topics from its MAVLink stream."""

from collections.abc import Iterable
from dataclasses import dataclass

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.formats.mavlink import MavlinkParser
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.driver_node import DriverNode, PortSettings, source_setting


@dataclass(frozen=True)
class MavlinkSettings(PortSettings):
    """Port and what is published of an autopilot."""

    source: str = source_setting("/dev/ttyACM0")
    attitude: bool = setting(False, "Publish the autopilot's own attitude as imu/data and imu/data_fused: not beside the node ahrs.")
    solution: bool = setting(True, "Publish the autopilot's own position as autopilot/odometry, to compare with.")


@executable("mavlink_driver", kind="driver", Settings=MavlinkSettings, compiled=False)
class MavlinkDriver(DriverNode):
    """Publish what an autopilot measures."""

    def make_parser(self) -> Parser:
        """Frames of both versions."""
        return MavlinkParser()

    def published(self, measurement: Measurement) -> Iterable[Measurement]:
        """Publish the autopilot's own solution only where it is asked for."""
        if self.settings.solution or not isinstance(measurement, NavSolution):
            yield from super().published(measurement)
