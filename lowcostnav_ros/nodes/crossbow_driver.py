"""A Crossbow DMU or AHRS400 on a serial port onto imu/data_raw and imu/mag; its own attitude onto imu/data where it is asked for."""

import math
from dataclasses import dataclass

from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.formats.crossbow import LAYOUTS, CrossbowParser, CrossbowUnit
from lowcostnav_ros.formats.parser import Parser
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.ros.driver_node import DriverNode, PortSettings


@dataclass(frozen=True)
class CrossbowSettings(PortSettings):
    """Port and make of a unit."""

    baud: int = setting(38_400, "Serial rate; 0 finds it.", minimum=0, maximum=4_000_000)
    packet: str = setting("angle", "Mode of the unit: AHRS400 angle or scaled, VG angle, DMU-6X scaled.", choices=tuple(LAYOUTS))
    rate_range_dps: float = setting(100.0, "Range of the gyros, of the unit's label.", unit="deg/s", minimum=1.0, maximum=1000.0)
    accel_range_g: float = setting(2.0, "Range of the accelerometers, of the unit's label.", unit="g", minimum=0.5, maximum=50.0)
    started: bool = setting(True, "Command the unit into this mode and to send; off for a unit that does so by itself.")
    attitude: bool = setting(False, "Publish the unit's own attitude as imu/data and imu/data_fused: not beside the node ahrs.")
    declination_deg: float = setting(0.0, "Declination, east positive, added to its heading.", unit="deg", minimum=-180.0, maximum=180.0)


@executable("crossbow_driver", kind="driver", Settings=CrossbowSettings, compiled=False)
class CrossbowDriver(DriverNode):
    """Publish what a Crossbow unit measures."""

    def make_parser(self) -> Parser:
        """Packets of the unit's mode."""
        s = self.settings
        unit = CrossbowUnit(s.packet, s.rate_range_dps, s.accel_range_g)
        return CrossbowParser(unit, math.radians(s.declination_deg), s.started)
