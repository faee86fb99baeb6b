"""Solutions of an inertial core as rows of numbers, written where they fall due; objects are made of those that somebody takes.

A row holds, n being the number of error states and m = n - 9: lat, lon, height, velocity NED, q_nb (10); the covariances of position,
velocity and attitude (27); specific force and rate (6); the estimates of the further states and their variances (2 m); the covariance of
the wind (4).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import Health, Integrity, NavSolution, States

COVARIANCES, FORCE, RATE, FURTHER = slice(10, 37), slice(37, 40), slice(40, 43), 43
NO_WIND = -1


def width_of(size: int) -> int:
    """Numbers in a row of a core with ``size`` error states."""
    return FURTHER + 2 * (size - 9) + 4


@kernel
def write(nav, P, added, estimate, force_b, rate_b, wind, row):
    """Write a solution into ``row``; return whether its numbers are finite and no variance is negative.

    ``added`` (9, 9) is what the covariance is more than P; ``wind`` the first of the two states of the wind, :data:`NO_WIND` for none.
    """
    n = P.shape[0]
    m, total, is_sound = n - 9, 0.0, True
    for i in range(10):
        row[i] = nav[i]
        total += nav[i]
    for b in range(3):
        for i in range(3):
            for j in range(3):
                value = P[3 * b + i, 3 * b + j] + added[3 * b + i, 3 * b + j]
                row[10 + 9 * b + 3 * i + j] = value
                total += value
            is_sound = is_sound and row[10 + 9 * b + 4 * i] >= 0.0
    for i in range(3):
        row[37 + i], row[40 + i] = force_b[i], rate_b[i]
        total += force_b[i] + rate_b[i]
    for i in range(m):
        row[43 + i], row[43 + m + i] = estimate[9 + i], P[9 + i, 9 + i]
    for i in range(2 if wind >= 0 else 0):
        for j in range(2):
            row[43 + 2 * m + 2 * i + j] = P[wind + i, wind + j]
            total += P[wind + i, wind + j]
        total += estimate[wind + i]
        is_sound = is_sound and P[wind + i, wind + i] >= 0.0
    return is_sound and np.isfinite(total)


@dataclass(slots=True, eq=False)
class Rows:
    """Solutions of a navigator that share all but their numbers; what they say of themselves, ``health``, by the number of the row."""

    source: str
    stamps_ns: np.ndarray
    table: np.ndarray
    labels: tuple[str, ...]
    wind: int
    mode: str
    integrity: Integrity | None = None
    health: dict[int, Health] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the last."""
        return int(self.stamps_ns[-1])

    @property
    def first_of_wind(self) -> int | None:
        """Column of the wind, None where it is not given."""
        return None if self.wind == NO_WIND else FURTHER + self.wind - 9

    def between(self, first_ns: int, end_ns: int) -> "Rows":
        """Those from one stamp to before another."""
        a, b = np.searchsorted(self.stamps_ns, (first_ns, end_ns)).tolist()
        if a == 0 and b == len(self):
            return self
        health = {k - a: said for k, said in self.health.items() if a <= k < b}
        return replace(self, stamps_ns=self.stamps_ns[a:b], table=self.table[a:b], health=health)

    def __iter__(self) -> Iterator[NavSolution]:
        return map(self.solution, range(len(self)))

    def solution(self, k: int) -> NavSolution:
        """One of them."""
        row, m = self.table[k], len(self.labels)
        lat, lon, height = row[:3].tolist()
        cov = row[COVARIANCES].reshape(3, 3, 3)
        values, wind = row[FURTHER : FURTHER + m], self.first_of_wind
        return NavSolution(
            *(int(self.stamps_ns[k]), self.source, lat, lon, height, row[3:6], row[6:10], row[RATE], row[FORCE], cov[0], cov[1], cov[2]),
            wind_n=None if wind is None else row[wind : wind + 2],
            cov_wind=None if wind is None else row[FURTHER + 2 * m :].reshape(2, 2),
            mode=self.mode,
            states=States(self.labels, values, row[FURTHER + m : FURTHER + 2 * m]),
            integrity=self.integrity,
            health=self.health.get(k),
        )


class Page:
    """Where a core writes the solutions that fall due: up to ``room`` of them, and no further once one is due at ``until_ns`` or later.

    Attributes
    ----------
    added : ndarray, shape (9, 9)
        What the covariances are more than those of the core.
    wind : int
        First of the states of the wind; :data:`NO_WIND`: it is not given.
    stamps_ns, table : ndarray, shape (k,), (k, width)
    is_lost : bool
        Whether a solution was none, and is left out.
    """

    def __init__(self, size: int, room: int, until_ns: int, added: np.ndarray, wind: int) -> None:
        self.until_ns, self.added, self.wind, self.is_lost = until_ns, added, wind, False
        self.stamps_ns, self.table = np.empty(room, np.int64), np.empty((room, width_of(size)))

    def close(self, count: int, *, is_lost: bool) -> None:
        """Keep the first ``count`` rows."""
        self.stamps_ns, self.table, self.is_lost = self.stamps_ns[:count], self.table[:count], is_lost


NO_PAGE = Page(9, 0, -(2**62), np.zeros((9, 9)), NO_WIND)
"""Nothing is written, and every solution that falls due is stopped at."""
