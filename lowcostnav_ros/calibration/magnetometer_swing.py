"""Heading swing: the compass deviation as a truncated Fourier series of the heading.

Gebre-Egziabher (2004), section 3.11.1: ``error = A + B sin + C cos + D sin 2 + E cos 2`` of the true heading (equation 3.52), error =
measured minus true.  B and C depend on the horizontal field, so a swing holds for the region where it was made; tilt cannot be
handled at all.  It needs headings from elsewhere: a compass rose, or equal turns and one known heading at the end.

Navigators take the iron behind the curve rather than the curve (:func:`swing_calibration`): hard iron does not change with the region, and
what is known of the field is taken off before the field is levelled.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerFit, coverage_of
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.physics.rotation import wrap

FEWEST_HEADINGS = 5
WIDEST_GAP = math.radians(100.0)
"""Gap between neighbouring headings beyond which the second harmonic is guessed rather than seen."""
_CORRECTIONS = 20
_MOST_IRON = 0.9
"""Iron, as a share of the horizontal field, from which a compass does not come round with the aircraft."""


@dataclass(frozen=True, slots=True, eq=False)
class HeadingSwing:
    """A fitted deviation curve.

    Attributes
    ----------
    coefficients, sigma : ndarray, shape (5,)
        A, B, C, D, E and their standard deviations, rad; sigma is NaN for exactly five headings.
    residual_rms : float
        rad.
    condition : float
        Condition number of the least-squares problem.
    widest_gap : float
        Greatest gap between neighbouring headings, rad.
    headings : int
    """

    coefficients: np.ndarray
    sigma: np.ndarray
    residual_rms: float
    condition: float
    widest_gap: float
    headings: int

    def error(self, heading: np.ndarray) -> np.ndarray:
        """Heading error, measured minus true, rad, at a true heading."""
        return _rows(heading) @ self.coefficients

    def correct(self, measured: np.ndarray) -> np.ndarray:
        """True heading, rad in (-pi, pi], behind a measured one; iterated, because the curve is a function of the true heading."""
        measured = np.asarray(measured, dtype=float)
        heading = measured
        for _ in range(_CORRECTIONS):
            heading = measured - self.error(heading)
        return wrap(heading)


def swing_fit(heading: np.ndarray, measured: np.ndarray) -> HeadingSwing:
    """Fit the deviation curve to measured headings at known ones.

    Parameters
    ----------
    heading : ndarray, shape (n,), n >= 5
        True (or magnetic, then so is the result) headings from elsewhere, rad.
    measured : ndarray, shape (n,)
        Headings of the magnetometer there, rad.

    Raises
    ------
    CalibrationError
        For fewer than five headings, values not finite, or a gap of more than 100 degrees between neighbours.
    """
    heading, measured = _checked(heading, measured)
    gap = _widest_gap(heading)
    if gap > WIDEST_GAP:
        raise CalibrationError(f"The headings leave a gap of {math.degrees(gap):.0f} deg; swing all round in equal steps.")
    return _fit(heading, wrap(measured - heading), gap)


def coefficients_of(hard_iron: tuple[float, float], alpha: np.ndarray, horizontal: float) -> np.ndarray:
    """First-order coefficients A..E, rad, of known iron (equation 3.51 with its combinations of alpha corrected).

    Parameters
    ----------
    hard_iron : (float, float)
        Forward and right.
    alpha : ndarray, shape (2, 2)
        Effective soft-iron coefficients [[xx, xy], [yx, yy]].
    horizontal : float
        Horizontal field strength, unit of the hard iron.
    """
    (xx, xy), (yx, yy) = np.asarray(alpha, dtype=float)
    return np.array([0.5 * (xy - yx), -hard_iron[0] / horizontal, -hard_iron[1] / horizontal, 0.5 * (yy - xx), -0.5 * (xy + yx)])


def level_field(heading: np.ndarray, hard_iron: tuple[float, float], alpha: np.ndarray, horizontal: float) -> np.ndarray:
    """Measured level field (n, 2), forward and right, at magnetic headings (n,) (equations 3.43, 3.44 and 3.63)."""
    clean = horizontal * np.column_stack([np.cos(heading), -np.sin(heading)])
    return clean @ (np.eye(2) + np.asarray(alpha, dtype=float)).T + np.asarray(hard_iron)


def swing_calibration(heading: np.ndarray, measured: np.ndarray, horizontal: float) -> MagnetometerFit:
    """Level hard and soft iron whose headings are the measured ones: equation 3.51 without its first order, solved by Gauss-Newton.

    Headings show five numbers: hard iron forward and right, and soft iron but for a factor common to both axes, which is left at one.

    Parameters
    ----------
    heading, measured : ndarray, shape (n,), n >= 5
        As :func:`swing_fit`, magnetic headings.
    horizontal : float
        Horizontal field strength, in the unit that the calibration is to have.

    Returns
    -------
    MagnetometerFit
        ``residual_rms`` is that of the headings times ``horizontal``.

    Raises
    ------
    CalibrationError
        As :func:`swing_fit`; where the deviation is no level iron's, or the strength not positive.
    """
    if not (math.isfinite(horizontal) and horizontal > 0.0):
        raise CalibrationError(f"The horizontal field strength must be positive, got {horizontal:g}.")
    swing = swing_fit(heading, measured)
    heading, measured = np.asarray(heading, dtype=float), np.asarray(measured, dtype=float)
    a, b, c, d, e = swing.coefficients
    iron = np.array([-b, -c, -d, a - e, -a - e])
    for _ in range(_CORRECTIONS):
        x, y = level_field(heading, (iron[0], iron[1]), _alpha(iron), 1.0).T
        residual = wrap(measured - np.arctan2(-y, x))
        north, west = np.cos(heading), np.sin(heading)
        rows = np.column_stack([y, -x, y * north - x * west, -y * west, -x * north]) / (x * x + y * y)[:, None]
        step, _, rank, singular = np.linalg.lstsq(rows, residual, rcond=None)
        iron = iron + step
        if not np.all(np.abs(iron) < _MOST_IRON) or rank < len(iron):
            raise CalibrationError("These deviations are not those of iron in a level turn; check the headings.")
    spare = len(heading) - len(iron)
    scatter = math.sqrt(float(residual @ residual) / spare) if spare else math.nan
    sigma = scatter * np.linalg.norm(np.linalg.pinv(rows), axis=1)
    level = np.column_stack([np.cos(heading), -np.sin(heading), np.zeros(len(heading))])
    matrix = np.eye(3)
    matrix[:2, :2] = np.linalg.inv(np.eye(2) + _alpha(iron))
    return MagnetometerFit(
        "swing", np.append(iron[:2] * horizontal, 0.0), matrix, np.append(sigma[:2] * horizontal, np.nan),
        np.array([sigma[2], sigma[2], np.nan]), float(np.sqrt(np.mean(residual**2))) * horizontal, horizontal,
        float(singular[0] / singular[-1]), coverage_of(level), len(heading),
        ("z and a factor common to x and y were not calibrated: headings hold for level flight only.",),
        np.array([0.0, 0.0, math.hypot(sigma[3], sigma[4]) / 2.0]),
    )  # fmt: skip


def _alpha(iron: np.ndarray) -> np.ndarray:
    return np.array([[iron[2], iron[3]], [iron[4], -iron[2]]])


def _checked(heading: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    heading, measured = np.asarray(heading, dtype=float), np.asarray(measured, dtype=float)
    if heading.shape != measured.shape or heading.ndim != 1:
        raise CalibrationError(f"Give one measured heading for each known one, got {heading.shape} and {measured.shape}.")
    if len(heading) < FEWEST_HEADINGS:
        raise CalibrationError(f"A swing needs at least {FEWEST_HEADINGS} headings, got {len(heading)}.")
    if not (np.all(np.isfinite(heading)) and np.all(np.isfinite(measured))):
        raise CalibrationError("Some headings are not finite; remove them.")
    return heading, measured


def _fit(heading: np.ndarray, error: np.ndarray, gap: float) -> HeadingSwing:
    rows = _rows(heading)
    coefficients, _, _, singular = np.linalg.lstsq(rows, error, rcond=None)
    residual = error - rows @ coefficients
    spare = len(heading) - FEWEST_HEADINGS
    inverse = np.linalg.pinv(rows)
    scatter = math.sqrt(float(residual @ residual) / spare) if spare else math.nan
    sigma = scatter * np.linalg.norm(inverse, axis=1)
    rms = float(np.sqrt(np.mean(residual**2)))
    return HeadingSwing(coefficients, sigma, rms, float(singular[0] / singular[-1]), gap, len(heading))


def _rows(heading: np.ndarray) -> np.ndarray:
    heading = np.asarray(heading, dtype=float)
    return np.stack([np.ones_like(heading), np.sin(heading), np.cos(heading), np.sin(2 * heading), np.cos(2 * heading)], axis=-1)


def _widest_gap(heading: np.ndarray) -> float:
    around = np.sort(np.mod(heading, 2.0 * np.pi))
    return float(np.max(np.diff(np.append(around, around[0] + 2.0 * np.pi))))
