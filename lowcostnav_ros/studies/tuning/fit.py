"""The fit: the most likely factors on the declared numbers, with priors, and how far they can be trusted.

Parameters are logarithms of factors on the numbers to begin with, each with the normal prior that its declaration states (``within``).
Gradient and information matrix come from forward differences by blocks of time: sums and sums of squares of the blocks' scores (Berndt,
Hall, Hall and Hausman, "Estimation and inference in nonlinear structural models", Annals of Economic and Social Measurement 3, 1974).
Where the model does not fit, scores scatter more than the likelihood curves, and their squares would promise too much.  The uncertainty is
therefore that of a misspecified model, H^-1 J H^-1 with J from the scores and H from the curvature (White, "Maximum likelihood estimation
of misspecified models", Econometrica 50, 1982); H takes its correlations from J, so that only its diagonal has to be flown.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from lowcostnav_ros.base.settings import SettingsError, declared
from lowcostnav_ros.studies.campaign import Workers, executor
from lowcostnav_ros.studies.tuning.likelihood import Flight, Innovations, Source, innovations, load

STEP = 0.1
"""Step of the differences, in the logarithm of a factor."""
CLOSE = 0.1
"""A step that gains less log-likelihood than this is the last."""
FURTHEST = 3.0
"""A factor stays within so many sigmas of its prior."""
OBSERVED = 0.7
"""A number whose sigma the recordings cut to less than this share of the prior's counts as learned."""
Advance = Callable[[float], None]


@dataclass(frozen=True)
class Tunable:
    """A number that recordings may tune: its value to begin with (one, or three by axis), its range, and the factor of its prior."""

    name: str
    value: Any
    unit: str
    low: float
    high: float
    within: float

    def at(self, x: float) -> Any:
        """Its value for the logarithm of a factor."""
        factor = math.exp(min(max(x, -FURTHEST * math.log(self.within)), FURTHEST * math.log(self.within)))
        clipped = [min(max(factor * v, self.low), self.high) for v in (self.value if isinstance(self.value, list) else [self.value])]
        return clipped if isinstance(self.value, list) else clipped[0]


def tunables(settings: Any, groups: frozenset[str]) -> list[Tunable]:
    """Numbers of settings that may be tuned: those of the core, and of sensors that had innovations; a number of 0 is a state left out."""
    sensors = set(getattr(settings, "aids", ()))
    found = []
    for entry in declared(settings):
        if entry.within is None:
            continue
        group, value = entry.name.partition(".")[0], entry.default
        is_on = min(value if isinstance(value, list) else [value]) > 0.0
        if is_on and (group not in sensors or group in groups):
            low, high = entry.minimum or 0.0, math.inf if entry.maximum is None else entry.maximum
            found.append(Tunable(entry.name, value, entry.unit, low, high, entry.within))
    return found


@lru_cache(maxsize=1)
def _flights(sources: tuple[Source, ...]) -> list[Flight]:
    """The recordings, read once by each worker."""
    return [load(source) for source in sources]


def _fly(sources: tuple[Source, ...], changes: Mapping[str, Any]) -> list[Innovations]:
    return [innovations(flight, changes) for flight in _flights(sources)]


class Trials:
    """Recordings in worker processes, flown with many settings.

    Attributes
    ----------
    parameters : list of Tunable
    reference : list of Innovations
        Of the numbers to begin with, by recording.
    gradients : int
        How many are expected, for the share of the work that ``advance`` is told.
    """

    gradients: int = 16

    def __init__(self, sources: Sequence[Source], workers: Workers = None, advance: Advance | None = None) -> None:
        self._advance, self._done = advance, 0
        flight = load(sources[0])  # what cannot be flown is refused here, in this process
        self._stack, self._fly = ExitStack(), partial(_fly, tuple(sources))
        self._pool = self._stack.enter_context(executor(workers))
        self.reference: list[Innovations] = self._pool.submit(self._fly, {}).result()
        if not any(one.count.sum() for one in self.reference):
            raise SettingsError(f"{sources[0].navigator} had no innovations over the recordings; look at the replay first.")
        groups = frozenset.union(*(one.groups for one in self.reference))
        self.parameters = tunables(flight.settings, groups)
        if not self.parameters:
            raise SettingsError(f"{sources[0].navigator} has no numbers that could be tuned.")
        self._known: dict[tuple, np.ndarray] = {}

    def __enter__(self) -> "Trials":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)
        self._stack.close()

    def changes(self, x: np.ndarray) -> dict[str, Any]:
        """Settings of a point."""
        return {p.name: p.at(v) for p, v in zip(self.parameters, x.tolist(), strict=True)}

    def blocks(self, points: Sequence[np.ndarray]) -> np.ndarray:
        """Log-likelihood of each point (p, n) by block, those of all recordings one after the other (p, b)."""
        keys = [tuple(np.round(p, 9).tolist()) for p in points]
        new = {key: point for key, point in zip(keys, points, strict=True) if key not in self._known}
        for key, flown in zip(new, self._pool.map(self._fly, [self.changes(p) for p in new.values()]), strict=True):
            self._known[key] = np.concatenate([one.against(r) for one, r in zip(flown, self.reference, strict=True)])
            self._done += 1
            if self._advance is not None:
                self._advance(min(self._done / (self.gradients * (len(self.parameters) + 1)), 0.99))
        return np.array([self._known[key] for key in keys])

    def half(self, which: int) -> np.ndarray:
        """Blocks of the first (0) or the second (1) half of every recording, as 1 and 0 (b,)."""
        return np.concatenate([(np.arange(len(r.count)) * 2 >= len(r.count)) == bool(which) for r in self.reference]).astype(float)

    def count(self) -> np.ndarray:
        """Innovations by block (b,)."""
        return np.concatenate([r.count for r in self.reference])


@dataclass(frozen=True)
class Fit:
    """The most likely point (n,), its covariance (n, n), and the gain of log-likelihood over the numbers to begin with."""

    x: np.ndarray
    covariance: np.ndarray
    gain: float

    def sigma(self) -> np.ndarray:
        """Sigmas (n,) of the logarithms of the factors."""
        return np.sqrt(np.diag(self.covariance))


def fit(trials: Trials, blocks: np.ndarray, start: np.ndarray, steps: int) -> Fit:
    """Maximise the posterior over some blocks (b,), 1 or 0, from a point (n,), with about ``steps`` gradients."""
    from scipy.optimize import minimize

    prior = np.array([math.log(p.within) for p in trials.parameters])

    def scores(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = trials.blocks([x, *(x + STEP * np.eye(len(x)))])
        return found[0], (found[1:] - found[0]) / STEP * blocks

    def information(x: np.ndarray) -> np.ndarray:
        each = scores(x)[1]
        centred = (each - each.sum(axis=1, keepdims=True) / blocks.sum()) * blocks
        return centred @ centred.T + np.diag(prior**-2.0)

    def covariance(x: np.ndarray) -> np.ndarray:
        steps = STEP * np.eye(len(x))
        here, ahead, behind = np.split(trials.blocks([x, *(x + steps), *(x - steps)]) @ blocks, [1, 1 + len(x)])
        return misspecified(information(x), (2.0 * here - ahead - behind) / STEP**2, prior)

    scale = np.linalg.inv(np.linalg.cholesky(information(start))).T  # x = start + scale z: of a curvature of about one

    def cost(z: np.ndarray) -> tuple[float, np.ndarray]:
        x = start + scale @ z
        found, each = scores(x)
        return float(0.5 * ((x / prior) ** 2).sum() - found @ blocks), scale.T @ (x / prior**2 - each.sum(axis=1))

    options = {"maxfun": steps, "ftol": CLOSE / max(abs(cost(np.zeros_like(start))[0]), 1.0), "gtol": 1e-3}
    best = minimize(cost, np.zeros_like(start), method="L-BFGS-B", jac=True, options=options)
    x = start + scale @ best.x
    gain = float((trials.blocks([x])[0] - trials.blocks([np.zeros_like(x)])[0]) @ blocks)
    return Fit(x, covariance(x), gain)


def misspecified(information: np.ndarray, curvature: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Covariance (n, n) from the scores' information with the prior's (n, n), the curvature of the log-likelihood (n,), prior sigmas (n,).

    A curvature that is larger than the scores say is not believed, and none is below zero.
    """
    held = np.diag(prior**-2.0)
    scores = information - held
    share = np.sqrt(np.clip(curvature / np.maximum(np.diag(scores), 1e-12), 0.0, 1.0))
    bread = np.linalg.inv(share[:, None] * scores * share + held)
    return bread @ information @ bread
