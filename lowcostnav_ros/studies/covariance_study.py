"""Covariance studies: how the error covariance of a filter evolves along a flight, without flying it.

A study takes transition, process noise and measurement rows from the very functions the navigators run; the filter is filterpy's.  What
it adds is bookkeeping: process noise kept apart by source, covariances kept before and after every update, error budgets.

The budget of one source is its covariance alone carried through the *gains of the whole filter*.  Covariance is linear in its
sources when gains are given, so the budgets add up to the whole, in the squares; a test holds that to rounding.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter

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
    return _carried(P0, step, steps, updates)[0]


def error_budget(
    starts: Mapping[str, np.ndarray], step: Step, steps: int, updates: UpdateSource | None = None
) -> tuple[History, dict[str, History]]:
    """Carry every source of error alone through the gains of the whole filter.

    Parameters
    ----------
    starts : mapping of str to ndarray, shape (n, n)
        Covariance at time 0, by source; empty for a perfect start.
    step, steps, updates
        As for :func:`run`; the step's noise names the sources.

    Returns
    -------
    whole : History
        All sources together.
    budget : dict of str to History
        One per source of ``starts`` and of the noise, and :data:`MEASUREMENTS` where there are updates.  Squares add up to the whole.
    """
    n = len(step.Phi)
    names = dict.fromkeys([*starts, *step.noise, *([MEASUREMENTS] if updates else [])])
    parts = {name: np.array(starts.get(name, np.zeros((n, n))), float) for name in names}
    zero = np.zeros((n, n))
    whole, gains = _carried(sum(parts.values(), zero), step, steps, updates)
    shape = (len(parts), steps + 1, n, n)
    after, before = np.empty(shape), np.empty(shape)
    stack = np.array(list(parts.values()))
    noise = np.array([step.noise.get(name, zero) for name in parts])
    after[:, 0] = before[:, 0] = stack
    for k in range(1, steps + 1):
        stack = step.Phi @ stack @ step.Phi.T + noise
        before[:, k] = stack
        for update, K in gains[k - 1]:
            left = np.eye(n) - K @ update.H
            stack = left @ stack @ left.T
            stack[list(parts).index(MEASUREMENTS)] += K @ update.R @ K.T
        after[:, k] = stack
    return whole, {name: History(whole.t_s, after[i], before[i]) for i, name in enumerate(parts)}


def first_crossing(t_s: np.ndarray, sigma: np.ndarray, level: float) -> float:
    """Return the first time a curve rises to ``level``, linear between its points; ``inf`` when it never does."""
    above = np.flatnonzero(np.asarray(sigma) >= level)
    if not len(above):
        return math.inf
    k = int(above[0])
    if k == 0:
        return float(t_s[0])
    share = (level - sigma[k - 1]) / (sigma[k] - sigma[k - 1])
    return float(t_s[k - 1] + share * (t_s[k] - t_s[k - 1]))


def growth_exponent(t_s: np.ndarray, sigma: np.ndarray, begin_s: float, end_s: float) -> float:
    """Return the exponent p of sigma ~ t^p between two times: 1 for a constant rate, 1.5 for its random walk."""
    first, last = np.interp([begin_s, end_s], t_s, sigma)
    return math.log(last / first) / math.log(end_s / begin_s)


def _carried(
    P0: np.ndarray, step: StepSource, steps: int, updates: UpdateSource | None
) -> tuple[History, list[list[tuple[Update, np.ndarray]]]]:
    """History, and the updates of every step with the gain (n, m) that each had."""
    linear = KalmanFilter(dim_x=len(P0), dim_z=1)
    linear.P = np.array(P0, float)
    after, before = np.empty((2, steps + 1, *linear.P.shape))
    after[0] = before[0] = linear.P
    t_s, gains = np.zeros(steps + 1), []
    for k, dt_s, Phi, Qd in _sequence(step, steps):
        t_s[k] = t_s[k - 1] + dt_s
        linear.predict(F=Phi, Q=Qd)
        before[k] = linear.P
        used = []
        for update in updates(k) if updates else ():
            linear.update(np.zeros((len(update.H), 1)), update.R, update.H)
            used.append((update, linear.K))
        gains.append(used)
        after[k] = linear.P
    return History(t_s, after, before), gains


def _sequence(step: StepSource, steps: int) -> Iterator[tuple[int, float, np.ndarray, np.ndarray]]:
    """Number, length, transition and whole noise of each step."""
    for k in range(1, steps + 1):
        if k == 1 or callable(step):  # a constant step is summed once
            now = step(k) if callable(step) else step
            Qd = now.total()
        yield k, now.dt_s, now.Phi, Qd
