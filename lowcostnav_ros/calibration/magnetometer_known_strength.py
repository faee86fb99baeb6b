"""Calibration from partial coverage: field strength known from the magnetic model, and a prior on what the data do not show.

Minimises the robust misfit of |M (measured - hard iron)| to the known strength, M symmetric, plus a prior on every parameter.  The
misfit is divided by its own sensitivity to the measured field (the distance of Sampson 1982): a plain misfit shrinks with M, and
thousands of noisy samples would shrink M against any prior.  Where
an aircraft never banked enough for a free fit, the prior holds the weak directions near "no error" and the posterior sigma shows
so; the strong directions are calibrated all the same.  Outliers (a hangar, a towing truck) are weighted down after Huber.

Solved for M and M hard_iron: after a level turn the data fix M_zz B_z - (M hard_iron)_z, a straight valley in these unknowns and a
curved one in the hard iron itself.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.calibration.least_squares import condition_number
from lowcostnav_ros.calibration.magnetometer_fit import NARROW_DEG, MagnetometerFit, checked_samples, coverage_of
from lowcostnav_ros.calibration.record import CalibrationError

MOST_ITERATIONS = 200
ROUNDS = 4
SETTLED = 1e-3
"""Length of a step, in posterior sigmas, that ends the iteration."""
HUBER = 1.5
"""Residual, in sigmas, beyond which a sample counts less."""
LEARNT = 0.5
"""Share of the prior sigma below which a parameter counts as determined by the data."""
_STEP = 1e-6
_SYMMETRIC = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, slots=True)
class CalibrationPrior:
    """What is assumed before the flight, one sigma.

    Attributes
    ----------
    hard_iron : tuple of float
        Expected centre, unit of the data, x y z.
    hard_iron_share : float
        Sigma of each component of the centre as a share of the field strength.
    scale_sigma : float
        Sigma of each diagonal element of the matrix about 1.
    cross_sigma : float
        Sigma of each off-diagonal element about 0; 0 leaves soft iron and misalignment out.
    """

    hard_iron: tuple[float, float, float] = (0.0, 0.0, 0.0)
    hard_iron_share: float = 0.5
    scale_sigma: float = 0.05
    cross_sigma: float = 0.0


def known_strength_fit(measured: np.ndarray, strength: float | np.ndarray, prior: CalibrationPrior | None = None) -> MagnetometerFit:
    """Calibrate three axes with the field strength known and a prior.

    Parameters
    ----------
    measured : ndarray, shape (n, 3)
        Measured field, body axes, any unit.
    strength : float or ndarray, shape (n,)
        True field strength in the same unit, for each sample where the place changes.
    prior : CalibrationPrior, optional

    Raises
    ------
    CalibrationError
        When the data are unusable, do not span 15 degrees, the iteration does not settle, or the data determine fewer than two
        components of the hard iron.
    """
    prior = prior or CalibrationPrior()
    measured, strengths = checked_samples(measured, strength)
    unit = float(strengths.mean())
    problem = _Problem(measured / unit, strengths / unit, prior, np.array(prior.hard_iron) / unit)
    parameters = problem.solve()
    shift, matrix = _unpack(parameters)
    hard_iron = np.linalg.solve(matrix, shift)
    calibrated = measured / unit @ matrix - shift
    coverage = coverage_of(calibrated)
    sigma, condition, residual_rms = problem.quality(parameters)
    learnt = sigma[:3] < LEARNT * prior.hard_iron_share
    if coverage.span_deg < NARROW_DEG or np.count_nonzero(learnt) < 2:
        raise CalibrationError(
            f"The samples span {coverage.span_deg:.0f} deg and determine {np.count_nonzero(learnt)} component(s) of the hard iron; "
            "turn through all headings with some bank."
        )
    return MagnetometerFit(
        "known-strength", hard_iron * unit, matrix, sigma[:3] * unit, sigma[3:6], residual_rms * unit, unit, condition, coverage,
        len(measured), _warnings(learnt, sigma, prior), sigma[[8, 7, 6]],
    )  # fmt: skip


class _Problem:
    """Residuals and derivatives in units of the field strength.

    Parameters are the shift M hard_iron (3), then the symmetric matrix M (6); the field is M measured - shift.
    """

    def __init__(self, measured: np.ndarray, strengths: np.ndarray, prior: CalibrationPrior, centre: np.ndarray) -> None:
        self.measured, self.strengths = measured, strengths
        self.mean = np.concatenate((centre, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))
        self.sigma = np.array([prior.hard_iron_share] * 3 + [prior.scale_sigma] * 3 + [prior.cross_sigma] * 3)
        self.free = np.flatnonzero(self.sigma > 0.0)

    def solve(self) -> np.ndarray:
        """Gauss-Newton steps with Huber weights, halved while they do not improve; the noise level is renewed between rounds."""
        parameters = self.mean.copy()
        for _ in range(ROUNDS):
            parameters, settled = self._minimum(parameters, self._noise(parameters))
        if not settled:
            raise CalibrationError("The fit with known strength did not settle; check the field strength and its unit, or the samples.")
        return parameters

    def _minimum(self, parameters: np.ndarray, noise: float) -> tuple[np.ndarray, bool]:
        for _ in range(MOST_ITERATIONS):
            rows, right = self._system(parameters, noise)
            step = np.linalg.lstsq(rows, right, rcond=None)[0]
            parameters = self._shortened(parameters, step, noise)
            if np.linalg.norm(rows @ step) < SETTLED:
                return parameters, True
        return parameters, False

    def quality(self, parameters: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Posterior sigma of hard iron and matrix (9,), condition number of the data alone, root mean square of the residuals."""
        noise = self._noise(parameters)
        rows, _ = self._system(parameters, noise)
        inverse = np.zeros((9, len(self.free)))
        inverse[self.free] = np.linalg.inv(np.linalg.qr(rows, mode="r"))
        inverse[:3] = self._of_hard_iron(parameters) @ inverse
        sigma = np.linalg.norm(inverse, axis=1)
        data_only: Any = np.linalg.qr(rows[: len(self.measured)], mode="r")
        residual = self._residual(parameters)
        return sigma, condition_number(data_only), float(np.sqrt(np.mean(residual**2)))

    def _of_hard_iron(self, parameters: np.ndarray) -> np.ndarray:
        """Derivative of the hard iron, M^-1 shift, by all parameters, shape (3, 9)."""
        shift, matrix = _unpack(parameters)
        inverse = np.linalg.inv(matrix)
        hard_iron = inverse @ shift
        rows = np.zeros((3, 9))
        rows[:, :3] = inverse
        for k, (i, j) in enumerate(_SYMMETRIC):
            change = np.zeros(3)
            change[i] += hard_iron[j]
            if i != j:
                change[j] += hard_iron[i]
            rows[:, 3 + k] = -inverse @ change
        return rows

    def _residual(self, parameters: np.ndarray) -> np.ndarray:
        """Distance of each sample from the surface, to first order, in units of the measured field over the strength."""
        shift, matrix = _unpack(parameters)
        field = self.measured @ matrix - shift
        length = np.maximum(np.linalg.norm(field, axis=1, keepdims=True), 1e-12)
        sensitivity = np.linalg.norm(field / length @ matrix, axis=1)
        return (self.strengths - length[:, 0]) / sensitivity

    def _noise(self, parameters: np.ndarray) -> float:
        residual = self._residual(parameters)
        return max(1.4826 * float(np.median(np.abs(residual))), 1e-5)

    def _cost(self, parameters: np.ndarray, noise: float) -> float:
        scaled = np.abs(self._residual(parameters)) / noise
        huber = np.where(scaled <= HUBER, 0.5 * scaled**2, HUBER * scaled - 0.5 * HUBER**2)
        departure = (parameters - self.mean)[self.free] / self.sigma[self.free]
        return float(huber.sum() + 0.5 * departure @ departure)

    def _shortened(self, parameters: np.ndarray, step: np.ndarray, noise: float) -> np.ndarray:
        cost, share = self._cost(parameters, noise), 1.0
        for _ in range(12):
            trial = parameters.copy()
            trial[self.free] += share * step
            if self._cost(trial, noise) <= cost:
                return trial
            share *= 0.5
        return parameters

    def _system(self, parameters: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
        """Weighted rows and right side of one step, prior included; derivatives by central differences."""
        residual = self._residual(parameters)
        columns = np.empty((len(residual), len(self.free)))
        for column, k in enumerate(self.free):
            ahead, behind = parameters.copy(), parameters.copy()
            ahead[k] += _STEP
            behind[k] -= _STEP
            columns[:, column] = (self._residual(behind) - self._residual(ahead)) / (2.0 * _STEP)
        weight = np.sqrt(np.minimum(1.0, HUBER * noise / np.maximum(np.abs(residual), 1e-300))) / noise
        prior_rows = np.diag(1.0 / self.sigma[self.free])
        prior_right = (self.mean - parameters)[self.free] / self.sigma[self.free]
        return np.vstack((columns * weight[:, None], prior_rows)), np.concatenate((residual * weight, prior_right))


def _unpack(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    matrix = np.empty((3, 3))
    for value, (i, j) in zip(parameters[3:], _SYMMETRIC, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return parameters[:3], matrix


def _warnings(learnt: np.ndarray, sigma: np.ndarray, prior: CalibrationPrior) -> tuple[str, ...]:
    found = [f"The hard iron of {axis} is mostly the prior, not the data." for axis, known in zip("xyz", learnt, strict=True) if not known]
    weak = [axis for axis, s in zip("xyz", sigma[3:6], strict=True) if s > LEARNT * prior.scale_sigma]
    if weak and math.isfinite(prior.scale_sigma):
        found.append(f"The scale factor of {' and '.join(weak)} is mostly the prior, not the data.")
    return tuple(found)
