"""Raw observations of one epoch, as a receiver gives them, with what cannot be right excluded and counted."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

SHORTEST_M, LONGEST_M = 1.5e7, 6.0e7
"""Pseudoranges outside cannot be: a Galileo satellite on the horizon is 2.9e7 m away; clocks may be off by 0.1 s."""


@dataclass(frozen=True, slots=True, eq=False)
class RawEpoch:
    """Uncorrected observations, columns of n signals.

    Attributes
    ----------
    gps_ns : int
        Time of reception by the receiver's clock, GPS time, ns.
    system : ndarray of str, shape (n,)
    sat_id : ndarray of int, shape (n,)
    pseudorange_m : ndarray, shape (n,)
    doppler_mps : ndarray, shape (n,)
        Range rate, positive receding; NaN where not measured.
    cn0 : ndarray, shape (n,)
        dB-Hz, 0 where not given.
    """

    gps_ns: int
    system: np.ndarray
    sat_id: np.ndarray
    pseudorange_m: np.ndarray
    doppler_mps: np.ndarray
    cn0: np.ndarray

    def __len__(self) -> int:
        return len(self.sat_id)

    def rows(self, rows: np.ndarray) -> "RawEpoch":
        """The same epoch with some signals only."""
        columns = (getattr(self, name)[rows] for name in self.__dataclass_fields__ if name != "gps_ns")
        return RawEpoch(self.gps_ns, *columns)

    def satellites(self) -> list[tuple[str, int]]:
        """System and number of each signal."""
        return [(str(s), int(k)) for s, k in zip(self.system, self.sat_id, strict=True)]


def screened(epoch: RawEpoch, rejected: Counter) -> RawEpoch:
    """Exclude what cannot be right, counting reasons in ``rejected``.

    Impossible pseudoranges (not finite, or outside 15000 to 60000 km) go alone.  Of a satellite that appears twice every copy goes:
    there is no way to decide which one is right.
    """
    with np.errstate(invalid="ignore"):
        possible = (epoch.pseudorange_m >= SHORTEST_M) & (epoch.pseudorange_m <= LONGEST_M)
    copies = Counter(epoch.satellites())
    single = np.array([copies[satellite] == 1 for satellite in epoch.satellites()], dtype=bool)
    for reason, bad in (("duplicate satellite", ~single), ("impossible pseudorange", single & ~possible)):
        if np.any(bad):
            rejected[reason] += int(np.count_nonzero(bad))
    return epoch.rows(np.flatnonzero(possible & single))
