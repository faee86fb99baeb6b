"""Recordings whose recorder was killed (SIGKILL, power cut, full disk), read to their last whole message.

An mcap file grows by whole records; its index, and the ``metadata.yaml`` beside it, are written when it is closed.  Without them the file
is walked once: the records that are whole are indexed here, the chunk that was being written is cut after its last whole message.  An
sqlite3 file is rolled back from its journal as every reader of it would do, in a copy.  The recording itself is not touched.
"""

import io
import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, NamedTuple

from rosbags.interfaces import Connection
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import ChunkInfo, decompress, read_string

from lowcostnav_ros.messages.arrival import ArrivalMcap, ArrivalSqlite3, Names
from lowcostnav_ros.messages.windows import Window

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_RECORD = 9  # opcode and length
_CHUNK_HEAD, _MESSAGE_HEAD = struct.Struct("<QQQI"), struct.Struct("<HIQQ")


class _Chunk(NamedTuple):
    """What is whole of the records of one chunk: their bytes, first and last stamp, messages by channel."""

    length: int
    start_ns: int
    end_ns: int
    counts: Counter


def _walk(body: bytes, channels: set[int], is_twice: bool) -> _Chunk:
    """Walk the records of a chunk up to the last whole one; ``channels``, known so far, are added to.

    Where ``is_twice`` every message bears its stamp twice, as this package's recorder writes it.
    """
    at, start_ns, end_ns = 0, 2**63 - 1, 0
    counts: Counter[int] = Counter()
    while at + _RECORD <= len(body):
        opcode, size = body[at], int.from_bytes(body[at + 1 : at + _RECORD], "little")
        if opcode not in (_SCHEMA, _CHANNEL, _MESSAGE) or at + _RECORD + size > len(body):
            break
        if opcode == _CHANNEL:
            channels.add(int.from_bytes(body[at + _RECORD : at + _RECORD + 2], "little"))
        if opcode == _MESSAGE:
            channel, _, stamp_ns, sent_ns = _MESSAGE_HEAD.unpack_from(body, at + _RECORD) if size >= _MESSAGE_HEAD.size else (-1, 0, 0, 0)
            if channel not in channels or (stamp_ns != sent_ns and is_twice):  # of a page that a power cut left empty
                break
            start_ns, end_ns = min(start_ns, stamp_ns), max(end_ns, stamp_ns)
            counts[channel] += 1
        at += _RECORD + size
    return _Chunk(at, start_ns, end_ns, counts)


class _WithEnd(io.RawIOBase):
    """A file up to a place, then other bytes."""

    def __init__(self, file: BinaryIO, place: int, end: bytes) -> None:
        self._file, self._place, self._end, self._at = file, place, end, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = offset + (0, self._at, self._place + len(self._end))[whence]
        return self._at

    def readinto(self, buffer: Any) -> int:
        if self._at < self._place:
            self._file.seek(self._at)
            data = self._file.read(min(len(buffer), self._place - self._at))
        else:
            data = self._end[self._at - self._place :][: len(buffer)]
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)

    def close(self) -> None:
        self._file.close()
        super().close()


class _UnclosedMcap(ArrivalMcap):
    """An mcap file without its end."""

    def _open(self) -> None:
        assert self.bio is not None
        head = self.bio.read(8 + _RECORD)
        if not head:
            raise ReaderError("the file is empty")
        if len(head) < 8 + _RECORD or not head.startswith(b"\x89MCAP0\r\n") or head[8] != 0x01:
            raise ReaderError("File magic is invalid.")
        self.data_start = len(head) + int.from_bytes(head[9:], "little")
        self._is_own = b"rosbags" in self.bio.read(min(self.data_start - len(head), 1000))
        chunks, end = self._scan()
        self.bio = io.BufferedReader(_WithEnd(self.bio, self.data_end, end))
        self.data_end += len(end)
        self.meta_scan()
        self.chunks = chunks
        found = self.statistics
        assert found is not None
        self.connections = [c._replace(msgcount=found.channel_message_counts.get(c.id, 0)) for c in self.connections]
        if found.message_count:
            span = found.end_time - found.start_time + 1
            self.metadata = self.metadata._replace(
                duration=span, start_time=found.start_time, end_time=found.end_time + 1, message_count=found.message_count
            )

    def _scan(self) -> tuple[list[ChunkInfo], bytes]:
        """Index the whole records; return their chunks, and the last one again without what is torn of it."""
        assert self.bio is not None
        chunks: list[ChunkInfo] = []
        self._known: set[int] = set()
        size = self.bio.seek(0, 2)
        at = self.data_start
        while at + _RECORD <= size:
            self.bio.seek(at)
            record = self.bio.read(_RECORD)
            opcode, length = record[0], int.from_bytes(record[1:], "little")
            if not 0x03 <= opcode < _DATA_END:
                break
            if opcode == _CHUNK:
                chunk, whole = self._chunk(at, self.bio.read(min(length, size - at - _RECORD)), length)
                if chunk is not None:
                    chunks.append(chunk)
                if whole is not None:
                    self.data_end = at
                    return chunks, whole
            elif at + _RECORD + length > size:
                break
            at += _RECORD + length
        self.data_end = at
        return chunks, b""

    def _chunk(self, at: int, record: bytes, length: int) -> tuple[ChunkInfo | None, bytes | None]:
        """Index a chunk; where it is torn, return it as a record of what is whole of it, empty for nothing."""
        if len(record) < 40:
            return None, b""
        head = io.BytesIO(record)
        _, _, body_size, crc = _CHUNK_HEAD.unpack(head.read(_CHUNK_HEAD.size))
        try:
            compression = read_string(head)
            stored_size = int.from_bytes(head.read(8), "little")
            body = head.read(stored_size)
            if compression:
                body = decompress(body, compression, body_size, crc)
        except Exception:  # cut within its head, or compressed and torn: nothing of it can be read
            return None, b""
        found = _walk(body, self._known, self._is_own)
        is_torn = len(record) < length or found.length < body_size
        if is_torn:
            compression, body = "", body[: found.length]
            record = _CHUNK_HEAD.pack(found.start_ns, found.end_ns, len(body), 0) + bytes(4) + struct.pack("<Q", len(body)) + body
            stored_size = body_size = len(body)
        chunk = None
        if found.counts:
            place = at, _RECORD + len(record), dict.fromkeys(found.counts, 0), 0
            chunk = ChunkInfo(found.start_ns, found.end_ns, *place, compression, stored_size, body_size, dict(found.counts))
        return chunk, bytes([_CHUNK]) + struct.pack("<Q", len(record)) + record if is_torn and body else b"" if is_torn else None


class _RolledBack(ArrivalSqlite3):
    """An sqlite3 file in a copy, rolled back to its last commit."""

    def __init__(self, path: Path) -> None:
        self._folder = TemporaryDirectory(prefix="lowcostnav_")
        copy = Path(self._folder.name) / path.name
        for part in path.parent.glob(f"{path.name}*"):
            shutil.copy(part, copy.with_name(part.name))
        try:
            with closing(sqlite3.connect(copy)) as connection:  # rolls back from a hot journal, or takes a write-ahead log in
                connection.execute("PRAGMA journal_mode=DELETE").fetchall()
        except sqlite3.Error as error:
            raise ReaderError(f"Cannot open database {path}: {error}") from error
        super().__init__(copy)

    def close(self) -> None:
        super().close()
        self._folder.cleanup()


STORAGES: dict[str, Any] = {".mcap": _UnclosedMcap, ".db3": _RolledBack}


def files_of(path: Path, is_torn: bool = False) -> list[Path]:
    """The files of a recording that has no metadata, in order; of one that has only if ``is_torn``, else there are none."""
    if path.is_file():
        return [path] if path.suffix in STORAGES else []
    if not is_torn and (path / "metadata.yaml").exists():
        return []
    found = [file for file in path.iterdir() if file.suffix in STORAGES]
    return sorted(found, key=lambda file: (len(file.name), file.name))  # rosbag2 numbers them: _2 before _10


class UnclosedReader:
    """The files of an unclosed recording as one; offers what :class:`rosbags.rosbag2.Reader` does.

    Raises
    ------
    ReaderError
        When a file is none of a recording.
    """

    def __init__(self, files: Collection[Path]) -> None:
        self.is_open = True
        self._storages: list[Any] = []
        try:
            for file in files:
                self._storages.append(STORAGES[file.suffix](file))
                self._storages[-1].open()
        except BaseException:
            del self._storages[-1]
            self.close()
            raise
        described = [storage.metadata for storage in self._storages if storage.metadata.message_count]
        self.message_count = sum(one.message_count for one in described)
        self.start_time = min((one.start_time for one in described), default=0)
        self.end_time = max((one.end_time for one in described), default=0)

    @property
    def connections(self) -> list[Connection]:
        """Topics, of every file on its own."""
        return [connection for storage in self._storages for connection in storage.connections]

    def windows(self, names: Names) -> Iterator[Window]:
        """Yield all messages of some topics in windows, in order."""
        for storage in self._storages:
            yield from storage.windows(names)

    def close(self) -> None:
        """Close the files."""
        self.is_open = False
        for storage in self._storages:
            storage.close()
