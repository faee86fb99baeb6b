"""Broadcast ephemerides: satellite position, velocity and clock, when they are valid, and a store that picks the right one.

References
----------
IS-GPS-200, Tables 20-IV and 20.3.3.3.3.1; Galileo OS SIS ICD 5.1; Solimeno (2007), IST Lisbon, appendix A (whose x and y lack cos i and
whose week rollover has the wrong sign).
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.gps_time import SECOND, week_and_tow
from lowcostnav_ros.gnss.signals import SPEED_OF_LIGHT, name

MU = {"G": 3.986005e14, "E": 3.986004418e14}
"""Gravitational constant each system computes its orbits with, m^3/s^2."""
ORBIT_EARTH_RATE = 7.2921151467e-5
"""Rotation of the earth in the orbit formulas, rad/s."""
VALID_S = {"G": 7200.0, "E": 14400.0}
"""How far from its reference time an ephemeris is used, s."""
MAX_ECCENTRICITY = 0.1


@dataclass(frozen=True, slots=True)
class Ephemeris:
    """Orbit and clock of one satellite around a reference time, rad, m, s.

    Attributes
    ----------
    system, sat_id
        Letter and number.
    toe_ns, toc_ns : int
        Reference times of orbit and clock, GPS time, ns.
    af0, af1, af2 : float
        Clock ahead of system time, s, s/s, s/s^2.
    group_delay_s : float
        Group delay of the single-frequency L1/E1 user (TGD, BGD), s.
    ura_m : float
        1-sigma range accuracy the satellite claims, m.
    healthy : bool
    issue : int
        Issue of data.
    valid_s : float
        Used up to this far from ``toe_ns``.
    """

    system: str
    sat_id: int
    toe_ns: int
    toc_ns: int
    sqrt_a: float
    eccentricity: float
    mean_anomaly: float
    node: float
    inclination: float
    perigee: float
    node_rate: float
    inclination_rate: float = 0.0
    motion_correction: float = 0.0
    cuc: float = 0.0
    cus: float = 0.0
    crc: float = 0.0
    crs: float = 0.0
    cic: float = 0.0
    cis: float = 0.0
    af0: float = 0.0
    af1: float = 0.0
    af2: float = 0.0
    group_delay_s: float = 0.0
    ura_m: float = 2.0
    healthy: bool = True
    issue: int = 0
    valid_s: float = 7200.0

    def __post_init__(self) -> None:
        bad = not (1000.0 < self.sqrt_a < 10000.0 and 0.0 <= self.eccentricity < MAX_ECCENTRICITY)
        if bad or not all(math.isfinite(getattr(self, field)) for field in self.__dataclass_fields__ if field != "system"):
            raise GnssError(
                f"The ephemeris of {name(self.system, self.sat_id)} is no satellite orbit (root of axis {self.sqrt_a:g}, "
                f"eccentricity {self.eccentricity:g}); leave it out."
            )

    def age_s(self, gps: int) -> float:
        """Time from the reference time, s, negative before it; full times, so a week rollover needs no care."""
        return (gps - self.toe_ns) / SECOND

    def valid_at(self, gps: int) -> bool:
        """Whether ``gps`` (ns) lies in the span the ephemeris is meant for."""
        return abs(self.age_s(gps)) <= self.valid_s

    def elements(self) -> np.ndarray:
        """Columns that :func:`orbit` takes, shape (18,)."""
        toe_s = week_and_tow(self.toe_ns)[1]
        orbit_ = (self.sqrt_a, self.eccentricity, self.mean_anomaly, self.node, self.inclination, self.perigee, self.node_rate)
        rates = (self.inclination_rate, self.motion_correction)
        harmonics = (self.cuc, self.cus, self.crc, self.crs, self.cic, self.cis)
        return np.array([*orbit_, *rates, *harmonics, toe_s, MU[self.system], 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class SatelliteState:
    """ECEF position m and velocity m/s at a time, in the frame of that time; clock ahead of system time, s, and its rate, s/s.

    The clock holds the relativistic part and, for the L1/E1 code user, minus the group delay.
    """

    position_e: np.ndarray
    velocity_e: np.ndarray
    clock_s: float
    clock_rate: float


def satellite_state(ephemeris: Ephemeris, gps: int) -> SatelliteState:
    """State of a satellite at a GPS time, ns (of transmission), whatever the age of the ephemeris."""
    position, velocity, e_sin, e_cos_rate = orbit(ephemeris.elements(), ephemeris.age_s(gps))
    mu_root = math.sqrt(MU[ephemeris.system])
    relativity = -2.0 * mu_root / SPEED_OF_LIGHT**2 * ephemeris.sqrt_a
    dt = (gps - ephemeris.toc_ns) / SECOND
    clock = ephemeris.af0 + dt * (ephemeris.af1 + dt * ephemeris.af2) + relativity * e_sin - ephemeris.group_delay_s
    return SatelliteState(position, velocity, clock, ephemeris.af1 + 2.0 * ephemeris.af2 * dt + relativity * e_cos_rate)


@kernel
def eccentric_anomaly(mean_anomaly, eccentricity):
    """Solve Kepler's equation M = E - e sin E by Newton's method, rad."""
    anomaly = mean_anomaly + eccentricity * math.sin(mean_anomaly)
    for _ in range(10):
        step = (anomaly - eccentricity * math.sin(anomaly) - mean_anomaly) / (1.0 - eccentricity * math.cos(anomaly))
        anomaly -= step
        if abs(step) < 1e-15:
            break
    return anomaly


@kernel
def orbit(p, t):
    """Position (3,) and velocity (3,), ECEF, ``t`` s from the reference time, with e sin E and its rate for the relativistic clock.

    ``p`` (18,) comes from :meth:`Ephemeris.elements`; the velocity is the exact derivative of the position.
    """
    e, mu, axis = p[1], p[16], p[0] * p[0]
    motion = math.sqrt(mu / (axis * axis * axis)) + p[8]
    big_e = eccentric_anomaly(p[2] + motion * t, e)
    se, ce = math.sin(big_e), math.cos(big_e)
    e_rate = motion / (1.0 - e * ce)
    flat = math.sqrt(1.0 - e * e)
    phi = math.atan2(flat * se, ce - e) + p[5]
    phi_rate = flat * e_rate / (1.0 - e * ce)
    s2, c2 = math.sin(2.0 * phi), math.cos(2.0 * phi)
    u = phi + p[10] * s2 + p[9] * c2
    r = axis * (1.0 - e * ce) + p[12] * s2 + p[11] * c2
    incl = p[4] + p[7] * t + p[14] * s2 + p[13] * c2
    u_rate = phi_rate * (1.0 + 2.0 * (p[10] * c2 - p[9] * s2))
    r_rate = axis * e * se * e_rate + 2.0 * phi_rate * (p[12] * c2 - p[11] * s2)
    i_rate = p[7] + 2.0 * phi_rate * (p[14] * c2 - p[13] * s2)
    node_rate = p[6] - ORBIT_EARTH_RATE
    node = p[3] + node_rate * t - ORBIT_EARTH_RATE * p[15]
    position, velocity = _to_earth(r, r_rate, u, u_rate, incl, i_rate, node, node_rate)
    return position, velocity, e * se, e * ce * e_rate


@kernel
def _to_earth(r, r_rate, u, u_rate, incl, i_rate, node, node_rate):
    """Turn polar coordinates in the orbital plane into ECEF."""
    su, cu, si, ci = math.sin(u), math.cos(u), math.sin(incl), math.cos(incl)
    so, co = math.sin(node), math.cos(node)
    x, y = r * cu, r * su
    vx, vy = r_rate * cu - y * u_rate, r_rate * su + x * u_rate
    position, velocity = np.empty(3), np.empty(3)
    position[0], position[1], position[2] = x * co - y * ci * so, x * so + y * ci * co, y * si
    velocity[0] = vx * co - vy * ci * so + y * si * so * i_rate - position[1] * node_rate
    velocity[1] = vx * so + vy * ci * co - y * si * co * i_rate + position[0] * node_rate
    velocity[2] = vy * si + y * ci * i_rate
    return position, velocity


class EphemerisStore:
    """Ephemerides by satellite; picks the one nearest in time, or gives the reason when there is none."""

    def __init__(self, ephemerides: Iterable[Ephemeris] = ()) -> None:
        self._of: dict[tuple[str, int], list[Ephemeris]] = {}
        self.rejected: Counter[str] = Counter()
        for ephemeris in ephemerides:
            self.add(ephemeris)

    def __len__(self) -> int:
        return sum(len(kept) for kept in self._of.values())

    def __iter__(self) -> Iterator[Ephemeris]:
        return (ephemeris for kept in self._of.values() for ephemeris in kept)

    def add(self, ephemeris: Ephemeris) -> None:
        """Add one; the same reference time and issue again is a repeat and counted, a later upload for a time replaces the earlier."""
        kept = self._of.setdefault((ephemeris.system, ephemeris.sat_id), [])
        for k, known in enumerate(kept):
            if known.toe_ns == ephemeris.toe_ns:
                self.rejected["repeated ephemeris" if known.issue == ephemeris.issue else "replaced ephemeris"] += 1
                kept[k] = ephemeris
                return
        kept.append(ephemeris)

    def satellites(self) -> list[tuple[str, int]]:
        """Satellites with at least one ephemeris, sorted."""
        return sorted(self._of)

    def latest(self, system: str, sat_id: int) -> Ephemeris:
        """The ephemeris of a satellite with the latest reference time; KeyError when there is none."""
        return max(self._of[system, sat_id], key=lambda ephemeris: ephemeris.toe_ns)

    def find(self, system: str, sat_id: int, gps: int) -> tuple[Ephemeris | None, str]:
        """Return the ephemeris to use at a GPS time (ns) and an empty text, or None and why: absent, unhealthy or out of date."""
        kept = self._of.get((system, int(sat_id)))
        if not kept:
            return None, "no ephemeris"
        nearest = min(kept, key=lambda ephemeris: abs(ephemeris.age_s(gps)))
        if not nearest.valid_at(gps):
            return None, "ephemeris out of date"
        if not nearest.healthy:
            return None, "satellite unhealthy"
        return nearest, ""
