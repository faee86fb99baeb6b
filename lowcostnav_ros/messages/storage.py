"""How a recording grows on the disk: by whole pieces, so that a killed recorder or a full disk costs the last piece alone."""

import os
import sqlite3
import struct
from contextlib import suppress
from io import BytesIO
from typing import Any

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter, write_channel, write_schema
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

_MESSAGE = struct.Struct("<BQHIQQ")
"""Head of a message in an mcap file: kind of record and its length, channel, sequence number, two times."""


class _WholePieces:
    """A file that takes what was written since the last :meth:`flush` whole, or not at all."""

    def __init__(self, file: Any) -> None:
        self._file, self._length, self._pending = file, file.seek(0, 2), BytesIO()

    def write(self, data: bytes) -> int:
        return self._pending.write(data)

    def tell(self) -> int:
        return self._length + self._pending.tell()

    def flush(self) -> None:
        """Hand the pending bytes to the system; a failure leaves the file as it was and forgets them."""
        data, self._pending = self._pending.getbuffer(), BytesIO()
        written = 0
        try:
            while written < len(data):
                written += self._file.write(data[written:])
        except OSError:
            self._file.truncate(self._length)
            self._file.seek(self._length)
            raise
        self._length += len(data)

    def sync(self) -> None:
        """Wait until the disk has what the system was handed."""
        os.fdatasync(self._file.fileno())

    def close(self) -> None:
        try:
            self.flush()
        finally:
            self._file.close()


class _Mcap(McapWriter):
    """An mcap file whose chunks are written whole; of one that cannot be written the messages are lost, and counted."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.bio.close()  # writes the header out, or raises on a full disk
        self.bio: Any = _WholePieces(self.path.open("r+b", buffering=0))
        self.lost = 0

    def write(self, connection: Any, timestamp: int, data: bytes | memoryview) -> None:
        """Append a message: as the library does, in a third of its time."""
        chunk, number, bio = self.chunk, connection.id, self.chunk.bio
        self.message_start_time, self.message_end_time = min(timestamp, self.message_start_time), max(timestamp, self.message_end_time)
        chunk.message_start_time, chunk.message_end_time = min(timestamp, chunk.message_start_time), max(timestamp, chunk.message_end_time)
        self.channel_stats[number] += 1
        chunk.msgs[number].append((timestamp, bio.tell()))
        bio.write(_MESSAGE.pack(0x05, _MESSAGE.size - 9 + len(data), number, 0, timestamp, timestamp))
        bio.write(data)
        if bio.tell() > 2**20:
            self.close_chunk()

    def close_chunk(self) -> None:
        """Write the messages gathered since the last one, whole or not at all: a full disk loses them, counted, and no others."""
        messages = self.chunk.msgs
        super().close_chunk()
        try:
            self.bio.flush()
        except OSError:
            self.chunks.pop()
            for number, entries in messages.items():
                self.channel_stats[number] -= len(entries)
                self.lost += len(entries)
            for schema in self.schemas:  # they may have been in the lost chunk
                write_schema(self.chunk.bio, schema)
            for channel in self.channels:
                write_channel(self.chunk.bio, channel, self.schemas)
            raise

    def flush(self) -> None:
        if self.chunk.msgs:
            self.close_chunk()

    def sync(self) -> None:
        self.bio.sync()

    def counts(self) -> dict[int, int]:
        return self.channel_stats


class _Sqlite3(Sqlite3Writer):
    """An sqlite3 file that is committed when it is flushed; a failed commit is rolled back."""

    lost = 0

    def add_connection(self, *arguments: Any) -> None:
        super().add_connection(*arguments)
        self.conn.commit()  # messages that are rolled back must not take their topic along

    def flush(self) -> None:
        try:
            self.conn.commit()  # waits for the disk, too
        except sqlite3.Error as error:
            self.conn.rollback()
            raise OSError(None, str(error)) from error

    def write(self, connection: Any, timestamp: int, data: bytes | memoryview) -> None:
        try:
            super().write(connection, timestamp, data)
        except sqlite3.Error as error:
            self.lost += 1
            raise OSError(None, str(error)) from error

    def sync(self) -> None:
        """Nothing: a commit is on the disk."""

    def counts(self) -> dict[int, int]:
        return dict(self.conn.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"))


class SafeWriter(Writer):
    """Writer whose storages lose at most what came since the last :meth:`flush`."""

    STORAGE_PLUGINS = {StoragePlugin.MCAP: _Mcap, StoragePlugin.SQLITE3: _Sqlite3}
    storage: Any

    def close(self) -> None:
        """Write index and metadata, of the messages that are there."""
        with suppress(OSError):  # the last messages do not fit any more; the rest is to be closed all the same
            self.storage.flush()
        self.counts |= self.storage.counts()
        super().close()
