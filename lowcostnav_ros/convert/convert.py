"""Convert recorded tables to a standard recording."""

import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.convert import derived
from lowcostnav_ros.convert.profile import ConvertError, FieldSpec, Profile, TableProfile, TopicProfile, load_profile
from lowcostnav_ros.convert.table import Table, read_table
from lowcostnav_ros.convert.timebase import stamps_ns
from lowcostnav_ros.convert.units_by_name import NMEA
from lowcostnav_ros.formats.log import rising
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.bag_writer import SETTINGS_FOLDER, BagWriter, new_bag
from lowcostnav_ros.messages.encode import Record, encode_rows
from lowcostnav_ros.messages.samples import TableRow
from lowcostnav_ros.messages.topics import spec

_SHOWN = 5


@dataclass(slots=True)
class ConversionReport:
    """What a conversion did.

    Attributes
    ----------
    messages : dict of topic to number written
    malformed : dict of file to list of (line number, reason)
    skipped : dict of file to rows skipped by ``keep`` and ``every``
    not_increasing : dict of file to rows skipped because their time did not increase
    rows : dict of file to rows read
    vehicle : name of the vehicle whose settings the recording carries, empty for none
    """

    messages: dict[str, int] = field(default_factory=dict)
    malformed: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    skipped: dict[str, int] = field(default_factory=dict)
    not_increasing: dict[str, int] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    vehicle: str = ""

    @property
    def malformed_share(self) -> float:
        """Share of the rows with something malformed."""
        return sum(map(len, self.malformed.values())) / max(sum(self.rows.values()), 1)

    def __str__(self) -> str:
        """Return lines for a terminal."""
        lines = [f"{count:8d}  {topic}" for topic, count in self.messages.items()]
        for file, rows in self.malformed.items():
            shown = "; ".join(f"line {number}: {reason}" for number, reason in rows[:_SHOWN])
            lines.append(f"{file}: {len(rows)} malformed rows or cells left out ({shown}{'; ...' if len(rows) > _SHOWN else ''})")
        lines += [f"{file}: {n} rows skipped by the profile" for file, n in self.skipped.items() if n]
        lines += [f"{file}: {n} rows skipped, their time does not increase" for file, n in self.not_increasing.items() if n]
        if self.vehicle:
            lines.append(f"the recording carries the settings of vehicle '{self.vehicle}' for its replay")
        return "\n".join(lines)


def convert(source: str | Path, profile: str | Path | Profile, out_bag: str | Path, storage: str = "mcap") -> ConversionReport:
    """Convert recorded tables to a bag with the standard topics, in order of stamp.

    Parameters
    ----------
    source : str or Path
        Folder with the files a profile names, or the one file of a profile with one table.
    profile : str, Path or Profile
        YAML profile, the name of a shipped one, or a checked one.
    out_bag : str or Path
        Bag to create.
    storage : str
        ``mcap`` or ``sqlite3``.

    Raises
    ------
    ConvertError, SettingsError, BagError
        Each with one sentence that says what to do.
    """
    checked = profile if isinstance(profile, Profile) else load_profile(profile)
    with new_bag(out_bag, storage) as bag:
        return _converted(Path(source), checked, bag)


def _converted(source: Path, checked: Profile, bag: BagWriter) -> ConversionReport:
    report = ConversionReport()
    records: list[Record] = []
    for table_profile in checked.tables:
        records += _records(_file(source, table_profile, len(checked.tables)), table_profile, report)
    write_records(bag, records)
    report.messages, report.vehicle = dict(bag.counts), checked.vehicle
    if checked.vehicle:  # the recording carries the settings its vehicle is to be replayed with
        shutil.copytree(config_dir() / "vehicles" / checked.vehicle, bag.path / SETTINGS_FOLDER)
    return report


def write_records(bag: BagWriter, records: list[Record]) -> None:
    """Write records in order of stamps; those of one stamp keep their order."""
    for stamp_ns, topic, msgtype, cdr in sorted(records, key=lambda record: record[0]):
        bag.write(topic, msgtype, stamp_ns, cdr)


def _file(source: Path, profile: TableProfile, tables: int) -> Path:
    if source.is_file() and tables == 1:
        return source
    if not source.is_dir():
        raise ConvertError(f"{source} is not a folder; give the folder that holds {profile.file}.")
    path = source / profile.file
    if not path.is_file():
        there = ", ".join(sorted(p.name for p in source.iterdir() if p.is_file())) or "nothing"
        raise ConvertError(f"{source} has no {profile.file}; it holds {there}.")
    return path


def _records(path: Path, profile: TableProfile, report: ConversionReport) -> list[Record]:
    table = read_table(path, profile)
    report.rows[path.name] = table.total
    stamps = stamps_ns(table, profile.time, path.parent)
    if table.malformed:
        report.malformed[path.name] = table.malformed
    kept = _kept(table, profile)
    report.skipped[path.name] = len(stamps) - int(kept.sum())
    used = rising(stamps, kept)
    report.not_increasing[path.name] = int(kept.sum() - used.sum())
    if not used.any():
        raise ConvertError(f"{path}: the profile leaves no row; relax 'keep' or correct the time.")
    records: list[Record] = []
    for topic in profile.topics:
        there, columns = topic_columns(topic, table, used)
        _refuse_no_place(columns, table, there, f"{path}, {topic.topic}")
        if there.any():
            records += encode_rows(table_rows(topic, stamps[there], columns))
    if not records:
        raise ConvertError(f"{path}: no row has all the numbers of a topic; {_first_malformed(table)}.")
    return records


def topic_columns(topic: TopicProfile, table: Table, rows: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return which of some rows have all the numbers of a topic, and its fields of those, SI and NED/FRD."""
    there = rows.copy()
    for one in topic.fields.values():  # a cell that is empty or no number costs its own topic, not the row
        for name in one.columns:
            there &= np.isfinite(table.numbers[name])
    return there, {name: _values(one, table, there) for name, one in topic.fields.items()}


def table_rows(topic: TopicProfile, stamps: np.ndarray, columns: dict[str, np.ndarray]) -> TableRow:
    """Return the rows of a topic with all fields: those given, those made of others, and the usual sigmas."""
    kind = spec(topic.topic)
    complete = derived.complete(kind.name, kind, columns, len(stamps))
    return TableRow((stamps, topic.topic), complete, topic.mounting_deg, topic.station)


def _first_malformed(table: Table) -> str:
    return f"the first that fails is line {table.malformed[0][0]}: {table.malformed[0][1]}" if table.malformed else "their cells are empty"


def _kept(table: Table, profile: TableProfile) -> np.ndarray:
    kept = np.ones(len(table.row_end), bool)
    for name, (low, high) in profile.keep.items():
        kept &= (table.numbers[name] >= low) & (table.numbers[name] <= high)
    kept[kept] = np.arange(int(kept.sum())) % profile.every == 0
    return kept


def _refuse_no_place(columns: dict[str, np.ndarray], table: Table, rows: np.ndarray, where: str) -> None:
    """Refuse latitudes and longitudes that are none, with what they look like."""
    for name, limit_deg in (("lat", 90.0), ("lon", 180.0)):
        degrees = np.degrees(columns.get(name, np.zeros(0)))
        wrong = np.flatnonzero(np.abs(degrees) > limit_deg * (1.0 + 1e-12))
        if not len(wrong):
            continue
        value, line = degrees[wrong[0]], table.lines[np.flatnonzero(rows)[wrong[0]]]
        guess = "latitude and longitude exchanged?" if abs(value) <= 180.0 else "degrees and minutes of NMEA (unit ddmm)?"
        guess = "1e-7 deg (unit 1e-7 deg)?" if abs(value) > 100.0 * limit_deg + 60.0 else guess
        raise ConvertError(f"{where}: line {line}: {name} {value:.10g} is no number of degrees: {guess}")


def _values(spec: FieldSpec, table: Table, rows: np.ndarray) -> np.ndarray:
    """Return a field in SI and NED/FRD: shape (n,) for one column, (n, k) for several."""
    n = int(rows.sum())
    if spec.columns:
        values = np.stack([table.numbers[name][rows] for name in spec.columns], axis=1)
    else:
        values = np.tile(np.array(spec.constants), (n, 1))
    if spec.unit == NMEA:
        whole = np.trunc(values / 100.0)
        values = whole + (values - 100.0 * whole) / 60.0
    values = values * spec.factor + spec.offset
    if spec.frame == "ENU":
        values = conv.swap_world(values)
    elif spec.frame == "FLU":
        values = conv.swap_body(values)
    return values[:, 0] if values.shape[1] == 1 else values
