"""Words that the tables of satellite navigation share."""

import datetime
import math
from collections.abc import Iterable

import numpy as np

from lowcostnav_ros.gnss.gps_time import GPS_EPOCH_UNIX_S, SECOND

_ORIGIN = datetime.datetime.fromtimestamp(GPS_EPOCH_UNIX_S, datetime.UTC)


def date(gps_ns: int) -> str:
    """A GPS time, ns, as a date of the GPS time scale, to the nearest second."""
    return f"{_ORIGIN + datetime.timedelta(seconds=(gps_ns + SECOND // 2) // SECOND):%Y-%m-%d %H:%M:%S}"


SPREAD = ("smallest", "median", "95 %", "largest")


def spread(values: Iterable[float], digits: int) -> list[str]:
    """Smallest, median, 95 % and largest of some numbers, ``none`` for an infinite one."""
    ordered = np.sort(np.asarray(values, float))  # by rank: an interpolated quantile of infinities would be no number
    ranks = (0, (len(ordered) - 1) // 2, math.ceil(0.95 * (len(ordered) - 1)), -1)
    return [f"{ordered[k]:.{digits}f}" if math.isfinite(ordered[k]) else "none" for k in ranks]
