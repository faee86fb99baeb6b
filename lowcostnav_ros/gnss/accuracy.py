"""How good a solution is and what it is good for: error statistics, precision-approach categories, Galileo service limits.

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: chapter 7, equation (7-8), Tables 7.4 and D.1.
"""

import math
from dataclasses import dataclass

import numpy as np

CATEGORIES_M = {"III": (4.1, 0.6), "II": (5.2, 1.7), "I": (17.1, 4.1)}
"""Horizontal and vertical accuracy a precision approach asks for, m, strictest first (Table 7.4)."""


@dataclass(frozen=True, slots=True)
class Service:
    """Integrity of a Galileo service: alert limits, m, and time to alert, s."""

    horizontal_m: float
    vertical_m: float
    time_to_alert_s: float


SERVICES = {"SOL": Service(12.0, 20.0, 6.0), "PRS": Service(20.0, 35.0, 10.0)}
"""Safety of life and public regulated service (Table D.1); the open and commercial services give no integrity."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorStatistics:
    """Statistics of position or velocity errors: ``mean`` and ``rms`` (3,) north, east, up; 2D and 3D rms; largest ones."""

    mean: np.ndarray
    rms: np.ndarray
    rms_2d: float
    rms_3d: float
    max_horizontal: float
    max_vertical: float
    max_3d: float


def statistics(errors_neu: np.ndarray) -> ErrorStatistics:
    """Statistics of errors (n, 3) in north, east, up, n >= 1."""
    errors = np.asarray(errors_neu, float)
    rms = np.sqrt(np.mean(errors**2, axis=0))
    horizontal, total = np.hypot(errors[:, 0], errors[:, 1]), np.linalg.norm(errors, axis=1)
    return ErrorStatistics(
        errors.mean(axis=0),
        rms,
        float(np.hypot(rms[0], rms[1])),
        float(np.linalg.norm(rms)),
        float(horizontal.max()),
        float(np.abs(errors[:, 2]).max()),
        float(total.max()),
    )


def max_per_gap(time_s: np.ndarray, errors_neu: np.ndarray, gaps_s: list[tuple[float, float]]) -> list[float]:
    """Largest 3D error within each gap ``(start, end)``, s; NaN for a gap without samples."""
    total = np.linalg.norm(np.asarray(errors_neu, float), axis=1)
    inside = [total[(time_s >= start) & (time_s <= end)] for start, end in gaps_s]
    return [float(values.max()) if values.size else math.nan for values in inside]


def relative_error(estimate: float, truth: float) -> float:
    """|estimate - truth| / |truth| (7-8); where the truth is zero, which has no relative error, the absolute error."""
    return abs(estimate - truth) / (abs(truth) or 1.0)


def category(horizontal_m: float, vertical_m: float) -> str:
    """Strictest precision-approach category that 95 % errors of this size meet, or an empty text."""
    return next((name for name, (h, v) in CATEGORIES_M.items() if horizontal_m <= h and vertical_m <= v), "")


def alarms(time_s: np.ndarray, horizontal_m: np.ndarray, vertical_m: np.ndarray, service: Service) -> list[tuple[float, float]]:
    """When errors pass a service's alert limits, and by when the user must have been warned.

    Parameters
    ----------
    time_s, horizontal_m, vertical_m : ndarray, shape (n,)
        Times and absolute errors.
    service : Service

    Returns
    -------
    list of (float, float)
        Start of each exceedance and the latest time of its alarm, s.
    """
    beyond = (np.asarray(horizontal_m) > service.horizontal_m) | (np.asarray(vertical_m) > service.vertical_m)
    starts = np.flatnonzero(beyond & ~np.concatenate(([False], beyond[:-1])))
    return [(float(time_s[k]), float(time_s[k]) + service.time_to_alert_s) for k in starts]
