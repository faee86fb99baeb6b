"""CDR bytes to measurements: what cannot be used comes back as a :class:`Rejected` with a reason, never as an exception or a NaN.

Live nodes hand over the bytes of raw subscriptions, a replay the bytes of a bag; both get the same measurement to the last bit.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock, Measurement, NavSolution
from lowcostnav_ros.base.tally import OTHERS, Tally
from lowcostnav_ros.messages import checks, topics
from lowcostnav_ros.messages.columns import Columns, decoded
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.messages.map_frames import MapFrame
from lowcostnav_ros.messages.rules import RULES, DecodeRules, Refusal, Rejected
from lowcostnav_ros.messages.store import from_cdr, full_type
from lowcostnav_ros.messages.windows import Window
from lowcostnav_ros.physics.earth import LocalFrame

__all__ = ["RULES", "DecodeRules", "Decoder", "Rejected", "decode", "decode_imu_block"]

Notes = Counter[str]


def decode(
    source: str, msgtype: str, raw: bytes | memoryview, rules: DecodeRules = RULES, notes: Notes | None = None
) -> Measurement | Rejected:
    """Turn the bytes of one message into a measurement.

    Parameters
    ----------
    source : str
        Topic name, with or without a leading slash; gives the meaning of the message (``gps/vel`` or ``air/velocity``).
    msgtype : str
        ``sensor_msgs/msg/Imu`` or ``sensor_msgs/Imu``.
    raw : bytes-like
        CDR, either byte order.
    rules : DecodeRules
        Frames, plausible ranges and default variances.
    notes : Counter, optional
        Counts, by phrase, what was assumed (``gps/fix: covariance unknown, default used``).

    Returns
    -------
    Measurement or Rejected
    """
    source = topics.source_of(source)
    kind = rules.kind_of(source)
    if kind is None or kind.decode is None:
        return Rejected(source, "unknown topic")
    if kind.msgtype != msgtype and kind.msgtype != full_type(msgtype):
        if full_type(msgtype) not in kind.also:
            return Rejected(source, "wrong message type", f"{full_type(msgtype)}, expected {kind.msgtype}")
        return _carefully(raw, kind, rules, Counter() if notes is None else notes, full_type(msgtype))
    if kind.fast is not None:
        measurement = kind.fast(raw, kind, rules)
        if measurement is not None:
            return measurement
    return _carefully(raw, kind, rules, Counter() if notes is None else notes)


def decode_imu_block(raws: list[bytes], source: str = "imu/data_raw", rules: DecodeRules = RULES) -> tuple[ImuBlock | None, list[Rejected]]:
    """Turn consecutive ``imu/data_raw`` messages into one block of columns.

    Returns
    -------
    block : ImuBlock or None
        The usable samples in the order given, bit-equal to decoding one by one; None where there is none.
    rejected : list of Rejected
    """
    window = Window.of_messages([(source, 0, raw) for raw in raws])
    found, rest = decode_many(window, np.arange(len(raws)), topics.spec(source, rules), rules)
    return imu_block(found, rest)[0], [result for _, result in rest if isinstance(result, Rejected)]


def decode_many(
    window: Window, rows: np.ndarray, kind: Kind, rules: DecodeRules = RULES, notes: Notes | None = None, msgtype: str = ""
) -> tuple[list[Columns], list[tuple[int, Measurement | Rejected]]]:
    """Turn the messages of one topic in a window into measurements, bit-equal to decoding one by one.

    Parameters
    ----------
    window : Window
    rows : ndarray of int64
        Those of the topic.
    kind : Kind
        Of the topic.
    msgtype : str
        Of its messages; empty for what the kind expects.

    Returns
    -------
    columns : list of Columns
        What is clean at first sight.
    rest : list of (int, Measurement or Rejected)
        Row and result of every other message.
    """
    notes = Counter() if notes is None else notes
    msgtype = full_type(msgtype or kind.msgtype)
    found = decoded(window, rows, kind, rules, notes) if msgtype == kind.msgtype and len(rows) else []
    done = np.concatenate([columns.rows for columns in found]) if found else rows[:0]
    left = rows if not found else np.setdiff1d(rows, done) if len(done) < len(rows) else rows[:0]
    return found, [(row, decode(kind.name, msgtype, window.raw(row), rules, notes)) for row in left.tolist()]


def imu_block(found: Sequence[Columns], rest: Sequence[tuple[int, Measurement | Rejected]]) -> tuple[ImuBlock | None, np.ndarray]:
    """Join the inertial samples of :func:`decode_many` in the order of their messages; return the block and the row of each sample."""
    parts = [(columns.rows, columns.stamps_ns, *columns.fields) for columns in found]
    single = [(row, one) for row, one in rest if isinstance(one, ImuBlock)]
    parts += [(np.array([row]), one.stamps_ns, one.specific_force_b, one.angular_rate_b) for row, one in single]
    if not parts:
        return None, np.zeros(0, np.int64)
    rows, *columns = parts[0] if len(parts) == 1 else (np.concatenate(column) for column in zip(*parts, strict=True))
    if len(parts) > 1:
        order = np.argsort(rows)
        rows, columns = rows[order], [column[order] for column in columns]
    return ImuBlock.of(found[0].kind.name if found else single[0][1].source, *columns), rows


class Decoder:
    """A decoder that counts: accepted and rejected by source, assumptions by phrase; learns map origins as they pass.

    Attributes
    ----------
    accepted : Counter of source
    rejected : Counter of (source, reason)
    notes : Counter of phrase
    examples : dict of (source, reason) to the detail of the first rejected
    """

    def __init__(self, rules: DecodeRules | None = None) -> None:
        self.rules = rules or DecodeRules()
        self.accepted: Counter[str] = Counter()
        self.rejected: Counter[tuple[str, str]] = Tally(others=(OTHERS, OTHERS))
        self.notes: Notes = Tally()
        self.examples: dict[tuple[str, str], str] = {}

    def decode(self, source: str, msgtype: str, raw: bytes | memoryview) -> Measurement | Rejected:
        """Decode one message as :func:`decode` does, and count it."""
        result = decode(source, msgtype, raw, self.rules, self.notes)
        source = topics.source_of(source)
        if source.endswith("/origin") and isinstance(result, NavSolution):
            lat, lon, height = result.lat, result.lon, result.height
            if lat is not None and lon is not None and height is not None:
                origin, room = LocalFrame(lat, lon, height), source.rpartition("/")[0]
                frame = self.rules.map_frames.setdefault(room, MapFrame(origin, result.stamp_ns))
                frame.announce(origin)
                self.rules.origins[room] = frame.origin
        self.count(result, source)
        return result

    def decode_many(self, window: Window, rows: np.ndarray, msgtype: str) -> tuple[list[Columns], list[tuple[int, Measurement]]]:
        """Decode the messages of one topic in a window as :func:`decode_many` does, and count them; what is rejected is left out.

        Raises
        ------
        ValueError
            For a topic that is none.
        """
        source = window.sources[window.of[rows[0]]]
        kind = topics.spec(source, self.rules)
        if source.endswith("/origin"):  # what the next odometry means depends on it
            rest = [(row, self.decode(source, msgtype, window.raw(row))) for row in rows.tolist()]
            return [], [(row, one) for row, one in rest if not isinstance(one, Rejected)]
        found, others = decode_many(window, rows, kind, self.rules, self.notes, msgtype)
        self.accepted[source] += sum(map(len, found))
        for _, one in others:
            self.count(one, source)
        return found, [(row, one) for row, one in others if not isinstance(one, Rejected)]

    def decode_imu_block(self, raws: list[bytes], source: str) -> tuple[ImuBlock | None, np.ndarray]:
        """Decode consecutive inertial messages in columns, count them, and return which were usable.

        Returns
        -------
        block : ImuBlock or None
        good : ndarray of bool, shape (len(raws),)
        """
        window, good = Window.of_messages([(source, 0, raw) for raw in raws]), np.zeros(len(raws), bool)
        block, rows = imu_block(*self.decode_many(window, np.arange(len(raws)), topics.spec(source, self.rules).msgtype))
        good[rows] = True
        return block, good

    def count(self, result: Measurement | Rejected, source: str) -> None:
        """Count one result."""
        if isinstance(result, Rejected):
            self.rejected[source, result.reason] += 1
            self.examples.setdefault((source, result.reason), result.detail)
        else:
            self.accepted[source] += 1


def _carefully(raw: bytes | memoryview, kind: Kind, rules: DecodeRules, notes: Notes, other: str = "") -> Measurement | Rejected:
    stamp_ns = 0
    assert kind.decode is not None, f"{kind.name} has no decoder"
    try:
        message = kind.also[other](from_cdr(raw, other)) if other else from_cdr(raw, kind.msgtype)
    except Exception as error:
        return Rejected(kind.name, "malformed message", str(error)[:120])
    try:
        stamp_ns = checks.stamp_ns(message.header)
        return kind.decode(message, checks.Received((stamp_ns, kind.name), kind, rules, notes))
    except Refusal as refusal:
        return Rejected(kind.name, refusal.reason, refusal.detail, stamp_ns)
    except (ArithmeticError, ValueError) as error:  # numbers that no check foresaw must not end a flight
        return Rejected(kind.name, "numbers cannot be used", f"{type(error).__name__}: {error}"[:120], stamp_ns)
