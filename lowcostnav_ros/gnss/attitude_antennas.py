"""Attitude from the carrier phases of three GPS antennas on short baselines, the integers known (Gebre-Egziabher 2004, section 4.6).

Between the reference antenna and antenna j the phase of satellite i differs by ``d_ij = s_i' C_nb b_j + c_j + noise`` metres, with s the
unit vector to the satellite in n, b the baseline in b and c the delay between the two receiver channels.  With
``C_true = C_est (I + [a x])`` the residual is ``-s' C_est [b x] a + c_j``; iterated least squares solve for a and every c.
"""

import math

import numpy as np

from lowcostnav_ros.physics.rotation import quat_from_rotvec, quat_multiply, quat_normalise, quat_to_dcm, skew

REAR_BASELINE_M, FRONT_BASELINE_M = 0.36, 0.50
_ITERATIONS, _SMALL = 20, 1e-10
_WORST_RESIDUAL = 5.0


def isosceles_array(rear_m: float = REAR_BASELINE_M, front_m: float = FRONT_BASELINE_M) -> np.ndarray:
    """Baselines (2, 3), m, FRD, from the left rear antenna to the right rear and the front one: 36, 50 and 50 cm.

    Raises
    ------
    ValueError
        Where three such sides make no triangle.
    """
    if not (rear_m > 0.0 and front_m > 0.5 * rear_m):
        raise ValueError(f"An antenna triangle needs a front baseline of more than half the rear one, got {front_m:g} and {rear_m:g} m.")
    ahead = math.sqrt(front_m**2 - 0.25 * rear_m**2)
    return np.array([[0.0, rear_m, 0.0], [ahead, 0.5 * rear_m, 0.0]])


def phase_differences(q_nb: np.ndarray, sight_n: np.ndarray, baselines_b: np.ndarray, channel_m: np.ndarray) -> np.ndarray:
    """Error-free single differences (satellites, baselines), m.

    Parameters
    ----------
    q_nb : ndarray, shape (4,)
    sight_n : ndarray, shape (m, 3)
        Unit vectors to the satellites, NED.
    baselines_b : ndarray, shape (k, 3)
        m, FRD.
    channel_m : ndarray, shape (k,)
        Delay between the channels of each baseline, m.
    """
    return sight_n @ quat_to_dcm(q_nb) @ baselines_b.T + channel_m


def attitude_from_phases(
    phases_m: np.ndarray, sight_n: np.ndarray, baselines_b: np.ndarray, q_nb: np.ndarray, sigma_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Solve the attitude from single differences.

    Parameters
    ----------
    phases_m : ndarray, shape (m, k)
        Single differences with the integers resolved, m.
    sight_n, baselines_b
        As :func:`phase_differences`.
    q_nb : ndarray, shape (4,)
        Attitude to start from, the gyros' after a loss of lock: from half a radian off, one start in some hundred ends in a false minimum.
    sigma_m : float
        Noise of one difference, m (5 mm with multipath gives 0.25 to 1 deg on half a metre).

    Returns
    -------
    q_nb : ndarray, shape (4,)
    cov_att : ndarray, shape (3, 3)
        Covariance of the small rotation resolved in n, rad^2.

    Raises
    ------
    ValueError
        For fewer than three satellites, a geometry that leaves the attitude open, or residuals that the noise does not explain (a false
        minimum, or a wrong integer).
    """
    m, k = phases_m.shape
    if m < 3 or m * k < 3 + k:
        raise ValueError(f"Attitude needs at least three satellites on two baselines, got {m} satellites on {k}; wait for more.")
    q = np.array(q_nb, dtype=float)
    channel = np.kron(np.ones((m, 1)), np.eye(k))
    c = np.zeros(k)
    for _ in range(_ITERATIONS):
        rotated = sight_n @ quat_to_dcm(q)
        H = np.hstack((np.array([-s @ skew(b) for s in rotated for b in baselines_b]), channel))
        step, _, rank, _ = np.linalg.lstsq(H, (phases_m - rotated @ baselines_b.T - c).ravel(), rcond=1e-9)
        if rank < 3 + k:
            raise ValueError("The satellites in view leave the attitude open (they lie on one cone or the baselines in one line).")
        q = quat_normalise(quat_multiply(q, quat_from_rotvec(step[:3])))
        c += step[3:]
        if np.abs(step).max() < _SMALL:
            break
    C = quat_to_dcm(q)
    left = phases_m - sight_n @ C @ baselines_b.T - c
    rms = float(np.sqrt(np.sum(left**2) / max(m * k - 3 - k, 1)))
    if rms > _WORST_RESIDUAL * sigma_m:
        noise_mm = 1e3 * sigma_m
        raise ValueError(f"Residuals of {1e3 * rms:.0f} mm do not fit phases good to {noise_mm:.1f} mm; start nearer or fix the integers.")
    return q, C @ np.linalg.inv(H.T @ H)[:3, :3] @ C.T * sigma_m**2
