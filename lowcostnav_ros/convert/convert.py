"""Convert recorded tables to a standard recording."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lowcostnav_ros.base import measurements as m
from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.convert.profile import ConvertError, FieldSpec, Profile, TableProfile, TopicProfile, load_profile
from lowcostnav_ros.convert.table import Table, read_table
from lowcostnav_ros.convert.timebase import stamps_ns
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages import encode
from lowcostnav_ros.messages.bag import SETTINGS_FOLDER, BagWriter
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.physics.rotation import euler_to_dcm, euler_to_quat, wrap_2pi

_SHOWN = 5


@dataclass(slots=True)
class ConversionReport:
    """What a conversion did.

    Attributes
    ----------
    messages : dict of topic to number written
    malformed : dict of file to list of (line number, reason)
    skipped : dict of file to rows left out by ``keep`` and ``every``
    not_increasing : dict of file to rows left out because their time did not increase
    vehicle : name of the vehicle whose settings the recording carries, empty for none
    """

    messages: dict[str, int] = field(default_factory=dict)
    malformed: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    skipped: dict[str, int] = field(default_factory=dict)
    not_increasing: dict[str, int] = field(default_factory=dict)
    vehicle: str = ""

    def __str__(self) -> str:
        """Say it in lines for a terminal."""
        lines = [f"{count:8d}  {topic}" for topic, count in self.messages.items()]
        for file, rows in self.malformed.items():
            shown = "; ".join(f"line {number}: {reason}" for number, reason in rows[:_SHOWN])
            lines.append(f"{file}: {len(rows)} malformed rows left out ({shown}{'; ...' if len(rows) > _SHOWN else ''})")
        lines += [f"{file}: {n} rows left out by the profile" for file, n in self.skipped.items() if n]
        lines += [f"{file}: {n} rows left out, their time does not increase" for file, n in self.not_increasing.items() if n]
        if self.vehicle:
            lines.append(f"the recording carries the settings of vehicle '{self.vehicle}' for its replay")
        return "\n".join(lines)


Record = tuple[int, str, str, bytes]


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
    report = ConversionReport()
    records: list[Record] = []
    for table_profile in checked.tables:
        records += _records(_file(Path(source), table_profile, len(checked.tables)), table_profile, report)
    records.sort(key=lambda record: record[0])  # stable: topics of one row keep the order of the profile
    with BagWriter(out_bag, storage) as bag:
        for stamp_ns, topic, msgtype, cdr in records:
            bag.write(topic, msgtype, stamp_ns, cdr)
        report.messages = dict(bag.counts)
    if checked.vehicle:  # the recording carries the settings its vehicle is to be replayed with
        report.vehicle = checked.vehicle
        shutil.copytree(config_dir() / "vehicles" / checked.vehicle, Path(out_bag) / SETTINGS_FOLDER)
    return report


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
    stamps = stamps_ns(table, profile.time, path.parent)
    if table.malformed:
        report.malformed[path.name] = table.malformed
    kept = _kept(table, profile)
    report.skipped[path.name] = len(stamps) - int(kept.sum())
    rising = kept.copy()
    chosen = stamps[kept]
    rising[kept] = np.diff(np.maximum.accumulate(chosen), prepend=-1) > 0 if len(chosen) else False
    report.not_increasing[path.name] = int(kept.sum() - rising.sum())
    if not rising.any():
        raise ConvertError(f"{path}: the profile leaves no row; relax 'keep' or correct the time.")
    records: list[Record] = []
    for topic in profile.topics:
        columns = {name: _values(spec, table, rising) for name, spec in topic.fields.items()}
        records += _BUILDERS[topic.topic](topic, stamps[rising], columns)
    return records


def _kept(table: Table, profile: TableProfile) -> np.ndarray:
    kept = np.ones(len(table.row_end), bool)
    for name, (low, high) in profile.keep.items():
        kept &= (table.numbers[name] >= low) & (table.numbers[name] <= high)
    kept[kept] = np.arange(int(kept.sum())) % profile.every == 0
    return kept


def _values(spec: FieldSpec, table: Table, rows: np.ndarray) -> np.ndarray:
    """Return a field in SI and NED/FRD: shape (n,) for one column, (n, k) for several."""
    n = int(rows.sum())
    if spec.columns:
        values = np.stack([table.numbers[name][rows] for name in spec.columns], axis=1)
    else:
        values = np.tile(np.array(spec.constants), (n, 1))
    values = values * spec.factor + spec.offset
    if spec.frame == "ENU":
        values = conv.swap_world(values)
    elif spec.frame == "FLU":
        values = conv.swap_body(values)
    return values[:, 0] if values.shape[1] == 1 else values


def _mounted(values: np.ndarray, topic: TopicProfile) -> np.ndarray:
    """Turn sensor axes into body axes by the mounting rotations, the first applied first."""
    for turn in topic.mounting_deg:
        values = values @ euler_to_dcm(*np.radians(turn)).T
    return values


def _imu_raw(topic: TopicProfile, stamps: np.ndarray, columns: dict[str, np.ndarray]) -> Iterator[Record]:
    force, rate = _mounted(columns["force"], topic), _mounted(columns["rate"], topic)
    yield from encode.encode_cdr(m.ImuBlock.of(topic.topic, stamps, force, rate))


def _rows(build: Callable[[int, TopicProfile, dict], Any]) -> Callable[..., Iterator[Record]]:
    """Make a builder of records from a builder of the measurement of one row."""

    def records(topic: TopicProfile, stamps: np.ndarray, columns: dict[str, np.ndarray]) -> Iterator[Record]:
        for k, stamp_ns in enumerate(stamps.tolist()):
            yield from encode.encode_cdr(build(stamp_ns, topic, {name: column[k] for name, column in columns.items()}))

    return records


def _variances(sigma: np.ndarray) -> np.ndarray:
    return np.diag(np.abs(sigma) ** 2)


def _fix(stamp_ns: int, topic: TopicProfile, row: dict) -> m.GpsPosition:
    return m.GpsPosition(stamp_ns, topic.topic, float(row["lat"]), float(row["lon"]), float(row["height"]), _variances(row["sigma"]))


def _velocity(stamp_ns: int, topic: TopicProfile, row: dict) -> m.GpsVelocity:
    return m.GpsVelocity(stamp_ns, topic.topic, row["velocity"], _variances(row["sigma"]))


def _attitude(topic: TopicProfile, stamps: np.ndarray, columns: dict[str, np.ndarray]) -> Iterator[Record]:
    known = "force" in columns
    for k, stamp_ns in enumerate(stamps.tolist()):
        q_nb = columns["quaternion"][k] if "quaternion" in columns else euler_to_quat(*columns["euler"][k])
        force = columns["force"][k] if known else np.zeros(3)
        attitude = m.Attitude(stamp_ns, topic.topic, q_nb, _variances(columns["sigma"][k]), columns["rate"][k], force)
        message: Any = encode.imu_attitude(attitude, specific_force_known=known)
        yield stamp_ns, topic.topic, message.__msgtype__, to_cdr(message)


def _magnetic(stamp_ns: int, topic: TopicProfile, row: dict) -> m.MagneticField:
    return m.MagneticField(stamp_ns, topic.topic, _mounted(row["field"], topic), _variances(row["sigma"]))


def _air(stamp_ns: int, topic: TopicProfile, row: dict) -> m.AirVelocity:
    cov = np.diag([row["sigma"] ** 2, m.UNKNOWN_VARIANCE, m.UNKNOWN_VARIANCE])
    return m.AirVelocity(stamp_ns, topic.topic, np.array([row["tas"], 0.0, 0.0]), cov)


def _pressure(stamp_ns: int, topic: TopicProfile, row: dict) -> m.Pressure:
    return m.Pressure(stamp_ns, topic.topic, row["value"], row["sigma"] ** 2)


def _temperature(stamp_ns: int, topic: TopicProfile, row: dict) -> m.AirTemperature:
    return m.AirTemperature(stamp_ns, topic.topic, row["value"], row["sigma"] ** 2)


def _range(stamp_ns: int, topic: TopicProfile, row: dict) -> m.SlantRange:
    return m.SlantRange(stamp_ns, topic.topic, topic.station, row["range"], row["sigma"] ** 2)


def _radial(stamp_ns: int, topic: TopicProfile, row: dict) -> m.VorBearing:
    return m.VorBearing(stamp_ns, topic.topic, topic.station, float(wrap_2pi(row["radial"])), row["sigma"] ** 2)


_BUILDERS = {
    "imu/data_raw": _imu_raw,
    "imu/data": _attitude,
    "imu/data_fused": _attitude,
    "gps/fix": _rows(_fix),
    "gps/vel": _rows(_velocity),
    "imu/mag": _rows(_magnetic),
    "air/velocity": _rows(_air),
    "air/static_pressure": _rows(_pressure),
    "air/dynamic_pressure": _rows(_pressure),
    "air/temperature": _rows(_temperature),
    "dme/range": _rows(_range),
    "vor/bearing": _rows(_radial),
}
