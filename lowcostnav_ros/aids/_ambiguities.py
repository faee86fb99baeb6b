"""Carrier ambiguities as states that come and go: a state for each transmitter tracked, while it is tracked."""

from typing import Any

import numpy as np

from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.carrier_model import renewed


class Ambiguities:
    """Which state holds the ambiguity of which transmitter.

    Parameters
    ----------
    rows : slice
        States of the block.
    sigma : float
        Of a state that holds none, cycles.
    """

    def __init__(self, rows: slice, sigma: float) -> None:
        self._sigma = sigma
        self._free = list(range(rows.start, rows.stop))
        self._held: dict[str, int] = {}

    def __iter__(self) -> Any:
        return iter(tuple(self._held))

    def index(self, ident: str) -> int:
        """State of a transmitter, -1 for none."""
        return self._held.get(ident, -1)

    def renew(
        self, ident: str, cycles: float, row: np.ndarray, variance: float, P: np.ndarray, estimate: np.ndarray, history: Any = None
    ) -> bool:
        """Begin an arc: the ambiguity is ``cycles``, its error ``row`` (n,) times those of the other states plus noise of ``variance``.

        Returns False where no state is free.
        """
        if ident not in self._held:
            if not self._free:
                return False
            self._held[ident] = self._free.pop(0)
        k = self._held[ident]
        if history is not None:
            track = history.begin(P)
            track[k] = row @ track
        renewed(P, row, k, variance)
        if history is not None:
            history.end(P)
        estimate[k] = cycles
        return True

    def drop(self, ident: str, P: np.ndarray, estimate: np.ndarray, history: Any = None) -> None:
        """Forget the ambiguity of a transmitter; its state is free."""
        k = self._held.pop(ident)
        kalman.reset_block(P, slice(k, k + 1), np.array([[self._sigma**2]]), history)
        estimate[k] = 0.0
        self._free.append(k)
