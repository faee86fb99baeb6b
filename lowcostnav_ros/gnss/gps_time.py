"""GPS time: weeks, time of week, calendar dates and leap seconds.

Inside, a GPS time is ``gps_ns``, integer nanoseconds since 1980-01-06 00:00:00 of GPS time, which has no leap seconds.  A stamp of a
measurement is UTC, integer nanoseconds since 1970 as ROS counts them; :func:`unix_ns` and :func:`gps_ns` convert.

References
----------
IS-GPS-200, sections 3.3.4 and 20.3.3.5.2.4; IERS Bulletin C for the leap seconds.
"""

import bisect
import calendar
import math

from lowcostnav_ros.gnss import GnssError

SECOND = 1_000_000_000
WEEK_S = 604800
WEEK_NS = WEEK_S * SECOND
ROLLOVER_WEEKS = 1024
"""The navigation message counts weeks modulo this."""
GPS_EPOCH_UNIX_S = 315964800
_LEAP_DATES = (
    (1981, 7), (1982, 7), (1983, 7), (1985, 7), (1988, 1), (1990, 1), (1991, 1), (1992, 7), (1993, 7),
    (1994, 7), (1996, 1), (1997, 7), (1999, 1), (2006, 1), (2009, 1), (2012, 7), (2015, 7), (2017, 1),
)  # fmt: skip
_LEAPS_UTC_S = [calendar.timegm((year, month, 1, 0, 0, 0)) for year, month in _LEAP_DATES]
"""UTC seconds since 1970 from which GPS - UTC is one second more."""
_LEAPS_GPS_S = [utc_s - GPS_EPOCH_UNIX_S + count for count, utc_s in enumerate(_LEAPS_UTC_S)]
"""GPS seconds at which each inserted second begins."""


def leap_seconds(gps: int) -> int:
    """GPS minus UTC, s, at a GPS time in ns; an inserted second itself already counts as the new value."""
    return bisect.bisect_right(_LEAPS_GPS_S, gps // SECOND)


def unix_ns(gps: int) -> int:
    """UTC stamp, ns since 1970, of a GPS time, ns.

    Unix time has no name for an inserted second: 23:59:60 gets the stamps of 23:59:59, so stamps repeat for one second there.
    """
    return gps + (GPS_EPOCH_UNIX_S - leap_seconds(gps)) * SECOND


def gps_ns(unix: int) -> int:
    """GPS time, ns, of a UTC stamp in ns since 1970; of an ambiguous stamp (see :func:`unix_ns`) the first.

    Raises
    ------
    GnssError
        For a stamp before GPS time began.
    """
    if unix < GPS_EPOCH_UNIX_S * SECOND:
        raise GnssError(f"The stamp {unix / 1e9:.1f} s is before GPS time began (1980-01-06); set the clock of its source.")
    return unix + (bisect.bisect_right(_LEAPS_UTC_S, unix // SECOND) - GPS_EPOCH_UNIX_S) * SECOND


def from_week(week: int, tow_s: float) -> int:
    """GPS time, ns, of a full week number and a time of week, s.

    Raises
    ------
    GnssError
        For a time of week outside 0 to 604800 s (604800 itself is the next week's zero).
    """
    if not (0.0 <= tow_s <= WEEK_S):
        raise GnssError(f"A time of week is between 0 and 604800 s, got {tow_s:g}; check the unit.")
    return week * WEEK_NS + round(tow_s * SECOND)


def week_and_tow(gps: int) -> tuple[int, float]:
    """Full week number and time of week, s."""
    week, rest = divmod(gps, WEEK_NS)
    return week, rest / SECOND


def full_week(week: int, near_gps: int) -> int:
    """Complete a week number known modulo 1024 to the one nearest to ``near_gps``, ns."""
    near = (near_gps + WEEK_NS // 2) // WEEK_NS
    return near + (week - near + ROLLOVER_WEEKS // 2) % ROLLOVER_WEEKS - ROLLOVER_WEEKS // 2


def nearest_tow(tow_s: float, near_gps: int) -> int:
    """GPS time, ns, that has the time of week ``tow_s`` and is nearest to ``near_gps``, ns.

    The half-week rule of the broadcast ephemeris (IS-GPS-200 20.3.3.4.3): a difference above half a week means another week.
    """
    tow = round(tow_s * SECOND)
    return near_gps + (tow - near_gps % WEEK_NS + WEEK_NS // 2) % WEEK_NS - WEEK_NS // 2


def from_calendar(year: int, month: int, day: int, hour: int = 0, minute: int = 0, second: float = 0.0) -> int:
    """GPS time, ns, of a calendar date on the GPS time scale; two-digit years are 1980 to 2079.

    Raises
    ------
    GnssError
        For a date that does not exist or lies before GPS time.
    """
    if year < 100:
        year += 1900 if year >= 80 else 2000
    fits = 1 <= month <= 12 and 0 <= hour <= 24 and 0 <= minute < 60 and 0.0 <= second < 61.0 and math.isfinite(second)
    if not fits or not 1 <= day <= calendar.monthrange(year, month)[1]:
        raise GnssError(f"The date {year}-{month}-{day} {hour}:{minute}:{second:g} does not exist; correct it.")
    whole = calendar.timegm((year, month, day, hour, minute, 0)) - GPS_EPOCH_UNIX_S
    if whole < 0:
        raise GnssError(f"The date {year}-{month}-{day} is before GPS time began (1980-01-06); correct it.")
    return whole * SECOND + round(second * SECOND)


def leap_second_conflict(announced_s: int, gps: int) -> str:
    """Return one sentence that an announced GPS - UTC differs from the table, or return an empty text.

    A receiver that announces more than the table has received a leap second that this program does not have.
    """
    known = leap_seconds(gps)
    if announced_s == known:
        return ""
    return f"The data announce {announced_s} leap seconds where the table of this program has {known}; update whichever is older."
