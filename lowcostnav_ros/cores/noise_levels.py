"""How large wind, turbulence and heading error are on the day: hypotheses about their sigmas, weighed by GPS velocity.

Data sheets and climatology give sigmas within a factor of four at best; a compass in a small aircraft that circles is off by 20 deg,
in an airliner by one.  So a bank of small filters, one for each combination of factors on the declared sigmas, estimates wind, airspeed
and heading errors from GPS velocity alone, once a second, and is weighed by the likelihood of its innovations (Magill, "Optimal adaptive
estimation of sampled stochastic processes", IEEE TAC 10, 1965).  The core then flies with the weighed mean of the factors.

The declared sigmas are the prior, log-normal within a factor of three, and what was learned is forgotten: the weather changes.
Innovations are held to be of Student's distribution, so that one bad velocity does not change the weather.
"""

import itertools
import math
from collections.abc import Mapping

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.cores.reckoning_model import CORE, corrected_air, coupling, sum_estimates
from lowcostnav_ros.estimation.error_state import Kind, Layout

FACTORS: Mapping[str, tuple[float, ...]] = {
    "wind": (0.25, 0.5, 1.0, 2.0),
    "gust": (0.5, 1.0, 2.0),
    "heading_bias": (0.5, 1.0, 2.0, 4.0, 8.0),
}
"""Factors on the sigmas of these blocks that are tried."""
PRIOR = math.log(3.0)
"""Sigma of the natural logarithm of a factor, before anything is seen."""
PERIOD_NS = 1_000_000_000
"""Errors of GPS velocity and of airspeed are taken as white at this spacing."""
FREEDOM = 6.0
"""Degrees of freedom of Student's distribution."""
ACTS = (Kind.WIND, Kind.AIRSPEED_SCALE, Kind.AIRSPEED_BIAS, Kind.HEADING_BIAS, Kind.HEADING_BANK)
"""States that turn a velocity over ground."""


class NoiseLevels:
    """A bank of filters over the states of a layout that turn a velocity; it sets the levels of the layout.

    Parameters
    ----------
    layout : Layout
    memory_s : float
        Time in which evidence counts half to a third; 0: nothing is learned.
    """

    def __init__(self, layout: Layout, memory_s: float) -> None:
        self._layout, self._memory_s = layout, memory_s
        self.factors = dict.fromkeys((name for name in FACTORS if name in layout), 1.0)
        layout.set_levels(self.factors)
        self._tried = np.array(list(itertools.product(*(FACTORS[name] for name in self.factors))))
        self._prior = -0.5 * (np.log(self._tried) ** 2).sum(axis=1) / PRIOR**2
        self._rows = np.concatenate((np.arange(CORE), np.flatnonzero(np.isin(layout.kind, ACTS))))
        self._kind, self._axis = layout.kind[self._rows], layout.axis[self._rows]
        scale = np.ones((len(self._tried), layout.size))
        for name, column in zip(self.factors, self._tried.T, strict=True):
            scale[:, layout[name]] = column[:, None]
        sigma = (scale * layout.sigma0)[:, self._rows]
        sigma[:, :CORE] = 0.0
        self._variance, self._weight = sigma**2, self._prior.copy()
        self._x, self._P = np.zeros_like(sigma), self._variance[:, :, None] * np.eye(len(self._rows))
        self._seen_ns: int | None = None

    def wants(self, t_ns: int) -> bool:
        """Whether the next velocity is to be taken."""
        return self._memory_s > 0.0 and len(self._tried) > 1 and (self._seen_ns is None or t_ns - self._seen_ns >= PERIOD_NS)

    def take(self, t_ns: int, air_n: np.ndarray, bank: float, vel_n: np.ndarray, noise: np.ndarray) -> None:
        """Weigh the hypotheses by a velocity over ground and give the layout their mean.

        Parameters
        ----------
        t_ns : int
        air_n, vel_n : ndarray (3,)
            Air-relative velocity as measured, and velocity over ground, m/s NED.
        bank : float
            Sine of the bank.
        noise : ndarray (3, 3)
            Covariance of their difference that no state explains, (m/s)^2.
        """
        dt = 0.0 if self._seen_ns is None else 1e-9 * (t_ns - self._seen_ns)
        self._seen_ns = t_ns
        self._weight = self._prior + (self._weight - self._prior) * math.exp(-dt / self._memory_s)
        rate = self._layout.rate[self._rows]
        weigh(self._weight, self._x, self._P, self._variance, rate, self._kind, self._axis, air_n, bank, vel_n, noise, dt)
        self._weight -= self._weight.max()
        share = np.exp(self._weight)
        mean = np.exp(share @ np.log(self._tried) / share.sum())
        self.factors = dict(zip(self.factors, mean.tolist(), strict=True))
        self._layout.set_levels(self.factors)


@kernel
def weigh(weight, x, P, variance, rate, kind, axis, air_n, bank, vel_n, noise, dt):
    """Carry every hypothesis over ``dt``, fuse a velocity and add the log-likelihood of its innovations to its weight, all in place.

    ``weight`` (k,), ``x`` (k, n), ``P`` (k, n, n), ``variance`` (k, n) steady ones; the others as in :mod:`.reckoning_model`.
    """
    n = rate.shape[0]
    decay = np.exp(-rate * dt)
    h, Ph = np.zeros(n), np.zeros(n)
    for k in range(weight.shape[0]):
        for i in range(CORE, n):
            x[k, i] *= decay[i]
            for j in range(CORE, n):
                P[k, i, j] *= decay[i] * decay[j]
            P[k, i, i] += variance[k, i] * (1.0 - decay[i] * decay[i])
        for r in range(2):
            total = sum_estimates(x[k], kind, axis, bank)
            air = corrected_air(air_n, total)
            h[:] = coupling(air[0], air[1], bank, 1.0, kind, axis)[r]
            s = noise[r, r]
            for i in range(CORE, n):
                Ph[i] = 0.0
                for j in range(CORE, n):
                    Ph[i] += P[k, i, j] * h[j]
                s += h[i] * Ph[i]
            y = vel_n[r] - air[r] - total[r]
            weight[k] -= 0.5 * (math.log(s) + (FREEDOM + 1.0) * math.log1p(y * y / (FREEDOM * s)))
            for i in range(CORE, n):
                x[k, i] += Ph[i] / s * y
                for j in range(CORE, n):
                    P[k, i, j] -= Ph[i] * Ph[j] / s
