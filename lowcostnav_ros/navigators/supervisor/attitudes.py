"""The attitude of a solution against that of the attitude reference: they share gyros and little else, and nobody knows which is wrong.

A reference that has lost its tilt for what compass, airspeed and velocity say of the gyros says so of the gyros of both.
"""

import math

import numpy as np

from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, rotvec_from_quat

COVERED, NAMED = chi_square.threshold(0.99, 3), chi_square.threshold(0.99999, 3)
"""Squared difference of two attitudes over both covariances, from which on both are covered; and named, if it lasts."""
LOST = 20.0 * DEGREE
"""Sigma of a tilt that is lost."""
KEPT_NS = 5_000_000_000
"""What was found is covered for so long: an error does not end where chance takes it below the limit."""


class AttitudeCheck(Latch):
    """Attitudes of solutions and of the attitude reference, deg.

    Attributes
    ----------
    covered : ndarray (3, 3)
        What is added to the covariance of either in n, rad^2; zero where they agree.
    """

    def __init__(self, solution: str, reference: str) -> None:
        super().__init__("attitudes disagree", (solution, reference), "deg", begin_s=1.0)

    def clear(self) -> None:
        """Forget all."""
        super().clear()
        self.covered, self._seen_ns = np.zeros((3, 3)), 0

    def compare(self, stamp_ns: int, own: tuple[np.ndarray, np.ndarray], reference: tuple[np.ndarray, np.ndarray]) -> None:
        """Compare an attitude with that of the reference, each (4,) with its covariance (3, 3), rad^2, both at a stamp."""
        (q_nb, P), (q_reference, P_reference) = own, reference
        offset = rotvec_from_quat(quat_multiply(q_nb, quat_conjugate(q_reference)))
        squared = float(offset @ np.linalg.solve(P + P_reference, offset))
        if _tilt(P) < LOST < _tilt(P_reference):
            self.covered, self._seen_ns = P_reference, stamp_ns
        elif squared > COVERED:
            self.covered, self._seen_ns = np.outer(offset, offset), stamp_ns
        elif stamp_ns - self._seen_ns > KEPT_NS:
            self.covered = np.zeros((3, 3))
        self.judge(stamp_ns, squared > NAMED, float(np.linalg.norm(offset)) / DEGREE)


def _tilt(covariance: np.ndarray) -> float:
    return math.sqrt(max(float(covariance[0, 0]), float(covariance[1, 1]), 0.0))
