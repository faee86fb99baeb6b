"""Over a hole in the inertial data: the last motion goes on, and the covariance grows by what an aircraft may do meanwhile.

Mean: the horizontal velocity and the attitude turn about the vertical at the last turn rate, which dies away over ``TURN_TAU_S``; climb
and bank stay.  A steady turn is met exactly at first, straight flight always; roll and pitch rates never last and are not carried on.

Covariance: acceleration a and turn rate w are unknown, Gauss-Markov with sigma s and a correlation time tau shorter than the holes, hence
white of the density q = 2 s^2 tau, so that the growth over a hole is the same in one piece or in many (an aid inside it is fused at its own
time): ``q t`` on velocity and attitude, ``q t^2 / 2`` between position and velocity, ``q t^3 / 3`` on position.  The sigma s is what common
manoeuvres take (a turn of standard rate, 3 deg/s, at 60 m/s is 3.1 m/s^2; rolling into its 17 deg takes a second or two), or what the last
sample saw where that was more.  An aircraft that is not flown in aerobatics comes back to the level, so that the tilt grows to
``TILT_LIMIT`` and no further.
"""

import math

import numpy as np

from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, displace
from lowcostnav_ros.physics.rotation import quat_apply_phi_n

TURN_TAU_S = 10.0
ACCELERATION, ACCELERATION_TAU_S = 3.0, 3.0
TURN, TURN_TAU_NOISE_S = 3.0 * DEGREE, 3.0
ROLL, ROLL_TAU_S = 10.0 * DEGREE, 1.0
TILT_LIMIT = 30.0 * DEGREE


UNKNOWN_ACCELERATION = 2.0 * ACCELERATION_TAU_S * ACCELERATION**2
"""Density of what common manoeuvres take, (m/s^2)^2 s."""


def accelerate(P: np.ndarray, density: float, dt: float) -> None:
    """Add to a covariance, in place, what a white acceleration does in ``dt`` s to position and velocity, its first six states."""
    for axis in range(3):
        P[axis, axis] += density * dt**3 / 3.0
        P[3 + axis, 3 + axis] += density * dt
        P[axis, 3 + axis] += density * dt**2 / 2.0
        P[3 + axis, axis] = P[axis, 3 + axis]


class LastMotion:
    """What is known of the motion when a hole begins.

    Parameters
    ----------
    C : ndarray (3, 3)
        Attitude, b to n.
    force_b, rate_b : ndarray (3,)
        Specific force, m/s^2, and rate, rad/s, of the last sample, sensor errors taken out.

    Attributes
    ----------
    turn : float
        Rate about the vertical, rad/s.
    """

    def __init__(self, C: np.ndarray, force_b: np.ndarray, rate_b: np.ndarray) -> None:
        acceleration_n, rate_n = C @ force_b + np.array([0.0, 0.0, STANDARD_GRAVITY]), C @ rate_b
        self.turn = float(rate_n[2])
        rolling = math.hypot(rate_n[0], rate_n[1])
        self._acceleration = 2.0 * ACCELERATION_TAU_S * (ACCELERATION**2 + float(acceleration_n @ acceleration_n) / 2.0)
        self._heading = 2.0 * TURN_TAU_NOISE_S * (TURN**2 + self.turn**2)
        self._tilt = 2.0 * ROLL_TAU_S * (ROLL**2 + rolling**2)
        self._limit = min(TILT_LIMIT + rolling * ROLL_TAU_S, 0.5 * math.pi) ** 2

    def carry(self, nav: np.ndarray, dt: float) -> np.ndarray:
        """Carry a state (10,) on for ``dt`` s, in place; return the transition (9, 9) of the core's errors."""
        fade = math.exp(-dt / TURN_TAU_S)
        angle = self.turn * TURN_TAU_S * (1.0 - fade)
        self.turn *= fade
        whole, half = _about_down(angle), _about_down(0.5 * angle)
        chord = dt * float(np.sinc(0.5 * angle / math.pi))
        nav[0], nav[1], nav[2] = displace(nav[0], nav[1], nav[2], chord * (half @ nav[3:6]))
        nav[3:6] = whole @ nav[3:6]
        nav[6:10] = quat_apply_phi_n(nav[6:10], np.array([0.0, 0.0, angle]))
        Phi = np.eye(9)
        Phi[0:3, 3:6], Phi[3:6, 3:6], Phi[6:9, 6:9] = chord * half, whole, whole
        return Phi

    def noise(self, P: np.ndarray, dt: float) -> np.ndarray:
        """What ``dt`` s add to the covariance (9, 9) of the core's errors, ``P`` being that before; the head of the module derives it."""
        Q = np.zeros((9, 9))
        accelerate(Q, self._acceleration, dt)
        for axis in (6, 7):
            Q[axis, axis] = min(self._tilt * dt, max(self._limit - P[axis, axis], 0.0))
        Q[8, 8] = self._heading * dt
        return Q


def _about_down(angle: float) -> np.ndarray:
    """Rotation (3, 3) of a vector in n about the vertical, north to east positive."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
