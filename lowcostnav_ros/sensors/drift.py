"""Slow sensor errors: a bank of independent first-order Gauss-Markov processes advanced together, one column each.

A process with an infinite correlation time is a random constant, drawn once: turn-on biases and constant scale factors are
columns of the same bank.  Exact discretisation (Gebre-Egziabher 2004, eq. 3.4-3.5; Solimeno 2007, eq. 4-28):
``x[k+1] = exp(-dt/tau) x[k] + sigma sqrt(1 - exp(-2 dt/tau)) nu``.
"""

import numpy as np

from lowcostnav_ros.kernels import kernel


class DriftBank:
    """Independent Gauss-Markov errors that start in their stationary distribution.

    Parameters
    ----------
    sigma, tau_s : ndarray, shape (m,)
        Stationary standard deviation (any unit) and correlation time, seconds; ``inf`` for a constant.
    dt_s : float
        Sample interval, seconds.
    rng : numpy.random.Generator
        Used by this bank only.
    """

    def __init__(self, sigma: np.ndarray, tau_s: np.ndarray, dt_s: float, rng: np.random.Generator) -> None:
        sigma, tau_s = np.asarray(sigma, dtype=float), np.asarray(tau_s, dtype=float)
        self._decay = np.exp(-dt_s / tau_s)
        self._kick = sigma * np.sqrt(-np.expm1(-2.0 * dt_s / tau_s))
        self._rng = rng
        self._state = sigma * rng.standard_normal(len(sigma))

    def draw(self, n: int) -> np.ndarray:
        """Return the next ``n`` values (n, m); any cutting into calls gives the same numbers."""
        return _advance(self._state, self._decay, self._kick, self._rng.standard_normal((n, len(self._state))))


@kernel
def _advance(state: np.ndarray, decay: np.ndarray, kick: np.ndarray, normals: np.ndarray) -> np.ndarray:
    out = np.empty_like(normals)
    for k in range(normals.shape[0]):
        for j in range(normals.shape[1]):
            out[k, j] = state[j]
            state[j] = decay[j] * state[j] + kick[j] * normals[k, j]
    return out
