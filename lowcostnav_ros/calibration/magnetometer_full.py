"""Free calibration: the simplest of hard iron, factors and cross terms that the field strength carries, outliers found and named.

The robust fit of :mod:`.magnetometer_known_strength` with priors so wide that data which show a parameter decide on it: factors lie within
0.8 and 1.25.  What the directions flown do not show is refused, with what is missing; cross terms alone may stay out, unless the data
contradict their absence.  What is not told from zero is left out, too: it would add its noise.  The sigmas stay those of the richer fit,
which does not pretend that what is left out is none.
A matrix that is not symmetric differs by a rotation, which no strength shows: it is a misalignment of the sensor.
"""

import math
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
_CLEARER, _CHANCE = 1.02, 16.0
"""Residual of a fit without some parameters over that with them, from which on the data contradict their absence: at least the first, and
beyond what chance makes of it (chi-square, three parameters, one in a thousand)."""
FACTORS = (0.8, 1.25)
"""No magnetometer's factors lie outside: a wrong strength or unit, or no ellipsoid."""
_SCALE_SIGMA, _CROSS_SIGMA, _USUAL_CROSS = 0.1, 0.1, 0.03
_SIGNIFICANT = 3.0
"""Sigmas from which on a parameter differs from zero."""


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
    fit = _without_outliers(measured, strength, _SCALE_SIGMA, _CROSS_SIGMA)
    plain = _without_outliers(measured, strength, _SCALE_SIGMA, 0.0)
    if weakness(fit):
        softer = _contradicted(plain, fit)
        modest = fit if softer else _without_outliers(measured, strength, _SCALE_SIGMA, _USUAL_CROSS)
        missing = weakness(fit) if softer else weakness(replace(modest, cross_sigma=np.zeros(3)))
        if missing:
            soft = "hold soft iron with cross terms and " if softer else ""
            remedy = "bank and pitch more in all headings, or use the fit with known field strength"
            raise CalibrationError(f"The samples {soft}do not show {missing}; {remedy}.")
        fit = _simpler(plain, modest)
    elif not _significant(fit.matrix[[1, 0, 0], [2, 2, 1]], fit.cross_sigma):
        fit = _simpler(plain, fit)
    if not np.any(fit.matrix[[1, 0, 0], [2, 2, 1]]) and not _significant(np.diag(fit.matrix) - 1.0, fit.scale_sigma):
        fit = _simpler(_without_outliers(measured, strength, 0.0, 0.0), fit)
    if fit.residual_rms > POOREST * strength:
        share = 100.0 * fit.residual_rms / strength
        raise CalibrationError(f"The samples lie on no ellipsoid: the residual is {share:.0f} % of the field; look for interference.")
    wide_coverage_of(fit.apply(measured), minimum_strip_deg)
    _check_factors(fit)
    return replace(fit, method="full")


def _significant(values: np.ndarray, sigmas: np.ndarray) -> bool:
    """Whether any of these differs from zero beyond its sigma."""
    return bool(np.any(np.abs(values) > _SIGNIFICANT * sigmas))


def _contradicted(simple: MagnetometerFit, rich: MagnetometerFit) -> bool:
    """Whether the data contradict the absence of what the simple fit leaves out."""
    return simple.residual_rms > max(_CLEARER, math.sqrt(1.0 + _CHANCE / rich.samples)) * rich.residual_rms


def _simpler(simple: MagnetometerFit, rich: MagnetometerFit) -> MagnetometerFit:
    """The fit with fewer parameters, at the sigmas of the one with more; that one where the data contradict it."""
    if _contradicted(simple, rich):
        return rich
    sigmas = {name: np.maximum(getattr(simple, name), getattr(rich, name)) for name in ("hard_iron_sigma", "scale_sigma", "cross_sigma")}
    return replace(simple, **sigmas)


def _check_factors(fit: MagnetometerFit) -> None:
    """Refuse a factor that no magnetometer has.

    Raises
    ------
    CalibrationError
    """
    for axis, value, sigma in zip("xyz", np.diag(fit.matrix), fit.scale_sigma, strict=True):
        if not 1.0 / FACTORS[1] - 3.0 * sigma <= value <= 1.0 / FACTORS[0] + 3.0 * sigma:
            limits = f"{FACTORS[0]} to {FACTORS[1]}"
            remedy = "check field strength and unit"
            raise CalibrationError(f"A factor of {1.0 / value:.2f} on {axis} is no magnetometer's ({limits}); {remedy}.")


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


def _without_outliers(measured: np.ndarray, strength: float, scale_sigma: float, cross_sigma: float) -> MagnetometerFit:
    low, high = np.percentile(measured, [2.0, 98.0], axis=0)
    centre = 0.5 * (low + high)
    prior = CalibrationPrior((float(centre[0]), float(centre[1]), float(centre[2])), 1.0, scale_sigma, cross_sigma)
    fit = known_strength_fit(measured, strength, prior)
    residual = np.abs(np.linalg.norm(fit.apply(measured), axis=1) - strength)
    noise = 1.4826 * float(np.median(residual))
    wrong = np.flatnonzero(residual > max(OUTLYING * noise, 1e-3 * strength))
    if len(wrong) > MOST_OUTLIERS * len(measured):
        raise CalibrationError(f"{len(wrong)} of {len(measured)} samples lie off the ellipsoid of the others; look for interference.")
    if len(wrong):
        fit = known_strength_fit(np.delete(measured, wrong, axis=0), strength, prior)
        rows = ", ".join(str(row + 1) for row in wrong[:SHOWN_ROWS]) + (", ..." if len(wrong) > SHOWN_ROWS else "")
        fit = replace(fit, warnings=(*fit.warnings, f"{len(wrong)} outliers excluded: samples {rows}."))
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
