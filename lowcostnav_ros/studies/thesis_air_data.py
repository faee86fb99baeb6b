"""Altitude and airspeed as Gebre-Egziabher (2004) has them, equations 2.1 and 2.2, beside which the package's own may be held."""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics.atmosphere import EXPONENT, LAPSE_RATE, SEA_LEVEL_PRESSURE, SEA_LEVEL_TEMPERATURE, density


@kernel
def thesis_altitude(static_pressure, sea_level_pressure=SEA_LEVEL_PRESSURE, sea_level_temperature=SEA_LEVEL_TEMPERATURE):
    """Altitude, m, of Gebre-Egziabher's equation (2.1), where another day is met by changing the sea-level values.

    Below the tropopause only.  On a standard day it equals :func:`~lowcostnav_ros.physics.atmosphere.pressure_altitude`.
    """
    return sea_level_temperature / LAPSE_RATE * (1.0 - (static_pressure / sea_level_pressure) ** (1.0 / EXPONENT))


@kernel
def thesis_airspeed(impact, static_pressure, static_temperature):
    """True airspeed, m/s, of Gebre-Egziabher's equation (2.2), sqrt(2 dP/rho): incompressible.

    It reads high by M^2/8, 0.3 % at 100 kt and 2.6 % at 300 kt at sea level;
    :func:`~lowcostnav_ros.physics.atmosphere.tas_from_impact` has no such error.
    """
    return np.sqrt(2.0 * np.maximum(impact, 0.0) / density(static_pressure, static_temperature))
