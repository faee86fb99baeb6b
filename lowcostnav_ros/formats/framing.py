"""A stream of bytes cut into frames of the protocols it may hold, or into lines; what belongs to none is skipped and counted.

A frame whose check sum is wrong costs one byte: the search goes on inside it, so that a good frame that a broken header claimed for its own
is not lost with it.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

MORE, NONE = 0, -1
"""In place of a length: more bytes are needed to tell; no frame begins here."""


@dataclass(frozen=True)
class Protocol:
    """How the frames of one protocol are found.

    Attributes
    ----------
    name : str
    sync : bytes
        What a frame begins with; the first byte must not begin another protocol of the same stream.
    length : callable
        (buffer, start) to the length of the frame in bytes, :data:`MORE` or :data:`NONE`.
    is_sound : callable
        Whether the check sum of a frame is right.
    """

    name: str
    sync: bytes
    length: Callable[[bytearray, int], int]
    is_sound: Callable[[bytes], bool]


@dataclass(slots=True)
class Framer:
    """Cuts a stream into frames; ``broken`` counts frames with a wrong check sum by protocol, ``skipped`` bytes outside of frames."""

    protocols: Sequence[Protocol]
    frames: Counter = field(default_factory=Counter)
    broken: Counter = field(default_factory=Counter)
    skipped: int = 0
    _buffer: bytearray = field(default_factory=bytearray)

    def feed(self, data: bytes, is_last: bool = False) -> Iterator[tuple[str, bytes]]:
        """Take bytes and yield (protocol, frame) of every whole frame; after the last bytes nothing is waited for."""
        search = re.compile(b"|".join(re.escape(protocol.sync) for protocol in self.protocols)).search
        by_first = {protocol.sync[0]: protocol for protocol in self.protocols}
        buffer, at = self._buffer, 0
        buffer += data
        while True:
            found = search(buffer, at)
            start = found.start() if found else self._tail(at, is_last)
            self.skipped += start - at
            at = start
            if found is None:
                break
            protocol = by_first[buffer[start]]
            size = protocol.length(buffer, start)
            if size == MORE or start + size > len(buffer):
                if not is_last:
                    break
                size = NONE
            frame = bytes(buffer[start : start + size]) if size > 0 else b""
            if frame and protocol.is_sound(frame):
                at += size
                self.frames[protocol.name] += 1
                yield protocol.name, frame
                continue
            self.broken[protocol.name] += bool(frame)
            self.skipped += 1
            at += 1
        del buffer[:at]

    def _tail(self, at: int, is_last: bool) -> int:
        """Where to go on when no frame begins: a last byte that may be the first half of a sync is kept."""
        end = len(self._buffer)
        keep = end > at and not is_last and any(len(p.sync) > 1 and self._buffer[-1] == p.sync[0] for p in self.protocols)
        return end - keep


@dataclass(slots=True)
class LineFramer:
    """Cuts a stream of text into lines, as :class:`Framer` does with frames; what is no line of the protocol is skipped and counted.

    Attributes
    ----------
    name : str
        Of the protocol.
    is_sound : callable
        Whether a line, without its end, is one of the protocol.
    longest : int
        Bytes after which what has no end is no line.
    """

    name: str
    is_sound: Callable[[bytes], bool]
    longest: int = 2000
    frames: Counter = field(default_factory=Counter)
    broken: Counter = field(default_factory=Counter)
    skipped: int = 0
    _rest: bytes = b""

    def feed(self, data: bytes, is_last: bool = False) -> Iterator[tuple[str, bytes]]:
        """Take bytes and yield (protocol, line) of every whole line; the last bytes need no end."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if is_last or len(self._rest) > self.longest:
            lines, self._rest = [*lines, self._rest], b""
        for line in lines:
            text = line.strip(b"\r \t\0")
            if text and len(line) <= self.longest and self.is_sound(text):
                self.frames[self.name] += 1
                yield self.name, text
            elif text:
                self.broken[self.name] += 1
                self.skipped += len(line)
