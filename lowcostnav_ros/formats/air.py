"""True airspeed of what recorders write down: calibrated airspeed, static pressure, perhaps the outside temperature; what is a reading."""

from typing import Any

import numpy as np

from lowcostnav_ros.physics import atmosphere

RATIO_SIGMA = 0.02
"""Relative error of a true airspeed made with the standard temperature: 12 K off."""

SLOW_MPS = 5.0
"""A tube that is not blown into and a recorder without a reading write the same."""


def is_reading(tas: np.ndarray, ground_speed: np.ndarray | float) -> np.ndarray:
    """Which true airspeeds (n,), m/s, are measured: those above :data:`SLOW_MPS` and, once it has flown, of an aircraft that stands.

    In a fast taxi a slow one is none: an instrument shows zero there, up to the speed from which it measures.
    """
    fast = tas > SLOW_MPS
    return fast | (np.logical_or.accumulate(fast) & np.isfinite(tas) & (ground_speed < SLOW_MPS))


def true_airspeed(calibrated: Any, static_pa: Any, temperature_k: Any = None) -> Any:
    """Return true airspeed, m/s, of calibrated airspeed, m/s, at a static pressure, Pa; scalars or arrays of one shape.

    Without a temperature, K, that of the standard atmosphere at the pressure is taken.
    """
    kelvin = atmosphere.temperature(atmosphere.pressure_altitude(static_pa)) if temperature_k is None else temperature_k
    return atmosphere.cas_to_tas(calibrated, static_pa, kelvin)
