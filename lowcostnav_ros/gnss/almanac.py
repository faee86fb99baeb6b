"""YUMA almanacs: coarse orbits of all satellites, good to a few kilometres for weeks, to plan visibility with.

References
----------
U.S. Coast Guard Navigation Center, YUMA almanac format; IS-GPS-200, 20.3.3.5.1.2.
"""

import re
from collections import Counter
from typing import Any

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.ephemeris import Ephemeris
from lowcostnav_ros.gnss.gps_time import WEEK_S, from_week, full_week
from lowcostnav_ros.gnss.signals import GPS

_LABELS = {
    "id": "id",
    "health": "health",
    "eccentricity": "eccentricity",
    "time of applicability": "toa",
    "orbital inclination": "inclination",
    "rate of right ascen": "node_rate",
    "sqrt(a)": "sqrt_a",
    "right ascen at week": "node",
    "argument of perigee": "perigee",
    "mean anom": "mean_anomaly",
    "af0": "af0",
    "af1": "af1",
    "week": "week",
}
_LINE = re.compile(r"^\s*([^:]+?)\s*(?:\([^()]*\))?\s*:\s*(\S+)\s*$")
_VALID_S = 26.0 * WEEK_S


def parse_yuma(text: str, near_gps: int) -> tuple[list[Ephemeris], Counter]:
    """Read a YUMA almanac.

    Parameters
    ----------
    text : str
        The file.
    near_gps : int
        A GPS time, ns, within ten years of the almanac: its weeks may be counted modulo 1024.

    Returns
    -------
    almanacs : list of Ephemeris
        Without harmonics, usable for half a year.
    rejected : Counter
        Records rejected, by reason.

    Raises
    ------
    GnssError
        When nothing in the text can be used.
    """
    almanacs: list[Ephemeris] = []
    rejected: Counter[str] = Counter()
    for block in re.split(r"(?m)^\s*\*{4,}.*$", text)[1:]:
        values = _values(block)
        missing = sorted(set(_LABELS.values()) - set(values))
        if missing:
            rejected["incomplete record"] += 1
            continue
        try:
            almanacs.append(_almanac(values, near_gps))
        except GnssError:
            rejected["no satellite orbit"] += 1
    if not almanacs:
        raise GnssError("No usable satellite was found; give a YUMA almanac, whose records begin with a line of asterisks.")
    return almanacs, rejected


def _values(block: str) -> dict[str, float]:
    found = {}
    for line in block.splitlines():
        match = _LINE.match(line)
        label = next((key for key in _LABELS if match and match[1].lower().startswith(key)), None)
        if match and label:
            try:
                found[_LABELS[label]] = float(match[2])
            except ValueError:
                continue  # the record then counts as incomplete
    return found


def _almanac(v: dict[str, float], near_gps: int) -> Ephemeris:
    toa_ns = from_week(full_week(int(v["week"]), near_gps), v["toa"])
    shape = (v["sqrt_a"], v["eccentricity"], v["mean_anomaly"], v["node"], v["inclination"], v["perigee"], v["node_rate"])
    clock: dict[str, Any] = {"af0": v["af0"], "af1": v["af1"], "ura_m": 1000.0, "healthy": v["health"] == 0.0, "valid_s": _VALID_S}
    return Ephemeris(GPS, int(v["id"]), toa_ns, toa_ns, *shape, **clock)
