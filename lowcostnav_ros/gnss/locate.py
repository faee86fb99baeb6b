"""From raw observations to a checked position: rough fix, corrections there, integrity test, again until it stands still."""

from collections import Counter

import numpy as np

from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.gnss import raim
from lowcostnav_ros.gnss.correction import CorrectionSettings, corrected
from lowcostnav_ros.gnss.raw_epoch import RawEpoch
from lowcostnav_ros.gnss.rinex_nav import Navigation

NEAR_M = 10.0
"""Corrections change by a few millimetres over this distance, most of it the troposphere over height."""
_PASSES = 4


def locate(
    raw: RawEpoch,
    navigation: Navigation,
    rejected: Counter,
    *,
    settings: CorrectionSettings | None = None,
    raim_settings: raim.RaimSettings | None = None,
    position_e: np.ndarray | None = None,
) -> tuple[GnssEpoch, raim.RaimResult]:
    """Correct an epoch and solve it, with nothing known beforehand.

    Parameters
    ----------
    raw : RawEpoch
    navigation : Navigation
    rejected : Counter
        Gets the counts of the last pass.
    settings : CorrectionSettings, optional
    raim_settings : RaimSettings, optional
    position_e : ndarray, shape (3,), optional
        Where the receiver was last, ECEF, m; saves the first pass.

    Returns
    -------
    epoch : GnssEpoch
        Corrected, stamped with the time of validity by the clock that was found.
    result : RaimResult

    Raises
    ------
    GnssError
        When the satellites that are left give no position.
    """
    settings, clock_m = settings or CorrectionSettings(), 0.0
    counts: Counter[str] = Counter()
    try:
        for _ in range(_PASSES):
            counts.clear()
            epoch = corrected(raw, navigation, position_e, settings, counts, clock_m)
            result = raim.check(epoch, raim_settings)
            fix, known = result.fix, position_e
            position_e, clock_m = fix.position_e, next(iter(fix.clocks_m.values()))
            if known is not None and np.linalg.norm(position_e - known) < NEAR_M:
                break
    finally:  # without a position too: they state why there is none
        rejected.update(counts)
    return corrected(raw, navigation, position_e, settings, Counter(), clock_m), result
