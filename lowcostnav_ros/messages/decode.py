"""CDR bytes to measurements: what cannot be used comes back as a :class:`Rejected` with a reason, never as an exception or a NaN.

Live nodes hand over the bytes of raw subscriptions, a replay the bytes of a bag; both get the same measurement to the last bit.
"""

from collections import Counter

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock, Measurement, NavSolution
from lowcostnav_ros.base.tally import OTHERS, Tally
from lowcostnav_ros.messages import checks, imu_columns, topics
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.messages.map_frames import MapFrame
from lowcostnav_ros.messages.rules import RULES, DecodeRules, Refusal, Rejected
from lowcostnav_ros.messages.store import from_cdr, full_type
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
    block, rejected, _good = _imu_rows(raws, source, rules)
    return block, rejected


def _imu_rows(raws: list[bytes], source: str, rules: DecodeRules) -> tuple[ImuBlock | None, list[Rejected], np.ndarray]:
    kind = topics.spec(source, rules)
    stamps, force, rate, good = imu_columns.many(raws, kind, rules)
    rejected = []
    for row in np.flatnonzero(~good):
        result = _carefully(raws[row], kind, rules, Counter())
        if isinstance(result, Rejected):
            rejected.append(result)
        elif isinstance(result, ImuBlock):
            stamps[row], force[row], rate[row], good[row] = result.stamp_ns, result.specific_force_b[0], result.angular_rate_b[0], True
    if not good.any():
        return None, rejected, good
    if rejected:
        stamps, force, rate = stamps[good], force[good], rate[good]
    return ImuBlock.of(source, stamps, force, rate), rejected, good


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

    def decode_imu_block(self, raws: list[bytes], source: str) -> tuple[ImuBlock | None, np.ndarray]:
        """Decode consecutive inertial messages in columns, count them, and return which were usable.

        Returns
        -------
        block : ImuBlock or None
        good : ndarray of bool, shape (len(raws),)
        """
        block, rejected, good = _imu_rows(raws, source, self.rules)
        self.accepted[source] += int(good.sum())
        for one in rejected:
            self.count(one, source)
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
