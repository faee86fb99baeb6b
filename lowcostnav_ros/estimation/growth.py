"""How fast some states walk, learned from the measurements that show them: a bank of small filters that differ in that alone.

The innovations of a filter whose process noise is right are the most probable ones; each filter of the bank adds up the logarithm of that
probability, and the noise used is the mean of theirs, weighed by it and by what was thought before (multiple models, Magill, IEEE TAC 10,
1965).
"""

import math

import numpy as np

from lowcostnav_ros.estimation.error_state import Layout

STEPS = np.arange(-2, 3)
MEMORY_S = 1800.0
"""What was seen longer ago counts less."""
SPACING_NS = 990_000_000
LONGEST_S = 60.0


class Growth:
    """The bank.

    Parameters
    ----------
    layout : Layout
        Of the host; its ``psd`` is what is set.
    taught : ndarray of bool, shape (n,)
        The states that the measurements teach while the rest is known otherwise.
    walking : slice
        Those of them whose growth is learned.
    spread : float
        Factor by which a sigma of their growth may be more or less than set (one sigma of its logarithm).

    Attributes
    ----------
    factor : float
        Growth learned, sigma over that set.
    """

    def __init__(self, layout: Layout, taught: np.ndarray, walking: slice, spread: float) -> None:
        self.layout, self.walking, self._rows = layout, walking, np.flatnonzero(taught)
        self._set, self._factors = layout.psd[walking].copy(), spread ** STEPS.astype(float)
        rows = self._rows
        is_walking = (rows >= walking.start) & (rows < walking.stop)
        self._psd = np.where(is_walking, self._factors[:, None] ** 2, 1.0) * layout.psd[rows]
        self._rate, self._P0 = layout.rate[rows], np.diag(layout.sigma0[rows] ** 2)
        self.restart()

    def restart(self) -> None:
        """Begin anew with what is set."""
        count = len(self._factors)
        self._x, self._P = np.zeros((count, len(self._rows))), np.tile(self._P0, (count, 1, 1))
        self._seen, self.factor = np.zeros(count), 1.0
        self._last_ns: int | None = None
        self.layout.psd[self.walking] = self._set

    def take(self, stamp_ns: int, y: np.ndarray, H: np.ndarray, R: np.ndarray, estimate: np.ndarray, P: np.ndarray) -> None:
        """Take an innovation ``y`` (m,) of the host with ``H`` (m, n) and ``R`` (m, m) at its ``estimate`` (n,) and covariance (n, n)."""
        if self._last_ns is not None and stamp_ns - self._last_ns < SPACING_NS:
            return
        self._move(0.0 if self._last_ns is None else min(1e-9 * (stamp_ns - self._last_ns), LONGEST_S))
        self._last_ns = stamp_ns
        own, other = H[:, self._rows], H.copy()
        other[:, self._rows] = 0.0
        R = R + other @ P @ other.T
        residual = y + own @ estimate[self._rows] - self._x @ own.T
        PH = self._P @ own.T
        S = own @ PH + R
        sign, logarithm = np.linalg.slogdet(S)
        if not (sign > 0.0).all():  # next to no noise, and rounding has made of what was left of P less than nothing
            self.restart()
            return
        weighed = np.linalg.solve(S, residual[:, :, None])[:, :, 0]
        self._seen -= 0.5 * (logarithm + np.einsum("gi,gi->g", residual, weighed))
        self._x = self._x + np.einsum("gij,gj->gi", PH, weighed)
        self._P = self._P - PH @ np.linalg.solve(S, PH.transpose(0, 2, 1))
        self._weigh()

    def _move(self, dt: float) -> None:
        decay = np.exp(-self._rate * dt)
        self._x *= decay
        self._P *= np.outer(decay, decay)
        walked = np.where(self._rate > 0.0, -np.expm1(-2.0 * self._rate * dt) / np.maximum(2.0 * self._rate, 1e-300), dt)
        self._P += (self._psd * walked)[:, :, None] * np.eye(len(self._rows))
        self._seen *= math.exp(-dt / MEMORY_S)

    def _weigh(self) -> None:
        logarithm = self._seen - 0.5 * STEPS**2.0
        weight = np.exp(logarithm - logarithm.max())
        self.factor = math.sqrt(float(weight @ self._factors**2 / weight.sum()))
        self.layout.psd[self.walking] = self._set * self.factor**2
