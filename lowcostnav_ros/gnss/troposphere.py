"""Troposphere: zenith delay of a standard atmosphere by latitude, season and height, and its mapping to low elevations.

References
----------
RTCA DO-229, appendix A.4.2.4 (the UNB3 model of Collins and Langley): meteorology, zenith delays, mapping and residual error.
"""

import math
from datetime import UTC, datetime

import numpy as np

from lowcostnav_ros.base.units import STANDARD_GRAVITY
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.gps_time import SECOND, unix_ns

_LATITUDES = np.array([15.0, 30.0, 45.0, 60.0, 75.0])
# pressure mbar, temperature K, water vapour mbar, lapse rate K/m, vapour lapse: yearly mean, then seasonal amplitude
_MEAN = np.array([
    [1013.25, 1017.25, 1015.75, 1011.75, 1013.00],
    [299.65, 294.15, 283.15, 272.15, 263.65],
    [26.31, 21.79, 11.66, 6.78, 4.11],
    [6.30e-3, 6.05e-3, 5.58e-3, 5.39e-3, 4.53e-3],
    [2.77, 3.15, 2.57, 1.81, 1.55],
])  # fmt: skip
_SEASON = np.array([
    [0.0, -3.75, -2.25, -1.75, -0.50],
    [0.0, 7.00, 11.00, 15.00, 14.50],
    [0.0, 8.85, 7.24, 5.36, 3.39],
    [0.0, 0.25e-3, 0.32e-3, 0.81e-3, 0.62e-3],
    [0.0, 0.33, 0.46, 0.74, 0.30],
])  # fmt: skip
_K1, _K2, _RD, _GM, _G = 77.604, 382000.0, 287.054, 9.784, STANDARD_GRAVITY
_COLDEST_DAY_NORTH, _COLDEST_DAY_SOUTH = 28.0, 211.0
TOP_M = 20000.0
"""Height above which the model is not used; what lies above delays by less than 0.15 m."""
RESIDUAL_ZENITH_M = 0.12
"""1-sigma of the zenith delay the model leaves, m."""
LOWEST_ELEVATION = math.radians(2.0)


def day_of_year(gps: int) -> float:
    """Day of the year, 1 on 1 January 00:00 UTC, of a GPS time in ns."""
    date = datetime.fromtimestamp(unix_ns(gps) // SECOND, UTC)
    return date.timetuple().tm_yday + (date.hour + date.minute / 60.0) / 24.0


def zenith_delays_m(lat: float, height_m: float, day: float) -> tuple[float, float]:
    """Dry and wet zenith delay, m.

    Parameters
    ----------
    lat : float
        Rad.
    height_m : float
        Above mean sea level; the ellipsoid's height does as well (50 m change the delay by 2 cm).
    day : float
        Day of the year, see :func:`day_of_year`.
    """
    season = math.cos(2.0 * math.pi * (day - (_COLDEST_DAY_NORTH if lat >= 0.0 else _COLDEST_DAY_SOUTH)) / 365.25)
    degrees = abs(math.degrees(lat))
    at = [np.interp(degrees, _LATITUDES, m) - np.interp(degrees, _LATITUDES, s) * season for m, s in zip(_MEAN, _SEASON, strict=True)]
    pressure, temperature, vapour, lapse, vapour_lapse = (float(value) for value in at)
    dry = 1e-6 * _K1 * _RD * pressure / _GM
    wet = 1e-6 * _K2 * _RD / (_GM * (vapour_lapse + 1.0) - lapse * _RD) * vapour / temperature
    remaining = 1.0 - lapse * min(max(height_m, -500.0), TOP_M) / temperature
    power = _G / (_RD * lapse)
    return dry * remaining**power, wet * remaining ** ((vapour_lapse + 1.0) * power - 1.0)


def mapping(elevation: np.ndarray) -> np.ndarray:
    """Slant over zenith delay, 1.001/sqrt(0.002001 + sin^2 El), with the extra term below 4 deg; ``elevation`` rad.

    Raises
    ------
    GnssError
        Below 2 deg, where the mapping is not defined.
    """
    elevation = np.asarray(elevation, float)
    if np.any(~(elevation >= LOWEST_ELEVATION)):
        lowest = math.degrees(float(np.min(elevation)))
        raise GnssError(f"The troposphere model reaches down to 2 deg; exclude the satellite at an elevation of {lowest:.1f} deg.")
    low = np.maximum(0.0, 4.0 - np.degrees(elevation))
    return 1.001 / np.sqrt(0.002001 + np.sin(elevation) ** 2) * (1.0 + 0.015 * low * low)


def delay_m(lat: float, height_m: float, elevation: np.ndarray, day: float) -> np.ndarray:
    """Delay, m, on slant paths (n,), both parts with one mapping."""
    return sum(zenith_delays_m(lat, height_m, day)) * mapping(elevation)


def residual_sigma_m(elevation: np.ndarray) -> np.ndarray:
    """1-sigma of what the model leaves on slant paths (n,), m."""
    return RESIDUAL_ZENITH_M * mapping(elevation)
