"""Smooth steps with closed-form integral and derivatives: what prescribed motion is made of.

The step is the quintic ``x^3 (10 - 15 x + 6 x^2)``: its first and second derivatives vanish at both ends, so whatever follows it is
twice continuously differentiable, and rates and specific force stay finite and continuous.
"""

import numpy as np

STEEPEST = 1.875
"""Largest slope of the unit step over unit time."""


def smooth_step(x: np.ndarray) -> np.ndarray:
    """Quintic step from 0 (x <= 0) to 1 (x >= 1)."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * x * (10.0 + x * (-15.0 + 6.0 * x))


def smooth_step_rate(x: np.ndarray) -> np.ndarray:
    """First derivative of :func:`smooth_step`."""
    x = np.clip(x, 0.0, 1.0)
    return 30.0 * x * x * (1.0 - x) ** 2


def smooth_step_curvature(x: np.ndarray) -> np.ndarray:
    """Second derivative of :func:`smooth_step`."""
    x = np.clip(x, 0.0, 1.0)
    return 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)


def smooth_step_integral(x: np.ndarray) -> np.ndarray:
    """Integral of :func:`smooth_step` from 0 to x (x - 1/2 beyond 1)."""
    inside = np.clip(x, 0.0, 1.0)
    return inside**4 * (2.5 + inside * (-3.0 + inside)) + np.maximum(x - 1.0, 0.0)


def plateau(t: np.ndarray, length: np.ndarray, entry: np.ndarray) -> np.ndarray:
    """Rise smoothly to 1 in ``entry`` seconds, stay, and be back at 0 at ``length`` seconds."""
    return smooth_step(t / entry) - smooth_step((t - length + entry) / entry)


def plateau_integral(t: np.ndarray, length: np.ndarray, entry: np.ndarray) -> np.ndarray:
    """Integral of :func:`plateau` from 0 to t; ``length - entry`` in total."""
    return entry * (smooth_step_integral(t / entry) - smooth_step_integral((t - length + entry) / entry))


def plateau_length(total: float, rate: float, entry: float) -> tuple[float, float]:
    """Length of a plateau of height ``rate`` whose integral is ``total``, and the height that makes it exact.

    A ``total`` too small to reach ``rate`` gives the shortest plateau (two entries) at a lower height.
    """
    length = max(abs(total) / rate + entry, 2.0 * entry)
    return length, total / (length - entry)
