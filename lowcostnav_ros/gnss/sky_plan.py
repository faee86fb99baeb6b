"""Which satellites a place sees over some hours, how good their geometry is, and when it is not good enough."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.constellation import Satellites
from lowcostnav_ros.gnss.dop import NO_SOLUTION, Dops, dops, to_ned
from lowcostnav_ros.gnss.error_budget import range_covariance
from lowcostnav_ros.gnss.observables import azimuth_elevation, line_of_sight
from lowcostnav_ros.gnss.signals import name
from lowcostnav_ros.physics.earth import geodetic_to_ecef

Lowest = Callable[[np.ndarray], np.ndarray]
"""Lowest visible elevation (n,), rad, towards azimuths (n,), rad."""


@dataclass(frozen=True, slots=True)
class Window:
    """A stretch from ``start_s`` to ``end_s`` of the plan without a good position: fewest satellites, worst PDOP (``inf``: none)."""

    start_s: float
    end_s: float
    fewest: int
    worst_pdop: float


@dataclass(frozen=True, slots=True, eq=False)
class SkyPlan:
    """Satellites over time at a place.

    Attributes
    ----------
    names : tuple of str
        The n satellites.
    time_s : ndarray, shape (m,)
        From the start of the plan.
    azimuth, elevation : ndarray, shape (m, n)
        Rad.
    visible : ndarray of bool, shape (m, n)
    dops : list of Dops
        At each time, one receiver clock for all systems; infinite below four satellites.
    effective : list of Dops
        The same for range errors that grow to the horizon and are partly common (equations 2-40 and 2-41).
    step_s : float
    """

    names: tuple[str, ...]
    time_s: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    visible: np.ndarray
    dops: list[Dops]
    effective: list[Dops]
    step_s: float

    @property
    def counts(self) -> np.ndarray:
        """Satellites in view at each time."""
        return self.visible.sum(axis=1)

    def column(self, dop: str, effective: bool = False) -> np.ndarray:
        """One dilution over time, such as ``pdop``."""
        return np.array([getattr(one, dop) for one in (self.effective if effective else self.dops)])

    def windows(self, pdop_limit: float) -> list[Window]:
        """Stretches in which the PDOP is above a limit or there is no position, longest first."""
        poor = np.concatenate(([False], ~(self.column("pdop") <= pdop_limit), [False]))
        edges = np.flatnonzero(poor[1:] != poor[:-1])
        found = [self._window(int(first), int(end)) for first, end in zip(edges[0::2], edges[1::2], strict=True)]
        return sorted(found, key=lambda window: window.start_s - window.end_s)

    def _window(self, first: int, end: int) -> Window:
        rows = slice(first, end)
        end_s = min(float(self.time_s[end - 1] + self.step_s), float(self.time_s[-1]))
        return Window(float(self.time_s[first]), end_s, int(self.counts[rows].min()), float(self.column("pdop")[rows].max()))


def plan_sky(
    satellites: Satellites,
    place: tuple[float, float, float],
    lowest: Lowest,
    hours: float,
    start_s: float = 0.0,
    step_s: float = 60.0,
    advance: Callable[[float], None] | None = None,
) -> SkyPlan:
    """Work out which satellites a place sees.

    Parameters
    ----------
    satellites : Satellites
    place : (lat, lon, height)
        Rad, rad, m above the ellipsoid.
    lowest : callable
        Elevation from which a satellite is seen.
    hours : float
        Length.
    start_s : float
        Time of the constellation at the start.
    step_s : float
        Time between looks.
    advance : callable, optional
        Called with the share done.

    Raises
    ------
    GnssError
        For a length or step that is not positive or gives more than 100000 looks.
    """
    if not (hours > 0.0 and step_s > 0.0 and 3600.0 * hours / step_s <= 1e5):
        raise GnssError(f"{hours:g} hours in steps of {step_s:g} s cannot be planned; give fewer hours or longer steps.")
    times = np.arange(0.0, 3600.0 * hours + 0.5 * step_s, step_s)
    position_e = geodetic_to_ecef(*place)
    azimuth, elevation = np.empty((2, len(times), len(satellites)))
    visible = np.empty(azimuth.shape, dtype=bool)
    dilutions, effective = [], []
    for k, t_s in enumerate(times):
        _, los = line_of_sight(position_e, satellites.states(start_s + float(t_s))[0])
        azimuth[k], elevation[k] = azimuth_elevation(place[0], place[1], los)
        visible[k] = elevation[k] >= lowest(azimuth[k])
        seen_n, seen_up = to_ned(place[0], place[1], los[visible[k]]), np.maximum(elevation[k][visible[k]], 0.0)
        enough = len(seen_n) >= 4
        dilutions.append(dops(seen_n) if enough else NO_SOLUTION)
        effective.append(dops(seen_n, range_covariance(seen_up, 1.0)) if enough else NO_SOLUTION)
        if advance is not None and k % 100 == 0:
            advance(k / len(times))
    names = tuple(name(s, i) for s, i in zip(satellites.system, satellites.sat_id, strict=True))
    return SkyPlan(names, times, azimuth, elevation, visible, dilutions, effective, step_s)
