"""How the position error of one horizontal axis of an unaided INS grows, by source, long before a Schuler period.

A constant gyro bias tilts the platform with t, gravity then accelerates with t, so position goes with t^3; an accelerometer bias with t^2
(Gebre-Egziabher 2004, section 5.4, equations 5.33 to 5.35).  White noise of a rate and of a specific force is integrated three and two
times.
"""

from collections.abc import Mapping

import numpy as np

from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

Times = np.ndarray | float


def gyro_bias_m(bias_radps: float, t_s: Times) -> Times:
    """``g b t^3/6``."""
    return STANDARD_GRAVITY * bias_radps * t_s**3 / 6.0


def accel_bias_m(bias_mps2: float, t_s: Times) -> Times:
    """``b t^2/2``."""
    return 0.5 * bias_mps2 * t_s**2


def gyro_noise_m(density: float, t_s: Times) -> Times:
    """Sigma ``g N sqrt(t^5/20)`` of white rate noise, rad/s/sqrt(Hz)."""
    return STANDARD_GRAVITY * density * np.sqrt(t_s**5 / 20.0)


def accel_noise_m(density: float, t_s: Times) -> Times:
    """Sigma ``N sqrt(t^3/3)`` of white noise of the specific force, m/s^2/sqrt(Hz)."""
    return density * np.sqrt(t_s**3 / 3.0)


def by_source_m(
    gyro_bias_radps: float, accel_bias_mps2: float, gyro_density: float, accel_density: float, t_s: Times
) -> Mapping[str, Times]:
    """All four, by name, and the root of the sum of their squares."""
    parts = {
        "gyro bias": gyro_bias_m(gyro_bias_radps, t_s),
        "accelerometer bias": accel_bias_m(accel_bias_mps2, t_s),
        "gyro noise": gyro_noise_m(gyro_density, t_s),
        "accelerometer noise": accel_noise_m(accel_density, t_s),
    }
    return {**parts, "all": np.sqrt(sum(part**2 for part in parts.values()))}
