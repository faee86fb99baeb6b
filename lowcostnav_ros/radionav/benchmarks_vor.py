"""What the aids in use today achieve on a non-precision approach: the benchmark a backup navigator is held against.

Gebre-Egziabher 2004, section 2.2 and page 221.  These are errors of one sigma or of a specification beside each other, not like for like.
"""

import math

import numpy as np

from lowcostnav_ros.base.units import DEGREE, NAUTICAL_MILE

LORAN_ERROR_M = 0.25 * NAUTICAL_MILE
"""Nominal LORAN-C error."""
VOR_ERRORS = (1.0 * DEGREE, 5.0 * DEGREE)
"""Range of VOR bearing errors, rad."""
REQUIREMENT_M = 0.5 * NAUTICAL_MILE
"""Position error allowed after half an hour without GPS."""


def vor_cross_track(distance_m: np.ndarray | float, bearing_error: np.ndarray | float) -> np.ndarray:
    """Return the cross-track error ``d tan(error)``, m, at ``distance_m`` from a VOR whose bearing is off by ``bearing_error`` rad.

    Raises
    ------
    ValueError
        For a negative distance or a bearing error of a right angle or more.
    """
    if np.any(np.asarray(distance_m) < 0.0) or np.any(np.abs(bearing_error) >= 0.5 * math.pi):
        raise ValueError("VOR cross-track error needs a distance of 0 or more and a bearing error below 90 degrees.")
    return np.asarray(distance_m) * np.tan(np.abs(bearing_error))
