"""The attitude of a solution against that of the attitude reference: they share gyros and little else, and nobody knows which is wrong."""

import numpy as np

from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, rotvec_from_quat

COVERED, NAMED = chi_square.threshold(0.99, 3), chi_square.threshold(0.99999, 3)
"""Squared difference of two attitudes over both covariances, from which on both are covered; and named, if it lasts."""
KEPT_NS = 5_000_000_000
"""What was found is covered for so long: an error does not end where chance takes it below the limit."""


class AttitudeCheck(Latch):
    """Attitudes of solutions and of the attitude reference, deg.

    Attributes
    ----------
    offset_n : ndarray (3,)
        By how much they contradict each other, rad in n; zero where they do not.
    """

    def __init__(self, solution: str, reference: str) -> None:
        super().__init__("attitudes disagree", (solution, reference), "deg", begin_s=1.0)

    def clear(self) -> None:
        """Forget all."""
        super().clear()
        self.offset_n, self._seen_ns = np.zeros(3), 0

    def compare(self, stamp_ns: int, q_nb: np.ndarray, reference: np.ndarray, covariance: np.ndarray) -> None:
        """Compare an attitude (4,) with that of the reference (4,), both at a stamp; ``covariance`` (3, 3), rad^2, is the sum of theirs."""
        offset = rotvec_from_quat(quat_multiply(q_nb, quat_conjugate(reference)))
        squared = float(offset @ np.linalg.solve(covariance, offset))
        if squared > COVERED:
            self.offset_n, self._seen_ns = offset, stamp_ns
        elif stamp_ns - self._seen_ns > KEPT_NS:
            self.offset_n = np.zeros(3)
        self.judge(stamp_ns, squared > NAMED, float(np.linalg.norm(offset)) / DEGREE)
