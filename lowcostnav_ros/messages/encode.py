"""Measurements to message objects (:func:`encode`) and CDR bytes (:func:`encode_cdr`); the door to what builds all other messages."""

from collections.abc import Callable, Iterator
from typing import Any

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.messages.kind import TOPICS, Kind
from lowcostnav_ros.messages.kinds.health import clock, diagnostics, health_from
from lowcostnav_ros.messages.kinds.imu import imu_attitude, imu_from_solution, imu_raw, imu_raw_cdr
from lowcostnav_ros.messages.kinds.navigator import fix_from_solution, odometry_from_solution, origin_fix, wind_from_solution, wind_message
from lowcostnav_ros.messages.kinds.truth import truth_imu, truth_odometry, truth_wind
from lowcostnav_ros.messages.layouts import messages_like
from lowcostnav_ros.messages.rules import RULES
from lowcostnav_ros.messages.samples import TableRow
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.messages.topics import spec

__all__ = ["clock", "diagnostics", "encode", "encode_cdr", "fix_from_solution", "imu_attitude", "imu_from_solution", "imu_raw"]
__all__ += ["imu_raw_cdr", "odometry_from_solution", "origin_fix", "truth_imu", "truth_odometry", "truth_wind", "wind_from_solution"]
__all__ += ["wind_message", "health_from"]


Record = tuple[int, str, str, bytes]
"""Stamp in ns, topic, message type, CDR bytes."""


def encode(measurement: Measurement) -> Any:
    """Build the message object of a measurement, of the kind of its source, or of its class where the source has none.

    Raises
    ------
    TypeError
        For a measurement that has no message of its own, such as a block of several inertial samples (see :func:`encode_cdr`).
    """
    return _encoder(measurement)[1](measurement)


def encode_cdr(measurement: Any) -> Iterator[Record]:
    """Yield (stamp_ns, topic, message type, CDR bytes) of a measurement, one per sample of an :class:`ImuBlock`."""
    kind, to_message = _encoder(measurement)
    if kind.encode_many is None:
        yield measurement.stamp_ns, measurement.source, kind.msgtype, to_cdr(to_message(measurement))
        return
    for stamp_ns, raw in zip(measurement.stamps_ns.tolist(), kind.encode_many(measurement), strict=True):
        yield stamp_ns, measurement.source, kind.msgtype, raw


def encode_rows(rows: TableRow) -> list[Record]:
    """Return the records of all rows of a table of the topic ``rows.head[1]``, in order; in columns where its kind can."""
    stamps_ns, topic = rows.head
    kind = spec(topic)
    build: Any = kind.from_row
    if kind.encode_many is not None:
        return list(encode_cdr(build(rows)))
    if kind.numbers is None:
        return [_record(build(rows.row(k)), topic, kind, stamp_ns) for k, stamp_ns in enumerate(stamps_ns.tolist())]
    *_, first = _record(build(rows.row(0)), topic, kind, 0)
    raws = messages_like(first, kind.msgtype, stamps_ns, kind.numbers(rows))
    return [(stamp_ns, topic, kind.msgtype, raw) for stamp_ns, raw in zip(stamps_ns.tolist(), raws, strict=True)]


def _record(built: Any, topic: str, kind: Kind, stamp_ns: int) -> Record:
    """The record of what a kind makes of a row: a measurement or a message."""
    return next(encode_cdr(built)) if isinstance(built, Measurement) else (stamp_ns, topic, kind.msgtype, to_cdr(built))


def _encoder(measurement: Measurement) -> tuple[Kind, Callable[[Any], Any]]:
    kind, cls = RULES.kind_of(measurement.source), type(measurement)
    if kind is None or kind.measurement is not cls or kind.encode is None:
        kind = next((other for other in TOPICS.values() if other.by_type and other.measurement is cls), None)
    if kind is None or kind.encode is None:
        raise TypeError(f"A {cls.__name__} from {measurement.source} has no message of its own.")
    return kind, kind.encode
