"""Is the filter's sigma honest? NEES, NIS and their Monte Carlo acceptance bands."""

import numpy as np
from scipy.special import chdtri


def nees(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Normalised estimation error squared of each row: e' P^-1 e.

    Parameters
    ----------
    error : ndarray, shape (..., n)
    covariance : ndarray, shape (..., n, n)

    Returns
    -------
    ndarray, shape (...)
        Mean n when the filter is consistent.
    """
    return np.einsum("...i,...i->...", error, np.linalg.solve(covariance, error[..., None])[..., 0])


def acceptance_band(dof: int, runs: int, probability: float = 0.95) -> tuple[float, float]:
    """Two-sided band of the mean of ``runs`` independent chi-square values with ``dof`` degrees of freedom.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 5.4.2.
    """
    tail = 0.5 * (1.0 - probability)
    return float(chdtri(dof * runs, 1.0 - tail) / runs), float(chdtri(dof * runs, tail) / runs)


def error_over_sigma_rms(error: np.ndarray, sigma: np.ndarray) -> float:
    """RMS of error divided by its own sigma; near 1 when sigma is honest, above when it is too small."""
    return float(np.sqrt(np.mean((error / sigma) ** 2)))
