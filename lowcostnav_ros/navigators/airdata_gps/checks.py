"""What the residuals say of the sensors: vanes that stick or have the other sign, a heading from the other north, straight flight."""

import math
from collections import deque

import numpy as np

from lowcostnav_ros.physics.rotation import wrap

STUCK_NS = 8_000_000_000
MOVED = 1e-9
SIGN, LEAST_SIGN = "sideslip has the opposite sign: residual follows it", 5.0
SPACED_NS, FORGET = 2_000_000_000, 0.97
"""Spacing of what the regression of the sign compares, and what is left of its sums from one to the next."""
SAME_COURSE, SAME_SPEED = math.radians(8.0), 0.06
OTHER_NORTH = "heading counts from the other north: estimated error equals the magnetic variation"


class VaneWatch:
    """Whether an angle of the airflow moves at all; one that does not, to the last bit, for seconds in flight is stuck."""

    def __init__(self, name: str) -> None:
        self.name, self._value, self._since_ns = name, math.nan, 0

    def is_stuck(self, stamp_ns: int, tangent: float) -> bool:
        """Take the tangent of the angle in."""
        if not abs(tangent - self._value) <= MOVED:
            self._value, self._since_ns = tangent, stamp_ns
        return stamp_ns - self._since_ns >= STUCK_NS


class SignWatch:
    """Regression of the change of what GPS shows of the wind on the change of what sideslip adds to it: -2 where its sign is wrong."""

    def __init__(self) -> None:
        self._last: tuple[int, np.ndarray, np.ndarray] | None = None
        self._xx = self._xy = self._yy = self._count = 0.0

    def take(self, stamp_ns: int, lateral_n: np.ndarray, wind_n: np.ndarray) -> str:
        """Take sideways airspeed (3,), NED, and velocity over ground less air velocity (3,) in; what is wrong, empty for nothing."""
        if self._last is None or stamp_ns - self._last[0] >= SPACED_NS:
            if self._last is not None and stamp_ns - self._last[0] < 2 * SPACED_NS:
                x, y = lateral_n - self._last[1], wind_n - self._last[2]
                self._xx, self._xy, self._yy = FORGET * self._xx + x @ x, FORGET * self._xy + x @ y, FORGET * self._yy + y @ y
                self._count = FORGET * self._count + 3.0
            self._last = stamp_ns, lateral_n, wind_n
        if self._count < 30.0 or self._xx <= 1e-6:
            return ""
        slope = self._xy / self._xx
        scatter = max(self._yy - slope * self._xy, 1e-9) / self._count
        return SIGN if slope < -1.2 and -slope > LEAST_SIGN * math.sqrt(scatter / self._xx) else ""


class StraightWatch:
    """Whether course and speed have stayed for so long that only the sum of wind and the other corrections is observable."""

    def __init__(self, span_s: float) -> None:
        self._span_ns = round(1e9 * span_s)
        self._looks: deque[tuple[int, float, float]] = deque(maxlen=4000)

    def is_straight(self, stamp_ns: int, heading: float, speed: float) -> bool:
        """Take heading, rad, and airspeed, m/s, in, at fixes."""
        if self._span_ns == 0:
            return False
        self._looks.append((stamp_ns, heading, speed))
        while stamp_ns - self._looks[1 if len(self._looks) > 1 else 0][0] > self._span_ns:
            self._looks.popleft()
        if stamp_ns - self._looks[0][0] < self._span_ns:
            return False
        turned = np.abs(wrap(np.array([look[1] for look in self._looks]) - heading)).max()
        changed = np.abs(np.array([look[2] for look in self._looks]) - speed).max()
        return bool(turned < SAME_COURSE and changed < SAME_SPEED * max(speed, 1.0))


def other_north(error: float, sigma: float, offset_sigma: float, variation: float, is_magnetic: bool) -> str:
    """Whether an estimated heading correction, rad, is that of the other reference of north.

    Parameters
    ----------
    error, sigma : float
        Correction and its sigma.
    offset_sigma : float
        What the settings expect of it.
    variation : float
        Magnetic variation at the place, east positive: what a magnetic heading lacks.
    is_magnetic : bool
        Whether the settings take the heading for magnetic, so that a true one has it added once too often.
    """
    expected = -variation if is_magnetic else variation
    if abs(variation) < math.radians(3.0) or abs(error) < 1.5 * offset_sigma or sigma > 0.3 * abs(variation):
        return ""
    return OTHER_NORTH if abs(wrap(error - expected)) < max(3.0 * sigma, 0.25 * abs(variation)) else ""
