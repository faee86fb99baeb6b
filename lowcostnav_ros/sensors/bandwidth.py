"""The low-pass filter in front of a sensor's converter, exact for an input that is constant over each interval.

The truth comes as means over equal intervals and leaves as such.  Over an interval the filter ``x' = A x + B u`` with output x[0] is
linear with a constant input, so its end state and the mean of its output follow from one matrix exponential, whatever the ratio of
bandwidth to sample rate: a 100 Hz filter is right at 100 Hz too, where a recursive filter designed by the bilinear transform is not.
"""

import math

import numpy as np

from lowcostnav_ros.base.kernels import kernel

DAMPING = math.sqrt(0.5)
"""Damping ratio of a second-order filter whose gain at its bandwidth is 1/sqrt(2), as data sheets count bandwidth."""


class LowPass:
    """First- or second-order low-pass of unit gain, the same on several axes, settled on its first input.

    Parameters
    ----------
    bandwidth_hz : float
        Where the gain has fallen by 3 dB.
    order : int
        1: an RC section, gain 1 / (1 + s/w).  2: w^2 / (s^2 + 2 zeta w s + w^2) with zeta = 1/sqrt(2).
    """

    def __init__(self, bandwidth_hz: float, order: int) -> None:
        w = 2.0 * math.pi * bandwidth_hz
        if order == 1:
            self._dynamics = np.array([[-w, w]])  # x' = A x + B u as [A B]
        else:
            self._dynamics = np.array([[0.0, 1.0, 0.0], [-w * w, -2.0 * DAMPING * w, w * w]])
        self._first_ns = 0
        self._begun = False
        self._step = np.empty(0)

    def mean_output(self, stamps_ns: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Filter, continuing from call to call.

        Parameters
        ----------
        stamps_ns : ndarray of int64, shape (n,)
            Ends of the intervals, equally spaced (by the first two ever seen).
        values : ndarray, shape (n, m)
            Means of the input over the intervals.

        Returns
        -------
        ndarray, shape (n, m)
            Means of the output over the same intervals.
        """
        settled = 0
        if len(stamps_ns) and not self._begun:
            self._first_ns, self._begun, settled = int(stamps_ns[0]), True, 1
            self._state = np.zeros((len(self._dynamics), values.shape[1]))
            self._state[0] = values[0]
        if len(stamps_ns) > settled and not self._step.size:
            self._prepare(1e-9 * (int(stamps_ns[settled]) - self._first_ns))
        if len(stamps_ns) == settled:
            return values
        rest = _filtered(self._step, self._mean, self._state, np.ascontiguousarray(values[settled:]))
        return np.vstack((values[:settled], rest))

    def _prepare(self, dt_s: float) -> None:
        """Solve one interval: states, the held input and the integral of the output, in one exponential."""
        from scipy.linalg import expm  # not on import: few flights need it

        n = len(self._dynamics)
        whole = np.zeros((n + 2, n + 2))
        whole[:n, : n + 1], whole[n + 1, 0] = self._dynamics, 1.0
        solved = expm(whole * dt_s)
        self._step = np.ascontiguousarray(solved[:n, : n + 1])
        self._mean = np.ascontiguousarray(solved[n + 1, : n + 1]) / dt_s


@kernel
def _filtered(step: np.ndarray, mean: np.ndarray, state: np.ndarray, values: np.ndarray) -> np.ndarray:
    n = state.shape[0]
    out = np.empty_like(values)
    following = np.empty(n)
    for k in range(values.shape[0]):
        for j in range(values.shape[1]):
            total = mean[n] * values[k, j]
            for i in range(n):
                total += mean[i] * state[i, j]
                following[i] = step[i, n] * values[k, j]
                for h in range(n):
                    following[i] += step[i, h] * state[h, j]
            out[k, j] = total
            for i in range(n):
                state[i, j] = following[i]
    return out
