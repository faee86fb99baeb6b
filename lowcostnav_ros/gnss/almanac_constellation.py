"""A constellation out of a YUMA almanac: the satellites that are healthy, where they are at a date.

Good to a few kilometres, a hundredth of a degree seen from the ground: for planning, and as the orbits of a simulated flight, where what
the satellites broadcast is what they fly.
"""

import datetime
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.almanac import parse_yuma
from lowcostnav_ros.gnss.ephemeris import Ephemeris, orbit
from lowcostnav_ros.gnss.gps_time import ROLLOVER_WEEKS, SECOND, WEEK_NS, week_and_tow
from lowcostnav_ros.gnss.signals import GPS, name

LAST_GPS = 32
"""Numbers beyond are of other systems, which some almanacs list too."""
_ROLLOVER_NS = ROLLOVER_WEEKS * WEEK_NS
_ORIGIN = datetime.datetime(1980, 1, 6, tzinfo=datetime.UTC)


@dataclass(frozen=True, slots=True, eq=False)
class AlmanacConstellation:
    """Satellites of an almanac at a date, as columns (n,): ``elements`` (n, 18) of the orbits, ``age_s`` of each at t = 0."""

    system: np.ndarray
    sat_id: np.ndarray
    elements: np.ndarray
    age_s: np.ndarray

    def __len__(self) -> int:
        return len(self.sat_id)

    def states(self, t_s: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) m and velocities (n, 3) m/s, ECEF, at ``t_s`` s, one time or one (n,) each."""
        return _states(self.elements, self.age_s + t_s)


@kernel
def _states(elements, age):
    position, velocity = np.empty((age.size, 3)), np.empty((age.size, 3))
    for k in range(age.size):
        position[k], velocity[k], _, _ = orbit(elements[k], age[k])
    return position, velocity


@dataclass(frozen=True, slots=True, eq=False)
class Almanac:
    """A YUMA almanac, checked.

    Attributes
    ----------
    where : str
        Name of the file, for sentences.
    satellites : list of Ephemeris
        Healthy ones, one each; their weeks are known modulo 1024 only.
    unhealthy : list of str
        Names of those excluded for their health.
    rejected : Counter
        Records rejected, by reason.
    """

    where: str
    satellites: list[Ephemeris]
    unhealthy: list[str]
    rejected: Counter

    @property
    def reference_gps(self) -> int:
        """Latest reference time, GPS time, ns, give or take 1024 weeks."""
        return max(one.toe_ns for one in self.satellites)

    def notes(self) -> list[str]:
        """What was excluded, in sentences."""
        count = len(self.unhealthy)
        noun = "satellite" if count == 1 else "satellites"
        lines = [f"{self.where}: {count} unhealthy {noun} left out ({', '.join(self.unhealthy)})."] if count else []
        return lines + [f"{self.where}: {count} x {reason} left out." for reason, count in sorted(self.rejected.items())]

    def near(self, gps: int) -> list[Ephemeris]:
        """The satellites with their weeks completed to those nearest to a GPS time, ns."""
        def completed(one: Ephemeris) -> Ephemeris:
            shift = round((gps - one.toe_ns) / _ROLLOVER_NS) * _ROLLOVER_NS
            return replace(one, toe_ns=one.toe_ns + shift, toc_ns=one.toc_ns + shift)

        return [completed(one) for one in self.satellites]

    def constellation(self, gps: int, t_s: float = 0.0) -> AlmanacConstellation:
        """The satellites as a constellation whose clock shows ``t_s`` at a GPS time, ns.

        Raises
        ------
        GnssError
            For a time further than half a year from the almanac.
        """
        near = self.near(gps)
        oldest = max(near, key=lambda one: abs(one.age_s(gps)))
        if not oldest.valid_at(gps):
            weeks, limit = (s * SECOND / WEEK_NS for s in (abs(oldest.age_s(gps)), oldest.valid_s))
            raise GnssError(
                f"{self.where} is of {_day(oldest.toe_ns)} (weeks are known modulo 1024), {weeks:.0f} weeks from {_day(gps)}; "
                f"give one of within {limit:.0f} weeks, or another date."
            )
        columns = np.array([one.elements() for one in near]), np.array([one.age_s(gps) for one in near]) - t_s
        return AlmanacConstellation(np.full(len(near), GPS), np.array([one.sat_id for one in near]), *columns)

    def dated(self, gps: int) -> str:
        """State which week its week was taken for at a GPS time, ns."""
        latest = max(self.near(gps), key=lambda one: one.toe_ns)
        week, _ = week_and_tow(latest.toe_ns)
        days = (gps - latest.toe_ns) * 1e-9 / 86400.0
        where = f"{abs(days):.0f} days {'before' if days >= 0.0 else 'after'} the start"
        taken = f"week {week % ROLLOVER_WEEKS} is taken for {week}"
        return f"{self.where}: {len(self.satellites)} satellites; {taken} ({_day(latest.toe_ns)}), the nearest, {where}."


def _day(gps: int) -> str:
    return f"{_ORIGIN + datetime.timedelta(seconds=gps // SECOND):%Y-%m-%d}"


def almanac_from_yuma(text: str, where: str = "almanac") -> Almanac:
    """Read and check a YUMA almanac.

    Parameters
    ----------
    text : str
    where : str
        Name of the file, for sentences.

    Raises
    ------
    GnssError
        When it holds no healthy GPS satellite.
    """
    try:
        records, rejected = parse_yuma(text, 0)
    except GnssError as error:
        raise GnssError(f"{where}: {error}") from error
    of: dict[int, Ephemeris] = {}
    for one in records:
        if not 1 <= one.sat_id <= LAST_GPS:
            rejected["number of no GPS satellite"] += 1
            continue
        rejected.update(["earlier record of a satellite"] if one.sat_id in of else [])
        of[one.sat_id] = one
    healthy = [one for one in of.values() if one.healthy]
    if not healthy:
        raise GnssError(f"{where} has no healthy GPS satellite; get a newer almanac.")
    unhealthy = sorted(name(GPS, one.sat_id) for one in of.values() if not one.healthy)
    return Almanac(where, healthy, unhealthy, rejected)
