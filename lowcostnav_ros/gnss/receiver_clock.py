"""Receiver clock: two states, bias and drift, with the noise of its Allan parameters (Solimeno 2007, section 5.2.1.1, Table 5.1).

    d(bias)/dt = drift + w_phi,   d(drift)/dt = w_f,   S_phi = c^2 h0/2,   S_f = c^2 2 pi^2 h-2      (m^2/s, m^2/s^3)
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.signals import SPEED_OF_LIGHT


@dataclass(frozen=True, slots=True)
class ClockModel:
    """Allan parameters of an oscillator: ``h0`` s (white frequency noise) and ``h_minus2`` 1/s (random walk of frequency)."""

    h0: float
    h_minus2: float

    def __post_init__(self) -> None:
        if not (0.0 <= self.h0 < math.inf and 0.0 <= self.h_minus2 < math.inf):
            raise GnssError(f"Allan parameters of a clock are finite and not negative, got {self.h0!r} and {self.h_minus2!r}.")

    def bias_psd(self) -> float:
        """S_phi, m^2/s."""
        return SPEED_OF_LIGHT**2 * 0.5 * self.h0

    def drift_psd(self) -> float:
        """S_f, m^2/s^3."""
        return SPEED_OF_LIGHT**2 * 2.0 * math.pi**2 * self.h_minus2


CLOCKS = {
    "compensated_crystal": ClockModel(2e-19, 2e-20),
    "ovenized_crystal": ClockModel(8e-20, 4e-23),
    "rubidium": ClockModel(2e-20, 4e-29),
}
"""Table 5.1."""


def transition(dt: float) -> np.ndarray:
    """Transition matrix (2, 2) of (bias m, drift m/s) over ``dt`` s."""
    return np.array([[1.0, dt], [0.0, 1.0]])


def process_noise(model: ClockModel, dt: float) -> np.ndarray:
    """Exact covariance (2, 2) that ``dt`` s add to (bias, drift): [[S_phi dt + S_f dt^3/3, S_f dt^2/2], [., S_f dt]]."""
    white, walk = model.bias_psd(), model.drift_psd()
    cross = 0.5 * walk * dt * dt
    return np.array([[white * dt + walk * dt**3 / 3.0, cross], [cross, walk * dt]])


def simulate(model: ClockModel, dt: float, n: int, rng: np.random.Generator, state: np.ndarray) -> np.ndarray:
    """Continue a clock by ``n`` steps of ``dt`` s.

    Parameters
    ----------
    state : ndarray, shape (2,)
        Bias m and drift m/s before the first step; overwritten with the last, so blocks join to the bit.

    Returns
    -------
    ndarray, shape (n, 2)
        Bias, m, and drift, m/s, after each step.
    """
    noise = process_noise(model, dt)
    root = np.zeros((2, 2))  # Cholesky by hand: a noiseless clock is allowed
    root[0, 0] = math.sqrt(noise[0, 0])
    root[1, 0] = noise[1, 0] / root[0, 0] if root[0, 0] > 0.0 else 0.0
    root[1, 1] = math.sqrt(max(noise[1, 1] - root[1, 0] ** 2, 0.0))
    return _advance(state, dt, root, rng.standard_normal((n, 2)))


@kernel
def _advance(state, dt, root, normals):
    out = np.empty_like(normals)
    for k in range(normals.shape[0]):
        state[0] += state[1] * dt + root[0, 0] * normals[k, 0]
        state[1] += root[1, 0] * normals[k, 0] + root[1, 1] * normals[k, 1]
        out[k] = state
    return out
