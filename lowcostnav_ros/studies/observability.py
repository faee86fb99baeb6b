"""Which states an inertial filter's measurements can tell, along a run.

At every fused instant the measurement rows and the continuous dynamics F give the observability matrix [H', F'H', ..., (F')^(n-1) H'],
local in time: flight that changes direction tells over minutes what no instant does.  Rank and singular values depend on units.  The
published ranks of the INS/GPS thesis belong to positions in radians and metres up and the default tolerance of a singular-value
decomposition; :func:`geodetic_units` gives those, and they are what is reported.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.estimation.aiding import Innovation
from lowcostnav_ros.gnss.observability import observability_matrix
from lowcostnav_ros.physics.earth import radii


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """What one instant can tell.

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
    """Follow a navigator and note, at most once a period, what its measurements can tell.

    It steps between the navigator and its aids, and changes nothing the navigator computes.

    Parameters
    ----------
    navigator : Navigator
        With ``use_aid`` and ``core`` or ``state``, which holds ``nav`` (lat, lon, height, ...) and ``layout``; the error state begins with
        the position north, east, down.
    dynamics : callable
        Gives F (n, n) of the navigator as it is now (:func:`lowcostnav_ros.studies.dynamics.dynamics_of`).
    period_s : float
    """

    def __init__(self, navigator: Any, dynamics: Callable[[Any], np.ndarray], period_s: float = 1.0) -> None:
        self.navigator, self.period_ns = navigator, round(1e9 * period_s)
        self.found: list[Observability] = []
        self._dynamics = dynamics
        self._rows: list[np.ndarray] = []
        self._stamp_ns = 0
        self._next_ns = 0
        self._use_aid = navigator.use_aid
        navigator.use_aid = self._watched

    def finish(self) -> list[Observability]:
        """Judge the last instant, let go of the navigator and return what was found, in order of time."""
        self._judge()
        self.navigator.use_aid = self._use_aid
        return self.found

    def _watched(self, aid: Any, measurement: Measurement) -> bool:
        if measurement.stamp_ns != self._stamp_ns:
            self._judge()
            self._stamp_ns = measurement.stamp_ns
        used = self._use_aid(aid, measurement)
        if used and measurement.stamp_ns >= self._next_ns:
            self._rows += [rows for rows in _rows_of(aid, measurement, self.navigator) if len(rows)]
        return used

    def _judge(self) -> None:
        if not self._rows:
            return
        core = filter_of(self.navigator)
        F = self._dynamics(self.navigator)
        units = geodetic_units(core.nav[0], core.nav[2], core.layout.size)
        self.found.append(observability(self._stamp_ns, F, np.vstack(self._rows), units))
        self._rows = []
        self._next_ns = self._stamp_ns + self.period_ns - 1_000_000


def filter_of(navigator: Any) -> Any:
    """The part of a navigator that holds its mean state ``nav`` and the ``layout`` of its error state."""
    return navigator.core if hasattr(navigator, "core") else navigator.state


def _rows_of(aid: Any, measurement: Measurement, host: Any) -> Iterator[np.ndarray]:
    """Measurement rows an aid has just used: kept by those that fuse part of a message, computed anew by the others."""
    if hasattr(aid, "fused_rows"):
        yield aid.fused_rows
        return
    innovation = aid.innovation(measurement, host)
    if isinstance(innovation, Innovation):
        yield innovation.H
