"""What the parsers of streams share: bytes in, measurements out, and an account of what was not used and what was assumed."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import ClassVar

from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.base.tally import Tally
from lowcostnav_ros.formats.framing import Framer, LineFramer, Protocol

UTC, BOOT, ARRIVAL = "UTC", "time since start of the device", "time of arrival"
"""Clocks that stamps may be in; of a protocol that carries no time, a message is stamped when it came."""

STEP_NS = 5 * 10**9
"""A stamp this far behind the newest is a clock that stepped, not a late message."""
ROLLOVER_S, SHORTEST_LEAP_S, LONGEST_LEAP_S = 1024 * 604_800.0, 10.0, 18.5
"""What a week number of ten bits loses at its end; the leap seconds (18 since 2017) less what passes until the step is seen."""


@dataclass(slots=True)
class Account:
    """What a parser found.

    Attributes
    ----------
    origins : dict of source to what it was made of, with its unit as it was decided
    refused : Tally of phrase
        What cannot be used and why.
    left_out : Tally of name
        Messages that no topic is made of.
    remarks : list of str
        One sentence each, said once.
    """

    origins: dict[str, str] = field(default_factory=dict)
    refused: Tally[str] = field(default_factory=Tally)
    left_out: Tally[str] = field(default_factory=Tally)
    remarks: list[str] = field(default_factory=list)

    def remark(self, sentence: str) -> None:
        """Add a remark once; there are no more than a hundred."""
        if sentence not in self.remarks and len(self.remarks) < 100:
            self.remarks.append(sentence)


class Parser:
    """Base of the parsers of streams.

    A subclass lists the ``protocols`` of its stream, or makes a framer of its own, and gives :meth:`take`.  Stamps are in the device's
    ``clock``; ``utc_offset_ns`` is what to add for UTC, None while that is not known.  ``arrived_ns`` is when the bytes now fed came, by
    the clock of whoever feeds them, 0 where they are read from a file; ``greeting`` is what the device waits for before it says anything.
    """

    protocols: ClassVar[tuple[Protocol, ...]] = ()
    clock: ClassVar[str] = UTC
    greeting: bytes = b""

    def __init__(self) -> None:
        self.framer: Framer | LineFramer = Framer(self.protocols)
        self.arrived_ns = 0
        self.account = Account()
        self._newest: dict[str, int] = {}
        self.utc_offset_ns: int | None = 0 if self.clock == UTC else None

    def is_new(self, source: str, stamp_ns: int) -> bool:
        """Whether a stamp is after the last of its source; a repeated one is no measurement more.

        A step back by more than :data:`STEP_NS` is a device that was started anew, or the end of a stretch of wrong times.
        """
        newest = self._newest.get(source, 0)
        if newest - STEP_NS < stamp_ns <= newest:
            return False
        if stamp_ns < newest:
            step_s = 1e-9 * (newest - stamp_ns)
            self.account.remark(f"The time of {source} stepped back by {step_s:.1f} s{why_back(step_s)}; what follows counts from there.")
            self.stepped_back()
        self._newest[source] = stamp_ns
        return True

    def stepped_back(self) -> None:
        """The device's clock stepped back."""

    def take(self, protocol: str, frame: bytes) -> Iterable[Measurement]:
        """Turn one sound frame into measurements."""
        raise NotImplementedError

    def feed(self, data: bytes) -> Iterator[Measurement]:
        """Take bytes and yield the measurements that they complete, in the order in which they came."""
        for protocol, frame in self.framer.feed(data):
            yield from self.take(protocol, frame)

    def close(self) -> Iterator[Measurement]:
        """Yield what can be made of the rest, once no more bytes will come."""
        for protocol, frame in self.framer.feed(b"", is_last=True):
            yield from self.take(protocol, frame)


def why_back(step_s: float) -> str:
    """What a step back of a receiver's time, less what passed until it was seen, may be; empty where nothing is known to step so."""
    if abs(step_s - ROLLOVER_S) < LONGEST_LEAP_S:
        return ": 1024 weeks, its week number rolled over"
    return ": what a receiver steps by that has come to know the leap seconds" if SHORTEST_LEAP_S < step_s < LONGEST_LEAP_S else ""


def shifted(one: Measurement, offset_ns: int) -> Measurement:
    """Return a measurement with its stamps moved."""
    if isinstance(one, ImuBlock):
        return ImuBlock.of(one.source, one.stamps_ns + offset_ns, one.specific_force_b, one.angular_rate_b)
    return replace(one, stamp_ns=one.stamp_ns + offset_ns)
