"""The last attitude that a core is carried by: it is turned on with its own rate, and how far that may be off."""

import math
from dataclasses import dataclass, field

import numpy as np

from lowcostnav_ros.base.measurements import Attitude
from lowcostnav_ros.estimation.aiding import Reason
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


@dataclass(slots=True)
class HeldAttitude:
    """The last attitude, with the rate (3,), rad/s, and specific force (3,), m/s^2, FRD, that came with it."""

    q_nb: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    rate_b: np.ndarray = field(default_factory=lambda: np.zeros(3))
    force_b: np.ndarray | None = None
    cov_att: np.ndarray = field(default_factory=lambda: np.eye(3))
    attitude_ns: int | None = None
    unsteady: Unsteadiness = field(default_factory=Unsteadiness)  # of the angular rate

    def take_attitude(self, attitude: Attitude) -> None:
        """Hold a new attitude."""
        rate_b = np.zeros(3) if attitude.angular_rate_b is None else attitude.angular_rate_b
        if self.attitude_ns is not None:
            self.unsteady = self.unsteady.after(self.rate_b, rate_b, 1e-9 * (attitude.stamp_ns - self.attitude_ns))
        self.q_nb, self.cov_att, self.rate_b, self.attitude_ns = attitude.q_nb, attitude.cov_att, rate_b, attitude.stamp_ns
        self.force_b = attitude.specific_force_b

    def attitude(self, t_ns: int) -> tuple[np.ndarray, float]:
        """Attitude (4,) at a time, turned on with its rate, and the sigma per axis, rad, that its age adds."""
        age_s = 0.0 if self.attitude_ns is None else 1e-9 * (t_ns - self.attitude_ns)
        return turned_on(self.q_nb, self.rate_b, age_s), turn_sigma(self.rate_b, self.unsteady.value, age_s)


def outdated(what: str, stamp_ns: int | None, t_ns: int, limit_s: float) -> str:
    """Why there is nothing of an input at ``t_ns``, in words; empty where its last stamp is no older than the limit."""
    if stamp_ns is None:
        return f"no {what} yet"
    return Reason(f"no {what}", f"for {1e-9 * (t_ns - stamp_ns):.0f} s", " ") if t_ns - stamp_ns > 1e9 * limit_s else ""
