"""Free calibration with soft iron: hard iron and a full symmetric matrix from the field strength alone, outliers found and named.

The robust fit of :mod:`.magnetometer_known_strength` with priors so wide that data which show a parameter decide on it.  What the
directions flown do not show is refused, with what is missing; cross terms alone may stay out, unless the data contradict their absence.
A matrix that is not symmetric differs by a rotation, which no strength shows: it is a misalignment of the sensor.
"""

from dataclasses import replace

import numpy as np

from lowcostnav_ros.calibration.magnetometer_fit import NARROW_DEG, MagnetometerFit, checked_samples, sphere_cells, wide_coverage_of
from lowcostnav_ros.calibration.magnetometer_known_strength import CalibrationPrior, known_strength_fit
from lowcostnav_ros.calibration.record import CalibrationError

OUTLYING = 6.0
"""Residual, in robust sigmas, beyond which a sample is left out."""
MOST_OUTLIERS = 0.1
KNOWN = 0.02
"""Largest sigma of hard iron (share of the field) and of the elements of the matrix: about a degree of heading."""
POOREST = 0.05
"""Largest residual, share of the field, of something that is still a calibration."""
SHOWN_ROWS = 8
_CLEARER = 1.2


def full_fit(measured: np.ndarray, strength: float, minimum_strip_deg: float = NARROW_DEG) -> MagnetometerFit:
    """Calibrate three axes with soft iron.

    Parameters
    ----------
    measured : ndarray, shape (n, 3)
        Measured field, body axes, any unit.
    strength : float
        True field strength in the same unit.
    minimum_strip_deg : float
        Refuse when the directions are a thinner strip than this, degrees.

    Raises
    ------
    CalibrationError
        When the data are unusable, do not lie on an ellipsoid, hold too many outliers, or do not show what is fitted.
    """
    measured, _ = checked_samples(measured, strength)
    fit = _without_outliers(measured, strength, 0.3)
    if weakness(fit):
        plain = _without_outliers(measured, strength, 0.0)
        softer = plain.residual_rms > _CLEARER * fit.residual_rms
        missing = weakness(fit if softer else plain)
        if missing:
            soft = "hold soft iron with cross terms and " if softer else ""
            remedy = "bank and pitch more in all headings, or use the fit with known field strength"
            raise CalibrationError(f"The samples {soft}do not show {missing}; {remedy}.")
        fit = plain
    if fit.residual_rms > POOREST * strength:
        share = 100.0 * fit.residual_rms / strength
        raise CalibrationError(f"The samples lie on no ellipsoid: the residual is {share:.0f} % of the field; look for interference.")
    wide_coverage_of(fit.apply(measured), minimum_strip_deg)
    return replace(fit, method="full", warnings=fit.warnings + _odd_strength(fit))


def weakness(fit: MagnetometerFit, limit: float = KNOWN) -> str:
    """Say what the data leave unknown beyond a share of the field or a factor, empty where they show all."""
    unknown = [
        f"the {what} of {axis} (+- {100.0 * share:.1f} % {of})"
        for what, of, shares in (
            ("hard iron", "of the field", fit.hard_iron_sigma / fit.strength),
            ("factor", "", fit.scale_sigma),
            ("cross term", "", fit.cross_sigma),
        )
        for axis, share in zip(("yz", "xz", "xy") if what == "cross term" else "xyz", shares, strict=True)
        if not share <= limit
    ]
    return " and ".join(unknown).replace(" )", ")")


def _without_outliers(measured: np.ndarray, strength: float, cross_sigma: float) -> MagnetometerFit:
    low, high = np.percentile(measured, [2.0, 98.0], axis=0)
    centre = 0.5 * (low + high)
    prior = CalibrationPrior((float(centre[0]), float(centre[1]), float(centre[2])), 1.0, 0.3, cross_sigma)
    fit = known_strength_fit(measured, strength, prior)
    residual = np.abs(np.linalg.norm(fit.apply(measured), axis=1) - strength)
    noise = 1.4826 * float(np.median(residual))
    wrong = np.flatnonzero(residual > max(OUTLYING * noise, 1e-3 * strength))
    if len(wrong) > MOST_OUTLIERS * len(measured):
        raise CalibrationError(f"{len(wrong)} of {len(measured)} samples lie off the ellipsoid of the others; look for interference.")
    if len(wrong):
        fit = known_strength_fit(np.delete(measured, wrong, axis=0), strength, prior)
        rows = ", ".join(str(row + 1) for row in wrong[:SHOWN_ROWS]) + (", ..." if len(wrong) > SHOWN_ROWS else "")
        fit = replace(fit, warnings=(*fit.warnings, f"{len(wrong)} outliers left out: samples {rows}."))
    grown = _growth(fit, np.delete(measured, wrong, axis=0))
    sigmas = {name: grown * getattr(fit, name) for name in ("hard_iron_sigma", "scale_sigma", "cross_sigma")}
    return replace(fit, **sigmas)


def _growth(fit: MagnetometerFit, measured: np.ndarray) -> float:
    """How much larger errors are than independent noise makes them: by the means of the residual in cells of direction."""
    field = fit.apply(measured)
    length = np.linalg.norm(field, axis=1)
    residual, cell = length - fit.strength, sphere_cells(field / length[:, None])
    _, place, count = np.unique(cell, return_inverse=True, return_counts=True)
    means = np.bincount(place, weights=residual) / count
    return max(1.0, float(np.sqrt(np.mean(count * means**2) / max(np.mean(residual**2), 1e-300))))


def _odd_strength(fit: MagnetometerFit) -> tuple[str, ...]:
    if np.all(np.abs(np.diag(fit.matrix) - 1.0) < 0.3):
        return ()
    return ("A factor far from 1 speaks for another field strength or unit than was given.",)
