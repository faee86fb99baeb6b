"""A first profile of an unknown table, by names of columns, units in them, and magnitudes: for its user to correct.

Each guess says why it was made.  What is not sure is written as a comment.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.documents import cells_of, delimiter_of, foreign_text, number_in
from lowcostnav_ros.convert.profile import ConvertError
from lowcostnav_ros.formats.log import read_bytes

ROWS = 2000
"""Rows looked at."""


@dataclass(frozen=True)
class Column:
    """A column: its name, the words of it, and its numbers."""

    name: str
    words: frozenset[str]
    numbers: np.ndarray

    @property
    def median(self) -> float:
        """Median magnitude."""
        return float(np.nanmedian(np.abs(self.numbers))) if np.isfinite(self.numbers).any() else np.nan

    @property
    def spread(self) -> tuple[float, float]:
        """Least and largest."""
        return float(np.nanmin(self.numbers)), float(np.nanmax(self.numbers))


def guess(path: str | Path) -> str:
    """Return the text of a profile.

    Raises
    ------
    ConvertError, FormatError
        For a file without a header of names, or one of which nothing is recognised.
    """
    columns, file = _columns(Path(path)), Path(path).name
    time = _time(columns)
    topics = [text for make in (_fix, _velocity, _air, _pressure, _inertial, _mag) if (text := make(columns))]
    if not topics:
        listed = ", ".join(column.name for column in columns[:20])
        raise ConvertError(f"{path}: none of its columns is recognised ({listed}); write a profile by hand, see docs/convert.md.")
    lines = [
        f"# A guess at {file} by names and magnitudes; correct it, then: lowcostnav convert {file} -o bag --profile THIS.yaml",
        f"description: {file}",
        "tables:",
        f"  - file: {file}",
        f"    time: {time}",
        "    topics:",
    ]
    return "\n".join([*lines, *topics]) + "\n"


def _columns(path: Path) -> list[Column]:
    lines = [line for line in foreign_text(read_bytes(path)).splitlines()[: ROWS + 50] if line.strip()]
    for start, line in enumerate(lines[:40]):
        mark = delimiter_of(line)
        names = cells_of(line.lstrip("#% "), mark)
        rows = [cells_of(row, mark) for row in lines[start + 1 :]]
        full = [row for row in rows if len(row) >= len(names)]
        if len(names) > 1 and len(full) > 0.5 * len(rows) and full and not any(map(_is_number, names)):
            numbers = [np.array([number_in(row[k]) for row in full]) for k in range(len(names))]
            return [Column(name, _words(name), column) for name, column in zip(names, numbers, strict=True)]
    raise ConvertError(f"{path} has no line of column names above its numbers; write a profile with 'columns', see docs/convert.md.")


def _is_number(text: str) -> bool:
    return bool(text) and np.isfinite(number_in(text))


def _words(name: str) -> frozenset[str]:
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return frozenset(word for word in re.split(r"[^a-z0-9/^]+", apart.lower()) if word) | {re.sub(r"[^a-z0-9]", "", name.lower())}


def _find(columns: Sequence[Column], *words: str, but: Sequence[str] = ()) -> Column | None:
    """The first column with one of the words, those named earlier before those later."""
    for word in words:
        for column in columns:
            if word in column.words and not column.words & set(but):
                return column
    return None


def _axes(columns: Sequence[Column], *stems: str) -> list[Column] | None:
    """Three columns of a stem with x, y, z."""
    for stem in stems:
        found = [_find(columns, f"{stem}{axis}", f"{axis}{stem}", f"{stem}0{k}", f"{stem}{k}") for k, axis in enumerate("xyz")]
        if all(found):
            return [one for one in found if one]
    return None


def _names(columns: Sequence[Column]) -> str:
    return "[" + ", ".join(f'"{column.name}"' for column in columns) + "]"


def _time(columns: Sequence[Column]) -> str:
    column = _find(columns, "time", "t", "timestamp", "utc", "timeus", "timems", "seconds", "epoch", "stamp", "times")
    if column is None or not np.isfinite(column.numbers).any():
        return "{column: TIME, unit: s, epoch_s: 1500000000} # no column of time was recognised: name it"
    largest, step = column.median, float(np.nanmedian(np.diff(column.numbers)))
    for unit, size in (("ns", 1e9), ("us", 1e6), ("ms", 1e3), ("s", 1.0)):
        if 5e8 * size < largest < 5e9 * size:
            return f'{{column: "{column.name}", unit: {unit}}} # since 1970, by its size'
    named = next((unit for unit in ("ns", "us", "ms") if any(word.endswith(unit) for word in column.words)), "")
    unit = named or ("us" if step > 500.0 else "ms" if step >= 2.0 else "s")
    why = "by its name" if named else "by its step"
    return f'{{column: "{column.name}", unit: {unit}, epoch_s: 1500000000}} # {why}; when was zero?'


def _fix(columns: Sequence[Column]) -> str:
    lat, lon = _find(columns, "lat", "latitude"), _find(columns, "lon", "lng", "long", "longitude")
    if lat is None or lon is None:
        return ""
    high = lat.median
    unit, why = ("1e-7 deg", "by its size") if high > 1e5 else ("ddmm", "by its size") if high > 90.0 else ("deg", "by its size")
    if high < 1.6 and "rad" in lat.words:
        unit, why = "rad", "by its name"
    height = _find(columns, "height", "ellipsoid", "hae", "alt", "altitude", "altgps", "altmsl", but=("baro", "pressure"))
    lines = ["      gps/fix:"]
    lines += [f'        {name}: {{column: "{one.name}", unit: {unit}}} # {why}' for name, one in (("lat", lat), ("lon", lon))]
    if height is None:
        lines.append("        height_msl: {constant: 0, unit: m} # no column of height was recognised: name it")
    else:
        above_sea = not height.words & {"ellipsoid", "hae", "height", "wgs", "wgs84"}
        unit = "ft" if height.words & {"ft", "feet"} else "m"
        note = f"{'above the sea' if above_sea else 'above the ellipsoid'} by its name; check unit and datum"
        lines.append(f'        {"height_msl" if above_sea else "height"}: {{column: "{height.name}", unit: {unit}}} # {note}')
    return "\n".join(lines)


def _speed_unit(column: Column) -> tuple[str, str]:
    known = {"kt": {"kt", "kts", "knots", "kn"}, "km/h": {"kmh", "kph", "km/h"}, "ft/s": {"fps"}, "m/s": {"mps", "m/s", "ms"}}
    for unit, words in known.items():
        if column.words & words or any(column.name.lower().endswith(word) for word in words):
            return unit, "by its name"
    return "m/s", "assumed: check"


def _velocity(columns: Sequence[Column]) -> str:
    parts = [_find(columns, f"v{a}", f"vel{a}", f"vel{b}", f"v{b}", b) for a, b in (("n", "north"), ("e", "east"), ("d", "down"))]
    if all(parts):
        found = [part for part in parts if part]
        unit, why = _speed_unit(found[0])
        return f"      gps/vel:\n        velocity: {{columns: {_names(found)}, unit: {unit}, frame: NED}} # {why}"
    speed = _find(columns, "speed", "groundspeed", "gndspd", "gs", "sog", "spd")
    track = _find(columns, "track", "course", "trk", "cog", "gcrs")
    if speed is None or track is None:
        return ""
    unit, why = _speed_unit(speed)
    return (
        f'      gps/vel:\n        speed: {{column: "{speed.name}", unit: {unit}}} # {why}\n'
        f'        track: {{column: "{track.name}", unit: {"rad" if track.spread[1] < 6.4 else "deg"}}} # from true north: check'
    )


def _air(columns: Sequence[Column]) -> str:
    tas, ias = _find(columns, "tas", "ktas", "trueairspeed"), _find(columns, "ias", "kias", "cas", "airspeed", "aspd")
    if tas is not None:
        unit, why = ("kt", "by its name") if "ktas" in tas.words else _speed_unit(tas)
        return f'      air/velocity:\n        tas: {{column: "{tas.name}", unit: {unit}}} # {why}'
    pressure = _static(columns)
    if ias is None or pressure is None:
        return ""
    unit, why = ("kt", "by its name") if "kias" in ias.words else _speed_unit(ias)
    return (
        f'      air/velocity:\n        ias: {{column: "{ias.name}", unit: {unit}}} # {why}\n'
        f'        pressure: {{column: "{pressure.name}", unit: {_pressure_unit(pressure)}}} # to make it true'
    )


def _static(columns: Sequence[Column]) -> Column | None:
    return _find(columns, "pressure", "static", "press", "baro", "pstatic", "ps", "p", but=("diff", "dynamic", "alt", "altitude"))


def _pressure_unit(column: Column) -> str:
    return next(unit for unit, largest in (("inHg", 35.0), ("kPa", 130.0), ("hPa", 1300.0), ("Pa", np.inf)) if not column.median > largest)


def _pressure(columns: Sequence[Column]) -> str:
    column = _static(columns)
    if column is None:
        return ""
    return f'      air/static_pressure:\n        value: {{column: "{column.name}", unit: {_pressure_unit(column)}}} # by its size'


def _inertial(columns: Sequence[Column]) -> str:
    force, rate = _axes(columns, "acc", "accel", "a", "acceleration"), _axes(columns, "gyr", "gyro", "g", "w", "rate")
    if force is None or rate is None:
        return ""
    size = float(np.nanmedian(np.sqrt(sum(column.numbers**2 for column in force))))
    unit = "m/s^2" if 6.0 < size < 14.0 else "g" if 0.6 < size < 1.4 else "mg" if 600.0 < size < 1400.0 else "m/s^2"
    along = max(force, key=lambda column: column.median)
    down = float(np.nanmedian(along.numbers)) < 0.0
    fast = float(np.nanpercentile(np.abs(np.stack([column.numbers for column in rate])), 95))
    named = any({"deg", "dps"} & column.words for column in rate)
    rate_unit = "deg/s" if named or fast > 8.0 else "rad/s"
    axes = f"FRD}} # gravity is {size:.3g} {unit} along {along.name}, which is {'negative: z down' if down else 'positive: z up'}"
    frame = axes if down else axes.replace("FRD}", "FLU}")
    return (
        f"      imu/data_raw:\n        force: {{columns: {_names(force)}, unit: {unit}, frame: {frame}\n"
        f"        rate: {{columns: {_names(rate)}, unit: {rate_unit}, frame: {frame[:3]}}} # 95 % below {fast:.3g}"
    )


def _mag(columns: Sequence[Column]) -> str:
    field = _axes(columns, "mag", "m", "b", "magnetic")
    if field is None:
        return ""
    size = float(np.nanmedian(np.sqrt(sum(column.numbers**2 for column in field))))
    known = (("gauss", 0.2, 0.8), ("mG", 150.0, 800.0), ("uT", 15.0, 80.0), ("nT", 15_000.0, 80_000.0), ("T", 1.5e-5, 8e-5))
    unit = next((unit for unit, low, high in known if low < size < high), "uT")
    why = f"its size is {size:.3g}; axes as those of the IMU?"
    return f"      imu/mag:\n        field: {{columns: {_names(field)}, unit: {unit}, frame: FRD}} # {why}"
