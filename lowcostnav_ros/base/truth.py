"""Truth: what trajectories produce, simulators corrupt and reports compare with. No estimator ever sees it."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class TruthBlock:
    """Consecutive true states at the inertial sample times, as columns.

    Attributes
    ----------
    stamps_ns : ndarray of int64, shape (n,)
    lat, lon, height : ndarray, shape (n,)
        Rad, rad, m above the ellipsoid.
    vel_n : ndarray, shape (n, 3)
        m/s, NED.
    q_nb : ndarray, shape (n, 4)
        Hamilton, scalar first.
    specific_force_b, angular_rate_b : ndarray, shape (n, 3)
        Mean over the interval that ends at the stamp (an ideal integrating IMU), m/s^2 and rad/s.
    wind_n : ndarray, shape (n, 3)
        Velocity of the air mass at the aircraft, m/s, NED (turbulence included).
    """

    stamps_ns: np.ndarray
    lat: np.ndarray
    lon: np.ndarray
    height: np.ndarray
    vel_n: np.ndarray
    q_nb: np.ndarray
    specific_force_b: np.ndarray
    angular_rate_b: np.ndarray
    wind_n: np.ndarray

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, rows: slice | np.ndarray) -> "TruthBlock":
        return TruthBlock(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    @classmethod
    def joined(cls, blocks: "Iterable[TruthBlock]") -> "TruthBlock":
        """Return consecutive blocks as one."""
        parts = list(blocks)
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__dataclass_fields__))
