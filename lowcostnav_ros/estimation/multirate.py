"""A filter of two rates whose gains repeat: every n-th step all measurements, in between some of them (Eggers 1995, chapter 5).

The covariance falls where all are used and rises in between, so that it converges to a cycle of n; the gains of the cycle, stored, make a
filter that solves no Riccati equation in flight.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Model:
    """A linear model: transition ``A`` (n, n), process noise ``Q``, rows ``C`` (m, n) and noise ``R`` (m, m) of all measurements.

    ``partial`` are the rows that come at every step; ``steps`` is the length of the cycle.
    """

    A: np.ndarray
    Q: np.ndarray
    C: np.ndarray
    R: np.ndarray
    partial: slice
    steps: int = 4

    def measured(self, phase: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows and noise of the measurements of a phase; 0 has all."""
        return (self.C, self.R) if phase == 0 else (self.C[self.partial], self.R[self.partial, self.partial])


@dataclass(frozen=True)
class Cycle:
    """Gains (n, m) by phase, and covariances (n, n) before and after the update of each."""

    gains: tuple[np.ndarray, ...]
    prior: tuple[np.ndarray, ...]
    posterior: tuple[np.ndarray, ...]
    updates: int = 0


def update(P: np.ndarray, C: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gain (n, m) and updated covariance (n, n), Joseph form."""
    K = np.linalg.solve(C @ P @ C.T + R, C @ P).T
    keep = np.eye(len(P)) - K @ C
    return K, keep @ P @ keep.T + K @ R @ K.T


def run(model: Model, P: np.ndarray, updates: int) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Gain, covariance before and after each of some updates, from the covariance before the first; phase 0 is the first."""
    out = []
    for k in range(updates):
        K, after = update(P, *model.measured(k % model.steps))
        out.append((K, P, after))
        P = model.A @ after @ model.A.T + model.Q
    return out


def steady_cycle(model: Model, P: np.ndarray | None = None, tolerance: float = 1e-12, longest: int = 200_000) -> Cycle:
    """The cycle that the covariance converges to.

    Raises
    ------
    ValueError
        When it has not converged after ``longest`` updates.
    """
    P, before = np.array(model.Q if P is None else P), None
    for k in range(0, longest, model.steps):
        steps = run(model, P, model.steps)
        after = steps[-1][2]
        if before is not None and (np.abs(after - before) <= tolerance * np.abs(after).max(axis=1, keepdims=True)).all():
            gains, prior, posterior = zip(*steps, strict=True)
            return Cycle(gains, prior, posterior, k)
        before, P = after, model.A @ after @ model.A.T + model.Q
    raise ValueError(f"The covariance has not converged after {longest} updates.")


def response(model: Model, gains: Sequence[np.ndarray], tau_steps: float, cycles: int = 4000) -> np.ndarray:
    """Covariance (n, n) that a correlated error of the measurements of every step causes, per unit of its variance.

    The error is the same in all of ``partial`` that a state sees, first-order Gauss-Markov of correlation time ``tau_steps``; it is what a
    gain tuned to white noise leaves out of account.
    """
    n, a = len(model.A), float(np.exp(-1.0 / tau_steps))
    X = np.zeros((n + 1, n + 1))
    X[n, n] = 1.0
    shows = np.ones(model.partial.stop - model.partial.start)
    for k in range(cycles * model.steps):
        K, (C, _) = gains[k % model.steps], model.measured(k % model.steps)
        error = np.zeros(C.shape[0])
        error[-len(shows) :] = shows
        step = np.zeros((n + 1, n + 1))
        step[:n, :n], step[:n, n] = np.eye(n) - K @ C, K @ error
        step[n, n] = 1.0
        X = step @ X @ step.T
        ahead = np.zeros((n + 1, n + 1))
        ahead[:n, :n], ahead[n, n] = model.A, a
        X = ahead @ X @ ahead.T
        X[n, n] += 1.0 - a * a
    return X[:n, :n]


def position_velocity(dt: float, position: float, velocity: float, gps: tuple[float, float], air: float, steps: int = 4) -> Model:
    """One axis of position and velocity on GPS position and velocity and a second velocity at every step.

    Parameters
    ----------
    dt : float
        Step, s.
    position, velocity : float
        Process noise of a step, variances.
    gps : tuple of float
        Variances of GPS position and velocity.
    air : float
        Variance of the other velocity.
    steps : int
        Steps from one GPS measurement to the next.
    """
    A, C = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
    return Model(A, np.diag([position, velocity]), C, np.diag([*gps, air]), slice(2, 3), steps)
