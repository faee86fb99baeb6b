"""Which states of an inertial filter are observable, along a run.

At every fused instant the measurement rows and the continuous dynamics F give the observability matrix [H', F'H', ..., (F')^(n-1) H'],
local in time: over minutes, flight that changes direction makes more states observable than any instant.  Rank and singular values depend
on units.  The published ranks of the INS/GPS thesis belong to positions in radians and metres up and the default tolerance of a
singular-value decomposition; :func:`geodetic_units` gives those, and they are what is reported.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.estimation.aiding import AidStatus
from lowcostnav_ros.gnss.observability import observability_matrix
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.physics.earth import radii


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """Observability of one instant.

    Attributes
    ----------
    stamp_ns : int
    rows : int
        Scalar measurements fused at this instant.
    rank : int
        Observable states, or combinations of them.
    singular_values : ndarray, shape (n,)
        Of the observability matrix, largest first.
    share : ndarray, shape (n,)
        How much of each state lies in the observable space: 1 wholly, 0 not at all.
    """

    stamp_ns: int
    rows: int
    rank: int
    singular_values: np.ndarray
    share: np.ndarray


def geodetic_units(lat: float, height: float, size: int) -> np.ndarray:
    """Factors (n,) that turn an error state in metres north, east, down into radians of latitude and longitude and metres up."""
    meridian, normal = radii(lat)
    out = np.ones(size)
    out[:3] = 1.0 / (meridian + height), 1.0 / ((normal + height) * np.cos(lat)), -1.0
    return out


def observability(stamp_ns: int, F: np.ndarray, H: np.ndarray, units: np.ndarray | None = None) -> Observability:
    """Rank, singular values and share of each state from dynamics ``F`` (n, n) and rows ``H`` (m, n).

    Parameters
    ----------
    units : ndarray, shape (n,), optional
        Factors that change the unit of each state (:func:`geodetic_units`); none by default.
    """
    n = len(F)
    if len(H) == 0:
        return Observability(stamp_ns, 0, 0, np.zeros(n), np.zeros(n))
    u = np.ones(n) if units is None else units
    matrix = observability_matrix(u[:, None] * F / u, H / u)
    left, values, _ = np.linalg.svd(matrix, full_matrices=False)
    rank = int(np.count_nonzero(values > values[0] * max(matrix.shape) * np.finfo(float).eps))
    return Observability(stamp_ns, len(H), rank, values, np.sum(left[:, :rank] ** 2, axis=1))


class Watch:
    """Follow a navigator and note, at most once a period, how observable its states are; it changes nothing the navigator computes.

    Parameters
    ----------
    navigator : Navigator
        Its core has ``nav`` (lat, lon, height, ...), ``layout`` and ``dynamics()``; the error state begins with the position north, east,
        down.  An observer of its aids that is set already is kept.
    period_s : float
    """

    def __init__(self, navigator: Navigator, period_s: float = 1.0) -> None:
        self.navigator, self.period_ns = navigator, round(1e9 * period_s)
        self.found: list[Observability] = []
        self._rows: list[np.ndarray] = []
        self._F = np.empty((0, 0))
        self._stamp_ns = -1
        self._next_ns = 0
        self._on_aid = navigator.on_aid
        navigator.on_aid = self._watched

    def finish(self) -> list[Observability]:
        """Evaluate the last instant, release the navigator and return what was found, in order of time."""
        self._judge()
        self.navigator.on_aid = self._on_aid
        return self.found

    def _watched(self, status: AidStatus) -> None:
        if status.stamp_ns != self._stamp_ns:
            self._judge()
            self._stamp_ns = status.stamp_ns
        if status.accepted and status.stamp_ns >= self._next_ns:
            aid = next(aid for aid in self.navigator.aids if aid.status is status)
            if aid.applied is not None:
                self._rows.append(aid.applied.H)
            self._F = self.navigator.core.dynamics()
        if self._on_aid is not None:
            self._on_aid(status)

    def _judge(self) -> None:
        if not self._rows:
            return
        nav = self.navigator.core.nav
        units = geodetic_units(nav[0], nav[2], len(self._F))
        self.found.append(observability(self._stamp_ns, self._F, np.vstack(self._rows), units))
        self._rows = []
        self._next_ns = self._stamp_ns + self.period_ns - 1_000_000
