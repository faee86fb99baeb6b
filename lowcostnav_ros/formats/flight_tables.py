"""Text recordings of avionics and simulators whose columns are known by their names: Garmin G1000 and G3X, X-Plane, FlightGear.

A dialect says where its header stands and which column, in which unit, is which quantity.  What a quantity needs besides (a variation, a
pressure setting) is a quantity of its own.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.documents import cells_of, delimiter_of, number_in
from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE
from lowcostnav_ros.base.units import FOOT, FOOT_PER_MINUTE, INCH_OF_MERCURY, KNOT, ZERO_CELSIUS
from lowcostnav_ros.catalogue.geoid import undulation
from lowcostnav_ros.formats.air import RATIO_SIGMA, is_reading, true_airspeed
from lowcostnav_ros.formats.log import ATTITUDE_SIGMA, NO_DATE_S, FormatError, Log, read_bytes
from lowcostnav_ros.formats.velocity_lag import taken_back
from lowcostnav_ros.physics import atmosphere
from lowcostnav_ros.physics.rotation import euler_to_quat

_NO_VERTICAL = float(np.sqrt(UNKNOWN_VARIANCE))
_DEG, _PLAIN = np.pi / 180.0, 1.0

Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Dialect:
    """A recorder's table.

    Attributes
    ----------
    name : str
    is_header : callable
        Whether a line is the one that names the columns.
    columns : mapping of quantity to (column, factor to SI)
        A column begins so, whatever blanks and underscores stand around it.
    is_magnetic : bool
        Heading and track count from magnetic north.
    """

    name: str
    is_header: Callable[[str], bool]
    columns: Mapping[str, tuple[str, float]]
    is_magnetic: bool = False
    notes: tuple[str, ...] = field(default=())


GARMIN = Dialect(
    "Garmin G1000 or G3X",
    lambda line: "Lcl Date" in line and "Latitude" in line,
    {
        "lat": ("Latitude", _DEG), "lon": ("Longitude", _DEG), "height": ("AltGPS", FOOT), "above_sea": ("AltMSL", FOOT),
        "indicated": ("AltB", FOOT), "setting": ("BaroA", INCH_OF_MERCURY), "celsius": ("OAT", _PLAIN), "ias": ("IAS", KNOT),
        "tas": ("TAS", KNOT), "speed": ("GndSpd", KNOT), "climb": ("VSpdG", FOOT_PER_MINUTE), "track": ("TRK", _DEG),
        "heading": ("HDG", _DEG), "pitch": ("Pitch", _DEG), "roll": ("Roll", _DEG), "variation": ("MagVar", _DEG),
    },
    is_magnetic=True,
    notes=("HDG and TRK count from magnetic north, as the courses between the fixes show; MagVar is added.",),
)  # fmt: skip
XPLANE = Dialect(
    "X-Plane Data.txt",
    lambda line: "lat,__deg" in line and "|" in line,
    {
        "seconds": ("totl,_time", _PLAIN), "real": ("real,_time", _PLAIN), "lat": ("lat,__deg", _DEG), "lon": ("lon,__deg", _DEG),
        "above_sea": ("alt,ftmsl", FOOT), "ias": ("Vind,_kias", KNOT), "tas": ("Vtrue,_ktas", KNOT), "speed": ("Vtrue,_ktgs", KNOT),
        "track": ("hpath,__deg", _DEG), "climb": ("VVI,__fpm", FOOT_PER_MINUTE), "heading": ("hding,_true", _DEG),
        "pitch": ("pitch,__deg", _DEG), "roll": ("roll,__deg", _DEG),
        "pressure": ("AMprs,_inHG", INCH_OF_MERCURY), "celsius": ("AMtmp,_degC", _PLAIN),
    },
)  # fmt: skip
FLIGHTGEAR = Dialect(
    "FlightGear log",
    lambda line: "latitude-deg" in line.lower() or line.lower().replace(" ", "").startswith("time,") and "latitude" in line.lower(),
    {
        "seconds": ("Time", _PLAIN), "lat": ("latitude-deg", _DEG), "lon": ("longitude-deg", _DEG), "above_sea": ("altitude-ft", FOOT),
        "ias": ("airspeed-kt", KNOT), "north": ("speed-north-fps", FOOT), "east": ("speed-east-fps", FOOT),
        "down": ("speed-down-fps", FOOT),
        "speed": ("groundspeed-kt", KNOT), "track": ("track-deg", _DEG), "climb": ("vertical-speed-fps", FOOT),
        "heading": ("heading-deg", _DEG), "pitch": ("pitch-deg", _DEG), "roll": ("roll-deg", _DEG),
        "pressure": ("pressure-inhg", INCH_OF_MERCURY), "celsius": ("temperature-degc", _PLAIN),
    },
)  # fmt: skip
DIALECTS = (GARMIN, XPLANE, FLIGHTGEAR)


def dialect_of(head: bytes) -> Dialect | None:
    """Return the dialect of a file by its first lines."""
    lines = head[:20_000].decode("utf-8-sig", "replace").splitlines()[:30]
    return next((dialect for dialect in DIALECTS for line in lines if dialect.is_header(line)), None)


def read(path: Path) -> Log:
    """Read a recording; raises FormatError for one without usable rows, position or time."""
    raw = read_bytes(path)
    dialect = dialect_of(raw)
    if dialect is None:
        raise FormatError(f"{path} is of no known recorder; describe its columns with a profile.")
    log = Log(dialect.name)
    for note in dialect.notes:
        log.account.remark(note)
    names, rows = _rows(raw.decode("utf-8", "replace"), dialect, log)
    data, places = _columns(names, rows, dialect, log)
    if "lat" not in data or "lon" not in data:
        raise FormatError(f"{path} has no columns of latitude and longitude; record them too.")
    stamps = _stamps(log, names, rows, data, path)
    _position(log, stamps, data, places)
    _velocity(log, stamps, data, places)
    _air(log, stamps, data, places)
    _attitude(log, stamps, data, places)
    return log


def _plain(name: str) -> str:
    return re.sub(r"[\s_]+", "", name).lower()


def _rows(text: str, dialect: Dialect, log: Log) -> tuple[list[str], list[list[str]]]:
    names: list[str] = []
    rows: list[list[str]] = []
    mark = ""
    for line in text.splitlines():
        if not names:
            if dialect.is_header(line):
                mark = "|" if "|" in line else delimiter_of(line)
                names = cells_of(line, mark)
            continue
        if not line.strip():
            continue
        cells = cells_of(line, mark)
        if len(cells) >= len(names) - 1:
            rows.append([*cells, ""][: len(names)])
        else:
            log.account.refused["row with too few columns"] += 1
    return names, rows


def _columns(names: list[str], rows: list[list[str]], dialect: Dialect, log: Log) -> tuple[Columns, dict[str, str]]:
    """The known quantities in SI, NaN where a cell is empty, and the name of the column of each."""
    plain = [_plain(name) for name in names]
    data: Columns = {}
    places: dict[str, str] = {}
    used = set()
    for quantity, (column, factor) in dialect.columns.items():
        where = next((k for k, name in enumerate(plain) if name.endswith(_plain(column)) or name.startswith(_plain(column))), None)
        if where is None:
            continue
        used.add(where)
        data[quantity], places[quantity] = factor * np.array([number_in(row[where]) for row in rows]), names[where].strip(" _")
    for k, name in enumerate(names):
        if k not in used and name.strip():
            log.account.left_out[name.strip(" _")] += len(rows)
    return data, places


def _stamps(log: Log, names: list[str], rows: list[list[str]], data: Columns, path: Path) -> np.ndarray:
    if "Lcl Date" in names:
        day, time, zone = (names.index(name) for name in ("Lcl Date", "Lcl Time", "UTCOfst"))
        log.time_base = "UTC, local time less its offset"
        return np.array([_garmin_time(f"{row[day]} {row[time]}", row[zone]) for row in rows], np.int64)
    seconds = data.get("seconds", data.get("real"))
    if seconds is None or not np.any(np.isfinite(seconds)):
        raise FormatError(f"{path} has no column of time; record the simulator's time too.")
    log.time_base = "time of the simulator; no date in the log, 2017-07-14 02:40:00 stands for its start"
    since = np.nan_to_num(seconds - seconds[np.isfinite(seconds)][0], nan=-1.0)
    return NO_DATE_S * 10**9 + np.rint(1e9 * since).astype(np.int64)


def _garmin_time(text: str, zone: str) -> int:
    """UTC, ns, of local date and time; 0, which is refused as not increasing, where the recorder had no time yet."""
    match = re.fullmatch(r"([+-])(\d\d):(\d\d)", zone.strip())
    try:
        local = datetime.strptime(text.strip(), "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return 0
    offset = 0 if match is None else (int(match[2]) * 3600 + int(match[3]) * 60) * (-1 if match[1] == "-" else 1)
    return round(local - offset) * 10**9


def _position(log: Log, stamps: np.ndarray, data: Columns, places: dict[str, str]) -> None:
    lat, lon = data["lat"], data["lon"]
    known = np.isfinite(lat) & np.isfinite(lon) & (np.abs(lat) <= np.pi / 2) & (np.abs(lon) <= np.pi)
    if "height" in data:
        height, how = data["height"], f"{places['height']} above the ellipsoid"
    elif "above_sea" in data:
        height = data["above_sea"] + undulation(np.where(known, lat, 0.0), np.where(known, lon, 0.0))
        how = f"{places['above_sea']} + shipped geoid"
    else:
        height, how = np.zeros(len(stamps)), "no height"
    sigma = np.array([3.0, 3.0, 5.0 if how != "no height" else 1.0e4])
    where = np.where(known, lat, np.nan)
    log.add("gps/fix", stamps, f"{places['lat']}, {places['lon']}, {how}", lat=where, lon=lon, height=height, sigma=sigma)


def _velocity(log: Log, stamps: np.ndarray, data: Columns, places: dict[str, str]) -> None:
    if {"north", "east"} <= data.keys():
        north, east = data["north"], data["east"]
        down = data.get("down", -data["climb"] if "climb" in data else np.zeros(len(stamps)))
        has_climb = "down" in data or "climb" in data
        origin = f"{places['north']}, {places['east']}"
    elif {"speed", "track"} <= data.keys():
        track = data["track"] + data.get("variation", 0.0)
        track = np.where(np.isfinite(track) | (data["speed"] > 0.5), track, 0.0)  # a receiver at rest states no track
        north, east = data["speed"] * np.cos(track), data["speed"] * np.sin(track)
        has_climb = "climb" in data
        down = -np.nan_to_num(data["climb"]) if has_climb else np.zeros(len(stamps))
        origin = f"{places['speed']} and {places['track']}{' + ' + places['variation'] if 'variation' in places else ''}"
    else:
        return
    origin += f", {places.get('climb', places.get('down', 'no vertical velocity'))}"
    sigma = np.array([0.3, 0.3, 0.5 if has_climb else _NO_VERTICAL])
    stamps, velocity, late = taken_back(stamps, data["lat"], data["lon"], np.stack([north, east, down], axis=1))
    log.add("gps/vel", stamps, origin + late, velocity=velocity, sigma=sigma)


def _air(log: Log, stamps: np.ndarray, data: Columns, places: dict[str, str]) -> None:
    static = data.get("pressure")
    origin = places.get("pressure", "")
    if static is None and {"indicated", "setting"} <= data.keys():
        static = np.array(atmosphere.pressure_at(data["indicated"], data["setting"]))
        origin = f"{places['indicated']} with the setting {places['setting']}, by the standard atmosphere"
    if static is not None:
        log.add("air/static_pressure", stamps, origin, value=static, sigma=30.0)
    kelvin = data["celsius"] + ZERO_CELSIUS if "celsius" in data else None
    if kelvin is not None:
        log.add("air/temperature", stamps, f"{places['celsius']} in degrees Celsius", value=kelvin, sigma=2.0)
    if "tas" in data and np.any(data["tas"] > 0.0):
        tas, origin = data["tas"], f"{places['tas']}: true airspeed"
    elif "ias" in data and static is not None:
        tas = np.array(true_airspeed(np.maximum(data["ias"], 0.0), static, kelvin))
        origin = f"{places['ias']}: indicated airspeed, made true by pressure and temperature"
    elif "ias" in data and "above_sea" in data:
        tas = np.array(true_airspeed(np.maximum(data["ias"], 0.0), np.array(atmosphere.pressure(data["above_sea"])), kelvin))
        origin = f"{places['ias']}: indicated airspeed, made true by the standard atmosphere"
    else:
        return
    measured = is_reading(tas, data.get("speed", np.inf))
    log.add("air/velocity", stamps[measured], origin, tas=tas[measured], sigma=np.hypot(1.0, RATIO_SIGMA * tas[measured]))


def _attitude(log: Log, stamps: np.ndarray, data: Columns, places: dict[str, str]) -> None:
    if not {"roll", "pitch", "heading"} <= data.keys():
        return
    heading = data["heading"] + data.get("variation", 0.0)
    known = np.isfinite(data["roll"]) & np.isfinite(data["pitch"]) & np.isfinite(heading) & (np.diff(stamps, prepend=0) > 0)
    if not known.any():
        return
    q_nb = np.array([euler_to_quat(*row) for row in np.stack([data["roll"], data["pitch"], heading], axis=1)[known]])
    variation = f" + {places['variation']}" if "variation" in places else ""
    origin = f"{places['roll']}, {places['pitch']}, {places['heading']}{variation}; sigmas assumed, 1 deg and 5 deg in heading"
    log.add_attitude(stamps[known], origin, q_nb, None, ATTITUDE_SIGMA)
