"""Words that the tables of satellite navigation share."""

import datetime
from collections.abc import Mapping

from lowcostnav_ros.gnss.gps_time import GPS_EPOCH_UNIX_S, SECOND

_ORIGIN = datetime.datetime.fromtimestamp(GPS_EPOCH_UNIX_S, datetime.UTC)


def date(gps_ns: int) -> str:
    """A GPS time, ns, as a date of the GPS time scale, to the nearest second."""
    return f"{_ORIGIN + datetime.timedelta(seconds=(gps_ns + SECOND // 2) // SECOND):%Y-%m-%d %H:%M:%S}"


def counted(reasons: Mapping[str, int]) -> str:
    """Counts by reason, the commonest first."""
    return ", ".join(f"{count} {reason}" for reason, count in sorted(reasons.items(), key=lambda item: (-item[1], item[0])))
