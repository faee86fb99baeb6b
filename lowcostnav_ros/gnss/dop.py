"""Dilution of precision: how the geometry of the satellites carries range errors into position and time.

With rows [-e, 1] in north, east, down: V = (H'H)^-1, or sigma^-2 (H'R^-1 H)^-1 when the range errors are correlated (effective DOP).

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: sections 2.5, 2.6, equations (2-26), (2-38), (2-41).
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.physics.earth import dcm_ne

SINGULAR = 1.0e12
"""Condition number of the normal matrix from which a geometry counts as having no solution."""


@dataclass(frozen=True, slots=True)
class Dops:
    """Dilutions of precision: geometric, position, horizontal, vertical, time, east, north; ``inf`` where there is no solution."""

    gdop: float
    pdop: float
    hdop: float
    vdop: float
    tdop: float
    edop: float
    ndop: float


NO_SOLUTION = Dops(*[math.inf] * 7)


def los_n(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3), NED, from azimuths and elevations, rad."""
    flat = np.cos(elevation)
    return np.column_stack((flat * np.cos(azimuth), flat * np.sin(azimuth), -np.sin(elevation)))


def to_ned(lat: float, lon: float, los_e: np.ndarray) -> np.ndarray:
    """Lines of sight (n, 3) in ECEF resolved in NED at a place, rad."""
    return los_e @ dcm_ne(lat, lon).T


def design(los: np.ndarray, clock: np.ndarray | None = None) -> np.ndarray:
    """Rows [-e, 1], shape (n, 3 + m): derivative of the pseudoranges by position and by the m receiver clocks.

    Parameters
    ----------
    los : ndarray, shape (n, 3)
    clock : ndarray of int, shape (n,), optional
        Which clock, 0 to m - 1, each satellite is seen with; one clock for all by default.
    """
    index = np.zeros(len(los), dtype=int) if clock is None else clock
    columns = np.zeros((len(los), int(index.max(initial=0)) + 1))
    columns[np.arange(len(los)), index] = 1.0
    return np.hstack((-np.asarray(los, float), columns))


def cofactor(rows: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray | None:
    """(H'WH)^-1 of design rows (n, m), with ``weight`` (n, n) the identity by default; None where the geometry gives no solution."""
    if len(rows) < rows.shape[1]:
        return None
    information = rows.T @ rows if weight is None else rows.T @ weight @ rows
    if not np.all(np.isfinite(information)) or np.linalg.cond(information) > SINGULAR:
        return None
    inverse = np.linalg.inv(information)
    return 0.5 * (inverse + inverse.T)


def dops(los: np.ndarray, covariance: np.ndarray | None = None, sigma_m: float = 1.0, clock: np.ndarray | None = None) -> Dops:
    """Dilutions of precision of lines of sight.

    Parameters
    ----------
    los : ndarray, shape (n, 3)
        Unit vectors from the receiver, **NED**.
    covariance : ndarray, shape (n, n), optional
        Of the pseudoranges, m^2: gives the effective DOP, normalised by ``sigma_m``.
    sigma_m : float
        What the effective DOP is to be multiplied with, m.
    clock : ndarray of int, optional
        See :func:`design`; ``tdop`` is that of the first clock.

    Returns
    -------
    Dops
        All ``inf`` with fewer satellites than unknowns or in a singular geometry.
    """
    weight = None if covariance is None else np.linalg.inv(covariance) * sigma_m**2
    inverse = cofactor(design(los, clock), weight)
    return NO_SOLUTION if inverse is None else of_cofactor(inverse)


def of_cofactor(v: np.ndarray) -> Dops:
    """Dilutions of a cofactor matrix in north, east, down, clock(s) order."""
    n, e, d, t = np.diag(v)[:4]
    return Dops(*(math.sqrt(x) for x in (np.trace(v), n + e + d, n + e, d, t, e, n)))
