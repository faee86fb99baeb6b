"""A recording in windows: some thousand messages at a time, their bytes in one piece and what heads each of them in columns."""

import itertools
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

MESSAGES, BYTES = 4096, 4_000_000
"""Most messages, and most of their bytes but for those of the last one, of a window that is no chunk of a file."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Consecutive messages of a recording in the order of arrival.

    Attributes
    ----------
    data : bytes
        Holds the CDR bytes of all of them.
    sources : sequence of str
    of : ndarray of int64, shape (n,)
        Index of the source of each message.
    stamps_ns : ndarray of int64, shape (n,)
        Receive stamps.
    starts, sizes : ndarray of int64, shape (n,)
        Where the bytes of each message stand in ``data``.
    """

    data: bytes
    sources: Sequence[str]
    of: np.ndarray
    stamps_ns: np.ndarray
    starts: np.ndarray
    sizes: np.ndarray

    @classmethod
    def of_messages(cls, messages: Sequence[tuple[str, int, bytes]]) -> "Window":
        """Build a window of (source, receive stamp ns, CDR bytes)."""
        sources = list(dict.fromkeys(source for source, _, _ in messages))
        index = {source: k for k, source in enumerate(sources)}
        sizes = np.array([len(raw) for _, _, raw in messages], np.int64)
        of, stamps = (np.array(column, np.int64) for column in ([index[s] for s, _, _ in messages], [t for _, t, _ in messages]))
        return cls(b"".join([raw for _, _, raw in messages]), sources, of, stamps, np.cumsum(sizes) - sizes, sizes)

    @classmethod
    def joined(cls, parts: Sequence["Window"]) -> "Window":
        """Join windows of the same sources that overlap in time, in the order of their stamps, earlier parts first at equal stamps."""
        shifts = np.cumsum([0, *(len(part.data) for part in parts[:-1])])
        starts = np.concatenate([part.starts + shift for part, shift in zip(parts, shifts, strict=True)])
        of, stamps, sizes = (np.concatenate([getattr(part, name) for part in parts]) for name in ("of", "stamps_ns", "sizes"))
        data = parts[0].data if len(parts) == 1 else b"".join([part.data for part in parts])
        order = slice(None) if (np.diff(stamps) >= 0).all() else np.argsort(stamps, kind="stable")
        return cls(data, parts[0].sources, of[order], stamps[order], starts[order], sizes[order])

    def __len__(self) -> int:
        return len(self.of)

    def __getitem__(self, rows: slice | np.ndarray) -> "Window":
        return Window(self.data, self.sources, self.of[rows], self.stamps_ns[rows], self.starts[rows], self.sizes[rows])

    def raw(self, row: int) -> bytes:
        """CDR bytes of one message."""
        first = int(self.starts[row])
        return self.data[first : first + int(self.sizes[row])]

    def raws(self) -> list[bytes]:
        """CDR bytes of every message."""
        data = self.data
        return [data[a:b] for a, b in zip(self.starts.tolist(), (self.starts + self.sizes).tolist(), strict=True)]

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """Yield (source, receive stamp ns, CDR bytes)."""
        sources = self.sources
        return zip((sources[k] for k in self.of.tolist()), self.stamps_ns.tolist(), self.raws(), strict=True)

    def compact(self) -> "Window":
        """The same without bytes of other messages."""
        return Window(b"".join(self.raws()), self.sources, self.of, self.stamps_ns, np.cumsum(self.sizes) - self.sizes, self.sizes)

    def only(self, sources: Collection[str]) -> "Window":
        """The messages of some sources alone."""
        wanted = np.array([source in sources for source in self.sources], bool)
        return self if wanted.all() else self[wanted[self.of]]

    def by_source(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield every source that has messages here, with their rows."""
        for k, source in enumerate(self.sources):
            rows = np.flatnonzero(self.of == k)
            if len(rows):
                yield source, rows

    def table(self, rows: np.ndarray, dtype: np.dtype) -> np.ndarray:
        """Read messages of one size by the structure of a layout, shape (len(rows),)."""
        n = len(self.data) - dtype.itemsize + 1
        whole = np.ndarray((n,), f"V{dtype.itemsize}", self.data, strides=(1,))
        return whole[self.starts[rows]].view(dtype)

    def little_endian(self, rows: np.ndarray) -> np.ndarray:
        """Which messages, of two bytes at least, say that their CDR is little-endian, shape (len(rows),)."""
        heads: np.ndarray = np.ndarray((len(self.data) - 1,), "<u2", self.data, strides=(1,))[self.starts[rows]]
        return heads == 0x0100

    def update(self, digest: Any) -> None:
        """Add source, receive stamp and bytes of every message to a digest."""
        heads = [f"{source} ".encode() for source in self.sources]
        of, stamps, sizes = self.of.tolist(), self.stamps_ns.tolist(), self.sizes.tolist()
        pairs = zip([b"%b%d %d " % (heads[k], t, n) for k, t, n in zip(of, stamps, sizes, strict=True)], self.raws(), strict=True)
        digest.update(b"".join(itertools.chain.from_iterable(pairs)))


def batched(messages: Iterable[tuple[str, int, bytes]]) -> Iterator[Window]:
    """Make windows of messages that come one by one."""
    batch: list[tuple[str, int, bytes]] = []
    held = 0
    for message in messages:
        batch.append(message)
        held += len(message[2])
        if len(batch) == MESSAGES or held >= BYTES:
            yield Window.of_messages(batch)
            batch, held = [], 0
    if batch:
        yield Window.of_messages(batch)
