"""Warm-up transient of a bias and temperature slope of a scale factor (Gebre-Egziabher 2004, section 3.3.1).

The vibrating gyro of the source settles about three hours after power-up, and its scale factor changes by less than 2.6 % between
0 and 60 degrees Celsius.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.calibration.record import CalibrationError, checked_record


@dataclass(frozen=True, slots=True)
class WarmUp:
    """Bias ``settled + transient exp(-t/tau)`` after power-up, unit of the sensor; t in s."""

    settled: float
    transient: float
    tau_s: float

    def at(self, t_s: np.ndarray) -> np.ndarray:
        """Bias ``t_s`` seconds after power-up."""
        return self.settled + self.transient * np.exp(-np.asarray(t_s, dtype=float) / self.tau_s)


def fit_warm_up(t_s: np.ndarray, bias: np.ndarray) -> WarmUp:
    """Fit a warm-up transient to averages of a sensor at rest by least squares.

    For each time constant the other two are linear, so one number is searched.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
        Time since power-up, s, increasing.
    bias : ndarray, shape (n,)
        Average output at those times.

    Raises
    ------
    CalibrationError
        When the data are unusable, or no transient ends within the record.
    """
    from scipy.optimize import minimize_scalar

    t_s = np.asarray(t_s, dtype=float)
    span_s = float(np.ptp(t_s)) if len(t_s) else 0.0
    bias = checked_record(bias, max(len(bias), 1) / span_s if span_s > 0.0 else 1.0, "the warm-up record")

    def solve(log_tau: float) -> tuple[np.ndarray, float]:
        columns = np.column_stack([np.ones(len(t_s)), np.exp(-t_s / math.exp(log_tau))])
        coefficients = np.linalg.lstsq(columns, bias, rcond=None)[0]
        return coefficients, float(np.sum((columns @ coefficients - bias) ** 2))

    grid = np.log(np.geomspace(span_s / 200.0, span_s, 40))
    best = int(np.argmin([solve(x)[1] for x in grid]))
    if best in (0, len(grid) - 1):
        raise CalibrationError("No warm-up transient ends within the record; record from power-up until the output has settled.")
    log_tau = float(minimize_scalar(lambda x: solve(x)[1], bounds=(grid[best - 1], grid[best + 1]), method="bounded").x)
    settled, transient = solve(log_tau)[0]
    return WarmUp(float(settled), float(transient), math.exp(log_tau))


@dataclass(frozen=True, slots=True)
class ScaleFactorSlope:
    """Scale factor ``1 + slope (T - reference)``; ``slope`` per kelvin, temperatures in degrees Celsius."""

    slope_per_k: float
    slope_sigma_per_k: float
    reference_c: float

    def change(self, low_c: float, high_c: float) -> float:
        """Change of the scale factor between two temperatures, dimensionless."""
        return self.slope_per_k * (high_c - low_c)

    def at(self, temperature_c: np.ndarray) -> np.ndarray:
        """Scale factor at a temperature."""
        return 1.0 + self.slope_per_k * (np.asarray(temperature_c, dtype=float) - self.reference_c)


def fit_scale_factor(temperature_c: np.ndarray, output: np.ndarray, true_input: float) -> ScaleFactorSlope:
    """Fit the temperature slope of a scale factor from rate-table runs at one rate, bias removed.

    Parameters
    ----------
    temperature_c : ndarray, shape (n,)
        Temperature of each run, degrees Celsius.
    output : ndarray, shape (n,)
        Mean output of each run.
    true_input : float
        The rate of the table, unit of ``output``, not zero.

    Raises
    ------
    CalibrationError
        For a zero input, fewer than three runs or one temperature only.
    """
    temperature_c, output = np.asarray(temperature_c, dtype=float), np.asarray(output, dtype=float)
    if true_input == 0.0 or len(output) < 3 or np.ptp(temperature_c) == 0.0:
        raise CalibrationError("A scale factor slope needs a rate that is not zero and at least three runs at different temperatures.")
    reference = float(temperature_c.mean())
    centred = temperature_c - reference
    ratio = output / true_input
    slope = float(centred @ (ratio - ratio.mean()) / (centred @ centred))
    residual = ratio - ratio.mean() - slope * centred
    sigma = math.sqrt(float(residual @ residual) / (len(ratio) - 2) / float(centred @ centred))
    return ScaleFactorSlope(slope / float(ratio.mean()), sigma, reference)
