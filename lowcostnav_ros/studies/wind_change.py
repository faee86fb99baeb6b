"""How much the wind may have changed between two points: the travelling-time model.

Berman and Powell, as used by Gebre-Egziabher (2004), equations 3.35 to 3.37: the wind is a first-order Gauss-Markov process in a
*travelling time* made of elapsed time and of the distance an aircraft covers, each leg at its own speed.  Valid for 0 to 3600 s,
37 to 42 degrees north, 2000 to 10 000 ft.
"""

import math

import numpy as np

from lowcostnav_ros.physics.stochastic import GaussMarkov

WIND = GaussMarkov(5.0, 400.0)
"""Variation of one wind component, m/s and s (equations 3.36 and 3.37)."""
LONGEST_S = 3600.0
"""Travelling time up to which the model was fitted, s."""


def travelling_time(displacement_n: np.ndarray, vel_n: np.ndarray, elapsed_s: float) -> float:
    """Travelling time between two points, s: sqrt(t_N^2 + t_E^2 + t_D^2 + elapsed^2), t_X = displacement_X / velocity_X.

    Steady straight flight counts its time twice, sqrt(2) elapsed; along one's own track elapsed time alone is the usual choice.

    Parameters
    ----------
    displacement_n, vel_n : ndarray, shape (3,)
        From one point to the other, m, and velocity, m/s, NED; where a component of the velocity is zero, that leg counts as zero.
    elapsed_s : float
        Time between the two, s.
    """
    squares = elapsed_s**2
    for distance, speed in zip(displacement_n, vel_n, strict=True):
        if abs(speed) > 1e-6:
            squares += (distance / speed) ** 2
    return math.sqrt(squares)


def wind_change_sigma(travelling_s: np.ndarray, wind: GaussMarkov = WIND) -> np.ndarray:
    """Sigma of the change of one wind component over a travelling time, m/s: sigma sqrt(1 - exp(-2 t/tau)).

    The change itself is the Gauss-Markov process (3.36), from zero; the difference of two values of one would reach sqrt(2) sigma.
    """
    return wind.sigma * np.sqrt(-np.expm1(-2.0 * np.asarray(travelling_s, dtype=float) / wind.tau))
