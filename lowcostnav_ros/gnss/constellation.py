"""Simulated constellations on circular orbits: the 24 satellites of Table 6.1 and a Galileo Walker 27/3/1.

    x = R (cos th cos Om - sin th sin Om cos i),  y = R (cos th sin Om + sin th cos Om cos i),  z = R sin th sin i

with th growing once per orbit and the earth-fixed node Om falling once per sidereal day.  The printed y (6-2) has cos Om where sin Om
belongs; at t = 0 the tabulated node is taken as its earth-fixed longitude.

References
----------
Solimeno (2007), Low-cost INS/GPS data fusion, IST Lisbon: sections 6.3, 6.4, Table 6.1, appendix D.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.gnss.gps_time import SECOND, from_calendar
from lowcostnav_ros.gnss.signals import GALILEO, GPS

SIDEREAL_DAY_S = 86164.0
TABLE_EPOCH_GPS_S = from_calendar(1993, 7, 1) / SECOND
"""t = 0 of Table 6.1, s of GPS time."""
_GPS_NODES_DEG = np.repeat([272.847, 332.847, 32.847, 92.847, 152.847, 212.847], 4)
_GPS_ARGUMENTS_DEG = np.array([
    268.126, 161.786, 11.676, 41.806, 80.956, 173.336, 309.976, 204.376, 111.876, 11.796, 339.666, 241.556,
    135.226, 265.446, 35.156, 167.356, 197.046, 302.596, 333.686, 66.066, 238.886, 345.226, 105.206, 135.346,
])  # fmt: skip


class Satellites(Protocol):
    """Satellites wherever their orbits come from: letters of their systems, their numbers, and ``states`` as :class:`Constellation` has."""

    @property
    def system(self) -> np.ndarray: ...

    @property
    def sat_id(self) -> np.ndarray: ...

    def __len__(self) -> int: ...

    def states(self, t_s: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) m and velocities (n, 3) m/s, ECEF, at one time or at one time (n,) each."""


@dataclass(frozen=True, slots=True, eq=False)
class Constellation:
    """Satellites on circular orbits, as columns (n,).

    Attributes
    ----------
    system : ndarray of str
        Letter of the system.
    sat_id : ndarray of int
    node, argument : ndarray
        Earth-fixed longitude of the ascending node and argument of latitude at t = 0, rad.
    inclination, radius_m, period_s : ndarray
        Rad, m, s.
    """

    system: np.ndarray
    sat_id: np.ndarray
    node: np.ndarray
    argument: np.ndarray
    inclination: np.ndarray
    radius_m: np.ndarray
    period_s: np.ndarray

    def __len__(self) -> int:
        return len(self.sat_id)

    def __add__(self, other: "Constellation") -> "Constellation":
        names = self.__dataclass_fields__
        return Constellation(*(np.concatenate((getattr(self, n), getattr(other, n))) for n in names))

    def states(self, t_s: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) m and velocities (n, 3) m/s, ECEF, ``t_s`` s after the constellation's epoch, one time or one (n,) each."""
        times = np.array(np.broadcast_to(np.asarray(t_s, float), len(self)))
        return _states(self.node, self.argument, self.inclination, self.radius_m, self.period_s, times)


@kernel
def _states(node, argument, inclination, radius, period, t):
    position, velocity = np.empty((node.size, 3)), np.empty((node.size, 3))
    node_rate = -2.0 * math.pi / SIDEREAL_DAY_S
    for k in range(node.size):
        rate = 2.0 * math.pi / period[k]
        theta, omega, r = argument[k] + rate * t[k], node[k] + node_rate * t[k], radius[k]
        st, ct, so, co = math.sin(theta), math.cos(theta), math.sin(omega), math.cos(omega)
        si, ci = math.sin(inclination[k]), math.cos(inclination[k])
        x, y = r * (ct * co - st * so * ci), r * (ct * so + st * co * ci)
        position[k, 0], position[k, 1], position[k, 2] = x, y, r * st * si
        velocity[k, 0] = r * rate * (-st * co - ct * so * ci) - y * node_rate
        velocity[k, 1] = r * rate * (-st * so + ct * co * ci) + x * node_rate
        velocity[k, 2] = r * rate * ct * si
    return position, velocity


def gps_24() -> Constellation:
    """GPS at 1993-07-01 00:00 (Table 6.1): 24 satellites, 6 planes, 55 deg, 26559.8 km, 43082 s."""
    ones = np.ones(24)
    return Constellation(
        np.full(24, GPS),
        np.arange(1, 25),
        np.radians(_GPS_NODES_DEG),
        np.radians(_GPS_ARGUMENTS_DEG),
        np.radians(55.0) * ones,
        26559.8e3 * ones,
        43082.0 * ones,
    )


def galileo_27(argument_deg: float = 0.0) -> Constellation:
    """Galileo as planned, Walker 27/3/1: planes 120 deg apart, satellites 40 deg, 56 deg, 29601 km, 50683.96 s.

    Parameters
    ----------
    argument_deg : float
        Argument of latitude of the first satellite; the source does not give the phase relative to GPS.
    """
    plane, slot = np.divmod(np.arange(27), 9)
    ones = np.ones(27)
    return Constellation(
        np.full(27, GALILEO),
        np.arange(1, 28),
        np.radians(120.0 * plane),
        np.radians(argument_deg + 40.0 * slot + 360.0 / 27.0 * plane),
        np.radians(56.0) * ones,
        29601.0e3 * ones,
        50683.96 * ones,
    )


_NAMED = {"gps": gps_24, "galileo": galileo_27, "gps_galileo": lambda: gps_24() + galileo_27()}
NAMES = tuple(_NAMED)


def constellation_named(name: str) -> Constellation:
    """``gps``, ``galileo`` or both, ``gps_galileo``."""
    return _NAMED[name]()


@dataclass(frozen=True, slots=True, eq=False)
class _Together:
    """Two constellations of different kinds, one after the other."""

    first: Satellites
    second: Satellites
    system: np.ndarray
    sat_id: np.ndarray

    def __len__(self) -> int:
        return len(self.sat_id)

    def states(self, t_s: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        times, cut = np.broadcast_to(np.asarray(t_s, float), len(self)), len(self.first)
        pairs = zip(self.first.states(times[:cut]), self.second.states(times[cut:]), strict=True)
        position, velocity = (np.vstack(pair) for pair in pairs)
        return position, velocity


def together(first: Satellites, second: Satellites) -> Satellites:
    """Satellites of two constellations whose orbits come from different sources."""
    names = (np.concatenate((getattr(first, name), getattr(second, name))) for name in ("system", "sat_id"))
    return _Together(first, second, *names)
