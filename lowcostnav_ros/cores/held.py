"""What is known of the motion after the last attitude: it is turned on with its own rate, and how far that may be off."""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.physics.rotation import quat_from_rotvec, quat_multiply

LONGEST_TURN_S = 0.5
"""An attitude is turned on with its own rate for this long at most; after that it is held."""
CALM = 0.25
"""Angular acceleration of an aircraft in the air, rad/s^2, sigma, when none was seen lately."""
RESTLESS = 0.1
"""Rate of an aircraft that was not turning, rad/s, sigma, once a rate is no longer turned on with."""
FORGET_S = 0.5
"""Time constant with which an angular acceleration that was seen is forgotten."""
ANY_WAY = math.pi / math.sqrt(3.0)
"""Sigma of an angle that may be anything, rad."""


def turned_on(q_nb: np.ndarray, rate_b: np.ndarray, age_s: float) -> np.ndarray:
    """Attitude (4,) ``age_s`` seconds after one with an angular rate (3,), rad/s."""
    return q_nb if age_s <= 0.0 else quat_multiply(q_nb, quat_from_rotvec(rate_b * min(age_s, LONGEST_TURN_S)))


def turn_sigma(rate_b: np.ndarray, change: float, age_s: float) -> float:
    """Sigma per axis, rad, of an attitude turned on for ``age_s``; ``change``: angular acceleration seen, rad/s^2."""
    if age_s <= 0.0:
        return 0.0
    turning_s = min(age_s, LONGEST_TURN_S)
    held = (age_s - turning_s) * (math.sqrt(float(rate_b @ rate_b)) + RESTLESS)
    return min(0.5 * math.hypot(CALM, change) * turning_s * turning_s + held, ANY_WAY)


@dataclass(frozen=True, slots=True)
class Unsteadiness:
    """How fast a vector changes, per second: the largest change seen lately; a value that twins of a state may share."""

    value: float = 0.0

    def after(self, before: np.ndarray, now: np.ndarray, dt_s: float) -> "Unsteadiness":
        """With two values seen ``dt_s`` seconds apart; what lies longer apart than is turned on tells nothing."""
        if dt_s <= 0.0:
            return self
        step = now - before
        seen = math.sqrt(float(step @ step)) / dt_s if dt_s <= LONGEST_TURN_S else 0.0
        return Unsteadiness(max(self.value * math.exp(-dt_s / FORGET_S), seen))
