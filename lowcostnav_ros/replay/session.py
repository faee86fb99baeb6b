"""The replay itself: one ordered pass of a recording, or of any stream of measurements, through the navigators."""

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Protocol

import numpy as np

from lowcostnav_ros import __version__
from lowcostnav_ros.base.measurements import GnssEpoch, GpsPosition, GpsVelocity, ImuBlock, Measurement, NavSolution
from lowcostnav_ros.base.settings import settings_hash, to_mapping
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.estimation.air_data.computer import AirDataComputer
from lowcostnav_ros.estimation.clocks import TIME_JUMPED, Clocks
from lowcostnav_ros.estimation.horizon import TIME_JUMP_NS
from lowcostnav_ros.messages.decode import DecodeRules
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.replay import result_files as files
from lowcostnav_ros.replay.columns import NavColumns, blank_columns, concatenate
from lowcostnav_ros.replay.evaluation import MAX_GAP_NS, Evaluation, Truth, fix_columns, set_back, truth_columns
from lowcostnav_ros.replay.links import Chain
from lowcostnav_ros.replay.outages import GpsGaps
from lowcostnav_ros.replay.result import Place, ReplayResult, Times, WithoutGps
from lowcostnav_ros.replay.runs import NavigatorRun
from lowcostnav_ros.replay.session_files import SessionFiles
from lowcostnav_ros.replay.withhold import Window, Withhold, WithholdError, resolve, split


class Watcher(Protocol):
    """What flies along, in ``seconds`` of its own: it sees every measurement before the navigators take it, and every solution."""

    seconds: float

    def before(self, measurement: Measurement) -> None:
        """Take a measurement that the navigators are about to take."""

    def take(self, name: str, solution: NavSolution) -> None:
        """Take a solution of a navigator."""

    def after(self) -> None:
        """The navigators have taken the measurement."""


FLUSH_NS = 5_000_000_000
"""Results are written and evaluated whenever the stream has moved on this far."""

LATEST_NS = 1_000_000_000
"""Messages of one instant are recorded within this long; what is further off tells no time."""

Item = Measurement | TruthBlock


class Session:
    """One pass of measurements through a set of navigators.

    Parameters
    ----------
    navigators : mapping of name to Navigator
        Fresh ones; they are fed in order, each after those whose solutions it takes.
    windows : sequence of Window
        What is withheld when.
    has_truth : bool
        Whether truth will come; without it withheld fixes are the reference.
    recorded : collection of str
        Topics whose recorded messages will be given to :meth:`feed_recorded` for comparison.
    out : Path, optional
        Folder of the result files.
    smooth : bool
        Whether every navigator that can is smoothed at the end.
    air_data : AirDataComputer, optional
        Makes the airspeed of pressures.

    Attributes
    ----------
    alongside : list of callable
        Called before every evaluation with the newest stamp, ns: what comes beside the measurements is handed over up to there.
    watcher : Watcher or None
    """

    def __init__(
        self,
        navigators: Mapping[str, Navigator],
        windows: Sequence[Window] = (),
        has_truth: bool = False,
        recorded: Iterable[str] = (),
        out: Path | None = None,
        rules: DecodeRules | None = None,
        smooth: bool = False,
        air_data: AirDataComputer | None = None,
    ) -> None:
        self.windows = list(windows)
        self.truth = Truth() if has_truth else None
        self.kept = Truth() if smooth and has_truth else None
        self.gaps = GpsGaps()
        self.files = SessionFiles(out)
        self.files.open()
        self.first_ns: int | None = None
        self.newest_ns = 0
        self._clocks = Clocks(LATEST_NS, TIME_JUMP_NS)
        self.withheld: Counter[str] = Counter()
        self._flushed_ns: int | None = None
        self._true: dict[str, list[NavColumns]] = {"states": [], "winds": []}
        self.alongside: list[Callable[[float], None]] = []
        self.watcher: Watcher | None = None
        recorded = set(recorded)
        self.runs: dict[str, NavigatorRun] = {}
        self.chain = Chain(navigators, rules, air_data)
        for name, link in self.chain.links.items():
            smoothed = Evaluation(self.kept, self.gaps, self.windows) if smooth and navigators[name].smooths else None
            out_files = self.files.navigator(name, smoothed is not None)
            evaluation = Evaluation(self.truth, self.gaps, self.windows)
            self.runs[name] = NavigatorRun(link, evaluation, out_files, link.topic in recorded, smoothed)

    def feed(self, measurement: Measurement) -> None:
        """Feed one measurement, less what is withheld, to every navigator that takes its source."""
        plausible = self._tell_time(measurement)
        given, held = split(measurement, self.windows) if self.windows else (measurement, None)
        if held is not None:
            self._withhold(held)
        if given is not None and self.chain.takes(given):
            if isinstance(given, GpsPosition) and plausible:
                self.gaps.add(given.stamp_ns)
                self._write_fix(given, withheld=False)
            elif isinstance(given, GnssEpoch) and plausible:
                self.gaps.add_epoch(given.stamp_ns, int(np.count_nonzero(given.range_valid)))
            if self.watcher is not None:
                self.watcher.before(given)
            for name, solution in self.chain.feed(given):
                self.runs[name].take(solution)
                if self.watcher is not None:
                    self.watcher.take(name, solution)
            if self.watcher is not None:
                self.watcher.after()
        if self._flushed_ns is None or self.newest_ns - self._flushed_ns > FLUSH_NS:
            self.flush()

    def _tell_time(self, measurement: Measurement) -> bool:
        """Follow the time that the inputs agree upon; return whether a message agrees with it, so that a wild stamp is no time at all."""
        plausible = True
        for piece in self._clocks.pieces(measurement):
            verdict = self._clocks.judge(piece, None)
            if verdict == TIME_JUMPED:
                self._clocks.clear()
                self._clocks.judge(piece, None)
                if self.first_ns is not None and self.newest_ns - self.first_ns < FLUSH_NS:
                    self.first_ns = None  # so short a beginning was no time either
                self._flushed_ns = None
            plausible = verdict in ("", TIME_JUMPED)
            if plausible:
                first = first_stamp(piece)
                self.first_ns = first if self.first_ns is None else min(first, self.first_ns)
        self._clocks.refused.clear()
        self.newest_ns = self._clocks.time_ns or 0
        return plausible

    def feed_truth(self, truth: TruthBlock | NavColumns) -> None:
        """Take true states in, in order of arrival; columns without positions are the true wind."""
        if isinstance(truth, TruthBlock):
            self._take_truth("states", truth_columns(truth), _ten_hertz(truth_columns(truth)))
        elif len(truth) and np.isfinite(truth.position[0, 0]):
            self._true["states"].append(truth)
        elif len(truth):
            self._true["winds"].append(blank_columns(truth.stamps_ns, wind_n=truth.wind_n))

    def _take_truth(self, name: str, columns: NavColumns, shown: NavColumns) -> None:
        """Form errors against true states or winds from now on, and write those that are to be shown."""
        if self.truth is None:
            return
        newest_ns = self.truth.newest_ns
        if name == "states" and newest_ns is not None and columns.stamps_ns[0] < newest_ns - MAX_GAP_NS:
            self._evaluate()  # the clock of the recording was set back
            self.truth = Truth()
            for run in self.runs.values():
                run.evaluation.begin_anew(self.truth)
        getattr(self.truth, name).add(columns)
        self.files.add_truth(shown)
        if self.kept is not None:
            getattr(self.kept, name).add(_ten_hertz(columns))

    def feed_recorded(self, name: str, stamps_ns: np.ndarray, records: np.ndarray) -> None:
        """Compare the records of fused messages the aircraft recorded with the replay's."""
        self.runs[name].comparison.add_recorded(stamps_ns, records)

    def _withhold(self, held: Measurement) -> None:
        self.withheld[held.source] += 1
        if isinstance(held, GpsPosition):
            self._write_fix(held, withheld=True)
        if isinstance(held, GpsVelocity) or (isinstance(held, GpsPosition) and held.has_height):  # no reference without its height
            columns = fix_columns(held)
            for run in self.runs.values():
                for evaluation in filter(None, (run.evaluation, run.smoothed)):
                    evaluation.add_withheld(columns)

    def _write_fix(self, fix: GpsPosition, withheld: bool) -> None:
        if self.files.gps is not None:
            self.files.gps.rows([files.gps_row(fix.stamp_ns, fix.lat, fix.lon, fix.height if fix.has_height else math.nan, withheld)])

    def flush(self) -> None:
        """Write and evaluate what has come; forget what is no longer needed."""
        self._flushed_ns = self.newest_ns
        for hand_over in self.alongside:
            hand_over(self.newest_ns)
        for name, parts in self._true.items():
            for columns in set_back(concatenate(parts)) if parts else ():
                self._take_truth(name, columns, columns)
            parts.clear()
        self._evaluate()

    def _evaluate(self) -> None:
        for run in self.runs.values():
            run.flush()
        if self.truth is not None and self.truth.newest_ns is not None:
            waiting = [o for run in self.runs.values() if (o := run.evaluation.oldest_pending_ns) is not None]
            self.truth.trim(min([*waiting, self.truth.newest_ns - 2 * FLUSH_NS]))

    def finish(self) -> ReplayResult:
        """End the pass: evaluate the rest, close the files, return what was found; the times are yet to be set."""
        self.gaps.close(self.newest_ns)
        self.flush()
        for run in self.runs.values():
            run.comparison.finish()
            run.smooth()
            if run.out is not None:
                run.out.close()
        self.files.close()
        first_ns = self.first_ns or 0
        self._check_withheld(first_ns)
        settings = {name: run.navigator.settings for name, run in sorted(self.runs.items())}
        outages = tuple((start / 1e9, end / 1e9) for start, end in self.gaps.intervals)
        return ReplayResult(
            None,
            __version__,
            settings_hash(*settings.values()),
            {name: to_mapping(value) for name, value in settings.items()},
            first_ns / 1e9,
            self.newest_ns / 1e9,
            (self.newest_ns - first_ns) / 1e9,
            tuple(w.text for w in self.windows),
            WithoutGps(outages, sum(end - start for start, end in outages)),
            tuple({s.ident: s for run in self.runs.values() for s in _stations(run.navigator)}.values()),
            {name: run.result(self.newest_ns) for name, run in self.runs.items()},
        )

    def _check_withheld(self, first_ns: int) -> None:
        """Refuse a window in which nothing was withheld: its times are wrong."""
        idle = [w.text for w in self.windows if not any(self.withheld[source] for source in w.sources)]
        if idle and self.first_ns is not None:
            span = f"{first_ns / 1e9:.1f} to {self.newest_ns / 1e9:.1f} s (0 to {(self.newest_ns - first_ns) / 1e9:.1f} s from the start)"
            raise WithholdError(f"--withhold: nothing fell in the window '{idle[0]}'; the recording spans {span}.")


def _stations(navigator: Navigator) -> list[Place]:
    """The radio stations a navigator knows, for the map."""
    table = getattr(navigator, "stations", None) or ()
    return [Place(s.ident, math.degrees(s.lat), math.degrees(s.lon)) for s in table]


def _ten_hertz(columns: NavColumns) -> NavColumns:
    """Thin truth that comes at the inertial rate: enough rows for a plot, not a copy of the flight."""
    if len(columns) < 2:
        return columns
    step = max(1, round(1e8 * (len(columns) - 1) / max(1, int(columns.stamps_ns[-1] - columns.stamps_ns[0]))))
    return columns[::step]


def replay_stream(
    items: Iterable[Item],
    navigators: Mapping[str, Navigator],
    withhold: Sequence[Withhold] = (),
    out: Path | None = None,
    smooth: bool = False,
) -> ReplayResult:
    """Feed a stream of measurements and true states to navigators; return the statistics.

    Parameters
    ----------
    items : iterable of Measurement or TruthBlock
        In the order in which they become available; see :func:`simulated`.  Errors are formed against the truth when the first or second
        item is a TruthBlock, else against withheld fixes.
    navigators : mapping of name to Navigator
        Fresh navigators.
    withhold : sequence of Withhold
        Sources kept from the navigators.
    out : Path, optional
        Folder for the result files.
    smooth : bool
        Whether every navigator that can is smoothed at the end.
    """
    began = perf_counter()
    items = iter(items)
    head: list[Item] = list(itertools.islice(items, 2))
    first_ns = min((first_stamp(item) for item in head), default=0)
    has_truth = any(isinstance(item, TruthBlock) for item in head)
    session = Session(navigators, [resolve(w, first_ns) for w in withhold], has_truth, out=out, smooth=smooth)
    for item in itertools.chain(head, items):
        if isinstance(item, TruthBlock):
            session.feed_truth(item)
        else:
            session.feed(item)
    return timed(session.finish(), perf_counter() - began, 0.0)


def simulated(blocks: Iterable[tuple[TruthBlock, list[Measurement]]]) -> Iterator[Item]:
    """Bring what a simulation yields into the order of arrival that :func:`replay_stream` takes.

    Inertial blocks are cut at the stamps of the other measurements: fed whole, a second of samples would come after aids that it precedes,
    and what one navigator receives from another would be late.
    """
    for truth, measurements in blocks:
        yield truth
        inertial = [m for m in measurements if isinstance(m, ImuBlock)]
        for aid in sorted((m for m in measurements if not isinstance(m, ImuBlock)), key=lambda m: m.stamp_ns):
            for k, block in enumerate(inertial):
                n = int(np.searchsorted(block.stamps_ns, aid.stamp_ns, side="right"))
                if n:
                    yield block[:n]
                    inertial[k] = block[n:]
            yield aid
        yield from (block for block in inertial if len(block))


def timed(result: ReplayResult, wall_s: float, decode_s: float) -> ReplayResult:
    """Set wall time and real-time factors, of the whole pass and per navigator (its own feeding plus the decoding, as if it flew alone)."""
    own = {name: navigator.feed_seconds + decode_s for name, navigator in result.navigators.items()}
    factors = {name: result.duration_s / s if s > 0.0 else None for name, s in own.items()}
    return dataclasses.replace(result, time=Times(wall_s, decode_s, result.duration_s / wall_s if wall_s > 0.0 else None, factors))


def first_stamp(item: Item) -> int:
    """Stamp (ns) of a measurement, or of the first row of a block."""
    return int(item.stamps_ns[0]) if isinstance(item, TruthBlock | ImuBlock) else item.stamp_ns
