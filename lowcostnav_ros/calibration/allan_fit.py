"""Read an error model off an Allan chart: the classic coefficients, and the numbers a filter takes.

Two models are fitted to the same chart by weighted non-negative least squares on the variance.  The *classic* one is a sum of
quantisation, white, flicker, random walk and ramp.  The *filter* one is white noise plus a first-order Gauss-Markov drift,
because its variance is bounded and its state is what the navigators estimate (Gebre-Egziabher 2004, section 3.2).
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.calibration import allan_models as model
from lowcostnav_ros.calibration.allan import AllanChart, local_slopes

SLOPE_NAMES = {-1.0: "quantisation", -0.5: "white", 0.0: "flicker", 0.5: "random walk", 1.0: "ramp"}
WELL_KNOWN = 50.0
"""Degrees of freedom from which on a point of a chart is known to a tenth."""
SLOPE_TOLERANCE = 0.15
DRIFT_EVIDENCE = 12.0
"""Fall of the weighted squares (two parameters more) below which white noise alone is kept."""


@dataclass(frozen=True, slots=True, eq=False)
class AllanFit:
    """Error model read off a chart, in the unit of the samples and seconds.

    Attributes
    ----------
    white_density : float
        N, unit/sqrt(Hz), of the filter model.
    drift_sigma, drift_tau_s : float
        Gauss-Markov drift of the filter model; both 0 where the chart shows none.
    drift_tau_observed : bool
        False where the correlation time exceeds a third of the record, so that only sigma^2/tau is known.
    bias_instability : float
        B, deviation at that minimum over 0.664.
    minimum_s, minimum : float
        Averaging time and deviation of the lowest point before the chart rises.
    quantisation, white, flicker, random_walk, ramp : float
        Coefficients Q, N, B, K, R of the classic model, 0 where absent.
    slopes : list of (str, float, float)
        Stretches of the chart of one slope: name, first and last averaging time, s.
    """

    white_density: float
    drift_sigma: float
    drift_tau_s: float
    drift_tau_observed: bool
    bias_instability: float
    minimum_s: float
    minimum: float
    quantisation: float
    white: float
    flicker: float
    random_walk: float
    ramp: float
    slopes: list[tuple[str, float, float]]

    def variance(self, tau_s: np.ndarray) -> np.ndarray:
        """Allan variance of the filter model."""
        drift = model.gauss_markov(tau_s, self.drift_sigma, self.drift_tau_s) if self.drift_sigma > 0.0 else 0.0
        return model.white(tau_s, self.white_density) + drift


    def misses(self, chart: AllanChart) -> tuple[float, float]:
        """By what factor the model leaves the deviation where it is known well, at worst, and at which averaging time, s."""
        known = chart.degrees >= min(WELL_KNOWN, float(chart.degrees.max()))  # of a short record what is known best
        ratio = np.sqrt(self.variance(chart.tau_s[known])) / chart.deviation[known]
        worst = int(np.argmax(np.abs(np.log(ratio))))
        return float(max(ratio[worst], 1.0 / ratio[worst])), float(chart.tau_s[known][worst])


def fit_chart(chart: AllanChart) -> AllanFit:
    """Fit both models to a chart."""
    classic = _classic(chart)
    density, sigma, tau_s = _filter_model(chart)
    lowest = first_minimum(chart)
    return AllanFit(
        white_density=density,
        drift_sigma=sigma,
        drift_tau_s=tau_s,
        drift_tau_observed=bool(sigma == 0.0 or tau_s <= chart.duration_s / 3.0),
        bias_instability=float(chart.deviation[lowest] / model.FLICKER_FLOOR),
        minimum_s=float(chart.tau_s[lowest]),
        minimum=float(chart.deviation[lowest]),
        **dict(zip(("quantisation", "white", "flicker", "random_walk", "ramp"), map(float, classic), strict=True)),
        slopes=slope_stretches(chart),
    )


def first_minimum(chart: AllanChart) -> int:
    """Index of the lowest point before the chart rises for sure.

    Beyond the correlation time of a bounded drift the chart falls again, and its last points scatter widely; so the search ends
    where a later point lies above the lowest one by more than both intervals.
    """
    lowest = 0
    for k in range(1, len(chart.tau_s)):
        if chart.degrees[k] < 3.0 or chart.low[k] > 1.1 * chart.high[lowest]:
            break
        if chart.deviation[k] < chart.deviation[lowest]:
            lowest = k
    return lowest


def slope_stretches(chart: AllanChart) -> list[tuple[str, float, float]]:
    """Stretches of at least three points whose slope is that of a known noise: name, first and last averaging time, s."""
    names = [_slope_name(slope) if degrees >= 3.0 else "" for slope, degrees in zip(local_slopes(chart), chart.degrees, strict=True)]
    stretches, start = [], 0
    for k in range(1, len(names) + 1):
        if k == len(names) or names[k] != names[start]:
            if names[start] and k - start >= 3:
                stretches.append((names[start], float(chart.tau_s[start]), float(chart.tau_s[k - 1])))
            start = k
    return stretches


def _slope_name(slope: float) -> str:
    nearest = min(SLOPE_NAMES, key=lambda known: abs(known - slope))
    return SLOPE_NAMES[nearest] if abs(nearest - slope) <= SLOPE_TOLERANCE else ""


def _classic(chart: AllanChart) -> np.ndarray:
    tau_s = chart.tau_s
    terms = np.column_stack([term(tau_s) for term in (model.quantisation, model.white, model.flicker, model.random_walk, model.ramp)])
    return np.sqrt(_weighted(chart, terms)[0])


def _filter_model(chart: AllanChart) -> tuple[float, float, float]:
    """White density, drift sigma and correlation time of the best white plus Gauss-Markov model; the last two 0 when not needed."""
    from scipy.optimize import minimize_scalar

    first = chart.tau_s[0]
    alone, cost_alone = _weighted(chart, model.white(chart.tau_s)[:, None])

    def solve(log_tau: float) -> tuple[np.ndarray, float]:
        terms = np.column_stack([model.white(chart.tau_s), model.gauss_markov(chart.tau_s, 1.0, np.exp(log_tau))])
        return _weighted(chart, terms)

    grid = np.log(np.geomspace(first, 3.0 * chart.duration_s, 40))
    best = int(np.argmin([solve(x)[1] for x in grid]))
    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    log_tau = float(minimize_scalar(lambda x: solve(x)[1], bounds=bounds, method="bounded").x)
    both, cost = solve(log_tau)
    if cost_alone - cost < DRIFT_EVIDENCE or both[1] == 0.0:
        return float(np.sqrt(alone[0])), 0.0, 0.0
    return float(np.sqrt(both[0])), float(np.sqrt(both[1])), float(np.exp(log_tau))


def _weighted(chart: AllanChart, terms: np.ndarray) -> tuple[np.ndarray, float]:
    """Non-negative coefficients of ``terms`` (k, m) and the weighted sum of squares.

    A variance with d degrees of freedom scatters by sqrt(2/d) of its expectation, so the weights follow the model, not the data;
    neighbouring points are correlated, which the evidence threshold allows for.
    """
    from scipy.optimize import nnls

    variance, expected = chart.deviation**2, chart.deviation**2
    for _ in range(4):
        weight = np.sqrt(0.5 * chart.degrees) / expected
        scale = np.linalg.norm(terms * weight[:, None], axis=0)
        coefficients = nnls(terms * (weight[:, None] / scale), variance * weight)[0] / scale
        expected = np.maximum(terms @ coefficients, 1e-3 * variance)
    cost = float(np.sum(((terms @ coefficients - variance) * weight) ** 2) * _independent(chart))
    return coefficients, cost


def _independent(chart: AllanChart) -> float:
    """Share of the points that carry information of their own: about four per decade."""
    decades = max(float(np.log10(chart.tau_s[-1] / chart.tau_s[0])), 0.25)
    return min(1.0, 4.0 * decades / len(chart.tau_s))
