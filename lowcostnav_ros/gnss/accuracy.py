"""What a position is good for: precision-approach categories and the limits of the Galileo services.

The monitor that holds a flight against them, sample by sample, is :mod:`lowcostnav_ros.replay.requirements`.

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: chapter 7, equation (7-8), Tables 7.4 and D.1.
"""

import math
from dataclasses import dataclass
from statistics import NormalDist

CATEGORIES_M = {"III": (4.1, 0.6), "II": (5.2, 1.7), "I": (17.1, 4.1)}
"""Horizontal and vertical accuracy a precision approach asks for, m, strictest first (Table 7.4)."""


@dataclass(frozen=True, slots=True)
class Service:
    """Integrity of a Galileo service: alert limits, m, time to alert, s, and the probability that an alert may fail in 150 s."""

    horizontal_m: float
    vertical_m: float
    time_to_alert_s: float
    integrity_risk: float = 3.5e-7

    def protection_factors(self) -> tuple[float, float]:
        """How many sigmas, horizontal (of the larger half-axis) and vertical, a Gaussian error passes with half the integrity risk each."""
        half = 0.5 * self.integrity_risk
        return math.sqrt(-2.0 * math.log(half)), -NormalDist().inv_cdf(0.5 * half)


SERVICES = {"SOL": Service(12.0, 20.0, 6.0), "PRS": Service(20.0, 35.0, 10.0)}
"""Safety of life and public regulated service (Table D.1); the open and commercial services give no integrity."""


def relative_error(estimate: float, truth: float) -> float:
    """|estimate - truth| / |truth| (7-8); where the truth is zero, which has no relative error, the absolute error."""
    return abs(estimate - truth) / (abs(truth) or 1.0)


def category(horizontal_m: float, vertical_m: float) -> str:
    """Strictest precision-approach category that 95 % errors of this size meet, or an empty text."""
    return next((name for name, (h, v) in CATEGORIES_M.items() if horizontal_m <= h and vertical_m <= v), "")
