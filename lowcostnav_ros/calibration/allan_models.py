"""Allan variance of the usual sensor errors in closed form.

Relation to the two-sided spectral density: sigma^2(T) = 4/(pi T) * integral of S(u/(pi T)) sin^4(u)/u^2 (equation C.5 of
Gebre-Egziabher 2004).  Slopes on the logarithmic chart of the deviation: quantisation -1, white -1/2, flicker 0, random walk
+1/2, ramp +1 (table C.1); a Gauss-Markov process rises with +1/2 well below its correlation time and falls with -1/2 far above.
"""

import math

import numpy as np

FLICKER_FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Allan deviation of flicker noise of bias instability 1: 0.664."""


def quantisation(tau_s: np.ndarray, step_density: float = 1.0) -> np.ndarray:
    """Allan variance of quantisation noise, 3 Q^2/tau^2; Q in unit s."""
    return 3.0 * step_density**2 / np.asarray(tau_s) ** 2


def white(tau_s: np.ndarray, density: float = 1.0) -> np.ndarray:
    """Allan variance of white noise, N^2/tau; N in unit/sqrt(Hz)."""
    return density**2 / np.asarray(tau_s)


def flicker(tau_s: np.ndarray, instability: float = 1.0) -> np.ndarray:
    """Allan variance of flicker noise, (2 ln2/pi) B^2 at every averaging time; B in the unit of the sensor."""
    return np.full(np.shape(tau_s), (FLICKER_FLOOR * instability) ** 2)


def random_walk(tau_s: np.ndarray, density: float = 1.0) -> np.ndarray:
    """Allan variance of a random walk of the sensor's output, K^2 tau/3; K in unit/s/sqrt(Hz)."""
    return density**2 * np.asarray(tau_s) / 3.0


def ramp(tau_s: np.ndarray, rate: float = 1.0) -> np.ndarray:
    """Allan variance of a steady drift, R^2 tau^2/2; R in unit/s."""
    return 0.5 * (rate * np.asarray(tau_s)) ** 2


def gauss_markov(tau_s: np.ndarray, sigma: float, correlation_time_s: float) -> np.ndarray:
    """Allan variance of a first-order Gauss-Markov process.

    ``2 sigma^2 c/T (1 - c/(2T) (3 - 4 exp(-T/c) + exp(-2T/c)))`` with c the correlation time; written by powers where T << c, because
    the bracket is a small difference of large terms there.
    """
    x = np.asarray(tau_s, dtype=float) / correlation_time_s
    small = x < 1e-3
    safe = np.where(small, 1.0, x)
    bracket = 2.0 / safe * (1.0 - (3.0 - 4.0 * np.exp(-safe) + np.exp(-2.0 * safe)) / (2.0 * safe))
    return sigma**2 * np.where(small, x * (2.0 / 3.0 - x / 2.0), bracket)
