"""Which grade an IMU is of, by the bias of its gyros.

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: Table 3.4.
"""

import math

from lowcostnav_ros.base.units import DEGREE_PER_HOUR
from lowcostnav_ros.sensors.imu_profile import ImuProfile

GRADES_DEG_PER_H = {"strategic": (0.0, 1e-4), "navigation": (0.005, 0.01), "tactical": (0.1, 10.0), "automotive": (100.0, math.inf)}
"""Range of the gyro bias of each grade, deg/h (Table 3.4); between two ranges the nearer one counts, by ratio."""


def grade(gyro_bias_deg_per_h: float) -> str:
    """Grade of a gyro with this bias, deg/h, one sigma.

    Raises
    ------
    ValueError
        For a bias that is negative or not finite.
    """
    if not (math.isfinite(gyro_bias_deg_per_h) and gyro_bias_deg_per_h >= 0.0):
        raise ValueError(f"A gyro bias must be a finite number of deg/h, zero or positive, got {gyro_bias_deg_per_h!r}.")
    return min(GRADES_DEG_PER_H, key=lambda name: _ratio(gyro_bias_deg_per_h, *GRADES_DEG_PER_H[name]))


def _ratio(value: float, low: float, high: float) -> float:
    """How many times a value lies below ``low`` or above ``high``; 1 between them."""
    if value < low:
        return low / max(value, 1e-12)
    return max(1.0, value / high)


def gyro_bias_deg_per_h(profile: ImuProfile) -> float:
    """Bias of a profile's worst gyro, deg/h: turn-on and drift together, one sigma; 0 where it states none."""
    noise = profile.gyro_noise()
    return max(math.hypot(turn_on, drift) for turn_on, drift in zip(noise.turn_on_sigma, noise.bias_sigma, strict=True)) / DEGREE_PER_HOUR


def grade_of(profile: ImuProfile) -> str:
    """Grade of an IMU by its worst gyro, empty where its profile states no bias."""
    bias = gyro_bias_deg_per_h(profile)
    return grade(bias) if bias > 0.0 else ""
