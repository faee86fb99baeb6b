"""Two-step estimator of hard iron and scale factors: linear least squares, then algebra; needs no first guess.

Gebre-Egziabher (2004), equations 3.69 to 3.81: the ellipsoid equation 3.65 is linear in products of the unknowns.  The data are
centred and scaled per axis first, which leaves the minimum where it is and takes the condition number from thousands to tens, and
solved by Householder QR.  Noise on the squared terms biases the scale factor of a weakly excited axis upwards.

The same algebra on two axes calibrates from one level turn (section 3.11.2).
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.calibration.least_squares import condition_number, solve_least_squares
from lowcostnav_ros.calibration.magnetometer_fit import NARROW_DEG, MagnetometerFit, checked_samples, coverage_of, wide_coverage_of
from lowcostnav_ros.calibration.record import CalibrationError


@kernel
def first_step_rows(measured):
    """Centre and scale the data and write the linear equations of the first step.

    Parameters
    ----------
    measured : ndarray, shape (n, d), d = 2 or 3

    Returns
    -------
    rows : ndarray, shape (n, 2 d)
        Unknowns: d_x, k_2, k_2 d_y, (k_3, k_3 d_z,) k_4 in scaled units.
    right : ndarray, shape (n,)
    centre, half : ndarray, shape (d,)
        ``u = (measured - centre)/half``.
    """
    n, d = measured.shape
    centre = np.empty(d)
    half = np.empty(d)
    for axis in range(d):
        low, high = measured[:, axis].min(), measured[:, axis].max()
        centre[axis] = 0.5 * (low + high)
        half[axis] = 0.5 * (high - low)
    rows = np.empty((n, 2 * d))
    right = np.empty(n)
    for i in range(n):
        u = (measured[i, 0] - centre[0]) / half[0]
        rows[i, 0] = -2.0 * u
        right[i] = -u * u
        for axis in range(1, d):
            u = (measured[i, axis] - centre[axis]) / half[axis]
            rows[i, 2 * axis - 1] = u * u
            rows[i, 2 * axis] = -2.0 * u
        rows[i, 2 * d - 1] = 1.0
    return rows, right, centre, half


@kernel
def second_step(x, strength, centre, half):
    """Turn the unknowns of the first step into hard iron and factors.

    Returns
    -------
    hard_iron, scale : ndarray, shape (d,)
        Unit of the data, and the factors 1 + s_f.
    real : bool
        False where the fitted surface is no ellipsoid (some k not positive): the arc was too small for the noise.
    """
    d = len(x) // 2
    hard_iron, scale = np.empty(d), np.empty(d)
    k1 = x[0] * x[0] - x[2 * d - 1]
    offset = x[0]
    real = True
    for axis in range(1, d):
        k1 += x[2 * axis] * x[2 * axis] / x[2 * axis - 1]
    for axis in range(d):
        k = 1.0
        if axis > 0:
            k = x[2 * axis - 1]
            offset = x[2 * axis] / k
        real = real and k > 0.0 and k1 > 0.0
        hard_iron[axis] = centre[axis] + half[axis] * offset
        scale[axis] = half[axis] * math.sqrt(abs(k1 / k)) / strength
    return hard_iron, scale, real


@kernel
def two_step(measured, strength):
    """Hard iron and factors of a cloud of samples, without any judgement: the kernel of Monte Carlo studies.

    Parameters
    ----------
    measured : ndarray, shape (n, d), d = 3, or 2 for a level turn
    strength : float
        Field strength, unit of the data (horizontal strength for a level turn).

    Returns
    -------
    hard_iron, scale : ndarray, shape (d,)
    real : bool
        See :func:`second_step`.
    """
    rows, right, centre, half = first_step_rows(measured)
    x = solve_least_squares(rows, right)[0]
    return second_step(x, strength, centre, half)


def two_step_fit(measured: np.ndarray, strength: float, minimum_strip_deg: float = NARROW_DEG) -> MagnetometerFit:
    """Calibrate three axes by the two-step estimator.

    Parameters
    ----------
    measured : ndarray, shape (n, 3)
        Measured field, body axes, any unit.
    strength : float
        True field strength in the same unit, one number; only ratios of scale factors can be found without it.
    minimum_strip_deg : float
        Refuse when the directions are a thinner strip than this, degrees.

    Raises
    ------
    CalibrationError
        When the data are unusable, the surface is no ellipsoid, or the coverage is too narrow.
    """
    measured, _ = checked_samples(measured, strength)
    rows, right, centre, half = first_step_rows(measured)
    x, upper, _ = solve_least_squares(rows.copy(), right.copy())
    hard_iron, scale, real = second_step(x, float(strength), centre, half)
    if not real or not np.all(np.isfinite(np.concatenate((hard_iron, scale)))):
        raise CalibrationError(
            "The samples do not lie on an ellipsoid: too little tilt for this noise; fly steeper turns or use the fit with known strength."
        )
    calibrated = (measured - hard_iron) / scale
    coverage = wide_coverage_of(calibrated, minimum_strip_deg)
    sigma = _sigmas(x, upper, rows, right, float(strength), centre, half)
    residual = np.linalg.norm(calibrated, axis=1) - strength
    return MagnetometerFit(
        "two-step", hard_iron, np.diag(1.0 / scale), sigma[:3], sigma[3:] / scale, _rms(residual), float(strength),
        condition_number(upper), coverage, len(measured), _warnings(sigma[3:] / scale, coverage.swept_deg),
    )  # fmt: skip


def level_turn_fit(measured: np.ndarray, horizontal: float, minimum_swept_deg: float = 270.0) -> MagnetometerFit:
    """Calibrate x and y from one level turn through 360 degrees (section 3.11.2); z is left as it is.

    Parameters
    ----------
    measured : ndarray, shape (n, 2) or (n, 3)
        Measured field, wings level throughout.
    horizontal : float
        True horizontal field strength in the same unit.
    minimum_swept_deg : float
        Refuse when less than this much of the turn was seen, degrees.

    Raises
    ------
    CalibrationError
        When the data are unusable, the locus is no ellipse, or too little of the turn was flown.
    """
    measured, _ = checked_samples(measured, horizontal, axes=2)
    rows, right, centre, half = first_step_rows(measured)
    x, upper, _ = solve_least_squares(rows.copy(), right.copy())
    hard_iron, scale, real = second_step(x, float(horizontal), centre, half)
    if not real or not np.all(np.isfinite(np.concatenate((hard_iron, scale)))):
        raise CalibrationError("The samples do not lie on an ellipse; fly a whole level turn and give only its samples.")
    calibrated = (measured - hard_iron) / scale
    coverage = coverage_of(np.column_stack([calibrated, np.zeros(len(calibrated))]))
    if coverage.swept_deg < minimum_swept_deg:
        raise CalibrationError(f"Only {coverage.swept_deg:.0f} deg of the level turn were seen; give at least {minimum_swept_deg:.0f} deg.")
    sigma = _sigmas(x, upper, rows, right, float(horizontal), centre, half)
    residual = np.linalg.norm(calibrated, axis=1) - horizontal
    return MagnetometerFit(
        "level-turn", np.append(hard_iron, 0.0), np.diag(np.append(1.0 / scale, 1.0)), np.append(sigma[:2], np.nan),
        np.append(sigma[2:] / scale, np.nan), _rms(residual), float(horizontal), condition_number(upper), coverage, len(measured),
        ("z was not calibrated: headings hold for level flight only.",),
    )  # fmt: skip


def _sigmas(
    x: np.ndarray, upper: np.ndarray, rows: np.ndarray, right: np.ndarray, strength: float, centre: np.ndarray, half: np.ndarray
) -> np.ndarray:
    """Standard deviations of hard iron then factors, shape (2 d,).

    The residuals of the squared equation are larger where the field is, so their actual squares weight the covariance (White 1980).
    """
    inverse = np.linalg.inv(upper)
    whitened = (rows @ inverse) * (right - rows @ x)[:, None]
    covariance = inverse @ (whitened.T @ whitened) @ inverse.T
    jacobian = np.empty((len(x), len(x)))
    for k in range(len(x)):
        step = 1e-6 * max(1e-3, abs(x[k]))
        ahead, behind = x.copy(), x.copy()
        ahead[k] += step
        behind[k] -= step
        difference = [np.concatenate(second_step(side, strength, centre, half)[:2]) for side in (ahead, behind)]
        jacobian[:, k] = (difference[0] - difference[1]) / (2.0 * step)
    return np.sqrt(np.diag(jacobian @ covariance @ jacobian.T))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _warnings(relative_scale_sigma: np.ndarray, swept_deg: float) -> tuple[str, ...]:
    found = [
        f"The scale factor of {axis} is known to {100.0 * sigma:.1f} % only; tilt more about the other axes."
        for axis, sigma in zip("xyz", relative_scale_sigma, strict=True)
        if sigma > 0.02
    ]
    if swept_deg < 270.0:
        found.append(f"Only {swept_deg:.0f} deg of headings were seen; turn through all of them.")
    return tuple(found)
