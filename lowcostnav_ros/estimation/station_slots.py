"""Slow errors of ground stations as states: a few states, as many stations as are received."""

from typing import Any

import numpy as np

from lowcostnav_ros.estimation import kalman


class StationSlots:
    """Which station's error each state of a block holds; a new station takes the state that was idle the longest.

    Parameters
    ----------
    rows : slice or None
        States of the block in the error state; None where these errors are no states.
    sigma : float
        Sigma of the error of a station not received before, in the unit of the states.
    """

    def __init__(self, rows: slice | None, sigma: float) -> None:
        self._rows, self._variance = rows, sigma**2
        self._slots: dict[str, int] = {}
        self._used_ns = [] if rows is None else [0] * (rows.stop - rows.start)

    def index(self, station: str) -> int | None:
        """State that holds the error of a station, None when no state does."""
        return None if self._rows is None or station not in self._slots else self._rows.start + self._slots[station]

    def take(self, station: str, now_ns: int, P: np.ndarray, estimate: np.ndarray, history: Any = None) -> int | None:
        """Return the state of a station, resetting it in ``P`` (n, n) and ``estimate`` (n,) if need be; None without states."""
        if self._rows is None:
            return None
        if station not in self._slots:
            slot = min(range(len(self._used_ns)), key=lambda i: (self._used_ns[i], i))
            self._slots = {name: i for name, i in self._slots.items() if i != slot}
            self._slots[station] = slot
            index = self._rows.start + slot
            kalman.reset_block(P, slice(index, index + 1), np.array([[self._variance]]), history)
            estimate[index] = 0.0
        self._used_ns[self._slots[station]] = now_ns
        return self.index(station)
