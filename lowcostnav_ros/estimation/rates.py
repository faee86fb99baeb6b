"""Rates of inputs and outputs by their stamps, how far one input lags behind another, and how long a solution lasts without its aid."""

import math
from collections import deque

WINDOW_NS = 10_000_000_000
MOST = 4096
"""Stamps kept of one input."""
LONGEST_S = 3600.0


class RateMonitor:
    """Rates over the last ten seconds, by stamps alone.

    Attributes
    ----------
    lag_s : float
        By how much the stamp of the last slow input was behind the newest stamp of all when it arrived.
    """

    def __init__(self) -> None:
        self._stamps: dict[str, deque[int]] = {}
        self._newest_ns, self.lag_s = 0, 0.0

    def clear(self) -> None:
        """Forget all."""
        self._stamps.clear()
        self._newest_ns, self.lag_s = 0, 0.0

    def take(self, name: str, stamp_ns: int, *, is_slow: bool = False) -> None:
        """Take what has arrived, in the order of arrival; ``is_slow``: its lag is wanted."""
        kept = self._stamps.setdefault(name, deque(maxlen=MOST))
        if not kept or stamp_ns > kept[-1]:
            kept.append(stamp_ns)
        self._newest_ns = max(self._newest_ns, stamp_ns)
        if is_slow:
            self.lag_s = 1e-9 * (self._newest_ns - stamp_ns)

    def rate_hz(self, name: str) -> float:
        """One over the mean spacing of stamps, Hz; 0 while there are not two."""
        kept = self._stamps.get(name, ())
        recent = [s for s in kept if kept[-1] - s <= WINDOW_NS] if kept else []
        return 1e9 * (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 1 else 0.0


def coast_sigma(t_s: float, position: float, velocity: float, bias: float, density: float) -> float:
    """Sigma of a position ``t_s`` seconds without aids, m.

    sqrt(P_p + (s_v t)^2 + (s_b t^2 / 2)^2 + q t^3 / 3) with the sigmas of position, m, velocity, m/s, and acceleration bias, m/s^2, at
    their beginning, and the density q of white acceleration, m^2/s^3.
    """
    return math.sqrt(position**2 + (velocity * t_s) ** 2 + (0.5 * bias * t_s * t_s) ** 2 + density * t_s**3 / 3.0)


def coast_time(limit_m: float, position: float, velocity: float, bias: float, density: float) -> float:
    """Seconds without aids until the sigma of the position exceeds ``limit_m``; 0 where it does already, an hour at most."""
    low, high = 0.0, LONGEST_S
    if coast_sigma(0.0, position, velocity, bias, density) >= limit_m:
        return 0.0
    if coast_sigma(high, position, velocity, bias, density) <= limit_m:
        return high
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if coast_sigma(middle, position, velocity, bias, density) <= limit_m else (low, middle)
    return low
