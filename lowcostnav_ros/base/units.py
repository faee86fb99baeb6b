"""Units of the cockpit and of data sheets, each as its size in SI.

Multiply to come in, divide to go out: ``120 * KNOT`` is a speed in m/s, ``height / FOOT`` a height in feet.
"""

import math

FOOT = 0.3048
"""m (international foot)."""
NAUTICAL_MILE = 1852.0
"""m."""
KNOT = NAUTICAL_MILE / 3600.0
"""m/s."""
FOOT_PER_MINUTE = FOOT / 60.0
"""m/s."""
DEGREE = math.pi / 180.0
"""rad."""
DEGREE_PER_HOUR = DEGREE / 3600.0
"""rad/s."""
STANDARD_GRAVITY = 9.80665
"""m/s^2, one g by definition."""
MILLI_G = STANDARD_GRAVITY / 1000.0
"""m/s^2."""
HECTOPASCAL = 100.0
"""Pa; one millibar is the same."""
INCH_OF_MERCURY = 3386.389
"""Pa (conventional mercury at 0 degrees Celsius)."""
GAUSS = 1.0e-4
"""T."""
ZERO_CELSIUS = 273.15
"""K."""
SPEED_OF_LIGHT = 299_792_458.0
"""m/s."""


def kelvin(celsius: float) -> float:
    """Absolute temperature, K, of a temperature in degrees Celsius."""
    return celsius + ZERO_CELSIUS


def celsius(kelvin: float) -> float:
    """Temperature in degrees Celsius of an absolute temperature, K."""
    return kelvin - ZERO_CELSIUS
