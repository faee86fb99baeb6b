"""Fixed-interval (Rauch-Tung-Striebel) smoothing by filterpy: a linear run, and the error states of a navigator as it flies.

An error-state filter has no estimate to smooth: its error is zero after every correction c.  The sum of the corrections, carried by the
transitions, X+ = Phi X and X = X + c, is one: the linear estimate, about the trajectory flown without corrections, of the same filter.
What smoothing adds to X is what is to be added to the filter's state.

X grows as the trajectory without corrections diverges, so it begins anew in every block of :data:`BLOCK_S`.  filterpy smooths a block as
soon as it is full and gives the gains K of its steps; their product carries what later blocks add, so no more than that is kept:
``d_first = x_first - X_first + K...K d_last``, and the like of the covariances.  The result is that of one pass.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.physics.rotation import quat_apply_phi_n

BLOCK_S = 2.0
ROUND_OFF = 1e-12
"""Share of a predicted variance that is added to it, so that fully correlated states can be inverted."""


def rts_smoother(x: np.ndarray, P: np.ndarray, Phi: np.ndarray, Q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Smooth filtered estimates backwards, by filterpy, in units in which all states are of one size.

    Parameters
    ----------
    x : ndarray, shape (n_steps, n)
        Filtered estimates, after the update of each step.
    P : ndarray, shape (n_steps, n, n)
        Their covariances.
    Phi, Q : ndarray, shape (n_steps - 1, n, n) or more
        Transition and process noise from step k to k + 1.

    Returns
    -------
    xs, Ps, K : ndarray
        Smoothed estimates and covariances, and the gains: what step k + 1 gains by smoothing, times ``K[k]``, step k gains.

    References
    ----------
    Rauch, Tung, Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA J. 3 (1965).
    """
    from filterpy.kalman import rts_smoother as smoother  # not on import: 44 MB that no node needs

    s = np.sqrt(np.diagonal(P, axis1=1, axis2=2).max(axis=0))
    s[s <= 0.0] = 1.0
    area, ratio = np.outer(s, s), s[:, None] / s
    xs, Ps, K, _ = smoother(x / s, P / area, Phi / ratio, Q / area)
    xs, Ps = xs * s, 0.5 * area * (Ps + Ps.transpose(0, 2, 1))
    xs[-1], Ps[-1] = x[-1], P[-1]  # without the round-off of the units
    return xs, Ps, K * ratio


@dataclasses.dataclass(slots=True, eq=False)
class _Output:
    """A solution and what its quantities (``rows``) gain: ``x``, ``P`` in its own block, and ``gain`` times what later blocks add."""

    solution: NavSolution
    rows: dict[str, slice]
    x: np.ndarray
    P: np.ndarray
    gain: np.ndarray

    def smoothed(self, d: np.ndarray, D: np.ndarray) -> NavSolution:
        x, P = self.x + self.gain @ d, self.P + self.gain @ D @ self.gain.T
        old = self.solution
        new: dict[str, Any] = {"states": None, "integrity": None}
        for name, rows in self.rows.items():
            if name == "pos":
                new |= dict(zip(("lat", "lon", "height"), map(float, displace(old.lat, old.lon, old.height, x[rows])), strict=True))
            elif name == "att":
                new["q_nb"] = quat_apply_phi_n(old.q_nb, x[rows])
            else:
                new[f"{name}_n"] = getattr(old, f"{name}_n") + x[rows]
            new[f"cov_{name}"] = getattr(old, f"cov_{name}") + P[rows, rows]
        return dataclasses.replace(old, **new)


_Block = tuple[list[_Output], np.ndarray, np.ndarray, np.ndarray]
"""Outputs, newest first, what the first entry gains (n,) and (n, n), and by what gain it gains from later blocks."""


class History:
    """What a filter did, kept for the backward pass; its core reports here while it runs.

    Corrections go to :meth:`correct`, every other change of the error state stands between :meth:`begin` and :meth:`end`; that a
    measurement has reduced the covariance is found at the next of these.  Nothing is kept before the first output and across a :meth:`cut`.
    """

    def __init__(self) -> None:
        self._segments: list[list[_Block]] = [[]]
        self._outputs: list[tuple[int, NavSolution, Mapping[str, np.ndarray]]] = []
        self._x: list[np.ndarray] = []
        self._P: list[np.ndarray] = []
        self._Phi: list[np.ndarray] = []
        self._Q: list[np.ndarray] = []
        self._X = np.zeros(0)

    def cut(self) -> None:
        """End the segment: what comes next has nothing to do with what was."""
        if self._outputs:
            self._close(self._outputs[-1][0] + 1)
            self._segments.append([])

    def correct(self, dx: np.ndarray) -> None:
        """Take a correction (n,), injected in the filter, in."""
        if self._outputs:
            self._X = self._X + dx
            self._corrected = True

    def begin(self, P: np.ndarray) -> np.ndarray:
        """Before a change of the error state other than a correction: return the identity (n, n), to be turned into its transition."""
        if self._outputs and self._corrected:
            self._keep(P)
        self._track = np.eye(len(P))
        return self._track

    def end(self, P: np.ndarray) -> None:
        """After the change: ``P`` (n, n) is the covariance it led to."""
        if self._outputs:
            self._X, self._Phi[-1] = self._track @ self._X, self._track @ self._Phi[-1]
            self._Q[-1] = P - self._Phi[-1] @ self._P[-1] @ self._Phi[-1].T + np.diag(ROUND_OFF * np.diag(P))

    def output(self, solution: NavSolution, P: np.ndarray, rows: Mapping[str, np.ndarray]) -> None:
        """Take a solution in, with the covariance (n, n) of the filter and its quantities (pos, vel, att, wind) by the states (m, n)."""
        known = {name: row for name, row in rows.items() if getattr(solution, f"cov_{name}") is not None}
        if self._outputs:
            self._keep(P)
            if solution.stamp_ns - self._outputs[0][1].stamp_ns >= 1e9 * BLOCK_S:
                self._close(len(self._P))
        if not self._outputs:
            self._x, self._P, self._Phi, self._Q, self._X = [], [], [], [], np.zeros(len(P))
            self._keep(P)
        self._outputs.append((len(self._P) - 1, dataclasses.replace(solution, states=None, integrity=None), known))

    def _keep(self, P: np.ndarray) -> None:
        """Begin an entry: what is known now; the way from here is still nothing."""
        n = len(P)
        self._x.append(self._X)
        self._P.append(P.copy())
        self._Phi.append(np.eye(n))
        self._Q.append(np.diag(ROUND_OFF * np.diag(P)))
        self._corrected = False

    def _close(self, end: int) -> None:
        """Smooth the block, of ``end`` entries; keep what each output gains in it, and by what gain it gains from later ones."""
        x, P, Phi, Q = (np.array(v[:end]) for v in (self._x, self._P, self._Phi, self._Q))
        xs, Ps, K = rts_smoother(x, P, Phi, Q)
        gain, kept = np.eye(x.shape[1]), []
        for k in range(end - 1, -1, -1):
            gain = K[k] @ gain if k < end - 1 else gain
            while self._outputs and self._outputs[-1][0] == k:
                _, solution, rows = self._outputs.pop()
                J, ends = np.vstack(list(rows.values())), np.cumsum([len(r) for r in rows.values()]).tolist()
                places = {name: slice(stop - len(r), stop) for (name, r), stop in zip(rows.items(), ends, strict=True)}
                kept.append(_Output(solution, places, J @ (xs[k] - x[k]), J @ (Ps[k] - P[k]) @ J.T, J @ gain))
        self._segments[-1].append((kept, xs[0] - x[0], Ps[0] - P[0], gain))

    def smoothed(self) -> Iterator[NavSolution]:
        """End the recording; yield the smoothed solutions, oldest first; the last of a segment is the filter's."""
        self.cut()
        for segment in self._segments:
            out: list[NavSolution] = []
            later: tuple[np.ndarray, np.ndarray] | None = None
            for outputs, d, D, gain in reversed(segment):
                d_end, D_end = later or (np.zeros_like(d), np.zeros_like(D))
                out += [output.smoothed(d_end, D_end) for output in outputs]
                later = d + gain @ d_end, D + gain @ D_end @ gain.T
            yield from reversed(out)
