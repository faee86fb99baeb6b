"""Replay of a recording: the bag is read directly, without middleware, and fed in recorded order."""

import copy
import dataclasses
import hashlib
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.catalogue.building import Registry, build_navigators
from lowcostnav_ros.catalogue.config_files import config_dir, load_settings
from lowcostnav_ros.catalogue.navigator_topics import fused_topics
from lowcostnav_ros.estimation.air_data.computer import AIR, INPUTS, REQUIRED, AirDataComputer, AirDataComputerSettings
from lowcostnav_ros.messages import topics, windows
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagError
from lowcostnav_ros.messages.decode import Decoder, decode
from lowcostnav_ros.messages.foreign import offers
from lowcostnav_ros.messages.foreign import options as word_options
from lowcostnav_ros.messages.inputs import inputs_in
from lowcostnav_ros.messages.rules import DecodeRules
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.columns import NavColumns, columns_of_messages
from lowcostnav_ros.replay.digest import records_of_messages
from lowcostnav_ros.replay.evaluation import Truth
from lowcostnav_ros.replay.links import Chain, output_topic
from lowcostnav_ros.replay.mountings import Mountings, mountings_of
from lowcostnav_ros.replay.result import Bag, Recording, ReplayResult, SourceCounts
from lowcostnav_ros.replay.result_files import results_in
from lowcostnav_ros.replay.selection import Selection, SelectionError, check_names, select, spared
from lowcostnav_ros.replay.session import Session, Watcher, first_stamp, timed
from lowcostnav_ros.replay.withhold import Window, Withhold, WithholdError, check_sources, resolve

DEFAULT_TRUTH = "truth/odometry"
TRUE_WIND = "truth/wind"


@dataclasses.dataclass(frozen=True)
class ReplayOptions:
    """What to replay and how.

    Attributes
    ----------
    navigators : tuple of str or None
        Names to run; None runs all whose required inputs the recording has.
    config : Path or None
        Directory of ``<navigator>.yaml``; None takes those the recording carries, then the package's own.
    withhold : tuple of Withhold
    truth : str or None
        Odometry topic to form errors against; None takes ``truth/odometry`` when it is there.
    out : Path or None
        Folder for result files.
    registry : mapping or None
        Navigators by name, None for the package's.
    on_progress : callable or None
        Called with the share done, 0 to 1.
    smooth : bool
        Whether every navigator that can is smoothed at the end.
    maps : mapping of recorded topic to the name it is read by
    frames : tuple of str
        Frame ids accepted of every source besides the usual ones.
    sparing : bool
        Whether a navigator that another one outdoes, or that has one solution to choose from, is left out.
    watch : callable or None
        Called with who flies, the chain and the first stamp (ns) when the replay begins; gives what flies along.
    """

    navigators: tuple[str, ...] | None = None
    config: Path | None = None
    withhold: tuple[Withhold, ...] = ()
    truth: str | None = None
    out: Path | None = None
    registry: Registry | None = None
    on_progress: Callable[[float], None] | None = None
    smooth: bool = False
    maps: Mapping[str, str] = dataclasses.field(default_factory=dict)
    frames: tuple[str, ...] = ()
    sparing: bool = False
    watch: "Callable[[Cast, Chain, int], Watcher] | None" = None


def replay_bag(path: str | Path, options: ReplayOptions | None = None) -> ReplayResult:
    """Replay a recording through the navigators.

    Parameters
    ----------
    path : str or Path
        Bag directory or file.
    options : ReplayOptions

    Raises
    ------
    ValueError
        (BagError, SelectionError, SettingsError, WithholdError) each with one sentence that says what to do.
    """
    options = options or ReplayOptions()
    if options.out is not None:
        with results_in(options.out) as part:
            return _replayed(path, dataclasses.replace(options, out=part))
    return _replayed(path, options)


def _replayed(path: str | Path, options: ReplayOptions) -> ReplayResult:
    with _reader(path, options) as reader:
        reference = reader.with_decoder(Decoder(copy.deepcopy(reader.decoder.rules)))
        return _Replay(reader, reference, options).run()


def _reader(path: str | Path, options: ReplayOptions) -> BagReader:
    return BagReader(path, Decoder(DecodeRules(everywhere=options.frames)), options.maps, inputs=inputs_in(options.config))


class Cast:
    """Which topics of a bag play which part.

    Two readers of the same bag: one is fed from, the other gives the truth, which must not cut the inertial blocks, nor count as a
    navigator's work.

    Attributes
    ----------
    navigators, selection
        Those that run, fresh, by name; and why others do not.
    truth : str or None
        Topic of the true states.
    true, true_sources : list of str
        Topics of true states and true wind; the same with the map origin before them.
    fed : list of str
        Topics that some navigator takes.
    """

    def __init__(self, reader: BagReader, reference: BagReader, options: ReplayOptions) -> None:
        self.reader, self.reference, self.options = reader, reference, options
        self.mountings = mountings_of(reader)
        reader.decoder.rules.allow(self.mountings.frames)
        self.navigators, self.selection = _navigators(reader, options, self.mountings)
        self.air_data = _air_data(reader, options) if any(AIR in navigator.inputs for navigator in self.navigators.values()) else None
        self.truth = _truth_topic(reader, options.truth)
        wind = [TRUE_WIND] if self.truth == DEFAULT_TRUTH and reader.types.get(TRUE_WIND) == topics.TWIST else []
        self.true = [self.truth, *wind] if self.truth else []
        self.true_sources = _with_origins(reader, self.true)
        taken = {source for navigator in self.navigators.values() for source in navigator.inputs}
        replaced = {topic for name in self.navigators for topic in fused_topics(name)}
        taken |= {*INPUTS} if self.air_data else set()
        self.fed = sorted(s for s in taken - replaced if s in reader.types)
        check_sources(options.withhold, self.fed)
        self.sources = _with_origins(reader, self.fed)

    def stream(self) -> Iterator[Measurement]:
        """What is fed, in recorded order; map origins, which the decoder learns, are not handed out.

        Raises
        ------
        BagError
            When nothing usable is in it.
        """
        stream = (m for m in self.reader.measurements(self.sources) if m.source in self.fed)
        head = next(stream, None)
        if head is None:
            raise self.reader.nothing(self.fed)
        return itertools.chain([head], stream)

    def true_states(self, step_ns: int) -> Truth | None:
        """All true states and winds, one each ``step_ns``; None where the bag has no truth."""
        truth, last = Truth(), dict.fromkeys(self.true, -(2**62))
        tracks = {source: truth.winds if source == TRUE_WIND else truth.states for source in self.true}
        for window in self.reference.windows(self.true_sources) if self.true else ():
            for part, source, rows in self.reference.topics_of(window):
                columns = columns_of_messages(*self.reference.decoder.decode_many(part, rows, self.reference.types[source]))
                if source in tracks and len(columns):
                    kept = thinned(columns.stamps_ns, step_ns, last[source])
                    last[source] = int(columns.stamps_ns[kept[-1]]) if len(kept) else last[source]
                    tracks[source].add(columns[kept])
        return truth if self.true else None


class _Replay(Cast):
    """One replay of one bag, in one pass over it: identity, measurements, true states, and what the aircraft recorded of itself."""

    def __init__(self, reader: BagReader, reference: BagReader, options: ReplayOptions) -> None:
        super().__init__(reader, reference, options)
        self.decode_s, self.identity = 0.0, hashlib.sha256()
        self.outputs = {output_topic(name): name for name in self.navigators if output_topic(name) in reader.types}
        self.session: Session | None = None
        self._written: list[tuple[str, NavColumns]] = []
        self._beside = {source: _Ahead() for source in (*self.true, *self.outputs)}
        self._recorded = Decoder(dataclasses.replace(reference.decoder.rules, origins={}, map_frames={}))

    def run(self) -> ReplayResult:
        """Read, feed, compare, sum up."""
        began, first_ns = perf_counter(), 0
        for window in self.reader.windows():
            window.update(self.identity)
            measurements = self._measurements(window)
            self._take_beside(window)
            for measurement in measurements:
                if self.session is None:
                    first_ns = first_stamp(measurement)
                    self.session = self._begin(first_ns)
                self.session.feed(measurement)
            if self.session is not None and self.options.on_progress is not None:
                span = max(1, self.reader.end_ns - self.reader.start_ns)
                self.options.on_progress(min(1.0, (self.session.newest_ns - first_ns) / span))
        if self.session is None:
            raise self.reader.nothing(self.fed)
        self._hand_over(math.inf)
        result = self.session.finish()
        wall_s = perf_counter() - began - (self.session.watcher.seconds if self.session.watcher else 0.0)
        return timed(dataclasses.replace(result, recording=self._about()), wall_s, self.decode_s)

    def _begin(self, first_ns: int) -> Session:
        withheld = [resolve(w, first_ns) for w in self.options.withhold]
        for window in withheld:
            self._check_window(window, first_ns)
        further = self.options.out, self.reader.decoder.rules, self.options.smooth, self.air_data
        session = Session(self.navigators, withheld, self.truth is not None, self.outputs, *further)
        session.alongside.append(self._hand_over)
        if self.options.watch is not None:
            session.watcher = self.options.watch(self, session.chain, first_ns)
        return session

    def _measurements(self, window: windows.Window) -> list[Measurement]:
        began = perf_counter()
        found = [m for m in self.reader.decoded(window.only(self.sources)) if m.source in self.fed]
        self.decode_s += perf_counter() - began
        return found

    def _take_beside(self, window: windows.Window) -> None:
        """Decode true states and what the aircraft recorded, to be handed over as the replay comes to their stamps."""
        decoder, types = self.reference.decoder, self.reference.types
        for part, source, rows in self.reference.topics_of(window.only(self.true_sources)) if self.true else ():
            columns = columns_of_messages(*decoder.decode_many(part, rows, types[source]))
            if source in self.true:
                self._beside[source].add(columns.stamps_ns, columns)
        written = _with_origins(self.reference, self.outputs) if self.options.out is not None else list(self.outputs)
        for part, source, rows in self.reference.topics_of(window.only(written)) if self.outputs else ():
            if source in self.outputs:
                self._beside[source].add(*records_of_messages(part, rows, types[source]))
            if self.options.out is not None:
                solutions = columns_of_messages(*self._recorded.decode_many(part, rows, types[source]))
                if source in self.outputs:
                    self._written.append((self.outputs[source], solutions))

    def _hand_over(self, newest_ns: float) -> None:
        """Hand the session what is not newer than ``newest_ns``."""
        assert self.session is not None
        for source in self.true:
            for _, columns in self._beside[source].up_to(newest_ns):
                self.session.feed_truth(columns)
        for source, name in self.outputs.items():
            for stamps_ns, records in self._beside[source].up_to(newest_ns):
                self.session.feed_recorded(name, stamps_ns, records)
        for name, solutions in self._written:
            self.session.files.add_recorded(name, solutions)
        self._written.clear()

    def _check_window(self, window: Window, first_ns: int) -> None:
        """Refuse, before the work, a window in which there is nothing to withhold, with what has no data there."""
        last: dict[str, int] = {}
        silent: dict[str, str] = {}
        with _reader(self.reader.path, self.options) as reader:  # its own files: this one is being read
            for source, _, raw in reader.stream(sorted(window.sources)):
                stamp_ns = decode(source, reader.types[source], raw, reader.decoder.rules).stamp_ns
                if window.holds(source, stamp_ns):
                    return
                if stamp_ns >= window.end_ns and source not in silent and source in last:
                    silent[source] = f"{source} from {1e-9 * (last[source] - first_ns):.0f} to {1e-9 * (stamp_ns - first_ns):.0f} s"
                last[source] = stamp_ns
        ended = (f"{source} from {1e-9 * (last[source] - first_ns):.0f} s on" for source in sorted(last.keys() - silent.keys()))
        missing = f"; already without data, from the start: {', '.join([*silent.values(), *ended])}" if last else ""
        end_s = 1e-9 * max(last.values(), default=first_ns)
        span = f"the recording spans {1e-9 * first_ns:.1f} to {end_s:.1f} s (0 to {end_s - 1e-9 * first_ns:.1f} s from the start)"
        raise WithholdError(f"--withhold: nothing fell in the window '{window.text}'; {span}{missing}.")

    def _about(self) -> Recording:
        rejected: dict[str, dict[str, int]] = {}
        for reader in (self.reader, self.reference):
            for (source, reason), count in sorted(reader.decoder.rejected.items()):
                rejected.setdefault(source, {})[reason] = count
        counts = self.reader.counts
        inputs = {s: SourceCounts(counts[s], rejected.get(s, {})) for s in dict.fromkeys([*self.sources, *self.true_sources])}
        bag = Bag(self.reader.path.name, self.identity.hexdigest(), dict(sorted(counts.items())))
        remarks = {f"{name}: {aid.remark}": 1 for name, one in self.navigators.items() for aid in one.aids if aid.remark}
        remarks |= {f"{name}: {deprived}": 1 for name, one in self.navigators.items() if (deprived := ", ".join(one.deprived()))}
        remarks |= {f"{name}: IMU {one.imu_words}": 1 for name, one in self.navigators.items() if one.imu_words}
        remarks |= self.mountings.remarks
        decoder = self.reader.decoder
        unused = {source for source, _ in decoder.rejected if not decoder.accepted[source]}
        remarks |= {} if self.air_data is None else self.air_data.remarks()
        remarks |= {f"nothing usable on {source}: {self.reader.rejections(source)}": 1 for source in sorted(unused)}
        found = offers(self.reader.types)
        if found:
            remarks[f"{len(found)} topics look like sensors and are not read; {word_options(found)} reads them"] = 1
        return Recording(bag, self.truth, self.selection.left_out, inputs, dict(sorted(self.reader.decoder.notes.items())) | remarks)


class _Ahead:
    """What has been read of a topic and is still ahead of the replay: stamps (n,), and rows of something."""

    def __init__(self) -> None:
        self._parts: list[tuple[np.ndarray, Any]] = []

    def add(self, stamps_ns: np.ndarray, rows: Any) -> None:
        """Append rows."""
        if len(stamps_ns):
            self._parts.append((stamps_ns, rows))

    def up_to(self, newest_ns: float) -> Iterator[tuple[np.ndarray, Any]]:
        """Give out the rows before the first one that is newer."""
        while self._parts:
            stamps_ns, rows = self._parts[0]
            newer = np.flatnonzero(stamps_ns > newest_ns)
            if not len(newer):
                yield self._parts.pop(0)
                continue
            n = int(newer[0])
            if n:
                self._parts[0] = stamps_ns[n:], rows[n:]
                yield stamps_ns[:n], rows[:n]
            return


def thinned(stamps_ns: np.ndarray, step_ns: int, last_ns: int) -> np.ndarray:
    """Rows, each at least ``step_ns`` after the one before and the first so long after ``last_ns``."""
    rows = []
    for row, stamp_ns in enumerate(stamps_ns.tolist()):
        if stamp_ns - last_ns >= step_ns:
            rows.append(row)
            last_ns = stamp_ns
    return np.array(rows, dtype=np.int64)


def _navigators(reader: BagReader, options: ReplayOptions, mountings: Mountings) -> tuple[dict[str, Navigator], Selection]:
    registry = NAVIGATORS if options.registry is None else options.registry
    check_names(options.navigators or (), list(registry))
    wanted = dict.fromkeys(options.navigators or registry)
    navigators = build_navigators(wanted, registry, options.config, reader.settings_folder, mountings.adapted)
    for navigator in navigators.values():
        reader.decoder.rules.accept(navigator)
    inputs = {name: navigator.inputs for name, navigator in navigators.items()}
    reader.require(s for s in reader.types if any(s in sources for sources in inputs.values()))
    decodable = set(reader.decodable())
    decodable |= {AIR} if _air_data(reader, options) else set()
    try:
        selection = select(inputs, decodable, insist=options.navigators is not None)
        selection = spared(selection, inputs) if options.sparing else selection
    except SelectionError as error:
        found = offers(reader.types)
        if found:
            raise SelectionError(f"{str(error).rstrip('.')}; read more with {word_options(found)}.") from error
        raise
    if not any(source in decodable for name in selection.chosen for source in inputs[name]):
        raise reader.nothing(())
    return {name: navigators[name] for name in selection.chosen}, selection


def _air_data(reader: BagReader, options: ReplayOptions) -> AirDataComputer | None:
    """The computer that makes the airspeed of a recording that holds pressures and no airspeed; None where there is nothing to make."""
    decodable = set(reader.decodable())
    if AIR in reader.types or not decodable.issuperset(REQUIRED):
        return None
    folders = (options.config,) if options.config else (reader.settings_folder, config_dir())
    files = (folder / "air_data_computer.yaml" for folder in folders if folder is not None)
    return AirDataComputer(load_settings(AirDataComputerSettings, next(filter(Path.is_file, files), None), "air_data_computer"))


def _truth_topic(reader: BagReader, wanted: str | None) -> str | None:
    if wanted is None:
        placed = reader.types.get(DEFAULT_TRUTH) == topics.ODOMETRY and _origin_of(DEFAULT_TRUTH) in reader.types
        return DEFAULT_TRUTH if placed else None
    wanted = topics.source_of(wanted)
    reader.require([wanted])
    if reader.types[wanted] != topics.ODOMETRY:
        raise BagError(f"--truth {wanted} is of type {reader.types[wanted]}; give a topic of type {topics.ODOMETRY}.")
    if _origin_of(wanted) not in reader.types:
        raise BagError(f"--truth {wanted} cannot be placed on the earth, the recording has no {_origin_of(wanted)}; record it too.")
    return wanted


def _origin_of(source: str) -> str:
    return f"{source.rpartition('/')[0]}/origin"


def _with_origins(reader: BagReader, sources: Sequence[str] | dict[str, str]) -> list[str]:
    """The sources, preceded by the map origins their odometries are expressed in."""
    odometries = [s for s in sources if reader.types[s] == topics.ODOMETRY]
    origins = dict.fromkeys(o for s in odometries if (o := _origin_of(s)) in reader.types)
    return [*origins, *(s for s in sources if s not in origins)]
