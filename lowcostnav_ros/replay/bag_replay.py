"""Replay of a recording: the bag is read directly, without middleware, and fed in recorded order."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.catalogue.building import Registry, build_navigators
from lowcostnav_ros.catalogue.config_files import config_dir, load_settings
from lowcostnav_ros.catalogue.navigator_topics import fused_topics
from lowcostnav_ros.estimation.air_data.computer import AIR, INPUTS, REQUIRED, AirDataComputer, AirDataComputerSettings
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.bag import BagError, BagReader
from lowcostnav_ros.messages.decode import Decoder, decode
from lowcostnav_ros.messages.foreign import offers
from lowcostnav_ros.messages.foreign import options as word_options
from lowcostnav_ros.messages.inputs import inputs_in
from lowcostnav_ros.messages.rules import DecodeRules
from lowcostnav_ros.messages.store import from_cdr
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.columns import columns_of
from lowcostnav_ros.replay.evaluation import Truth
from lowcostnav_ros.replay.links import output_topic
from lowcostnav_ros.replay.result import Bag, Recording, ReplayResult, SourceCounts
from lowcostnav_ros.replay.result_files import results_in
from lowcostnav_ros.replay.selection import Selection, SelectionError, check_names, select
from lowcostnav_ros.replay.session import Session, first_stamp, timed
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
    with (_reader(path, options) as reader, _reader(path, options) as recorded, _reader(path, options) as reference):
        return _Replay(reader, recorded, reference, options).run()


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
        self.navigators, self.selection = _navigators(reader, options)
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
        tracks, kept = {source: truth.winds if source == TRUE_WIND else truth.states for source in self.true}, []
        for source, stamp_ns, raw in self.reference.stream(self.true_sources) if self.true else ():
            if stamp_ns - last.get(source, stamp_ns - step_ns) >= step_ns:
                state = self.reference.decoder.decode(source, self.reference.types[source], raw)
                if source in self.true and isinstance(state, NavSolution):
                    last[source] = stamp_ns
                    kept.append(state)
        for source, track in tracks.items():
            track.add(columns_of([state for state in kept if state.source == source]))
        return truth if self.true else None


class _Replay(Cast):
    """One replay of one bag; a third reader gives what the aircraft recorded."""

    def __init__(self, reader: BagReader, recorded: BagReader, reference: BagReader, options: ReplayOptions) -> None:
        super().__init__(reader, reference, options)
        self.recorded, self.decode_s = recorded, 0.0
        self.outputs = {output_topic(name): name for name in self.navigators if output_topic(name) in reader.types}

    def run(self) -> ReplayResult:
        """Read, feed, compare, sum up."""
        began = perf_counter()
        stream = self._timed(self.stream())
        head = next(stream)
        first_ns = first_stamp(head)
        windows = [resolve(w, first_ns) for w in self.options.withhold]
        for window in windows:
            self._check_window(window, first_ns)
        rules = self.reader.decoder.rules
        further = self.options.out, rules, self.options.smooth, self.air_data
        session = Session(self.navigators, windows, self.truth is not None, self.outputs, *further)
        true = ((m.stamp_ns, (m,)) for m in self.reference.measurements(self.true_sources) if m.source in self.true)
        alongside = _Alongside(session.feed_truth, true), _Alongside(session.feed_recorded, _recorded(self.recorded, self.outputs))
        for measurement in itertools.chain([head], stream):
            session.feed(measurement)
            for reader in alongside:
                reader.advance(session.newest_ns)
            if self.options.on_progress is not None:
                span = max(1, self.reader.end_ns - self.reader.start_ns)
                self.options.on_progress(min(1.0, (session.newest_ns - first_ns) / span))
        for reader in alongside:
            reader.advance(math.inf)
        result = session.finish()
        wall_s = perf_counter() - began
        return timed(dataclasses.replace(result, recording=self._about()), wall_s, self.decode_s)

    def _check_window(self, window: Window, first_ns: int) -> None:
        """Refuse, before the work, a window in which there is nothing to withhold, and say what is silent there."""
        last: dict[str, int] = {}
        silent: dict[str, str] = {}
        for source, _, raw in self.reference.stream(sorted(window.sources)):
            stamp_ns = decode(source, self.reference.types[source], raw, self.reference.decoder.rules).stamp_ns
            if window.holds(source, stamp_ns):
                return
            if stamp_ns >= window.end_ns and source not in silent and source in last:
                silent[source] = f"{source} from {1e-9 * (last[source] - first_ns):.0f} to {1e-9 * (stamp_ns - first_ns):.0f} s"
            last[source] = stamp_ns
        ended = (f"{source} from {1e-9 * (last[source] - first_ns):.0f} s on" for source in sorted(last.keys() - silent.keys()))
        missing = f"; silent already, from the start: {', '.join([*silent.values(), *ended])}" if last else ""
        end_s = 1e-9 * max(last.values(), default=first_ns)
        span = f"the recording spans {1e-9 * first_ns:.1f} to {end_s:.1f} s (0 to {end_s - 1e-9 * first_ns:.1f} s from the start)"
        raise WithholdError(f"--withhold: nothing fell in the window '{window.text}'; {span}{missing}.")

    def _timed(self, stream: Iterator[Measurement]) -> Iterator[Measurement]:
        while True:
            began = perf_counter()
            measurement = next(stream, None)
            self.decode_s += perf_counter() - began
            if measurement is None:
                return
            yield measurement

    def _about(self) -> Recording:
        rejected: dict[str, dict[str, int]] = {}
        for reader in (self.reader, self.reference):
            for (source, reason), count in sorted(reader.decoder.rejected.items()):
                rejected.setdefault(source, {})[reason] = count
        counts = self.reader.counts
        inputs = {s: SourceCounts(counts[s], rejected.get(s, {})) for s in dict.fromkeys([*self.sources, *self.true_sources])}
        bag = Bag(self.reader.path.name, self.reference.identity(), dict(sorted(counts.items())))
        remarks = {f"{name}: {aid.remark}": 1 for name, one in self.navigators.items() for aid in one.aids if aid.remark}
        remarks |= {f"{name}: {deprived}": 1 for name, one in self.navigators.items() if (deprived := ", ".join(one.deprived()))}
        remarks |= {f"{name}: IMU {one.imu_words}": 1 for name, one in self.navigators.items() if one.imu_words}
        decoder = self.reader.decoder
        unused = {source for source, _ in decoder.rejected if not decoder.accepted[source]}
        remarks |= {} if self.air_data is None else self.air_data.remarks()
        remarks |= {f"nothing usable on {source}: {self.reader.rejections(source)}": 1 for source in sorted(unused)}
        found = offers(self.reader.types)
        if found:
            remarks[f"{len(found)} topics look like sensors and are not read; {word_options(found)} reads them"] = 1
        return Recording(bag, self.truth, self.selection.left_out, inputs, dict(sorted(self.reader.decoder.notes.items())) | remarks)


class _Alongside:
    """What another reader of the bag gives, handed to the session as far as the replay has come.

    Parameters
    ----------
    hand_over : callable
        Method of the session.
    items : iterator of (int, tuple)
        Stamp, ns, and the arguments of the method.
    """

    def __init__(self, hand_over: Callable[..., None], items: Iterator[tuple[int, tuple[Any, ...]]]) -> None:
        self._hand_over, self._items = hand_over, items
        self._next = next(items, None)

    def advance(self, newest_ns: float) -> None:
        """Hand over what is not newer than ``newest_ns``."""
        while self._next is not None and self._next[0] <= newest_ns:
            self._hand_over(*self._next[1])
            self._next = next(self._items, None)


def _recorded(reader: BagReader, names: dict[str, str]) -> Iterator[tuple[int, tuple[str, Any, NavSolution | None]]]:
    """The fused solutions that were recorded: name, message, decoded solution."""
    for source, _, raw in reader.stream(_with_origins(reader, names)) if names else ():
        msgtype = reader.types[source]
        decoded = reader.decoder.decode(source, msgtype, raw)
        if source in names and decoded.stamp_ns:
            yield decoded.stamp_ns, (names[source], from_cdr(raw, msgtype), decoded if isinstance(decoded, NavSolution) else None)


def _navigators(reader: BagReader, options: ReplayOptions) -> tuple[dict[str, Navigator], Selection]:
    registry = NAVIGATORS if options.registry is None else options.registry
    check_names(options.navigators or (), list(registry))
    wanted = dict.fromkeys(options.navigators or registry)
    navigators = build_navigators(wanted, registry, options.config, reader.settings_folder)
    for navigator in navigators.values():
        reader.decoder.rules.accept(navigator)
    inputs = {name: navigator.inputs for name, navigator in navigators.items()}
    reader.require(s for s in reader.types if any(s in sources for sources in inputs.values()))
    decodable = set(reader.decodable())
    decodable |= {AIR} if _air_data(reader, options) else set()
    try:
        selection = select(inputs, decodable, insist=options.navigators is not None)
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
