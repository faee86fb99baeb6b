"""A troposphere to simulate with, of no filter's form: hydrostatic air of a chosen lapse rate, vapour falling off exponentially.

N = 77.6890 p_dry/T + 71.2952 e/T + 375463 e/T^2 (Rueger 2002), integrated along the straight ray by Gauss and Legendre, heights with
the curvature of the earth; a gradient across the area makes the same path differ by direction.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.physics.atmosphere import GAS_CONSTANT
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.radionav.weather import Weather

EARTH_M = 6.371e6
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
NODES, WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS


@dataclass(frozen=True, slots=True)
class AirColumn:
    """Air over a place where the weather is known.

    ``lapse_k_per_m`` how temperature falls, ``vapour_m`` height over which the vapour falls to 1/e, ``gradient`` growth of N per metre
    eastward.
    """

    weather: Weather
    height: float
    lapse_k_per_m: float = 6.5e-3
    vapour_m: float = 2200.0
    gradient: float = 0.0

    def refractivity(self, height: np.ndarray) -> np.ndarray:
        """N at heights, m, over the place."""
        above = height - self.height
        T = self.weather.temperature_k - self.lapse_k_per_m * above
        ratio = T / self.weather.temperature_k
        p = 0.01 * self.weather.pressure_pa * ratio ** (STANDARD_GRAVITY / (GAS_CONSTANT * self.lapse_k_per_m))
        e = self.weather.vapour_hpa() * np.exp(-above / self.vapour_m)
        return 77.689 * (p - e) / T + 71.2952 * e / T + 375463.0 * e / T**2

    def at(self, height: float) -> Weather:
        """Weather at a height, m."""
        T = self.weather.temperature_k - self.lapse_k_per_m * (height - self.height)
        p = self.weather.pressure_pa * (T / self.weather.temperature_k) ** (STANDARD_GRAVITY / (GAS_CONSTANT * self.lapse_k_per_m))
        e = self.weather.vapour_hpa() * math.exp(-(height - self.height) / self.vapour_m)
        return Weather(p, T, min(e / Weather(p, T, 1.0).vapour_hpa(), 1.0))

    def delays(self, bottom: np.ndarray, top: float, ranges: np.ndarray, east: np.ndarray | float = 0.0) -> np.ndarray:
        """Delays (n,), m, along rays of ``ranges`` (n,) m from heights ``bottom`` (n,), their middles ``east`` (n,) m east of the place."""
        sag = np.outer(ranges**2 / (2.0 * EARTH_M), NODES * (1.0 - NODES))
        heights = bottom[:, None] + np.outer(top - bottom, NODES) - sag
        return 1e-6 * (self.refractivity(heights) @ WEIGHTS + self.gradient * east) * ranges
