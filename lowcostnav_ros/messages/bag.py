"""Recordings: check them, and read them as the ordered stream of measurements that a live navigator would have seen."""

import copy
import hashlib
import itertools
import logging
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2.errors import ReaderError

from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.base.settings import nearest
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.arrival import ArrivalReader
from lowcostnav_ros.messages.bag_writer import SETTINGS_FOLDER, BagError, BagWriter
from lowcostnav_ros.messages.checks import WRONG_FRAME
from lowcostnav_ros.messages.decode import Decoder, imu_block
from lowcostnav_ros.messages.foreign import mapped, offers, options
from lowcostnav_ros.messages.inputs import Inputs, inputs_in
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.messages.unclosed import UnclosedReader, files_of
from lowcostnav_ros.messages.windows import Window

_LISTED = 12
_NOT_A_BAG = "is not a recording: expected a bag directory with metadata.yaml, or an .mcap or .db3 file"
LARGEST_WINDOW = 16_384
"""Messages that are decoded together at most, however large the chunks of a file are."""


class BagReader:
    """Read a recording of either storage, as bytes or as measurements; a context manager.

    One without metadata is read to its last whole message; one that has been closed and is damaged since only where ``is_torn``.

    Parameters
    ----------
    path : str or Path
    decoder : Decoder, optional
    maps : mapping of recorded topic to the name it is read by, optional
        See :func:`~lowcostnav_ros.messages.foreign.parse_maps`.
    is_torn : bool, optional
        Read what is whole of a recording that has been closed and is damaged since.
    inputs : Inputs, optional
        Names and frames of its sources beside those in the settings that it carries; unlike ``maps``, of topics that may be missing.

    Attributes
    ----------
    path : Path
    types : dict of source to message type
    counts : dict of source to number of messages
    start_ns, end_ns : int
        First and last receive stamp.
    is_closed : bool
        False where the recorder was killed: read to the last whole message.
    decoder : Decoder
        Counts what :meth:`measurements` accepted and rejected, and why.

    Raises
    ------
    BagError
        For a missing path, something that is not a bag, an empty or a truncated one.
    """

    def __init__(
        self,
        path: str | Path,
        decoder: Decoder | None = None,
        maps: Mapping[str, str] | None = None,
        is_torn: bool = False,
        inputs: Inputs | None = None,
    ) -> None:
        self.path, self.maps = Path(path), dict(maps or {})
        self.decoder = decoder or Decoder()
        carried = inputs_in(self.settings_folder) | (inputs or Inputs())
        self.decoder.rules.allow(carried.frames)
        self._reader: Any = _opened(self.path, is_torn)
        self.is_closed = isinstance(self._reader, ArrivalReader)
        self.maps = carried.maps(c.topic for c in self._reader.connections) | self.maps
        self.types = {mapped(c.topic, self.maps): c.msgtype for c in self._reader.connections}
        self._refuse_double_names()
        stated = [c.msgcount for c in self._reader.connections]
        times = self._reader.message_count, self._reader.start_time, self._reader.end_time
        if not all(isinstance(number, int) for number in (*times, *stated)):
            self.close()
            raise BagError(f"{path} cannot be read, its metadata.yaml holds a count or time that is no number; record again.")
        self.counts: dict[str, int] = dict.fromkeys(self.types, 0)
        for connection in self._reader.connections:
            self.counts[mapped(connection.topic, self.maps)] += connection.msgcount
        if self._reader.message_count == 0:
            self.close()
            raise BagError(f"{path} holds no messages; check that the recorder was running while the sensors were.")
        self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time - 1
        if not self.is_closed:
            _note_once(self.path, self.duration_s)

    def with_decoder(self, decoder: Decoder) -> "BagReader":
        """The same recording, its files shared, with a decoder that learns and counts on its own; close only one of them."""
        other = copy.copy(self)
        other.decoder = decoder
        return other

    def _refuse_double_names(self) -> None:
        recorded = {topics.source_of(c.topic) for c in self._reader.connections}
        missing = [name for name in self.maps if not any(r == name or (name.endswith("/") and r.startswith(name)) for r in recorded)]
        if missing:
            self.close()
            raise BagError(f"{self.path} has no topic '{missing[0]}' to map{nearest(missing[0], recorded)}.")
        if len(self.types) < len(recorded):
            double = next(name for name in self.types if sum(mapped(r, self.maps) == name for r in recorded) > 1)
            self.close()
            raise BagError(f"{self.path}: two topics would be read as '{double}'; map the other one to another name too.")

    @property
    def settings_folder(self) -> Path | None:
        """Folder of navigator settings that the recording carries, None when it carries none."""
        folder = (self.path if self.path.is_dir() else self.path.parent) / SETTINGS_FOLDER
        return folder if folder.is_dir() else None

    def __enter__(self) -> "BagReader":
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; harmless when closed already."""
        if self._reader.is_open:
            self._reader.close()

    @property
    def duration_s(self) -> float:
        """Time from first to last message, s."""
        return (self.end_ns - self.start_ns) * 1e-9

    def require(self, sources: Iterable[str]) -> None:
        """Refuse sources the recording lacks or holds with another type than :func:`topics.spec` says.

        Raises
        ------
        BagError
            Naming the topic, the nearest one that exists, and the types.
        """
        for source in map(topics.source_of, sources):
            if source not in self.types:
                found = {theirs: ours for theirs, ours in offers(self.types).items() if ours in (source, "")}
                remedy = f"; read one with {options(found)}" if found else nearest(source, self.types)
                raise BagError(f"{self.path} has no topic '{source}'{remedy}.")
            kind = self._decoded_as(source)
            if kind is None:
                raise BagError(f"{self.path}: topic '{source}' carries nothing a navigator reads{nearest(source, topics.TOPICS)}.")
            if not kind.takes(self.types[source]):
                raise BagError(f"{self.path}: topic '{source}' is of type {self.types[source]}, expected {kind.msgtype}.")

    def stream(self, sources: Iterable[str] | None = None) -> Iterator[tuple[str, int, bytes]]:
        """Yield (source, receive stamp ns, CDR bytes) in the order of arrival, memory flat; all topics where ``sources`` is None.

        Raises
        ------
        BagError
            For a missing topic, or when the recording breaks off.
        """
        for window in self.windows(sources):
            yield from window.messages()

    def windows(self, sources: Iterable[str] | None = None) -> Iterator[Window]:
        """Yield what :meth:`stream` does, many messages at a time.

        Raises
        ------
        BagError
            For a missing topic, or when the recording breaks off.
        """
        wanted = set(self.types) if sources is None else {topics.source_of(s) for s in sources}
        for source in wanted:
            if source not in self.types:
                raise BagError(f"{self.path} has no topic '{source}'{nearest(source, self.types)}.")
        names = {(c.topic, c.msgtype): name for c in self._reader.connections if (name := mapped(c.topic, self.maps)) in wanted}
        try:
            for window in self._reader.windows(names) if names else ():
                for first in range(0, len(window), LARGEST_WINDOW):
                    yield window[first : first + LARGEST_WINDOW]
        except GeneratorExit:
            raise
        except Exception as error:  # the storage layers raise errors of many types on damaged files
            raise BagError(f"{self.path} is damaged ({error}); recover it with the tool of its storage, or record again.") from error

    def measurements(self, sources: Iterable[str] | None = None, chunk_s: float = 1.0) -> Iterator[Measurement]:
        """Yield decoded measurements in recorded order.

        Inertial messages that follow one another with nothing else of ``sources`` between them come as one :class:`ImuBlock`; they are
        decoded in columns, a chunk at a time.  What cannot be used is counted in ``decoder.rejected``.

        Parameters
        ----------
        sources : iterable of str, optional
            Topics to read; all that have a decoder where None.
        chunk_s : float
            Longest block of samples, s; changes no value.
        """
        names = self.decodable() if sources is None else [topics.source_of(s) for s in sources]
        self.require(names)
        for window in self.windows(names):
            yield from self.decoded(window, chunk_s)

    def decoded(self, window: Window, chunk_s: float = 1.0) -> Iterator[Measurement]:
        """Yield the measurements of a window as :meth:`measurements` does; all of its sources are to have a decoder."""
        for part in _between_origins(window):
            others: dict[int, Measurement] = {}
            inertial = []
            for source, rows in part.by_source():
                found, rest = self.decoder.decode_many(part, rows, self.types[source])
                if topics.spec(source, self.decoder.rules).measurement is ImuBlock:
                    inertial.append(imu_block(found, rest))
                    continue
                others.update(rest)
                for columns in found:
                    others.update(zip(columns.rows.tolist(), columns.measurements(), strict=True))
            yield from _in_order(others, [one for one in inertial if one[0] is not None], _cuts(part.stamps_ns, round(1e9 * chunk_s)))

    def topics_of(self, window: Window) -> Iterator[tuple[Window, str, np.ndarray]]:
        """Yield the messages of each topic, as parts of a window and rows in them, so that origins come before what they place."""
        for part in _between_origins(window):
            for source, rows in part.by_source():
                yield part, source, rows

    def decodable(self) -> list[str]:
        """List the sources of this recording that are measurements, with the type they ought to have."""
        kinds = {source: self._decoded_as(source) for source in self.types}
        return [source for source, kind in kinds.items() if kind is not None and kind.takes(self.types[source])]

    def _decoded_as(self, source: str) -> Kind | None:
        kind = self.decoder.rules.kind_of(source)
        return None if kind is None or kind.decode is None else kind

    def nothing(self, sources: Sequence[str]) -> BagError:
        """Return the refusal of a recording of which nothing can be used: what was rejected and why, or what there is instead."""
        if sources and self.decoder.rejected:
            return BagError(f"{self.path} holds nothing usable on {', '.join(sources)}: rejected {self.rejections()}.")
        there = ", ".join(f"{source} ({msgtype})" for source, msgtype in sorted(self.types.items())[:_LISTED])
        further = f" and {len(self.types) - _LISTED} more" if len(self.types) > _LISTED else ""
        found = offers(self.types)
        remedy = f"read them with {options(found)}" if found else "name the topics that are sensors with --map recorded=ours"
        empty = f"nothing on {', '.join(sources)}; it" if sources else "no topic that a navigator reads; it"
        return BagError(f"{self.path} holds {empty} has {there}{further}; {remedy}.")

    def rejections(self, only: str = "") -> str:
        """Say in words what was rejected most, with an example: of one source, or of all."""
        reasons = []
        counts = Counter({key: n for key, n in self.decoder.rejected.items() if only in ("", key[0])})
        for (source, reason), count in counts.most_common(3):
            detail = self.decoder.examples.get((source, reason), "")
            if reason == WRONG_FRAME:
                detail += f"; accept it with --frame {detail.split(chr(39))[1] or 'any'}"
            reasons.append(f"{source} {count} times '{reason}'{f' ({detail})' if detail else ''}")
        return ", ".join(reasons)

    def identity(self) -> str:
        """Return the SHA-256 over topic, receive stamp and bytes of every message in order: the same for either storage."""
        digest = hashlib.sha256()
        for window in self.windows():
            window.update(digest)
        return digest.hexdigest()


def _between_origins(window: Window) -> Iterator[Window]:
    """Cut before and behind every message that tells what the next odometries mean."""
    origins = [k for k, source in enumerate(window.sources) if source.endswith("/origin")]
    at = np.flatnonzero(np.isin(window.of, origins)) if origins else np.zeros(0, np.int64)
    edges = np.unique(np.concatenate([[0], at, at + 1, [len(window)]]))
    for first, last in itertools.pairwise(edges.tolist()):
        yield window[first:last]


def _cuts(stamps_ns: np.ndarray, longest_ns: int) -> list[int]:
    """Rows before which blocks of samples end for their length: that much later than the last such row, or earlier."""
    cuts, first = [], 0
    back = np.flatnonzero(np.diff(stamps_ns) < 0) + 1
    for last in [*back.tolist(), len(stamps_ns)]:
        while first < last:
            cuts.append(first)
            first += int(np.searchsorted(stamps_ns[first:last], stamps_ns[first] + longest_ns))
        first = last
    return cuts[1:]


def _in_order(others: dict[int, Measurement], inertial: list[tuple[Any, np.ndarray]], cuts: list[int]) -> Iterator[Measurement]:
    """Yield measurements by their rows; blocks of samples end where another measurement stands, or at a cut."""
    ends = sorted({*others, *cuts})
    ends.append(2**62)
    inertial = sorted(inertial, key=lambda one: int(one[1][0]))
    runs = [np.searchsorted(rows, ends).tolist() for _, rows in inertial]
    begun = [0] * len(runs)
    for k, row in enumerate(ends):
        for source, run in enumerate(runs):
            first, last = begun[source], run[k]
            if last > first:
                begun[source] = last
                yield inertial[source][0][first:last]
        if row in others:
            yield others[row]


def recover(path: str | Path, out: str | Path) -> "BagWriter":
    """Write what is whole of a recording to a new one, closed; return its writer, for the counts.

    Raises
    ------
    BagError
        When nothing of it can be read or the new one cannot be written.
    """
    with BagReader(path, is_torn=True) as bag, BagWriter(out) as writer:
        for source, stamp_ns, raw in bag.stream():
            writer.write(source, bag.types[source], stamp_ns, bytes(raw))
        if bag.settings_folder is not None:
            shutil.copytree(bag.settings_folder, writer.path / SETTINGS_FOLDER)
    return writer


@cache
def _note_once(path: Path, duration_s: float) -> None:
    """Say once that a recording was not closed, on stderr where nobody has set up logging."""
    note = "%s: the recorder was killed; read to its last message at %.1f s; 'lowcostnav recover %s' writes a clean copy."
    logging.getLogger(__name__).warning(note, path, duration_s, path)


def _opened(path: Path, is_torn: bool) -> Any:
    if not path.exists():
        raise BagError(f"{path} does not exist; check the path of the recording.")
    files = files_of(path, is_torn)
    if path.is_dir() and not files and not (path / "metadata.yaml").exists():
        raise BagError(f"{path} {_NOT_A_BAG}.")
    try:
        if path.is_dir() and files:
            return UnclosedReader(files)
        reader = ArrivalReader(path)
        try:
            reader.open()
        except Exception:
            if not files:
                raise
            return UnclosedReader(files)
    except ReaderError as error:
        text = str(error).rstrip(".")
        if "Unrecognized storage" in text or "File magic is invalid" in text:
            raise BagError(f"{path} {_NOT_A_BAG}.") from error
        raise BagError(f"{path} cannot be read, it is truncated or damaged ({text}); try 'lowcostnav recover'.") from error
    except Exception as error:  # the storage layers raise errors of many types on damaged files
        raise BagError(f"{path} cannot be read, it is damaged ({type(error).__name__}: {error}); record again.") from error
    return reader
