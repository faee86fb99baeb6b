"""The order in which the messages of a recording arrived: that of the file, where the receive stamps are no guide to it.

rosbags merges by receive stamp.  That is right for a file that was written topic by topic, and the same as the order of the file for what
a recorder wrote as it came.  But a clock that was set back while recording (NTP, a bag played in a loop) leaves two flights laid over one
another by their stamps; there a topic's own stamps go back, and the file is read as it was written.
"""

import struct
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, decompress
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from lowcostnav_ros.messages.windows import Window, batched

Messages = Generator[tuple[Connection, int, bytes], None, None]
Names = Mapping[tuple[str, str], str]
"""Topic and type of the messages that are wanted, and the source that they are read as."""
_INDEX_HEAD = 9 + 2 + 4  # opcode and length, channel, bytes of the entries
_RECORD, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
_CHUNK_HEAD, _MESSAGE_OPCODE = 9 + 40, 0x05
_MOST_CHUNKS = 16
"""Chunks that overlap in time are merged in columns; more of them at once one by one."""
_ENTRY = np.dtype([("stamp_ns", "<u8"), ("offset", "<u8")])
_GOES_BACK = (
    "SELECT 1 FROM (SELECT timestamp AS now, lag(timestamp) OVER (PARTITION BY topic_id ORDER BY id) AS before FROM messages) "
    "WHERE now < before LIMIT 1"
)


class ArrivalMcap(McapReader):
    """An mcap file."""

    @cached_property
    def goes_back(self) -> bool:
        """Whether the stamps of a topic go back: within a chunk or from one to the next, by their index."""
        newest: dict[int, int] = {}
        for chunk in sorted(self.chunks, key=lambda chunk: chunk.chunk_start_offset):
            if not chunk.message_index_length:
                return self._goes_back_by_scan()
            for channel, place in chunk.message_index_offsets.items():
                stamps = self._indexed(place)
                if stamps.size and (stamps[0] < newest.get(channel, 0) or (stamps[1:] < stamps[:-1]).any()):
                    return True
                newest[channel] = int(stamps[-1]) if stamps.size else newest.get(channel, 0)
        return False

    def _indexed(self, place: int) -> np.ndarray:
        """Stamps (k,) of one channel in a chunk, in the order of the file, from the index record at ``place``."""
        assert self.bio is not None
        self.bio.seek(place)
        size = int.from_bytes(self.bio.read(_INDEX_HEAD)[-4:], "little")
        entries = np.frombuffer(self.bio.read(size), dtype=_ENTRY)
        stamps: np.ndarray = entries["stamp_ns"][np.argsort(entries["offset"], kind="stable")]
        return stamps

    def _goes_back_by_scan(self) -> bool:
        newest: dict[int, int] = {}
        for connection, stamp_ns, _ in self.messages_scan(self.connections):
            if stamp_ns < newest.get(connection.id, 0):
                return True
            newest[connection.id] = stamp_ns
        return False

    def messages(self, connections: Collection[Connection], start: int | None = None, stop: int | None = None) -> Messages:
        """Yield (connection, stamp ns, CDR bytes) in the order of arrival."""
        read: Callable[..., Messages] = self.messages_scan if not self.chunks or self.goes_back else super().messages
        return read(connections, start, stop)

    def windows(self, names: Names) -> Iterator[Window]:
        """Yield what :meth:`messages` does, a chunk at a time."""
        chunks = sorted(self.chunks, key=lambda chunk: (chunk.message_start_time, chunk.chunk_start_offset))
        if not chunks or self.goes_back or not _follow(chunks):
            yield from _one_by_one(self, names)
            return
        sources = list(dict.fromkeys(names.values()))
        wanted = {c.id: sources.index(names[c.topic, c.msgtype]) for c in self.connections if (c.topic, c.msgtype) in names}
        held = Window.of_messages([])
        for chunk in chunks:
            if any(chunk.channel_count.get(channel, 0) for channel in wanted):
                done = int(np.searchsorted(held.stamps_ns, chunk.message_start_time))
                if done:
                    yield held[:done]
                held = Window.joined([*([held[done:].compact()] if done < len(held) else []), self._window(chunk, wanted, sources)])
        if len(held):
            yield held

    def _window(self, chunk: ChunkInfo, wanted: Mapping[int, int], sources: list[str]) -> Window:
        """Messages of a chunk, in the order of the file."""
        assert self.bio is not None
        self.bio.seek(chunk.chunk_start_offset + 9 + 24)
        crc = int.from_bytes(self.bio.read(4), "little")
        self.bio.seek(chunk.chunk_start_offset + _CHUNK_HEAD + len(chunk.compression))
        data = decompress(self.bio.read(chunk.compressed_size), chunk.compression, chunk.uncompressed_size, crc)
        at, end, found = 0, len(data), []
        while at < end:
            opcode, size = _RECORD.unpack_from(data, at)
            at += _RECORD.size
            if size > end - at:
                raise ReaderError(f"Truncated record in the chunk at offset {chunk.chunk_start_offset}.")
            if opcode == _MESSAGE_OPCODE:
                channel, _, stamp_ns, _ = _MESSAGE.unpack_from(data, at)
                if channel in wanted:
                    found.append((wanted[channel], stamp_ns, at + _MESSAGE.size, size - _MESSAGE.size))
            at += size
        return Window(data, sources, *np.array(found, np.int64).reshape(-1, 4).T)


def _follow(chunks: list[ChunkInfo]) -> bool:
    """Whether chunks in the order of their times are in that of the file, and no more than a few overlap at any time."""
    starts, ends = (np.array([getattr(chunk, name) for chunk in chunks]) for name in ("message_start_time", "message_end_time"))
    offsets = np.array([chunk.chunk_start_offset for chunk in chunks])
    overlapping = np.arange(len(chunks)) - np.searchsorted(np.sort(ends), starts)
    return bool((np.diff(offsets) > 0).all() and overlapping.max() < _MOST_CHUNKS)


def _one_by_one(storage: Any, names: Names) -> Iterator[Window]:
    """Windows of the messages as a storage yields them."""
    wanted = [c for c in storage.connections if (c.topic, c.msgtype) in names]
    return batched((names[c.topic, c.msgtype], stamp_ns, raw) for c, stamp_ns, raw in (storage.messages(wanted) if wanted else ()))


class ArrivalSqlite3(Sqlite3Reader):
    """An sqlite3 file."""

    windows = _one_by_one

    @cached_property
    def goes_back(self) -> bool:
        """Whether the stamps of a topic go back."""
        assert self.dbconn is not None
        return self.dbconn.execute(_GOES_BACK).fetchone() is not None

    def messages(self, connections: Collection[Connection], start: int | None = None, stop: int | None = None) -> Messages:
        """Yield (connection, stamp ns, CDR bytes) in the order of arrival."""
        if not self.goes_back:
            yield from super().messages(connections, start, stop)
            return
        assert self.dbconn is not None
        wanted, first, last = {c.id: c for c in connections}, start or 0, 2**63 - 1 if stop is None else stop
        for topic, stamp_ns, data in self.dbconn.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id"):
            if topic in wanted and first <= stamp_ns < last:
                yield wanted[topic], stamp_ns, data


class _ArrivalFolder(DirectoryReader):
    STORAGE_PLUGINS: Any = {"mcap": ArrivalMcap, "sqlite3": ArrivalSqlite3}

    def windows(self, names: Names) -> Iterator[Window]:
        """Yield what :meth:`messages` does in windows."""
        if self.metadata.compression_mode == "message":
            yield from _one_by_one(self, names)
            return
        storages: list[Any] = self.storages
        for storage in storages:
            yield from storage.windows(names)


class ArrivalReader(Reader):
    """A recording of either storage in the order of arrival."""

    STORAGE_PLUGINS: Any = {"dir": _ArrivalFolder, ".mcap": ArrivalMcap, ".db3": ArrivalSqlite3}
    storage: Any

    def windows(self, names: Names) -> Iterator[Window]:
        """Yield all messages of some topics in windows."""
        yield from self.storage.windows(names)
