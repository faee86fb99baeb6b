"""The air mass of a closed-form flight: mean wind, shear with height, slow Gauss-Markov variation or a periodic one, level turbulence.

A Gauss-Markov path has no derivative, and an aircraft riding on one would feel infinite acceleration.  So the process is drawn
exactly at knots much closer than its correlation time and joined by a uniform cubic B-spline, which is twice continuously
differentiable; its gain keeps the sigma.
"""

import math

import numpy as np

from lowcostnav_ros.trajectory.truth_settings import WindSettings

KNOTS_PER_TAU = 20
TURBULENCE_KNOTS_PER_TAU = 8
TURBULENCE_LENGTH_M = 250.0
"""Correlation length of turbulence, of the size of the Dryden scales a few hundred metres up."""
_GROW = 1024


class SmoothGaussMarkov:
    """First-order Gauss-Markov process as a smooth function of time, reproducible from its generator.

    Parameters
    ----------
    sigma, tau_s : float
        Steady standard deviation and correlation time, s.
    rng : numpy.random.Generator
        Drawn from in order, so values do not depend on how the time axis is asked for.
    knots_per_tau : int
        Knots per correlation time; fewer make it smoother.
    """

    def __init__(self, sigma: float, tau_s: float, rng: np.random.Generator, knots_per_tau: int = KNOTS_PER_TAU) -> None:
        self.knot_s = tau_s / knots_per_tau
        self._rho = math.exp(-1.0 / knots_per_tau)
        # At a knot the curve is (x0 + 4 x1 + x2)/6, of variance (18 + 16 rho + 2 rho^2)/36; between knots it differs by under 1 %.
        self._sigma = sigma / math.sqrt((18.0 + 16.0 * self._rho + 2.0 * self._rho**2) / 36.0)
        self._rng = rng
        self._knots = np.array([self._sigma * rng.standard_normal()])

    def at(self, t_s: np.ndarray) -> np.ndarray:
        """Values at ``t_s`` >= 0, shape (n,)."""
        x = np.asarray(t_s) / self.knot_s
        k = np.floor(x).astype(int)
        while k.max(initial=0) + 4 > len(self._knots):
            self._extend()
        u = x - k
        weights = ((1.0 - u) ** 3, 4.0 + u * u * (3.0 * u - 6.0), 1.0 + 3.0 * u * (1.0 + u - u * u), u**3)
        return sum(weight * self._knots[k + j] for j, weight in enumerate(weights)) / 6.0

    def _extend(self) -> None:
        new = np.empty(_GROW)
        value, drive = self._knots[-1], self._sigma * math.sqrt(1.0 - self._rho**2)
        for i, noise in enumerate(self._rng.standard_normal(_GROW)):
            value = self._rho * value + drive * noise
            new[i] = value
        self._knots = np.append(self._knots, new)


def triangle(phase: np.ndarray) -> np.ndarray:
    """Triangle wave between -1 and 1 that begins like a sine; ``phase`` (n,) in periods."""
    return 1.0 - 4.0 * np.abs(np.mod(phase + 0.25, 1.0) - 0.5)


class Wind:
    """Velocity of the air mass, NED m/s, as a smooth function of time and height.

    Parameters
    ----------
    settings : WindSettings
    seed : int
    height_ref : float
        Height at which the mean wind is as set, m.
    airspeed : float
        True airspeed that turns the turbulence length into a time, m/s.
    """

    def __init__(self, settings: WindSettings, seed: int, height_ref: float, airspeed: float) -> None:
        streams = [np.random.default_rng([seed, 0x71D, i]) for i in range(4)]
        self._settings = settings
        self._height_ref = height_ref
        self._slow = [SmoothGaussMarkov(settings.variation_sigma_mps, settings.variation_tau_s, s) for s in streams[:2]]
        sigma, tau_s = settings.turbulence_sigma_mps, TURBULENCE_LENGTH_M / airspeed
        self._gusts = [SmoothGaussMarkov(sigma, tau_s, s, TURBULENCE_KNOTS_PER_TAU) for s in streams[2:]]

    def steady(self, t_s: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Wind without turbulence, shape (n, 3)."""
        s, above = self._settings, np.asarray(height) - self._height_ref
        out = np.zeros((len(above), 3))
        out[:, 0] = s.north_mps + s.shear_north_per_s * above + self._slow[0].at(t_s)
        out[:, 1] = s.east_mps + s.shear_east_per_s * above + self._slow[1].at(t_s)
        if s.pattern != "none":
            for axis, period_s in enumerate((s.pattern_north_s, s.pattern_east_s)):
                phase = np.asarray(t_s) / period_s
                out[:, axis] += s.pattern_mps * (triangle(phase) if s.pattern == "triangle" else np.sin(2.0 * math.pi * phase))
        return out

    def at(self, t_s: np.ndarray, height: np.ndarray) -> np.ndarray:
        """Wind with turbulence, shape (n, 3); level, so that a closed-form flight is at the height of its mission."""
        out = self.steady(t_s, height)
        for axis, gust in enumerate(self._gusts):
            out[:, axis] += gust.at(t_s)
        return out
