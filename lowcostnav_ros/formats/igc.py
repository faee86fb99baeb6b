"""Flight recorders of gliders (IGC): position, pressure height, and where the recorder writes them true airspeed, heading, track and speed.

Times are UTC of one flight: after midnight the next day has begun.  Heights of the GPS are above the ellipsoid, as the rules of the
recorders ask, or above sea level where the header says so (HFALG: GEO).

References
----------
FAI technical specification for GNSS flight recorders, appendix A.
"""

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.documents import number_in
from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE
from lowcostnav_ros.base.units import ZERO_CELSIUS
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.formats.air import is_reading
from lowcostnav_ros.formats.log import FormatError, Log, heading_attitude, read_bytes, rising
from lowcostnav_ros.formats.velocity_lag import taken_back
from lowcostnav_ros.physics import atmosphere
from lowcostnav_ros.physics.earth import radii

_FIX = re.compile(r"B(\d\d)(\d\d)(\d\d)(\d\d)(\d{5})([NS])(\d{3})(\d{5})([EW])([AV])(-\d{4}|\d{5})(-\d{4}|\d{5})")
_DATE = re.compile(r"^HFDTE(?:DATE:)? *(\d\d)(\d\d)(\d\d)", re.MULTILINE)
_EXTENSION = re.compile(r"(\d\d)(\d\d)([A-Z0-9]{3})")
DEFAULT_SIGMA_M, VERTICAL = 10.0, 1.7
_DAY_S = 86_400
_NO_VERTICAL = float(np.sqrt(UNKNOWN_VARIANCE))


def fits(head: bytes) -> bool:
    """Whether a file begins as a recorder writes it: maker, then headers or fixes."""
    return bool(re.match(rb"\s*A[A-Z0-9]{3}[^\r\n]*\r?\n[HBIJLFO]", head)) and b"HFDTE" in head


def read(path: Path) -> Log:
    """Read a flight; raises FormatError for one without a date or a fix."""
    text = read_bytes(path).decode("latin-1")
    log = Log("IGC flight recorder", time_base="UTC")
    dated = _DATE.search(text)
    if dated is None:
        raise FormatError(f"{path} states no date (HFDTE); add the line by hand.")
    try:
        midnight = datetime(2000 + int(dated[3]), int(dated[2]), int(dated[1]), tzinfo=UTC).timestamp()
    except ValueError as error:
        raise FormatError(f"{path}: the date {dated[1]}-{dated[2]}-{dated[3]} does not exist; correct HFDTE.") from error
    places = _extensions(text)
    fixes, extended = [], []
    for line in text.splitlines():
        match = _FIX.match(line)
        if match is None:
            if line.startswith("B"):
                log.account.refused["fix that does not read as one"] += 1
            continue
        hour, minute, second, lat, lat_min, south, lon, lon_min, west, kind, pressure, height = match.groups()
        fixes.append((
            int(hour) * 3600 + int(minute) * 60 + int(second), (int(lat) + int(lat_min) / 60_000) * (-1 if south == "S" else 1),
            (int(lon) + int(lon_min) / 60_000) * (-1 if west == "W" else 1), kind == "A", int(pressure), int(height),
        ))  # fmt: skip
        extended.append([number_in(line[first - 1 : last]) for first, last in places.values()])
    if not fixes:
        raise FormatError(f"{path} holds no fix; check that the recorder had a satellite view.")
    table = np.array(fixes, float)
    further = dict(zip(places, np.array(extended, float).reshape(len(fixes), -1).T, strict=True))
    day = np.cumsum(np.diff(table[:, 0], prepend=table[0, 0]) < -_DAY_S / 2)
    stamps = np.rint((midnight + table[:, 0] + _DAY_S * day) * 1e9).astype(np.int64)
    _positions(log, stamps, table, further, "GEO" in (re.search(r"^H[FOP]ALG[^\r\n]*", text, re.MULTILINE) or [""])[0])
    _velocity(log, stamps, table, further, places)
    _air(log, stamps, table, further, places)
    return log


def _extensions(text: str) -> dict[str, tuple[int, int]]:
    """Columns, counted from one, of what the recorder adds to a fix, by its three letters."""
    line = re.search(r"^I\d\d([^\r\n]*)", text, re.MULTILINE)
    return {name: (int(first), int(last)) for first, last, name in _EXTENSION.findall(line[1])} if line else {}


def _speed_factor(name: str, places: dict[str, tuple[int, int]]) -> float:
    """Unit of a speed, m/s: three digits are km/h, further ones its decimals."""
    first, last = places[name]
    return 10.0 ** (3 - (last - first + 1)) / 3.6 if last - first > 1 else 1.0 / 3.6


def _positions(log: Log, stamps: np.ndarray, table: np.ndarray, further: dict[str, np.ndarray], above_sea: bool) -> None:
    lat, lon = np.radians(table[:, 1]), np.radians(table[:, 2])
    solid = table[:, 3] > 0.0
    level = np.where(further["FXA"] > 0.0, further["FXA"], DEFAULT_SIGMA_M) if "FXA" in further else np.full(len(stamps), DEFAULT_SIGMA_M)
    vertical = np.where(solid, VERTICAL * level, 1.0e4)  # a fix of two dimensions has no height
    sigma = np.stack([level / np.sqrt(2.0), level / np.sqrt(2.0), vertical], axis=1)
    height = table[:, 5] + (undulation(lat, lon) if above_sea else 0.0)
    datum = "sea level + shipped geoid (header)" if above_sea else "the ellipsoid, as the rules ask"
    log.add("gps/fix", stamps, f"B records: minutes/1000, m above {datum}, sigma of FXA", lat=lat, lon=lon, height=height, sigma=sigma)
    if np.any(table[:, 4] != 0.0):
        pressure = atmosphere.pressure(table[:, 4])
        log.add("air/static_pressure", stamps, "B records: pressure height in m, by the standard atmosphere", value=pressure, sigma=30.0)


def _velocity(log: Log, stamps: np.ndarray, table: np.ndarray, further: dict[str, np.ndarray], places: dict[str, tuple[int, int]]) -> None:
    lat, lon = np.radians(table[:, 1]), np.radians(table[:, 2])
    if {"GSP", "TRT"} <= places.keys():
        speed, track = further["GSP"] * _speed_factor("GSP", places), np.radians(further["TRT"])
        level = np.stack([speed * np.cos(track), speed * np.sin(track)], axis=1)
        origin, sigma = "B records: ground speed GSP in km/h and its decimals, true track TRT", np.full(len(stamps), 0.5)
    else:
        kept = rising(stamps, np.ones(len(stamps), bool))
        stamps, lat, lon = stamps[kept], lat[kept], lon[kept]
        before, after = np.maximum(np.arange(len(stamps)) - 1, 0), np.minimum(np.arange(len(stamps)) + 1, len(stamps) - 1)
        span = np.maximum((stamps[after] - stamps[before]) * 1e-9, 1e-3)
        meridian, normal = radii(float(np.median(lat)))
        east = normal * np.cos(lat) * (np.unwrap(lon)[after] - np.unwrap(lon)[before])
        level = np.stack([meridian * (lat[after] - lat[before]), east], axis=1) / span[:, None]
        origin, sigma = "differences of the fixes on either side, for want of a recorded speed", np.hypot(1.0, 1.5 / span)
        log.account.remark("The recorder writes no ground speed: velocity is made of successive fixes.")
    stamps, velocity, late = taken_back(stamps, lat, lon, np.column_stack([level, np.zeros(len(stamps))]))
    sigmas = np.column_stack([sigma, sigma, np.full(len(sigma), _NO_VERTICAL)])[: len(stamps)]
    log.add("gps/vel", stamps, origin + late, velocity=velocity, sigma=sigmas)


def _air(log: Log, stamps: np.ndarray, table: np.ndarray, further: dict[str, np.ndarray], places: dict[str, tuple[int, int]]) -> None:
    if "OAT" in places:
        first, last = places["OAT"]
        kelvin = further["OAT"] * 10.0 ** (3 - (last - first + 1)) + ZERO_CELSIUS if last - first > 1 else further["OAT"] + ZERO_CELSIUS
        log.add("air/temperature", stamps, "B records: OAT in degrees Celsius and its decimals", value=kelvin, sigma=1.0)
    if "TAS" not in places:
        return
    tas = further["TAS"] * _speed_factor("TAS", places)
    ground_speed = further["GSP"] * _speed_factor("GSP", places) if "GSP" in places else np.inf
    measured = is_reading(tas, ground_speed)
    log.add("air/velocity", stamps[measured], "B records: true airspeed TAS in km/h and its decimals", tas=tas[measured], sigma=1.0)
    name = next((name for name in ("HDT", "TRT") if name in places), None)
    if name is None:
        return
    heading = np.radians(further[name])
    known = np.isfinite(heading) & (np.maximum.accumulate(np.nan_to_num(heading)) > 0.0)  # zero is written until there is one
    if not known.all():
        kind = "heading" if name == "HDT" else "track"
        log.account.remark(f"{np.sum(~known)} fixes are without a {kind}, or before the first that is not zero.")
    origin = f"heading {'HDT' if name == 'HDT' else 'taken from the track TRT'}, bank of a coordinated turn, no pitch, interpolated"
    log.account.remark("The recorder knows no attitude: it is made of heading and turn, within 8 deg; its heading may be made of the wind.")
    heading_attitude(log, stamps[known], heading[known], tas[known], origin)
