"""What every magnetometer calibration returns, how much of the sphere it saw, and when it must refuse.

The correction is ``field = matrix @ (measured - hard_iron)``: in the error model ``measured = C (field + hard iron)`` of
Gebre-Egziabher (2004), equation 3.28, the thesis's hard iron is scaled by C; here, as in its equation 3.65, it is the centre of
the measured cloud.  Fields are in the unit of the data throughout; the result is stored in microtesla.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.base.units import GAUSS
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.physics.mounting import MOUNTING, check_mounting, mounting_dcm

FEWEST_SAMPLES = 50
NARROW_DEG = 15.0
"""Coverage below which a free fit is refused unless the caller lowers the bar."""
TESLA_PER = {"T": 1.0, "G": GAUSS, "mG": 1e-3 * GAUSS, "uT": 1e-6, "nT": 1e-9}
"""Size in tesla of the units that magnetometers are logged in."""
_TYPICAL_T = 50e-6
_SECTORS, _BANDS = 24, 12


@dataclass(frozen=True, slots=True)
class Coverage:
    """Which directions of the field, seen from the body, the samples hold.

    Attributes
    ----------
    span_deg : float
        Greatest angle between two directions.
    strip_deg : float
        Thickness of the directions across the plane they are closest to: 0 for a level turn, 180 for the whole sphere.
    swept_deg : float
        Azimuth about the normal of that plane, in sectors of 15 degrees.
    sphere_percent : float
        Share of equal cells of the sphere that hold a sample.
    """

    span_deg: float
    strip_deg: float
    swept_deg: float
    sphere_percent: float

    def __str__(self) -> str:
        return (
            f"{self.swept_deg:.0f} deg of turn, {self.strip_deg:.0f} deg of tilt across it, "
            f"{self.span_deg:.0f} deg end to end, {self.sphere_percent:.0f} % of the sphere"
        )


@dataclass(frozen=True, slots=True, eq=False)
class MagnetometerFit:
    """A magnetometer calibration, in the unit of the data it was made from.

    Attributes
    ----------
    method : str
    hard_iron : ndarray, shape (3,)
        Centre of the measured cloud, body axes.
    matrix : ndarray, shape (3, 3)
        Takes ``measured - hard_iron`` to the field; diag(1/(1 + s_f)) where only scale factors were fitted.
    hard_iron_sigma, scale_sigma : ndarray, shape (3,)
        Standard deviations; the second is relative, of the diagonal.
    residual_rms : float
        Root mean square of calibrated strength minus expected strength.
    strength : float
        Expected field strength (its mean where it varies); the horizontal one for a level turn.
    condition : float
        Condition number of the (column-scaled) least-squares problem.
    coverage : Coverage
    samples : int
    warnings : tuple of str
        Sentences a user should read before trusting the numbers.
    cross_sigma : ndarray, shape (3,)
        Standard deviations of the elements off the diagonal, yz, xz, xy; zero where these were not fitted.
    """

    method: str
    hard_iron: np.ndarray
    matrix: np.ndarray
    hard_iron_sigma: np.ndarray
    scale_sigma: np.ndarray
    residual_rms: float
    strength: float
    condition: float
    coverage: Coverage
    samples: int
    warnings: tuple[str, ...] = ()
    cross_sigma: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def apply(self, measured: np.ndarray) -> np.ndarray:
        """Calibrate samples (n, 3) or (3,), unit of the data."""
        return (np.asarray(measured, dtype=float) - self.hard_iron) @ self.matrix.T

    @property
    def scale(self) -> np.ndarray:
        """The factors 1 + s_f, shape (3,), of a diagonal fit."""
        return 1.0 / np.diag(self.matrix)


@dataclass(frozen=True)
class MagnetometerCalibration:
    """Calibration of one magnetometer as its YAML file declares it; the defaults change nothing."""

    hard_iron_ut: list = setting([0.0] * 3, "Centre of the measured cloud, x y z, body axes.", unit="uT", minimum=-1e4, maximum=1e4)
    matrix: list = setting([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], "3x3 by rows, after the hard iron.", minimum=-10.0, maximum=10.0)
    mounting_deg: list = MOUNTING

    def __post_init__(self) -> None:
        for name, count in (("hard_iron_ut", 3), ("matrix", 9)):
            if len(getattr(self, name)) != count:
                raise SettingsError(f"Magnetometer calibration: '{name}' needs {count} numbers, got {len(getattr(self, name))}.")
        check_mounting(self.mounting_deg, "magnetometer.mounting_deg")

    def apply(self, measured_t: np.ndarray) -> np.ndarray:
        """Calibrated field, tesla, body axes, of measured samples (n, 3) or (3,), tesla, axes of the sensor."""
        offset, turn = np.array(self.hard_iron_ut) * 1e-6, mounting_dcm(self.mounting_deg)
        field = (np.asarray(measured_t, dtype=float) - offset) @ np.reshape(self.matrix, (3, 3)).T
        return field if turn is None else field @ turn.T


def calibration_of(fit: MagnetometerFit, unit: str) -> MagnetometerCalibration:
    """Turn a fit made in ``unit`` into the settings a node loads."""
    hard_iron_ut = fit.hard_iron * TESLA_PER[unit] * 1e6
    return MagnetometerCalibration([round(float(v), 6) for v in hard_iron_ut], [round(float(v), 9) for v in fit.matrix.ravel()])


def unit_by_magnitude(samples: np.ndarray) -> str:
    """Name the unit whose earth field is nearest to the samples: T, G, mG, uT or nT.

    Raises
    ------
    CalibrationError
        When the strength is not within a factor of three of the earth's field in any unit.
    """
    strength = float(np.median(np.linalg.norm(np.asarray(samples, dtype=float), axis=1)))
    for unit, tesla in TESLA_PER.items():
        if strength > 0.0 and abs(math.log(strength * tesla / _TYPICAL_T)) <= math.log(10.0) / 2.0:
            return unit
    raise CalibrationError(
        f"A field of {strength:.3g} is not the earth's in any of {', '.join(TESLA_PER)}; name the unit, or check the columns."
    )


def checked_samples(measured: np.ndarray, strength: float | np.ndarray, axes: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Return samples (n, axes) and strengths (n,) as float64, or refuse them.

    Raises
    ------
    CalibrationError
        For a wrong shape, too few samples, values not finite, an axis that never changes, or a strength that is not positive.
    """
    measured = np.asarray(measured, dtype=float)
    if measured.ndim != 2 or measured.shape[1] < axes:
        raise CalibrationError(f"Give the field as rows of {axes} components, got an array of shape {measured.shape}.")
    if len(measured) < FEWEST_SAMPLES:
        raise CalibrationError(f"There are {len(measured)} samples of the field; collect at least {FEWEST_SAMPLES} in different attitudes.")
    measured = measured[:, :axes]
    if not np.all(np.isfinite(measured)):
        raise CalibrationError("Some samples of the field are not finite; remove those rows.")
    frozen = [axis for axis, spread in zip("xyz", np.ptp(measured, axis=0), strict=False) if spread == 0.0]
    if frozen:
        raise CalibrationError(f"The field on {' and '.join(frozen)} never changes; turn the aircraft, or check that the sensor is alive.")
    strengths = np.broadcast_to(np.asarray(strength, dtype=float), (len(measured),)).copy()
    if not np.all(np.isfinite(strengths)) or np.any(strengths <= 0.0):
        raise CalibrationError("The field strength must be positive; take it from the magnetic model at the place of the flight.")
    return measured, strengths


def coverage_of(directions: np.ndarray) -> Coverage:
    """Coverage of field directions seen from the body.

    Parameters
    ----------
    directions : ndarray, shape (n, 3)
        Calibrated (or expected) fields, any length, body axes.
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    normal = np.linalg.eigh(np.cov(unit.T))[1][:, 0]
    across = np.degrees(np.arcsin(np.clip(unit @ normal, -1.0, 1.0)))
    low, high = np.percentile(across, [0.5, 99.5])
    ahead = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.7 else [0.0, 1.0, 0.0])
    ahead /= np.linalg.norm(ahead)
    azimuth = np.arctan2(unit @ np.cross(normal, ahead), unit @ ahead)
    sectors = len(np.unique(np.floor(azimuth / (2.0 * np.pi) * _SECTORS)))
    return Coverage(_span_deg(unit), float(high - low), sectors * 360.0 / _SECTORS, _sphere_percent(unit))


def _span_deg(unit: np.ndarray) -> float:
    """Greatest angle between two directions, found by hopping to the farthest one from each extreme of the axes."""
    least = 1.0
    for start in {*np.argmin(unit, axis=0), *np.argmax(unit, axis=0)}:
        for _ in range(3):
            cosines = unit @ unit[start]
            start = int(np.argmin(cosines))
            least = min(least, float(cosines[start]))
    return math.degrees(math.acos(max(-1.0, least)))


def sphere_cells(unit: np.ndarray) -> np.ndarray:
    """Number of the cell, of equal size, in which each direction (n, 3) lies."""
    band = np.minimum(((unit[:, 2] + 1.0) * 0.5 * _BANDS).astype(int), _BANDS - 1)
    sector = ((np.arctan2(unit[:, 1], unit[:, 0]) / (2.0 * np.pi) + 0.5) * _SECTORS).astype(int) % _SECTORS
    cell: np.ndarray = band * _SECTORS + sector
    return cell


def _sphere_percent(unit: np.ndarray) -> float:
    return 100.0 * len(np.unique(sphere_cells(unit))) / (_BANDS * _SECTORS)


def wide_coverage_of(directions: np.ndarray, minimum_strip_deg: float) -> Coverage:
    """Coverage of the sphere by directions, body axes (n, 3), for a fit that needs tilt.

    Raises
    ------
    CalibrationError
        When the directions are a thinner strip than ``minimum_strip_deg``, degrees.
    """
    coverage = coverage_of(directions)
    if coverage.strip_deg < minimum_strip_deg:
        raise CalibrationError(
            f"The attitudes cover only {coverage.strip_deg:.0f} deg across the turn (under {minimum_strip_deg:.0f} deg); "
            "bank and pitch more, or use the fit with known field strength."
        )
    return coverage
