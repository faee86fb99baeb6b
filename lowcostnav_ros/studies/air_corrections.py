"""Simulated corrections of air data and attitude, the filter that estimates them once a second, and what its histories say (Eggers 1995).

Everything is in one unit of speed, knots for the thesis, and steps of one second; the measurement equations are those of the navigator
(:mod:`~lowcostnav_ros.cores.air_corrections_model`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.cores.air_corrections_model import COUNT, ground_velocity
from lowcostnav_ros.trajectory.load_factor import AirSeen

KNOT = 6080.0 / 3600.0 * 0.3048
"""m/s, of the thesis's nautical mile of 6080 ft."""
FOOT_PER_KNOT_S = 6080.0 / 3600.0
"""ft/s in a knot."""
GRAVITY_KT_S = 360.0 / 19.0
"""32.0 ft/s^2 in kt/s."""
REFERENCE_KT = 300.0
TAU_S, TILT_RAD = 150.0, np.radians(0.1)
DECAY = float(np.exp(-1.0 / TAU_S))
STATES = ("zeta N", "zeta E", "zeta D", "pitch", "bank", "V_S", "V_B", "W_N", "W_E", "W_D")
ZETA, ANGLES, AIRSPEED, WIND = slice(0, 3), slice(3, 5), slice(5, 7), slice(7, 10)
CENTRE_KT = np.array([10.0, -10.0, 0.0])


def markov(n: int, a: float, step: float, rng: np.random.Generator, centre: np.ndarray | float = 0.0) -> np.ndarray:
    """First-order Markov history (n, 3) that starts at its centre: x' = a (x - c) + c + step w."""
    return _markov(a, step * rng.standard_normal((n, 3))) + centre


@kernel
def _markov(a, noise):
    out = np.zeros_like(noise)
    for k in range(1, noise.shape[0]):
        out[k] = a * out[k - 1] + noise[k]
    return out


def wind(kind: str, n: int, rng: np.random.Generator) -> np.ndarray:
    """One of the thesis's four winds (n, 3), kt: ``markov 1``, ``markov 2``, ``sinusoidal``, ``ramp``."""
    t = np.arange(n)[:, None]
    if kind == "sinusoidal":
        return 20.0 * np.sin(2.0 * np.pi * t / [160.0, 240.0, 320.0]) + 1.5 * rng.standard_normal((n, 3))
    if kind == "ramp":
        phase = np.mod(t / [40.0, 60.0, 120.0] + 0.25, 1.0)
        return 30.0 * (1.0 - 4.0 * np.abs(phase - 0.5))
    a, step = {"markov 1": (0.9165, 2.0), "markov 2": (0.9789, 1.0)}[kind]
    return markov(n, a, step, rng, CENTRE_KT)


@dataclass(frozen=True)
class Truth:
    """True corrections (n, 10) and the velocity over ground (n, 3) that they give with what is seen of a flight."""

    seen: AirSeen
    corrections: np.ndarray
    velocity: np.ndarray
    variation: float = 0.0

    @classmethod
    def of(cls, seen: AirSeen, corrections: np.ndarray, variation: float = 0.0) -> "Truth":
        """Compute the velocity: the sensors show what is seen, the corrections make it true."""
        return cls(seen, corrections, _velocities(*columns(seen, variation), corrections, REFERENCE_KT), variation)


def true_corrections(
    n: int,
    wind_n: np.ndarray,
    zeta: np.ndarray | float = 0.0,
    pitch: float = 6e-4,
    bank: float = 5e-4,
    scale: float = 1.05,
    bias: float = 4.7,
) -> np.ndarray:
    """Corrections (n, 10) of constant angles, scale and bias; ``wind_n`` (n, 3), ``zeta`` (n, 3)."""
    out = np.zeros((n, 10))
    out[:, ZETA], out[:, WIND] = zeta, wind_n
    out[:, 3:7] = pitch, bank, scale, bias
    return out


def columns(seen: AirSeen, variation: float) -> tuple[np.ndarray, np.ndarray]:
    """Euler angles (n, 3), true heading, and air velocity (n, 3) by airspeed, incidence and sideslip; nose right is air from the left."""
    euler = np.column_stack((seen.bank, seen.pitch, seen.heading + variation))
    tangents = np.column_stack((np.ones(len(seen)), -np.tan(seen.sideslip) / np.cos(seen.incidence), np.tan(seen.incidence)))
    return euler, seen.airspeed[:, None] * tangents


@kernel
def _velocities(euler, air_b, corrections, reference):
    out = np.empty_like(air_b)
    y = np.zeros(COUNT)
    for k in range(air_b.shape[0]):
        y[:10] = corrections[k]
        out[k] = ground_velocity(euler[k], air_b[k], y, reference, False)[0]
    return out


@dataclass(frozen=True)
class Tuning:
    """Noise of the estimator: variances of a step (10,), of GPS velocity, of the start (10,); ``decay`` (10,); ``active`` states."""

    Q: np.ndarray
    R: float
    P0: np.ndarray
    decay: np.ndarray = field(default_factory=lambda: np.array([DECAY] * 3 + [1.0] * 7))
    active: np.ndarray = field(default_factory=lambda: np.ones(10))
    start: np.ndarray = field(default_factory=lambda: np.array([0.0] * 5 + [1.0] + [0.0] * 4))
    propagates_first: bool = False


def final_tuning(R: float = 0.0625, wind_q: float = 1.0, zeta_q: float = 4.03e-8, pitch_q: float = 1e-14) -> Tuning:
    """Tuning after the thesis's sensitivity tests, with the start variances of a cold start."""
    Q = np.array([zeta_q] * 3 + [pitch_q] * 2 + [1e-7, 0.01] + [wind_q] * 3)
    return Tuning(Q, R, np.array([3e-6] * 3 + [1e-6] * 2 + [1e-2, 25.0] + [100.0] * 3))


@dataclass(frozen=True)
class Run:
    """Histories: estimates before the update (n, 10), predicted velocity (n, 3), variance of the residual (n, 3), covariance after
    (n, 10, 10), GPS velocity (n, 3)."""

    estimates: np.ndarray
    predicted: np.ndarray
    residual_variance: np.ndarray
    P: np.ndarray
    measured: np.ndarray


def estimate(truth: Truth, measured: np.ndarray, tuning: Tuning) -> Run:
    """Run the ten-state estimator over a flight, in the order of the thesis's listing: predict with the corrections as they are, update."""
    t = tuning
    euler, air_b = columns(truth.seen, truth.variation)
    found = _estimate(euler, air_b, measured, t.Q, t.R, t.P0, t.decay, t.active, t.start, REFERENCE_KT, t.propagates_first)
    return Run(found[0], found[1], found[2], found[3], measured)


@kernel
def _estimate(euler, air_b, measured, Q, R, P0, decay, active, start, reference, first):
    n = air_b.shape[0]
    y, P = np.zeros(COUNT), np.diag(P0)
    y[:10] = start
    estimates, predicted, variance, kept = np.empty((n, 10)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 10, 10))
    for k in range(n):
        if first:
            y[:10] *= decay
        estimates[k] = y[:10]
        predicted[k], whole = ground_velocity(euler[k], air_b[k], y, reference, False)
        H = np.ascontiguousarray(whole[:, :10]) * active
        for i in range(10):
            for j in range(10):
                P[i, j] *= decay[i] * decay[j]
            P[i, i] += Q[i]
        PH = P @ H.T
        S = H @ PH
        for i in range(3):
            S[i, i] += R
            variance[k, i] = S[i, i]
        K = np.linalg.solve(S, PH.T.copy()).T.copy()
        if not first:
            y[:10] *= decay
        y[:10] += K @ (measured[k] - predicted[k])
        P = P - K @ PH.T
        P = 0.5 * (P + P.T)
        kept[k] = P
    return estimates, predicted, variance, kept


# analysis --------------------------------------------------------------------------------------------------------------------------------


def rms(values: np.ndarray) -> np.ndarray:
    """Root mean square over the steps."""
    return np.sqrt(np.mean(np.square(values), axis=0))


def total(values: np.ndarray) -> float:
    """RMS over the axes of what is an RMS of each axis already."""
    return float(np.sqrt(np.mean(np.square(values))))


@dataclass(frozen=True)
class Errors:
    """RMS of a run: of the estimates (10,), of GPS less predicted velocity (3,), of true less predicted velocity (3,)."""

    states: np.ndarray
    measured: np.ndarray
    true: np.ndarray


def errors(truth: Truth, run: Run) -> Errors:
    """RMS over all steps, the start included, as the thesis's ``showrms``."""
    corrections = rms(run.estimates - truth.corrections)
    return Errors(corrections, rms(run.measured - run.predicted), rms(truth.velocity - run.predicted))


def correlation(run: Run, state: int) -> np.ndarray:
    """Correlation coefficients (n, 10) of one state with all, step by step (``statcorr``)."""
    sigma = np.sqrt(np.maximum(np.diagonal(run.P, axis1=1, axis2=2), 1e-300))
    return run.P[:, state, :] / (sigma[:, state : state + 1] * sigma)


def share_inside(run: Run, skip: int = 1) -> float:
    """Share of the residuals within one sigma of their own, from the second step on (the thesis's residual plots)."""
    return float(np.mean(np.abs(run.measured - run.predicted)[skip:] < np.sqrt(run.residual_variance[skip:])))


def with_gps(truth: Truth, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """GPS velocity (n, 3): the true one with white noise."""
    return truth.velocity + sigma * rng.standard_normal(truth.velocity.shape)


def observability(truth: Truth, tuning: Tuning, states: Sequence[int] = range(10)) -> np.ndarray:
    """Sigma of each state at the end over that at the start (k,): near one is what a flight does not observe."""
    run = estimate(truth, truth.velocity, tuning)
    return np.sqrt(np.diagonal(run.P[-1])[list(states)] / tuning.P0[list(states)])
