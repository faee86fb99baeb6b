"""Snapshot RAIM: does one satellite lie, which one, and how far off can the position be without anybody noticing.

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
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.dop import cofactor
from lowcostnav_ros.gnss.positioning import PASSED, PointFix, require_near_ground, solve
from lowcostnav_ros.gnss.signals import name
from lowcostnav_ros.measurements import GnssEpoch
from lowcostnav_ros.settings import setting

HEALTHY, EXCLUDED, FAULTY, NOT_POSSIBLE = "healthy", "excluded", "faulty", "not possible"
INSEPARABLE = 0.999
"""Correlation of two satellites' normalised residuals from which their faults look alike."""


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
        ``healthy``; ``excluded`` (one satellite left out, the rest passed); ``faulty`` (do not use the position); ``not possible``.
    reason : str
        One sentence; empty when healthy.
    fix : PointFix
        Without the excluded satellite.
    excluded : str
        Name of the satellite left out, or empty.
    hpl_m, vpl_m : float
        Horizontal and vertical protection level against one further fault, m; ``inf`` where the test is not possible.
    """

    verdict: str
    reason: str
    fix: PointFix
    excluded: str
    hpl_m: float
    vpl_m: float


@lru_cache(maxsize=64)
def noncentrality(false_alarm: float, missed: float, redundancy: int) -> float:
    """Noncentrality of the test statistic at which the test misses with probability ``missed``."""
    threshold = chi2.ppf(1.0 - false_alarm, redundancy)
    return float(brentq(lambda value: ncx2.cdf(threshold, redundancy, value) - missed, 1e-6, 10.0 * threshold + 1000.0))


def check(epoch: GnssEpoch, settings: RaimSettings | None = None, **solve_options) -> RaimResult:
    """Solve an epoch, test it, and leave out one faulty satellite if that can be told.

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
        return faulty(f"The pseudoranges contradict each other and {len(fix.rows)} satellites cannot tell which; {needed} are needed.")
    normalised, correlation = normalised_residuals(fix)
    worst = int(np.argmax(normalised))
    suspect = name(epoch.system[fix.rows[worst]], epoch.sat_id[fix.rows[worst]])
    twins = np.flatnonzero(np.abs(correlation[worst]) > INSEPARABLE)
    if twins.size > 1:
        return faulty(f"A fault of {suspect} looks like one of another satellite from here; the position cannot be used.")
    try:
        without = solve(epoch, **{**options, "rows": np.delete(fix.rows, worst)})
    except GnssError:
        return faulty(f"{suspect} seems faulty and the others give no position; the position cannot be used.")
    if without.test.verdict != PASSED:
        return faulty("More than one satellite contradicts the others; the position cannot be used.")
    reason = f"{suspect} contradicts the others and was left out."
    return RaimResult(EXCLUDED, reason, without, suspect, *protection_levels(without, settings))


def normalised_residuals(fix: PointFix) -> tuple[np.ndarray, np.ndarray]:
    """Residuals over their own sigmas (n,) and their correlation (n, n), in whitened observations.

    A satellite without any redundancy of its own (its residual is always zero) counts as zero.
    """
    _, root, projector = _whitened(fix)
    spread = np.sqrt(np.maximum(np.diag(projector), 0.0))
    seen = spread > 1e-6
    scale = np.divide(1.0, spread, out=np.zeros_like(spread), where=seen)
    return np.abs(root @ fix.residuals_m) * scale, projector * np.outer(scale, scale)


def protection_levels(fix: PointFix, settings: RaimSettings) -> tuple[float, float]:
    """Horizontal and vertical protection level, m: the steepest slope times the bias that just goes unnoticed; inf if one is unseen."""
    gain, root, projector = _whitened(fix)
    seen = np.diag(projector)
    if np.any(seen < 1e-9):
        return math.inf, math.inf
    bias = math.sqrt(noncentrality(settings.false_alarm_probability, settings.missed_detection_probability, fix.test.redundancy))
    horizontal = np.hypot(gain[0], gain[1]) / np.sqrt(seen)
    vertical = np.abs(gain[2]) / np.sqrt(seen)
    return float(bias * horizontal.max()), float(bias * vertical.max())


def _whitened(fix: PointFix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gain (m, n) from whitened observations to the solution, whitening root of the weight, projector (n, n) onto the residuals."""
    root = np.linalg.cholesky(fix.weight).T
    white = root @ fix.geometry
    gain = cofactor(white) @ white.T
    return gain, root, np.eye(len(white)) - white @ gain
