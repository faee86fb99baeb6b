"""Where a measurement comes from when there is no message: a row of a recorded table, an instant of the warm-up flight."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, displace
from lowcostnav_ros.physics.mounting import mounting_dcm

M = TypeVar("M")


class _Headed:
    """What gives a measurement its ``head``, stamp and source."""

    head: tuple[Any, str]

    def of(self, make: Callable[..., M], *parts: Any, **named: Any) -> M:
        """Make a measurement of this stamp and source."""
        return make(*self.head, *parts, **named)


@dataclass(frozen=True, slots=True, eq=False)
class TableRow(_Headed):
    """Fields of a table in SI and NED/FRD, as a kind describes them: of one row, or of all rows with a leading axis more.

    ``head`` is that of the measurement, stamp and source; ``mounting_deg`` lists (roll, pitch, yaw) rotations from sensor to body axes,
    the first applied first.
    """

    head: tuple[Any, str]
    values: Mapping[str, Any]
    mounting_deg: tuple[tuple[float, float, float], ...] = ()
    station: str = ""

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    def mounted(self, name: str) -> np.ndarray:
        """Return a field turned from sensor axes into body axes."""
        values, turn = self.values[name], mounting_dcm(self.mounting_deg)
        return values if turn is None else values @ turn.T

    def cov(self) -> np.ndarray:
        """Return the covariance of three sigmas."""
        return np.diag(np.abs(self.values["sigma"]) ** 2)

    def covs(self) -> np.ndarray:
        """Return the covariances (n, 9) of three sigmas in all rows."""
        flat = np.zeros((len(self.values["sigma"]), 9))
        flat[:, ::4] = np.abs(self.values["sigma"]) ** 2
        return flat

    def row(self, k: int) -> "TableRow":
        """Return one of all rows."""
        return replace(self, head=(int(self.head[0][k]), self.head[1]), values={name: column[k] for name, column in self.values.items()})

    def variance(self) -> Any:
        """Return the variance of one sigma."""
        return self.values["sigma"] ** 2


FLIGHT_S, STEP_S = 30.0, 0.2
"""Length of the warm-up flight, and time between its instants."""
BEGIN_NS = 10**18
PLACE = (0.6578, -2.1262, 500.0)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
FORCE = np.array([0.0, 0.0, -STANDARD_GRAVITY])
VELOCITY = np.array([50.0, 0.0, 0.0])


class Instant(_Headed):
    """One instant of a flight straight and level to the north: place (rad, rad, m), stamp, and the source that is to measure."""

    def __init__(self, step: int, source: str) -> None:
        self.stamp_ns, self.source = BEGIN_NS + round(1e9 * STEP_S) * (step + 1), source
        self.place = tuple(float(x) for x in displace(*PLACE, VELOCITY * (STEP_S * step)))
        self.head, self.since_s = (self.stamp_ns, source), 1e-9 * (self.stamp_ns - BEGIN_NS)
