"""Snapshot RAIM: detect and exclude one faulty satellite, and bound the position error of a fault that goes undetected.

Detection: the weighted sum of squared residuals against chi-square with n - m degrees of freedom (n satellites, m unknowns).
Identification: the largest normalised residual, the most likely single fault.  Protection level: the bias on the satellite with the
steepest slope of position error over test statistic that stays below the threshold with the missed-detection probability.

References
----------
R. G. Brown, "A baseline GPS RAIM scheme and a note on the equivalence of three RAIM methods", Navigation 39 (1992);
T. Walter and P. Enge, "Weighted RAIM for precision approach", ION GPS (1995).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.base.chi_square import noncentrality
from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.parity import parity, slopes, suspect
from lowcostnav_ros.gnss.positioning import PASSED, PointFix, require_near_ground, solve
from lowcostnav_ros.gnss.signals import name

HEALTHY, EXCLUDED, FAULTY, NOT_POSSIBLE = "healthy", "excluded", "faulty", "not possible"


@dataclass(frozen=True)
class RaimSettings:
    """Settings of the integrity test."""

    false_alarm_probability: float = setting(6.67e-5, "Probability that a healthy epoch fails the test.", minimum=1e-12, maximum=0.5)
    missed_detection_probability: float = setting(
        1e-3, "Probability that a fault of the size of the protection level goes unnoticed.", minimum=1e-12, maximum=0.5
    )


@dataclass(frozen=True, slots=True, eq=False)
class RaimResult:
    """Outcome of the integrity test.

    Attributes
    ----------
    verdict : str
        ``healthy``; ``excluded`` (one satellite excluded, the rest passed); ``faulty`` (do not use the position); ``not possible``.
    reason : str
        One sentence; empty when healthy.
    fix : PointFix
        Without the excluded satellite.
    excluded : str
        Name of the excluded satellite, or empty.
    hpl_m, vpl_m : float
        Horizontal and vertical protection level against one further fault, m; ``inf`` where the test is not possible.
    """

    verdict: str
    reason: str
    fix: PointFix
    excluded: str
    hpl_m: float
    vpl_m: float


def check(epoch: GnssEpoch, settings: RaimSettings | None = None, **solve_options: Any) -> RaimResult:
    """Solve an epoch, test it, and exclude one faulty satellite if it can be identified.

    Parameters
    ----------
    epoch : GnssEpoch
    settings : RaimSettings, optional
    **solve_options
        For :func:`lowcostnav_ros.gnss.positioning.solve` (not ``covariance``).

    Raises
    ------
    GnssError
        When there is no position at all.
    """
    settings = settings or RaimSettings()
    options = {**solve_options, "probability": 1.0 - settings.false_alarm_probability}
    fix = solve(epoch, **options, anywhere=True)  # a gross fault moves it off the earth and must still be looked for
    if fix.test.redundancy < 1:
        require_near_ground(fix.height)
        needed = fix.geometry.shape[1] + 1
        reason = f"{len(fix.rows)} satellites leave nothing to check with; at least {needed} are needed to see a fault."
        return RaimResult(NOT_POSSIBLE, reason, fix, "", math.inf, math.inf)
    if fix.test.verdict == PASSED:
        require_near_ground(fix.height)
        return RaimResult(HEALTHY, "", fix, "", *protection_levels(fix, settings))
    return _exclude(epoch, fix, settings, options)


def _exclude(epoch: GnssEpoch, fix: PointFix, settings: RaimSettings, options: dict) -> RaimResult:
    def faulty(reason: str) -> RaimResult:
        return RaimResult(FAULTY, reason, fix, "", math.inf, math.inf)

    if fix.test.redundancy < 2:
        needed = fix.geometry.shape[1] + 2
        known = f"{len(fix.rows)} satellites do not show which is faulty"
        return faulty(f"The pseudoranges contradict each other and {known}; {needed} are needed.")
    _, _, _, w, S = _split(fix)
    worst, ambiguous = suspect(w, S)
    satellite = name(epoch.system[fix.rows[worst]], epoch.sat_id[fix.rows[worst]])
    if ambiguous:
        return faulty(f"A fault of {satellite} looks like one of another satellite from here; the position cannot be used.")
    try:
        without = solve(epoch, **{**options, "rows": np.delete(fix.rows, worst)})
    except GnssError:
        return faulty(f"{satellite} seems faulty and the others give no position; the position cannot be used.")
    if without.test.verdict != PASSED:
        return faulty("More than one satellite contradicts the others; the position cannot be used.")
    reason = f"{satellite} contradicts the others and was excluded."
    return RaimResult(EXCLUDED, reason, without, satellite, *protection_levels(without, settings))


def protection_levels(fix: PointFix, settings: RaimSettings) -> tuple[float, float]:
    """Horizontal and vertical protection level, m: the steepest slope times the bias that just goes unnoticed; inf if one is unseen."""
    _, _, gain, _, S = _split(fix)
    bias = math.sqrt(noncentrality(settings.false_alarm_probability, settings.missed_detection_probability, fix.test.redundancy))
    horizontal, vertical = slopes(gain, S)
    return bias * horizontal, bias * vertical


def _split(fix: PointFix) -> tuple:
    """Parity of the pseudoranges at a fix, whitened by their weight."""
    root = np.linalg.cholesky(fix.weight).T
    return parity(root @ fix.geometry, root @ fix.residuals_m)
