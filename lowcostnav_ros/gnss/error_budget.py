"""How wrong a pseudorange is: the budget of Table 2.1, and noise that grows towards the horizon with a part common to all satellites.

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: section 2.3, Tables 2.1, 7.7 and 7.8, equations (2-8), (2-9), (2-40), (7-9).
"""

import math
from collections.abc import Mapping

import numpy as np

from lowcostnav_ros.gnss import GnssError

UERE_BUDGET_M = {
    "space: satellite clock stability": 3.0,
    "space: satellite perturbations": 1.0,
    "space: others": 0.5,
    "control: ephemeris": 4.2,
    "control: others": 0.9,
    "user: ionosphere": 5.0,
    "user: troposphere": 1.5,
    "user: multipath": 2.5,
    "user: measurement noise": 1.5,
    "user: others": 0.5,
}
"""1-sigma range errors of single-frequency C/A code, m (Table 2.1)."""

UERE_TABLE_M = {
    ("Galileo", "8 MHz", "typical"): 4.18,
    ("Galileo", "24 MHz", "typical"): 3.64,
    ("GPS", "8 MHz", "typical"): 5.50,
    ("GPS", "24 MHz", "typical"): 5.14,
    ("Galileo", "8 MHz", "worst"): 9.82,
    ("Galileo", "24 MHz", "worst"): 7.57,
    ("GPS", "8 MHz", "worst"): 10.36,
    ("GPS", "24 MHz", "worst"): 8.31,
}
"""User equivalent range error by system, receiver bandwidth and case, m (Table 7.8)."""

COMMON_SHARE = 1.0 / 8.0
"""Share of the variance that is common to all satellites, at the zenith."""


def uere(budget: Mapping[str, float] = UERE_BUDGET_M) -> float:
    """Root of the sum of squares of a budget, m."""
    return math.sqrt(sum(sigma * sigma for sigma in budget.values()))


def obliquity(elevation: np.ndarray) -> np.ndarray:
    """Growth of the common error towards the horizon, f = 1.1/(sin El + 0.1), ``elevation`` rad (2-9).

    Raises
    ------
    GnssError
        Below the horizon, where the law has a pole.
    """
    elevation = np.asarray(elevation, float)
    if np.any(~(elevation >= 0.0)):
        lowest = math.degrees(float(np.min(elevation)))
        raise GnssError(f"Range noise is defined above the horizon only; exclude the satellite at an elevation of {lowest:.1f} deg.")
    return 1.1 / (np.sin(elevation) + 0.1)


def range_covariance(elevation: np.ndarray, sigma_m: float) -> np.ndarray:
    """Covariance (n, n) of the pseudoranges, m^2 (2-40): (7 + f_i^2) sigma^2/8 on the diagonal, f_i f_j sigma^2/8 beside it."""
    f = obliquity(elevation)
    return sigma_m**2 * (COMMON_SHARE * np.outer(f, f) + (1.0 - COMMON_SHARE) * np.eye(f.size))


def range_noise(elevation: np.ndarray, sigma_m: float, own: np.ndarray, common: float) -> np.ndarray:
    """Range errors (n,), m, from standard normals: one ``own`` (n,) per satellite and one ``common`` to all (2-8)."""
    return sigma_m * (math.sqrt(1.0 - COMMON_SHARE) * np.asarray(own) + math.sqrt(COMMON_SHARE) * common * obliquity(elevation))


def combined_error(sigma_gps_m: float, sigma_galileo_m: float, dop: float) -> float:
    """Expected 1-sigma error, m, with both systems: sqrt(2/(1/sigma_GPS^2 + 1/sigma_GAL^2)) DOP (7-9)."""
    return math.sqrt(2.0 / (1.0 / sigma_gps_m**2 + 1.0 / sigma_galileo_m**2)) * dop
