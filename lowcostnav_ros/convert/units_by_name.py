"""Units as loggers write them, by dimension: factor and offset to SI."""

from lowcostnav_ros.base import units

NMEA = "ddmm"
"""Degrees and minutes in one number, 3741.604 for 37 degrees 41.604 minutes: made degrees before the factor is applied."""

UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "angle": {"rad": (1.0, 0.0), "deg": (units.DEGREE, 0.0), "1e-7 deg": (1e-7 * units.DEGREE, 0.0), NMEA: (units.DEGREE, 0.0)},
    "angular rate": {"rad/s": (1.0, 0.0), "deg/s": (units.DEGREE, 0.0)},
    "acceleration": {"m/s^2": (1.0, 0.0), "g": (units.STANDARD_GRAVITY, 0.0), "mg": (units.MILLI_G, 0.0)},
    "length": {"m": (1.0, 0.0), "km": (1000.0, 0.0), "ft": (units.FOOT, 0.0), "NM": (units.NAUTICAL_MILE, 0.0)},
    "speed": {
        "m/s": (1.0, 0.0),
        "kt": (units.KNOT, 0.0),
        "km/h": (1.0 / 3.6, 0.0),
        "ft/s": (units.FOOT, 0.0),
        "ft/min": (units.FOOT_PER_MINUTE, 0.0),
        "cm/s": (0.01, 0.0),
    },
    "pressure": {"Pa": (1.0, 0.0), "hPa": (units.HECTOPASCAL, 0.0), "kPa": (1000.0, 0.0), "inHg": (units.INCH_OF_MERCURY, 0.0)},
    "temperature": {"K": (1.0, 0.0), "celsius": (1.0, units.ZERO_CELSIUS), "fahrenheit": (5.0 / 9.0, 459.67 * 5.0 / 9.0)},
    "magnetic field": {"T": (1.0, 0.0), "gauss": (units.GAUSS, 0.0), "mG": (1e-7, 0.0), "uT": (1e-6, 0.0), "nT": (1e-9, 0.0)},
    "time": {"s": (1.0, 0.0), "ms": (1e-3, 0.0), "us": (1e-6, 0.0), "ns": (1e-9, 0.0)},
    "number": {"": (1.0, 0.0)},
}
"""dimension -> unit -> (factor, offset): SI value = factor * value + offset."""
