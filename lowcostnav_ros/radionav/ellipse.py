"""The ellipse of a horizontal position error: axes and orientation of a 2-by-2 covariance.

One-sigma semi-axes are the square roots of the eigenvalues, the major axis lies along the eigenvector of the larger one
(Gebre-Egziabher 2004, appendix D.4, where the same is phrased through the inverse).  A Gaussian error lies inside the one-sigma
ellipse with probability 0.39, not 0.68.
"""

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Ellipse:
    """Semi-axes (unit of the covariance's root) and ``orientation``: bearing of the major axis, rad in [0, pi)."""

    major: float
    minor: float
    orientation: float

    def outline(self, centre: np.ndarray, scale: float = 1.0, points: int = 90) -> np.ndarray:
        """Return points (n, 2), north east, of the ellipse ``scale`` times 1 sigma about ``centre`` (2,); the last closes it."""
        angle = np.linspace(0.0, 2.0 * math.pi, points)
        along, across = scale * self.major * np.cos(angle), scale * self.minor * np.sin(angle)
        c, s = math.cos(self.orientation), math.sin(self.orientation)
        return np.asarray(centre) + np.column_stack((along * c - across * s, along * s + across * c))


def ellipse_of(covariance: np.ndarray) -> Ellipse:
    """Return the one-sigma ellipse of a covariance (2, 2), north east.

    Raises
    ------
    ValueError
        When the matrix is no covariance: not finite, not symmetric or with a negative variance.
    """
    P = np.asarray(covariance, dtype=float)
    if P.shape != (2, 2) or not np.isfinite(P).all():
        raise ValueError(f"An error ellipse needs a finite covariance of shape (2, 2), got {P.tolist()}.")
    scale = max(abs(P[0, 0]), abs(P[1, 1]))
    if abs(P[0, 1] - P[1, 0]) > 1e-9 * scale:
        raise ValueError(f"An error ellipse needs a symmetric covariance, got {P.tolist()}.")
    values, vectors = np.linalg.eigh(P)
    if values[0] < -1e-9 * scale:
        raise ValueError(f"A covariance has no negative variance; this one has {values[0]:g}.")
    minor, major = np.sqrt(np.maximum(values, 0.0))
    north, east = vectors[:, 1]
    return Ellipse(float(major), float(minor), math.atan2(east, north) % math.pi)
