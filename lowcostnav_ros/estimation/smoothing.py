"""Rauch-Tung-Striebel fixed-interval smoothing of a recorded filter run, for calibration and reference trajectories."""

import numpy as np


def rts_smoother(
    x: np.ndarray, P: np.ndarray, Phi: np.ndarray, Q: np.ndarray, x_prior: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Smooth filtered estimates backwards.

    Parameters
    ----------
    x : ndarray, shape (n_steps, n)
        Filtered estimates, after the update of each step.
    P : ndarray, shape (n_steps, n, n)
        Their covariances.
    Phi, Q : ndarray, shape (n_steps - 1, n, n)
        Transition and process noise from step k to k + 1.
    x_prior : ndarray, shape (n_steps - 1, n), optional
        Predicted estimate of step k + 1; by default Phi[k] x[k] (give it for a nonlinear prediction).

    Returns
    -------
    xs, Ps : ndarray
        Smoothed estimates and covariances, shapes of ``x`` and ``P``.

    References
    ----------
    Rauch, Tung, Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA J. 3 (1965).
    """
    xs, Ps = x.copy(), P.copy()
    for k in range(len(x) - 2, -1, -1):
        prior_cov = Phi[k] @ P[k] @ Phi[k].T + Q[k]
        prior = Phi[k] @ x[k] if x_prior is None else x_prior[k]
        gain = np.linalg.solve(prior_cov, Phi[k] @ P[k]).T
        xs[k] = x[k] + gain @ (xs[k + 1] - prior)
        Ps[k] = P[k] + gain @ (Ps[k + 1] - prior_cov) @ gain.T
        Ps[k] = 0.5 * (Ps[k] + Ps[k].T)
    return xs, Ps
