"""Offsets of an inertial solution from GPS, of acceleration and of position, each a bias of three states: the two filters of a cascade.

They are fed by what the filters step with, an attitude or a fix; the core keeps the last fix.
"""

from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.units import FOOT
from lowcostnav_ros.cores.cascade import CascadeSettings, cascade_blocks
from lowcostnav_ros.estimation.aiding import Aid, Decision, Host, Innovation, Sensor, each
from lowcostnav_ros.estimation.error_state import Block

NO_FIX, TOO_FEW = "no fresh fix", "fixes too few to differentiate"


@runtime_checkable
class Offsets(Protocol):
    """Offsets of an inertial solution from GPS."""

    def accel_offset(self) -> np.ndarray | None:
        """Of acceleration (3,), body axes, m/s^2; None where it is not known."""

    def position_offset(self) -> np.ndarray | None:
        """Of position (3,), NED m; None where it is not known."""

    def is_stale(self, t_ns: int) -> bool:
        """Whether the last fix is too old."""


class OffsetAid(Aid):
    """One of the two: z against the bias, H = I.

    Attributes
    ----------
    doubted : str
        Why GPS is not to be used at present.
    r_factor : float
        What R is multiplied by: the filters' step over that which R is of.
    """

    views, topic, updates_alone = (Offsets,), "", True
    block: ClassVar[str]
    doubted, r_factor = "", 1.0

    def blocks(self) -> list[Block]:
        """The bias."""
        return [block for block in cascade_blocks(self.settings) if block.name == self.block]

    def attach(self, host: Host) -> None:
        """Find the bias."""
        super().attach(host)
        self._rows = host.layout[self.block]

    def offset(self, host: Host) -> np.ndarray | None:
        """z (3,), None where it is not known."""
        raise NotImplementedError

    def variance(self) -> float:
        """R as set, SI."""
        raise NotImplementedError

    def innovation(self, measurement: Measurement, host: Host) -> Innovation | str:
        """y = z - b."""
        z = None if host.core.is_stale(measurement.stamp_ns) else self.offset(host)
        if z is None:
            return NO_FIX if host.core.is_stale(measurement.stamp_ns) else TOO_FEW
        H = np.zeros((3, host.layout.size))
        H[:, self._rows] = np.eye(3)
        return Innovation(z - host.core.estimate[self._rows], H, self.variance() * self.r_factor * np.eye(3), z)

    def control(self, stamp_ns: int, test_ratio: float, host: Host) -> tuple[Decision, str]:
        """Fuse whatever GPS is not doubted for: a filter that lags has no gate, its host watches the offset."""
        return (Decision.REJECT, self.doubted) if self.doubted else (Decision.FUSE, "")


class AccelOffsetAid(OffsetAid):
    """Offset of acceleration against the accelerometer bias, m/s^2, body axes."""

    name, labels, block = "gps_acceleration", ("x_mps2", "y_mps2", "z_mps2"), "accel_bias"

    def offset(self, host: Host) -> np.ndarray | None:
        """z_a of the core."""
        return host.core.accel_offset()

    def variance(self) -> float:
        """R of the acceleration filter, (m/s^2)^2."""
        return self.settings.r_accel_ft2 * FOOT**2


class PositionOffsetAid(OffsetAid):
    """Offset of position against the position bias, m NED."""

    name, labels, block, is_fix = "gps_offset", ("north_m", "east_m", "down_m"), "position_bias", True

    def offset(self, host: Host) -> np.ndarray | None:
        """z_p of the core."""
        return host.core.position_offset()

    def variance(self) -> float:
        """R of the position filter, m^2."""
        return self.settings.r_position_ft2 * FOOT**2


CASCADE = Sensor("cascade", CascadeSettings, each(AccelOffsetAid, PositionOffsetAid))
