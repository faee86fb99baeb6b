"""What leaves a navigator: its solutions, whether one is sound, and sigmas for people."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import overload

import numpy as np

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.cores.rows import Rows
from lowcostnav_ros.estimation import kalman

NO_COVARIANCE, NO_VECTOR = np.zeros((0, 0)), np.zeros(0)


class Solutions(Sequence[NavSolution]):
    """Fused solutions, oldest first: ``parts`` are solutions and rows of numbers, of which one is made when somebody takes it."""

    def __init__(self, parts: Iterable[NavSolution | Rows] = ()) -> None:
        self.parts = list(parts)

    def append(self, part: NavSolution | Rows) -> None:
        """Add one or several."""
        self.parts.append(part)

    def extend(self, others: "Solutions") -> None:
        """Add all of another."""
        self.parts += others.parts

    def between(self, first_ns: int, end_ns: int) -> "Solutions":
        """Those from one stamp to before another."""
        cut = (part.between(first_ns, end_ns) if isinstance(part, Rows) else part for part in self.parts)
        return Solutions(part for part in cut if (len(part) if isinstance(part, Rows) else first_ns <= part.stamp_ns < end_ns))

    def __len__(self) -> int:
        return sum(len(part) if isinstance(part, Rows) else 1 for part in self.parts)

    def __iter__(self) -> Iterator[NavSolution]:
        for part in self.parts:
            if isinstance(part, Rows):
                yield from part
            else:
                yield part

    @overload
    def __getitem__(self, k: int) -> NavSolution: ...
    @overload
    def __getitem__(self, k: slice) -> list[NavSolution]: ...
    def __getitem__(self, k: int | slice) -> NavSolution | list[NavSolution]:
        if isinstance(k, slice):
            return list(self)[k]
        parts, place = (self.parts, k) if k >= 0 else (self.parts[::-1], -1 - k)  # from the nearer end; nothing is made on the way
        for part in parts:
            count = len(part) if isinstance(part, Rows) else 1
            if place < count:
                return part.solution(place if k >= 0 else count - 1 - place) if isinstance(part, Rows) else part
            place -= count
        raise IndexError(f"no solution {k} of {len(self)}")

    def __add__(self, others: Iterable[NavSolution]) -> list[NavSolution]:
        return [*self, *others]

    def __radd__(self, others: Iterable[NavSolution]) -> list[NavSolution]:
        return [*others, *self]


def is_sound(solution: NavSolution) -> bool:
    """Whether all numbers of a solution are finite and no variance is negative: nothing else may leave a navigator."""
    if solution.lat is not None and not math.isfinite(sum(solution.place)):
        return False
    covariances = solution.cov_pos, solution.cov_vel, solution.cov_att, solution.cov_wind
    vectors = solution.vel_n, solution.specific_force_b, solution.q_nb, solution.wind_n, solution.angular_rate_b
    return kalman.are_sound(
        *[NO_COVARIANCE if cov is None else cov if cov.flags.c_contiguous else cov.copy() for cov in covariances],
        *[NO_VECTOR if vector is None else vector if vector.flags.c_contiguous else vector.copy() for vector in vectors],
    )


def position_sigmas(P: np.ndarray) -> dict[str, float]:
    """Sigmas of position and velocity, the first six states of ``P``."""
    s = np.sqrt(np.maximum(np.diag(P), 0.0))
    return {
        "position_horizontal_m": float(np.hypot(s[0], s[1])),
        "position_down_m": float(s[2]),
        "velocity_horizontal_mps": float(np.hypot(s[3], s[4])),
    }
