"""Iterated linearised batch least squares for hard iron and scale factors: precise near the truth, lost far from it.

Gebre-Egziabher (2004), equations 3.66 to 3.68.  Undamped, as in the source, so that its divergence can be studied; for work use
the two-step estimator, or start from it.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.calibration.least_squares import condition_number, solve_least_squares
from lowcostnav_ros.calibration.magnetometer_fit import NARROW_DEG, MagnetometerFit, checked_samples, wide_coverage_of
from lowcostnav_ros.calibration.record import CalibrationError

MOST_ITERATIONS = 60
LOST = 1e6
"""Step, in field strengths, after which no iteration has been seen to return."""


@kernel
def batch_rows(measured, strengths, hard_iron, scale):
    """Rows [-e/(s^2 R), -e^2/(s^3 R)], e = measured - hard iron, and right side (true minus computed strength) at a guess."""
    n = measured.shape[0]
    rows = np.empty((n, 6))
    right = np.empty(n)
    for i in range(n):
        squares = 0.0
        for axis in range(3):
            squares += ((measured[i, axis] - hard_iron[axis]) / scale[axis]) ** 2
        computed = math.sqrt(squares)
        right[i] = strengths[i] - computed
        for axis in range(3):
            e = measured[i, axis] - hard_iron[axis]
            rows[i, axis] = -e / (scale[axis] ** 2 * computed)
            rows[i, 3 + axis] = -e * e / (scale[axis] ** 3 * computed)
    return rows, right


@kernel
def linearised_batch(measured, strengths, hard_iron, scale, most_iterations):
    """Iterate undamped Gauss-Newton steps from a guess.

    Parameters
    ----------
    measured : ndarray, shape (n, 3)
    strengths : ndarray, shape (n,)
    hard_iron, scale : ndarray, shape (3,)
        First guess.
    most_iterations : int

    Returns
    -------
    hard_iron, scale : ndarray, shape (3,)
        Huge or not finite after a breakdown.
    iterations : int
        Steps taken; ``most_iterations`` where the steps never became small.
    """
    hard_iron, scale = hard_iron.copy(), scale.copy()
    for iteration in range(most_iterations):
        rows, right = batch_rows(measured, strengths, hard_iron, scale)
        step = solve_least_squares(rows, right)[0]
        hard_iron += step[:3]
        scale += step[3:]
        size = np.abs(step[:3]).max() / strengths[0] + np.abs(step[3:]).max()
        if not size < LOST:  # also where it is not finite
            return hard_iron, scale, most_iterations
        if size < 1e-9:
            return hard_iron, scale, iteration + 1
    return hard_iron, scale, most_iterations


def batch_fit(
    measured: np.ndarray,
    strength: float | np.ndarray,
    hard_iron: np.ndarray | None = None,
    scale: np.ndarray | None = None,
    minimum_strip_deg: float = NARROW_DEG,
) -> MagnetometerFit:
    """Calibrate three axes by iterated batch least squares.

    Parameters
    ----------
    measured : ndarray, shape (n, 3)
        Measured field, body axes, any unit.
    strength : float or ndarray, shape (n,)
        True field strength in the same unit.
    hard_iron, scale : ndarray, shape (3,), optional
        First guess: centre of the cloud, and the factors 1 + s_f; by default the middle of the cloud and its half extents over the
        strength.
    minimum_strip_deg : float
        Refuse when the directions are a thinner strip than this, degrees.

    Raises
    ------
    CalibrationError
        When the data are unusable, the iteration does not converge, or the coverage is too narrow.
    """
    measured, strengths = checked_samples(measured, strength)
    low, high = measured.min(axis=0), measured.max(axis=0)
    hard_iron = 0.5 * (low + high) if hard_iron is None else np.asarray(hard_iron, dtype=float)
    scale = np.maximum(0.5 * (high - low) / strengths.mean(), 0.1) if scale is None else np.asarray(scale, dtype=float)
    hard_iron, scale, iterations = linearised_batch(measured, strengths, hard_iron, scale, MOST_ITERATIONS)
    if iterations == MOST_ITERATIONS or np.any(scale == 0.0):
        raise CalibrationError(f"The batch fit did not converge in {MOST_ITERATIONS} steps; use the two-step fit or give a better guess.")
    scale = np.abs(scale)  # the equation holds squares only
    calibrated = (measured - hard_iron) / scale
    coverage = wide_coverage_of(calibrated, minimum_strip_deg)
    rows, right = batch_rows(measured, strengths, hard_iron, scale)
    residual_rms = float(np.sqrt(np.mean(right**2)))
    upper = solve_least_squares(rows, right)[1]
    inverse = np.linalg.inv(upper)
    sigma = residual_rms * np.linalg.norm(inverse, axis=1)
    return MagnetometerFit(
        "batch", hard_iron, np.diag(1.0 / scale), sigma[:3], sigma[3:] / scale, residual_rms, float(strengths.mean()),
        condition_number(upper), coverage, len(measured),
    )  # fmt: skip
