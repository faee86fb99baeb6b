"""The standard atmosphere to 20 km, altimetry on other days, and the airspeeds.

Altitudes are *geopotential* metres unless the name says geometric; the difference is 16 m at 10 km.  A *pressure altitude* is
the geopotential altitude at which the standard atmosphere has the given pressure.  None of these is a height above the
ellipsoid: the geoid lies between.  ``deviation`` is the temperature minus standard at the same pressure altitude, K ("ISA+10").

Airspeeds are compressible and subsonic (Mach below 1).  Functions marked as kernels take scalars or arrays alike.

References
----------
ICAO Doc 7488, Manual of the ICAO standard atmosphere (1993).
Gebre-Egziabher (2004), Stanford: equations (2.1), (2.2).
"""

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

SEA_LEVEL_PRESSURE = 101325.0
"""Pa."""
SEA_LEVEL_TEMPERATURE = 288.15
"""K."""
LAPSE_RATE = 6.5e-3
"""K/m, temperature lost per metre below the tropopause."""
GAS_CONSTANT = 287.05287
"""Specific gas constant of dry air, J/(kg K)."""
HEAT_RATIO = 1.4
"""Ratio of specific heats of air; the exponents 7/2 and 2/7 below follow from it."""
TROPOPAUSE = 11_000.0
"""Geopotential m."""
CEILING = 20_000.0
"""Geopotential m; the formulas stop here."""
SEA_LEVEL_SOUND_SPEED = float(np.sqrt(HEAT_RATIO * GAS_CONSTANT * SEA_LEVEL_TEMPERATURE))
"""m/s."""
EXPONENT = STANDARD_GRAVITY / (GAS_CONSTANT * LAPSE_RATE)
"""5.2559, of pressure over temperature below the tropopause."""

_GEOPOTENTIAL_RADIUS = 6_356_766.0  # m, nominal earth radius of the standard
_UPPER_TEMPERATURE = SEA_LEVEL_TEMPERATURE - LAPSE_RATE * TROPOPAUSE  # 216.65 K
_UPPER_PRESSURE = SEA_LEVEL_PRESSURE * (_UPPER_TEMPERATURE / SEA_LEVEL_TEMPERATURE) ** EXPONENT
_SCALE_HEIGHT = GAS_CONSTANT * _UPPER_TEMPERATURE / STANDARD_GRAVITY  # m, above the tropopause
_NEWTON_STEPS = 6  # from the standard-day guess; each step squares a relative error of at most 0.2


@kernel
def geopotential_altitude(geometric):
    """Geopotential altitude, m, of a geometric altitude above mean sea level, m."""
    return geometric * _GEOPOTENTIAL_RADIUS / (_GEOPOTENTIAL_RADIUS + geometric)


@kernel
def geometric_altitude(geopotential):
    """Geometric altitude above mean sea level, m, of a geopotential altitude, m."""
    return geopotential * _GEOPOTENTIAL_RADIUS / (_GEOPOTENTIAL_RADIUS - geopotential)


@kernel
def temperature(pressure_altitude, deviation=0.0):
    """Static air temperature, K, at a pressure altitude, m, on a day ``deviation`` K warmer than standard."""
    return SEA_LEVEL_TEMPERATURE - LAPSE_RATE * np.minimum(pressure_altitude, TROPOPAUSE) + deviation


@kernel
def pressure(pressure_altitude):
    """Static pressure, Pa, at a pressure altitude, m (the same on every day, by definition)."""
    below = (1.0 - LAPSE_RATE / SEA_LEVEL_TEMPERATURE * np.minimum(pressure_altitude, TROPOPAUSE)) ** EXPONENT
    return SEA_LEVEL_PRESSURE * below * np.exp(-np.maximum(pressure_altitude - TROPOPAUSE, 0.0) / _SCALE_HEIGHT)


@kernel
def density(static_pressure, static_temperature):
    """Air density, kg/m^3, of dry air at a pressure, Pa, and a temperature, K."""
    return static_pressure / (GAS_CONSTANT * static_temperature)


@kernel
def pressure_altitude(static_pressure):
    """Pressure altitude, geopotential m, of a static pressure, Pa: the inverse of :func:`pressure`."""
    ratio = np.maximum(static_pressure, _UPPER_PRESSURE) / SEA_LEVEL_PRESSURE
    below = SEA_LEVEL_TEMPERATURE / LAPSE_RATE * (1.0 - ratio ** (1.0 / EXPONENT))
    return below - _SCALE_HEIGHT * np.log(np.minimum(static_pressure / _UPPER_PRESSURE, 1.0))


@kernel
def _warm_column(pressure_altitude):
    """Integral of 1/T_standard from zero to a pressure altitude, m/K: how far each kelvin of deviation lifts it."""
    low = np.minimum(pressure_altitude, TROPOPAUSE)
    below = -np.log(1.0 - LAPSE_RATE / SEA_LEVEL_TEMPERATURE * low) / LAPSE_RATE
    return below + np.maximum(pressure_altitude - TROPOPAUSE, 0.0) / _UPPER_TEMPERATURE


@kernel
def true_altitude(static_pressure, qnh=SEA_LEVEL_PRESSURE, deviation=0.0):
    """Geopotential altitude above mean sea level, m, where the pressure is ``static_pressure`` Pa.

    Hydrostatic column of dry air from ``qnh`` Pa at sea level, ``deviation`` K warmer than standard at every level.
    """
    top, bottom = pressure_altitude(static_pressure), pressure_altitude(qnh)
    return top - bottom + deviation * (_warm_column(top) - _warm_column(bottom))


@kernel
def pressure_at(altitude, qnh=SEA_LEVEL_PRESSURE, deviation=0.0):
    """Static pressure, Pa, at a geopotential altitude above mean sea level, m: the inverse of :func:`true_altitude`."""
    bottom = pressure_altitude(qnh)
    lift = _warm_column(bottom)
    guess = altitude + bottom
    for _ in range(_NEWTON_STEPS):
        missing = altitude - (guess - bottom + deviation * (_warm_column(guess) - lift))
        guess = guess + missing / (1.0 + deviation / temperature(guess))
    return pressure(guess)


@kernel
def sound_speed(static_temperature):
    """Speed of sound, m/s, at a temperature, K."""
    return np.sqrt(HEAT_RATIO * GAS_CONSTANT * static_temperature)


@kernel
def impact_pressure(mach, static_pressure):
    """Impact pressure (pitot minus static), Pa: p ((1 + M^2/5)^(7/2) - 1), written so that low speeds keep every digit."""
    return static_pressure * np.expm1(3.5 * np.log1p(0.2 * mach * mach))


@kernel
def mach_number(impact, static_pressure):
    """Mach number of an impact pressure and a static pressure, Pa; a negative impact pressure (noise at rest) gives zero."""
    return np.sqrt(5.0 * np.expm1(np.log1p(np.maximum(impact, 0.0) / static_pressure) / 3.5))


@kernel
def cas_from_impact(impact):
    """Calibrated airspeed, m/s, of an impact pressure, Pa; a negative one gives zero."""
    return SEA_LEVEL_SOUND_SPEED * mach_number(impact, SEA_LEVEL_PRESSURE)


@kernel
def impact_from_cas(cas):
    """Impact pressure, Pa, of a calibrated airspeed, m/s."""
    return impact_pressure(cas / SEA_LEVEL_SOUND_SPEED, SEA_LEVEL_PRESSURE)


@kernel
def tas_from_impact(impact, static_pressure, static_temperature):
    """True airspeed, m/s, of impact and static pressure, Pa, and static (not total) temperature, K."""
    return mach_number(impact, static_pressure) * sound_speed(static_temperature)


@kernel
def impact_from_tas(tas, static_pressure, static_temperature):
    """Impact pressure, Pa, of a true airspeed, m/s."""
    return impact_pressure(tas / sound_speed(static_temperature), static_pressure)


@kernel
def cas_to_tas(cas, static_pressure, static_temperature):
    """True airspeed, m/s, of a calibrated airspeed, m/s."""
    return tas_from_impact(impact_from_cas(cas), static_pressure, static_temperature)


@kernel
def tas_to_cas(tas, static_pressure, static_temperature):
    """Calibrated airspeed, m/s, of a true airspeed, m/s."""
    return cas_from_impact(impact_from_tas(tas, static_pressure, static_temperature))
