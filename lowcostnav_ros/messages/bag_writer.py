"""Write recordings: message by message, whole or not at all where the maker asks for it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2.errors import WriterError

from lowcostnav_ros.base.documents import written_whole
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.storage import SafeWriter
from lowcostnav_ros.messages.store import STORE, full_type

_STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
_NEVER = QosTime(0, 0)
SETTINGS_FOLDER = "settings"
"""Inside a recording's directory: the settings, <navigator>.yaml, it was flown with or is to be replayed with."""


class BagError(ValueError):
    """A recording that cannot be used; the message is one sentence that says what to do."""


class BagWriter:
    """Write a recording; a context manager that closes the bag even when its body fails, so that what was recorded is kept.

    Parameters
    ----------
    path : str or Path
        Directory to create; it must not exist.
    storage : str
        ``mcap`` or ``sqlite3``.

    Raises
    ------
    BagError
        When the path exists or the storage is unknown.
    """

    def __init__(self, path: str | Path, storage: str = "mcap") -> None:
        if storage not in _STORAGES:
            raise BagError(f"Storage '{storage}' is unknown; use mcap or sqlite3.")
        self.path = Path(path)
        self.counts: dict[str, int] = {}
        self._connections: dict[str, Any] = {}
        try:
            self._writer = SafeWriter(self.path, version=9, storage_plugin=_STORAGES[storage])
            self._writer.open()
        except WriterError:
            raise BagError(f"{path} exists already; choose another name or remove it first.") from None
        except OSError as error:
            raise BagError(f"Cannot create {path}: {error.strerror}.") from error

    def __enter__(self) -> "BagWriter":
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def write(self, topic: str, msgtype: str, stamp_ns: int, cdr: bytes) -> None:
        """Append one message: topic with or without leading slash, receive stamp in ns, CDR bytes."""
        connection = self._connections.get(topic)
        if connection is None:
            connection = self._connections[topic] = self._connect("/" + topics.source_of(topic), full_type(msgtype))
            self.counts[topics.source_of(topic)] = 0
        self._writer.write(connection, stamp_ns, cdr)
        self.counts[topics.source_of(topic)] += 1

    def flush(self) -> None:
        """Hand what was written to the system: a recorder that is killed has lost nothing up to here; raises OSError on a full disk."""
        if self._writer.storage is not None:
            self._writer.storage.flush()

    def sync(self) -> None:
        """Wait until the disk has what was flushed, for the sake of a power cut."""
        if self._writer.storage is not None:
            self._writer.storage.sync()

    @property
    def lost(self) -> int:
        """Messages that could not be written."""
        return 0 if self._writer.storage is None else int(self._writer.storage.lost)

    def close(self) -> None:
        """Write index and metadata; harmless when closed already.

        Raises
        ------
        OSError
            When they cannot be written; what was recorded stays readable.
        """
        if self._writer.storage is not None:
            try:
                self._writer.close()
            finally:
                self._writer.storage = None

    def _connect(self, topic: str, msgtype: str) -> Any:
        latched = topic.endswith("/origin")  # so that `ros2 bag play` gives it to late joiners as the live node did
        qos = Qos(
            QosHistory.KEEP_LAST,
            1 if latched else 10,
            QosReliability.RELIABLE,
            QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            _NEVER,
            _NEVER,
            QosLiveliness.AUTOMATIC,
            _NEVER,
            False,
        )
        return self._writer.add_connection(topic, msgtype, typestore=STORE, offered_qos_profiles=[qos])


@contextmanager
def new_bag(path: str | Path, storage: str = "mcap") -> Iterator[BagWriter]:
    """Write a recording that is there when it is whole; one that is not finished leaves nothing.

    ``path`` of the writer is where a settings folder goes.  Raises as :class:`BagWriter` does, before anything is written.
    """
    if Path(path).exists():
        raise BagError(f"{path} exists already; choose another name or remove it first.")
    with written_whole(path) as place, BagWriter(place, storage) as writer:
        yield writer
