"""Covariance studies: how the error covariance of a filter evolves along a flight, without flying it.

A study takes transition, process noise and measurement rows from the very functions the navigators run, and the update from
:mod:`~lowcostnav_ros.estimation.kalman`; what it adds is bookkeeping: process noise kept apart by source, covariances kept before
and after every update, error budgets.

The budget of one source is its covariance alone carried through the *gains of the whole filter*.  Covariance is linear in its
sources when gains are given, so the budgets add up to the whole, in the squares; a test holds that to rounding.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.estimation import kalman

MEASUREMENTS = "measurements"
"""Name under which an error budget lists the white noise of the updates."""


@dataclass(frozen=True, eq=False)
class Step:
    """One time step of a linear error model.

    Attributes
    ----------
    Phi : ndarray, shape (n, n)
        Transition.
    noise : dict of str to ndarray, shape (n, n)
        Process noise of the step, by source; the whole is their sum.
    dt_s : float
    """

    Phi: np.ndarray
    noise: Mapping[str, np.ndarray]
    dt_s: float = 1.0

    def __post_init__(self) -> None:
        if not self.dt_s > 0.0:
            raise ValueError(f"A step of a covariance study must last longer than nothing, got {self.dt_s!r} s.")
        for name, Qd in self.noise.items():
            if np.shape(Qd) != np.shape(self.Phi):
                raise ValueError(f"The noise '{name}' of shape {np.shape(Qd)} does not fit a transition of shape {np.shape(self.Phi)}.")

    def total(self) -> np.ndarray:
        """Process noise of all sources, shape (n, n)."""
        return sum(self.noise.values(), np.zeros_like(self.Phi))


@dataclass(frozen=True, eq=False)
class Update:
    """One measurement: ``H`` (m, n) and white noise ``R`` (m, m)."""

    H: np.ndarray
    R: np.ndarray


StepSource = Step | Callable[[int], Step]
UpdateSource = Callable[[int], Sequence[Update]]


@dataclass(frozen=True, eq=False)
class History:
    """Covariance over time.

    Attributes
    ----------
    t_s : ndarray, shape (k + 1,)
        Times, from 0.
    P, before : ndarray, shape (k + 1, n, n)
        Covariance after and before the updates of each time; equal where there were none.
    """

    t_s: np.ndarray
    P: np.ndarray
    before: np.ndarray

    def sigma(self, *states: int, before: bool = False) -> np.ndarray:
        """Root of the sum of the variances of some states at every time, shape (k + 1,): two positions give the horizontal error."""
        P = self.before if before else self.P
        return np.sqrt(np.maximum(sum(P[:, i, i] for i in states), 0.0))

    def at(self, t_s: float) -> int:
        """Row of a time, the nearest.

        Raises
        ------
        ValueError
            For a time outside the study.
        """
        if not 0.0 <= t_s <= self.t_s[-1]:
            raise ValueError(f"The study covers 0 to {self.t_s[-1]:g} s; {t_s:g} s lies outside, run it for longer.")
        return int(np.argmin(np.abs(self.t_s - t_s)))


def discretise(F: np.ndarray, noise: Mapping[str, np.ndarray], dt_s: float) -> Step:
    """Make a step of a time-invariant model from its dynamics F (n, n) and its noise densities G Q G' (n, n) by source (van Loan)."""
    Phi, _ = kalman.van_loan(F, np.zeros_like(F), dt_s)
    return Step(Phi, {name: kalman.van_loan(F, GQG, dt_s)[1] for name, GQG in noise.items()}, dt_s)


def run(P0: np.ndarray, step: StepSource, steps: int, updates: UpdateSource | None = None) -> History:
    """Carry a covariance over ``steps`` steps; each moves it, then fuses the updates of the time reached.

    Parameters
    ----------
    P0 : ndarray, shape (n, n)
        Covariance at time 0.
    step : Step or callable
        The step, or a function of the step number 1... that returns it.
    steps : int
    updates : callable, optional
        Function of the step number 1... that returns the updates at its end, in order.

    Returns
    -------
    History
    """
    P = np.array(P0, float)
    after, before = np.empty((steps + 1, *P.shape)), np.empty((steps + 1, *P.shape))
    after[0] = before[0] = P
    t_s = np.zeros(steps + 1)
    free = np.ones(len(P))
    for k, now in _steps(step, steps):
        t_s[k] = t_s[k - 1] + now.dt_s
        P = _moved(P, now.Phi, now.total() if callable(step) else _cached_total(now))
        before[k] = P
        for update in updates(k) if updates else ():
            kalman.update(P, np.zeros(len(update.H)), np.asarray(update.H, float), np.asarray(update.R, float), free)
        after[k] = P
    return History(t_s, after, before)
