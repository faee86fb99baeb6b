"""Errors of a ground station's signal, which change along the way flown: shared by the DME and the VOR simulator."""

import math

import numpy as np

from lowcostnav_ros.base.truth import TruthBlock


class StationDrift:
    """Constant, slow and white error of one station, a function of the distance flown since power-up.

    Parameters
    ----------
    rng : numpy.random.Generator
        Used by this station only.
    bias, drift, noise : float
        1 sigma of the constant part, of the slow part (Gauss-Markov over distance) and of the white part, in one unit.
    correlation_distance_m : float
        Distance over which the slow part decorrelates, m.
    """

    def __init__(self, rng: np.random.Generator, bias: float, drift: float, correlation_distance_m: float, noise: float) -> None:
        self._rng, self._sigma, self._noise, self._correlation_m = rng, drift, noise, correlation_distance_m
        self._bias = bias * float(rng.standard_normal())
        self._drift = drift * float(rng.standard_normal())
        self._distance_m: float | None = None

    def draw(self, distance_m: float) -> float:
        """Return the error of one reading taken after ``distance_m`` flown; calls must not go back."""
        flown = 0.0 if self._distance_m is None else distance_m - self._distance_m
        self._distance_m = distance_m
        decay = math.exp(-flown / self._correlation_m)
        kick = self._sigma * math.sqrt(1.0 - decay * decay)
        normals = self._rng.standard_normal(2).tolist()
        self._drift = decay * self._drift + kick * normals[0]
        return self._bias + self._drift + self._noise * normals[1]


class DistanceFlown:
    """Distance over ground since the first truth row ever seen; a running sum, so independent of how the truth was cut."""

    def __init__(self) -> None:
        self._flown_m = 0.0
        self._last_ns: int | None = None

    def at(self, truth: TruthBlock) -> np.ndarray:
        """Return the distance up to each row (n,), m; every row must be given once, in order."""
        steps_s = np.diff(truth.stamps_ns, prepend=truth.stamps_ns[0] if self._last_ns is None else self._last_ns) * 1e-9
        north, east = truth.vel_n[:, 0], truth.vel_n[:, 1]
        steps_m = np.sqrt(north * north + east * east) * steps_s
        flown_m = np.cumsum(np.concatenate(([self._flown_m], steps_m)))[1:]
        self._flown_m, self._last_ns = float(flown_m[-1]), int(truth.stamps_ns[-1])
        return flown_m
