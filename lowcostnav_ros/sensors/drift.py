"""Slow sensor errors: a bank of independent processes with unlike numbers, advanced together, one column each.

:func:`lowcostnav_ros.physics.stochastic.simulate` continues one process on several axes; an IMU has eighteen different ones, and a live
node continues them one sample at a time, so here the whole bank is one compiled call.
"""

import math
from collections.abc import Sequence

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.physics.stochastic import GaussMarkov, Process, RandomConstant


def slow_error(sigma: float, tau_s: float) -> Process:
    """Return the process of a slow error: Gauss-Markov, or a constant where ``tau_s`` is infinite."""
    return GaussMarkov(float(sigma), float(tau_s)) if math.isfinite(tau_s) else RandomConstant(float(sigma))


class DriftBank:
    """Independent slow errors that start with their switch-on distribution.

    Parameters
    ----------
    processes : sequence of Process
        One per column.
    dt_s : float
        Sample interval, seconds.
    rng : numpy.random.Generator
        Used by this bank only.
    """

    def __init__(self, processes: Sequence[Process], dt_s: float, rng: np.random.Generator) -> None:
        self._transition = np.array([p.transition(dt_s) for p in processes])
        self._kick = np.sqrt([p.variance_increment(dt_s) for p in processes])
        self._rng = rng
        self._state = np.array([p.initial_sigma() for p in processes]) * rng.standard_normal(len(processes))

    def draw(self, n: int) -> np.ndarray:
        """Return the next ``n`` values (n, m); any cutting into calls gives the same numbers."""
        return _advance(self._state, self._transition, self._kick, self._rng.standard_normal((n, len(self._state))))


@kernel
def _advance(state: np.ndarray, transition: np.ndarray, kick: np.ndarray, normals: np.ndarray) -> np.ndarray:
    out = np.empty_like(normals)
    for k in range(normals.shape[0]):
        for j in range(normals.shape[1]):
            out[k, j] = state[j]
            state[j] = transition[j] * state[j] + kick[j] * normals[k, j]
    return out
