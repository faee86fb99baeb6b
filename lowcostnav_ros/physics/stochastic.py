"""Stochastic processes of sensor errors: one description for simulation, covariance studies and filters alike.

Every process has the discrete form ``x[k+1] = a x[k] + w[k]`` with ``a = transition(dt)`` and the variance of w given by
``variance_increment(dt)``, both exact for any step, so the same numbers mean the same at 50 and at 200 Hz.

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: equations (4-23) to (4-34), Table 4.1.
Gebre-Egziabher (2004), Design and performance analysis of a low-cost aided dead reckoning navigator, Stanford: sections 3.3, 4.7.
"""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from lowcostnav_ros.base.kernels import kernel

CONVENTIONS = ("per_sample", "one_hz")


class Process:
    """What :func:`simulate` and the filters ask of a process; as it stands here it is a value that never changes."""

    __slots__ = ()

    def __post_init__(self) -> None:
        _require(self)

    def transition(self, dt: float) -> float:
        """Factor ``a`` from one sample to the next, ``dt`` seconds later."""
        return 1.0

    def variance_increment(self, dt: float) -> float:
        """Variance that one step of ``dt`` seconds adds."""
        return 0.0

    def initial_sigma(self) -> float:
        """Standard deviation at switch-on."""
        return 0.0

    def driving_psd(self) -> float:
        """Two-sided power spectral density of the driving noise, unit^2/s."""
        return 0.0


def _require(process: Any, *, positive: tuple[str, ...] = ()) -> None:
    """Refuse negative or non-finite numbers; those named must also not be zero."""
    for field in fields(process):
        value = getattr(process, field.name)
        if not (math.isfinite(value) and value >= 0.0) or (field.name in positive and value == 0.0):
            kind = "positive" if field.name in positive else "zero or positive"
            raise ValueError(f"{type(process).__name__}: {field.name} must be a finite number, {kind}, got {value!r}.")


@dataclass(frozen=True, slots=True)
class GaussMarkov(Process):
    """First-order Gauss-Markov process, stationary: dx/dt = -x/tau + w.

    Attributes
    ----------
    sigma : float
        Standard deviation, in the unit of the quantity.
    tau : float
        Correlation time, s.
    """

    sigma: float
    tau: float

    def __post_init__(self) -> None:
        _require(self, positive=("tau",))

    def transition(self, dt: float) -> float:
        """exp(-dt/tau)."""
        return math.exp(-dt / self.tau)

    def variance_increment(self, dt: float) -> float:
        """sigma^2 (1 - exp(-2 dt/tau)); exact also where dt is a billionth of tau."""
        return -(self.sigma**2) * math.expm1(-2.0 * dt / self.tau)

    def initial_sigma(self) -> float:
        """The stationary sigma."""
        return self.sigma

    def driving_psd(self) -> float:
        """Two-sided power spectral density of the driving noise, 2 sigma^2/tau, unit^2/s."""
        return 2.0 * self.sigma**2 / self.tau

    def autocorrelation(self, lag: np.ndarray) -> np.ndarray:
        """sigma^2 exp(-|lag|/tau), ``lag`` in s."""
        return self.sigma**2 * np.exp(-np.abs(lag) / self.tau)

    def psd(self, frequency_hz: np.ndarray) -> np.ndarray:
        """Two-sided power spectral density 2 sigma^2 tau/(1 + (2 pi f tau)^2), unit^2/Hz."""
        return 2.0 * self.sigma**2 * self.tau / (1.0 + (2.0 * np.pi * np.asarray(frequency_hz) * self.tau) ** 2)

    def sigma_from_known(self, seconds: np.ndarray) -> np.ndarray:
        """Standard deviation ``seconds`` after the value was known exactly: sigma sqrt(1 - exp(-2 t/tau))."""
        return self.sigma * np.sqrt(-np.expm1(-2.0 * np.asarray(seconds) / self.tau))


@dataclass(frozen=True, slots=True)
class RandomConstant(Process):
    """A value drawn once at switch-on (a turn-on bias) with standard deviation ``sigma``."""

    sigma: float

    def initial_sigma(self) -> float:
        """The sigma of the draw."""
        return self.sigma


@kernel
def _recursion(state, transition, sigma, draws):
    values = np.empty_like(draws)
    for k in range(draws.shape[0]):
        for axis in range(draws.shape[1]):
            state[axis] = transition * state[axis] + sigma * draws[k, axis]
            values[k, axis] = state[axis]
    return values


def initial_state(process: Process, rng: np.random.Generator, axes: int = 1) -> np.ndarray:
    """Draw the value at switch-on, shape (axes,)."""
    return process.initial_sigma() * rng.standard_normal(axes)


def simulate(process: Process, dt: float, n: int, rng: np.random.Generator, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Continue a process by ``n`` samples.

    Parameters
    ----------
    process : Process
        One of the processes of this module.
    dt : float
        Sample interval, s.
    n : int
        Number of samples.
    rng : numpy.random.Generator
        Drawn from in sample order, so a run cut into blocks of any lengths repeats the uncut run to the last bit.
    state : ndarray, shape (axes,)
        Value one interval before the first sample, from :func:`initial_state` or the previous block; not changed.

    Returns
    -------
    values : ndarray, shape (n, axes)
    state : ndarray, shape (axes,)
        The last value, to be given to the next block.
    """
    if not (dt > 0.0 and math.isfinite(dt)):
        raise ValueError(f"The sample interval must be a positive number of seconds, got {dt!r}.")
    state = np.array(state, dtype=float).reshape(-1)
    draws = rng.standard_normal((n, state.size))
    values = _recursion(state, process.transition(dt), math.sqrt(process.variance_increment(dt)), draws)
    return values, state


def white_density(sigma: float, rate_hz: float, convention: str) -> float:
    """Density, unit/sqrt(Hz), behind a white-noise figure quoted in one of two customary ways.

    Parameters
    ----------
    sigma : float
        The figure.
    rate_hz : float
        Sampling rate it was quoted at, Hz.
    convention : {"per_sample", "one_hz"}
        ``per_sample``: the scatter of single samples at that rate (simulations, angle random walk).
        ``one_hz``: already a spectral amplitude (covariance analyses).

    Raises
    ------
    ValueError
        For another convention.
    """
    if convention not in CONVENTIONS:
        raise ValueError(f"The white-noise convention must be one of {', '.join(CONVENTIONS)}, got {convention!r}.")
    return sigma / math.sqrt(rate_hz) if convention == "per_sample" else sigma


def angle_random_walk(sigma: float, rate_hz: float, seconds: np.ndarray) -> np.ndarray:
    """Angle sigma after integrating rate noise of per-sample ``sigma`` at ``rate_hz``: sigma sqrt(T/f) (equation 4.7)."""
    return sigma * np.sqrt(np.asarray(seconds) / rate_hz)


def correlation_factor(dt_s: float, tau_s: float) -> float:
    """Factor on the noise variance of one of many samples ``dt_s`` apart whose errors stay correlated over ``tau_s``.

    coth(dt / (2 tau)): fused as if white, such samples then give a slowly varying state the information they really hold (the variance
    of the mean of a first-order autoregression, (1 + r) / (1 - r) with r = exp(-dt / tau)).
    """
    if tau_s <= 0.0 or dt_s >= 20.0 * tau_s:
        return 1.0
    return 1.0 / math.tanh(max(dt_s, 1e-3) / (2.0 * tau_s))
