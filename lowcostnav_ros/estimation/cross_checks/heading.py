"""A heading against the track over ground: apart by more than any wind makes an aircraft crab, magnetometer or gyro is wrong."""

import cmath
import math

import numpy as np

from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.physics.rotation import wrap

SLOWEST_MPS = 12.0
STRONGEST_WIND_MPS = 20.0
MARGIN_RAD = math.radians(20.0)
UNKNOWN = 3.0
"""Sigmas within which a heading contradicts nothing: it is not known."""
MOVING_MPS, KNOWN_RAD = 4.0, math.radians(10.0)
"""Slower, or with a larger sigma, a heading shows no mounting."""
MEMORY_S, LONG_S = 120.0, 40.0
STEADY, EVERYWHERE = 0.97, 0.7
"""Lengths of the mean directions: of the angle between nose and track, at least (a scatter of 14 deg), and of the track, at most."""
TURNED_RAD = math.radians(40.0)


def heading_of(C: np.ndarray) -> float:
    """Heading of an attitude ``C_nb`` (3, 3) that is not steep, rad in (-pi, pi]."""
    return math.atan2(C[1, 0], C[0, 0])


def crabs(heading: float, north_mps: float, east_mps: float) -> float | None:
    """Heading minus track, rad, where it is more than wind and margin explain; else None."""
    speed = math.hypot(north_mps, east_mps)
    if speed < SLOWEST_MPS:
        return None
    apart = wrap(heading - math.atan2(east_mps, north_mps))
    return apart if abs(apart) > math.asin(min(1.0, STRONGEST_WIND_MPS / speed)) + MARGIN_RAD else None


class HeadingCheck(Latch):
    """Magnetic heading and track, deg."""

    def __init__(self, field: str) -> None:
        super().__init__("magnetic heading and track disagree", (field, "the GPS track"), "deg", begin_s=2.0)

    def compare(self, stamp_ns: int, heading: float, north_mps: float, east_mps: float) -> bool:
        """Compare a magnetic heading, rad, with the velocity over ground; return whether a contradiction begins."""
        apart = crabs(heading, north_mps, east_mps)
        advice = "magnetometer mounted turned, its axes half converted, or not calibrated"
        return self.judge(stamp_ns, apart is not None, math.degrees(abs(apart or 0.0)), self.parties[0], advice)


class OwnHeadingCheck(Latch):
    """A navigator's own heading and the track, deg: what the gyros have turned it by."""

    _taken_ns: int

    def __init__(self, imu: str) -> None:
        super().__init__("heading and track disagree", (imu, "the GPS track"), "deg", begin_s=1.0, end_s=20.0)

    def compare(self, stamp_ns: int, heading: float, sigma: float, north_mps: float, east_mps: float) -> float | None:
        """Compare a heading and its sigma, rad, with the velocity over ground; return heading minus track where that is better."""
        apart = crabs(heading, north_mps, east_mps)
        if apart is not None and abs(apart) < UNKNOWN * sigma:
            apart = None
        began = self.judge(stamp_ns, apart is not None, math.degrees(abs(apart or 0.0)), self.parties[0], "a gyro is wrong")
        again = apart is not None and self.held is not None and stamp_ns - self._taken_ns >= self.begin_ns
        if not began and not again:
            return None
        self._taken_ns = stamp_ns
        return apart

    def clear(self) -> None:
        """Forget all."""
        super().clear()
        self._taken_ns = 0


class MountingCheck(Latch):
    """Nose and track apart by the same angle whatever the direction of flight, deg: no wind, but an IMU turned about the vertical."""

    def __init__(self, imu: str) -> None:
        super().__init__("IMU mounting and track disagree", (imu, "the GPS track"), "deg", begin_s=5.0)

    def clear(self) -> None:
        """Forget all."""
        super().clear()
        self._apart, self._track, self._weight, self._last_ns = 0j, 0j, 0.0, 0

    def compare(self, stamp_ns: int, heading: float, sigma: float, north_mps: float, east_mps: float) -> None:
        """Take a heading and its sigma, rad, and the velocity over ground."""
        dt = min(max(1e-9 * (stamp_ns - self._last_ns), 0.0), 1.0) if self._last_ns else 0.0
        self._last_ns = stamp_ns
        speed = math.hypot(north_mps, east_mps)
        if speed < MOVING_MPS or sigma > KNOWN_RAD:
            return
        track, nose, kept = complex(north_mps, east_mps) / speed, cmath.exp(1j * heading), math.exp(-dt / MEMORY_S)
        self._apart = kept * self._apart + dt * nose * track.conjugate()
        self._track, self._weight = kept * self._track + dt * track, kept * self._weight + dt
        turned = cmath.phase(self._apart)
        is_same = abs(self._apart) > STEADY * self._weight and abs(self._track) < EVERYWHERE * self._weight
        degrees = math.degrees(turned)
        advice = f"is the IMU turned by {degrees:.0f} deg about the vertical? imu.mounting_deg takes roll, pitch, yaw: 0, 0, {degrees:.0f}"
        self.judge(stamp_ns, is_same and self._weight > LONG_S and abs(turned) > TURNED_RAD, abs(degrees), self.parties[0], advice)
