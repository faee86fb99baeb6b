"""What leaves a navigator: whether it is sound, and its sigmas for people."""

import math

import numpy as np

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.estimation import kalman

NO_COVARIANCE, NO_VECTOR = np.zeros((0, 0)), np.zeros(0)


def is_sound(solution: NavSolution) -> bool:
    """Whether all numbers of a solution are finite and no variance is negative: nothing else may leave a navigator."""
    if solution.lat is not None and not math.isfinite(sum(solution.place)):
        return False
    covariances = solution.cov_pos, solution.cov_vel, solution.cov_att, solution.cov_wind
    vectors = solution.vel_n, solution.specific_force_b, solution.q_nb, solution.wind_n, solution.angular_rate_b
    return kalman.are_sound(
        *[NO_COVARIANCE if cov is None else cov if cov.flags.c_contiguous else cov.copy() for cov in covariances],
        *[NO_VECTOR if vector is None else vector if vector.flags.c_contiguous else vector.copy() for vector in vectors],
    )


def position_sigmas(P: np.ndarray) -> dict[str, float]:
    """Sigmas of position and velocity, the first six states of ``P``."""
    s = np.sqrt(np.maximum(np.diag(P), 0.0))
    return {
        "position_horizontal_m": float(np.hypot(s[0], s[1])),
        "position_down_m": float(s[2]),
        "velocity_horizontal_mps": float(np.hypot(s[3], s[4])),
    }
