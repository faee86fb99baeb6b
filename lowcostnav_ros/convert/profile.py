"""The column profile: what a YAML file may say about recorded tables, checked before any data is read."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lowcostnav_ros.base.documents import read_yaml
from lowcostnav_ros.base.settings import nearest, shown
from lowcostnav_ros.catalogue.config_files import config_dir, find_config
from lowcostnav_ros.convert import derived
from lowcostnav_ros.convert.units_by_name import UNITS
from lowcostnav_ros.messages.kind import TOPICS, Quantity
from lowcostnav_ros.messages.topics import kind_of


class ConvertError(ValueError):
    """A profile or recording that cannot be converted; the message is one sentence that says what to do."""


@dataclass(frozen=True, slots=True)
class FieldSpec:
    """One field: columns of the table or constants, with factor and offset to SI and the frame they are in."""

    columns: tuple[str, ...]
    constants: tuple[float, ...]
    factor: float
    offset: float
    frame: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class TopicProfile:
    """One topic made of a table; ``mounting_deg`` lists (roll, pitch, yaw) rotations from sensor to body axes, applied in order."""

    topic: str
    fields: dict[str, FieldSpec]
    mounting_deg: tuple[tuple[float, float, float], ...] = ()
    station: str = ""


@dataclass(frozen=True, slots=True)
class TimeBase:
    """How a row gets its stamp.

    ``columns`` hold one number in a unit (``factor`` to seconds), or text read by ``text_format``.  The stamp is that time, plus
    ``epoch_s`` and ``offset_s``, minus ``leap_seconds`` where the table counts GPS time.  With a ``tag_file`` the number is only a
    counter, fitted to the arrival times of the bytes of the table (``line_end_bytes`` is 2 where lines ended in CR LF when it was
    recorded).
    """

    columns: tuple[str, ...]
    factor: float = 1.0
    text_format: str = ""
    epoch_s: float = 0.0
    offset_s: float = 0.0
    leap_seconds: float = 0.0
    tag_file: str = ""
    line_end_bytes: int = 1


@dataclass(frozen=True, slots=True)
class TableProfile:
    """One file: layout, time base, what to keep, and the topics made of it."""

    file: str
    time: TimeBase
    topics: tuple[TopicProfile, ...]
    columns: tuple[str, ...] = ()
    delimiter: str = ""
    comment: str = "%#"
    keep: dict[str, tuple[float, float]] = field(default_factory=dict)
    every: int = 1

    def needed(self) -> set[str]:
        """Names of the numeric columns this profile reads."""
        names = {c for t in self.topics for f in t.fields.values() for c in f.columns} | set(self.keep)
        return names if self.time.text_format else names | set(self.time.columns)


@dataclass(frozen=True, slots=True)
class Profile:
    """A whole profile."""

    description: str
    tables: tuple[TableProfile, ...]
    vehicle: str = ""


def load_profile(path: str | Path) -> Profile:
    """Read a profile; a bare name such as ``px4_flight`` is looked for among the shipped ones.

    Raises
    ------
    ConvertError
        For an unknown key, unit, topic or frame (with the nearest known one), or something missing.
    SettingsError
        For a file that is missing or not YAML.
    """
    given = Path(path)
    found = (
        given if given.suffix == ".yaml" and given.is_file() else find_config(Path("convert") / f"{given.name.removesuffix('.yaml')}.yaml")
    )
    return profile_from(read_yaml(found), str(found))


def shipped_profile_for(source: str | Path) -> str:
    """Name of the shipped profile whose files all lie in ``source``.

    Raises
    ------
    ConvertError
        When none fits, or more than one does; the sentence lists the shipped profiles.
    """
    folder = Path(source)
    if not folder.exists():
        raise ConvertError(f"{folder} does not exist; give a folder or file of recorded tables.")
    shipped = sorted((config_dir() / "convert").glob("*.yaml"))
    fitting = [path.stem for path in shipped if all((folder / table.file).is_file() for table in load_profile(path).tables)]
    if len(fitting) == 1:
        return fitting[0]
    known = ", ".join(path.stem for path in shipped)
    if fitting:
        raise ConvertError(f"{folder} fits several profiles ({', '.join(fitting)}); choose one with --profile.")
    raise ConvertError(f"No shipped profile fits the files in {folder}; give one with --profile (shipped: {known}, or your own YAML file).")


def profile_from(content: Any, where: str = "profile") -> Profile:
    """Check the content of a profile; see :func:`load_profile`."""
    _known(content, {"description", "tables", "vehicle"}, where)
    tables = content.get("tables")
    if not isinstance(tables, list) or not tables:
        raise ConvertError(f"{where}: 'tables' must list at least one file.")
    vehicle = str(content.get("vehicle", ""))
    known = sorted(p.name for p in (config_dir() / "vehicles").iterdir())
    if vehicle and vehicle not in known:
        raise ConvertError(f"{where}: unknown vehicle '{vehicle}'{nearest(vehicle, known)}.")
    return Profile(str(content.get("description", "")), tuple(_table(t, f"{where}: table {k + 1}") for k, t in enumerate(tables)), vehicle)


def _known(content: Any, keys: set[str], where: str, required: tuple[str, ...] = ()) -> None:
    if not isinstance(content, Mapping):
        raise ConvertError(f"{where}: expected names and values, got {shown(content)}.")
    for key in content:
        if key not in keys:
            raise ConvertError(f"{where}: unknown key '{key}'{nearest(str(key), keys)}.")
    for key in required:
        if key not in content:
            raise ConvertError(f"{where}: '{key}' is missing.")


def _table(content: Any, where: str) -> TableProfile:
    _known(content, {"file", "columns", "delimiter", "comment", "time", "keep", "every", "topics"}, where, ("file", "time", "topics"))
    where = f"{where} ({content['file']})"
    if not isinstance(content["topics"], Mapping) or not content["topics"]:
        raise ConvertError(f"{where}: 'topics' must name at least one topic.")
    every = content.get("every", 1)
    if not isinstance(every, int) or isinstance(every, bool) or every < 1:
        raise ConvertError(f"{where}: 'every' must be a whole number of at least 1, got {shown(every)}.")
    keep = content.get("keep", {})
    _known(keep, set(keep) if isinstance(keep, Mapping) else set(), f"{where}: keep")
    return TableProfile(
        str(content["file"]),
        _time(content["time"], f"{where}: time"),
        tuple(_topic(name, value, f"{where}: {name}") for name, value in content["topics"].items()),
        _columns({"columns": content["columns"]}, where) if "columns" in content else (),
        str(content.get("delimiter", "")),
        str(content.get("comment", "%#")),
        {str(k): _numbers(v, 2, f"{where}: keep.{k}") for k, v in keep.items()},
        every,
    )


def _time(content: Any, where: str) -> TimeBase:
    keys = {"column", "columns", "unit", "format", "epoch_s", "offset_s", "leap_seconds", "tag_file", "line_end_bytes"}
    _known(content, keys, where)
    columns = _columns(content, where)
    if not columns:
        raise ConvertError(f"{where}: name the 'column' or 'columns' that hold the time.")
    text_format = str(content.get("format", ""))
    timed = bool(text_format) and not any(part in text_format for part in ("%d", "%j", "%x", "%c"))
    if timed and not content.get("epoch_s"):
        raise ConvertError(f"{where}: the format '{text_format}' has no date; add the column of the date, or 'epoch_s', its midnight.")
    if len(columns) > 1 and not text_format:
        raise ConvertError(f"{where}: several columns need a 'format' to read them by.")
    factor, _ = (1.0, 0.0) if text_format else _unit(content.get("unit", "s"), "time", where)
    epoch, offset, leap, line_end = (_numbers([content.get(k, d)], 1, where)[0] for k, d in _TIME_NUMBERS)
    return TimeBase(columns, factor, text_format, epoch, offset, leap, str(content.get("tag_file", "")), int(line_end))


_TIME_NUMBERS = (("epoch_s", 0.0), ("offset_s", 0.0), ("leap_seconds", 0.0), ("line_end_bytes", 1))


def _topic(topic: str, content: Any, where: str) -> TopicProfile:
    kind = kind_of(topic)
    if kind is None or not kind.fields:
        possible = [name for name, other in TOPICS.items() if other.fields]
        raise ConvertError(f"{where}: a table cannot become this topic{nearest(topic, possible)}.")
    expected = derived.possible(kind.name, kind)
    _known(content, {*expected, *kind.options}, where, tuple(set(kind.options) - {"mounting_deg"}))
    if lacking := derived.missing(kind.name, kind, set(content)):
        raise ConvertError(f"{where}: '{lacking}' is missing.")
    fields = {name: _field(value, expected[name], f"{where}.{name}") for name, value in content.items() if name in expected}
    if "quaternion" in expected and ("quaternion" in fields) == ("euler" in fields):
        raise ConvertError(f"{where}: give the attitude either as 'quaternion' or as 'euler'.")
    turns = content.get("mounting_deg", [])
    if not isinstance(turns, list):
        raise ConvertError(f"{where}.mounting_deg: expected a list of rotations of three angles, got {shown(turns)}.")
    mounting = tuple(_numbers(turn, 3, f"{where}.mounting_deg") for turn in turns)
    return TopicProfile(topic, fields, mounting, str(content.get("station", "")))


def _field(content: Any, quantity: Quantity, where: str) -> FieldSpec:
    _known(content, {"column", "columns", "constant", "constants", "unit", "frame"}, where)
    columns = _columns(content, where)
    constants = content.get("constants", [content["constant"]] if "constant" in content else [])
    if not isinstance(constants, list):
        raise ConvertError(f"{where}: 'constants' must be a list of numbers, got {shown(constants)}.")
    if bool(columns) == bool(constants):
        raise ConvertError(f"{where}: give either columns or constants.")
    if len(columns or constants) != quantity.size:
        raise ConvertError(
            f"{where}: needs {quantity.size} {'column' if quantity.size == 1 else 'columns'}, got {len(columns or constants)}."
        )
    numbers = _numbers(constants, quantity.size, where) if constants else ()
    unit = content.get("unit", "" if quantity.dimension == "number" else None)
    if unit is None:
        raise ConvertError(f"{where}: 'unit' is missing; known: {', '.join(UNITS[quantity.dimension])}.")
    factor, offset = _unit(unit, quantity.dimension, where)
    return FieldSpec(columns, numbers, factor, 0.0 if where.endswith("sigma") else offset, _frame(content, quantity, where), str(unit))


def _frame(content: Mapping, quantity: Quantity, where: str) -> str:
    if not quantity.frames:
        return ""
    if "frame" not in content:
        raise ConvertError(f"{where}: 'frame' is missing; known: {', '.join(quantity.frames)}.")
    if content["frame"] not in tuple(quantity.frames):
        raise ConvertError(f"{where}: unknown frame '{content['frame']}'{nearest(str(content['frame']), quantity.frames)}.")
    return content["frame"]


def _columns(content: Mapping, where: str) -> tuple[str, ...]:
    columns = content.get("columns", [content["column"]] if "column" in content else [])
    if not isinstance(columns, list) or not all(isinstance(name, str | int) for name in columns):
        raise ConvertError(f"{where}: 'columns' must be a list of column names, got {shown(columns)}.")
    return tuple(map(str, columns))


def _unit(unit: Any, dimension: str, where: str) -> tuple[float, float]:
    if not isinstance(unit, str) or unit not in UNITS[dimension]:
        raise ConvertError(f"{where}: '{unit}' is not a unit of {dimension}{nearest(str(unit), UNITS[dimension])}.")
    return UNITS[dimension][unit]


def _numbers(values: Any, size: int, where: str) -> Any:
    good = isinstance(values, list) and len(values) == size and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    if not good or not all(abs(v) < 1e300 for v in values):
        raise ConvertError(f"{where}: expected {size} number{'s' if size > 1 else ''}, got {shown(values)}.")
    return tuple(map(float, values))
