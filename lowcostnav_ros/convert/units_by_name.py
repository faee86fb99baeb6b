"""Units as loggers write them, by dimension: factor and offset to SI."""

import math

UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "angle": {"rad": (1.0, 0.0), "deg": (math.pi / 180.0, 0.0)},
    "angular rate": {"rad/s": (1.0, 0.0), "deg/s": (math.pi / 180.0, 0.0)},
    "acceleration": {"m/s^2": (1.0, 0.0), "g": (9.80665, 0.0), "mg": (9.80665e-3, 0.0)},
    "length": {"m": (1.0, 0.0), "km": (1000.0, 0.0), "ft": (0.3048, 0.0), "NM": (1852.0, 0.0)},
    "speed": {
        "m/s": (1.0, 0.0),
        "kt": (1852.0 / 3600.0, 0.0),
        "km/h": (1.0 / 3.6, 0.0),
        "ft/s": (0.3048, 0.0),
        "ft/min": (0.3048 / 60.0, 0.0),
        "cm/s": (0.01, 0.0),
    },
    "pressure": {"Pa": (1.0, 0.0), "hPa": (100.0, 0.0), "kPa": (1000.0, 0.0), "inHg": (3386.389, 0.0)},
    "temperature": {"K": (1.0, 0.0), "celsius": (1.0, 273.15), "fahrenheit": (5.0 / 9.0, 459.67 * 5.0 / 9.0)},
    "magnetic field": {"T": (1.0, 0.0), "gauss": (1e-4, 0.0), "mG": (1e-7, 0.0), "uT": (1e-6, 0.0), "nT": (1e-9, 0.0)},
    "time": {"s": (1.0, 0.0), "ms": (1e-3, 0.0), "us": (1e-6, 0.0), "ns": (1e-9, 0.0)},
    "number": {"": (1.0, 0.0)},
}
"""dimension -> unit -> (factor, offset): SI value = factor * value + offset."""
