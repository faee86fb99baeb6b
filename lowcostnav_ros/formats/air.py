"""True airspeed of what recorders write down: calibrated airspeed, static pressure, perhaps the outside temperature."""

from typing import Any

from lowcostnav_ros.physics import atmosphere

RATIO_SIGMA = 0.02
"""Relative error of a true airspeed made with the standard temperature: 12 K off."""


def true_airspeed(calibrated: Any, static_pa: Any, temperature_k: Any = None) -> Any:
    """Return true airspeed, m/s, of calibrated airspeed, m/s, at a static pressure, Pa; scalars or arrays of one shape.

    Without a temperature, K, that of the standard atmosphere at the pressure is taken.
    """
    kelvin = atmosphere.temperature(atmosphere.pressure_altitude(static_pa)) if temperature_k is None else temperature_k
    return atmosphere.cas_to_tas(calibrated, static_pa, kelvin)
