"""Matching solutions with a reference as both stream by, and filing the errors under flight, GPS outages and withheld windows."""

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

import numpy as np

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.replay.columns import NavColumns, blank_columns, concatenate, interpolate
from lowcostnav_ros.replay.metrics import Errors, ErrorStatistics, error_row, errors_between
from lowcostnav_ros.replay.outages import GpsGaps
from lowcostnav_ros.replay.requirements import Coverage, monitors
from lowcostnav_ros.replay.result import IntervalErrors, NavigatorErrors
from lowcostnav_ros.replay.withhold import NS, Window

MAX_GAP_NS = NS
"""Nothing is interpolated over more than this."""


class Track:
    """States that stream in, of which only what may still be asked for is kept."""

    def __init__(self) -> None:
        self._parts: list[NavColumns] = []
        self.newest_ns: int | None = None

    def add(self, columns: NavColumns) -> None:
        """Append states; rows that are not newer than the newest are dropped."""
        if self.newest_ns is not None:
            columns = columns[columns.stamps_ns > self.newest_ns]
        if len(columns):
            self._parts.append(columns)
            self.newest_ns = int(columns.stamps_ns[-1])

    def at(self, stamps_ns: np.ndarray, max_gap_ns: int = MAX_GAP_NS) -> NavColumns | None:
        """Interpolate at ``stamps_ns`` over gaps of no more than ``max_gap_ns``, None while empty."""
        return interpolate(self.whole(), stamps_ns, max_gap_ns) if self._parts else None

    def whole(self) -> NavColumns:
        """All states that are kept; there must be some."""
        self._parts = [concatenate(self._parts)]
        return self._parts[0]

    def trim(self, before_ns: int) -> None:
        """Forget what is older than ``before_ns`` by more than one bridgeable gap."""
        self._parts = [part[rows] for part in self._parts if (rows := part.stamps_ns >= before_ns - 2 * MAX_GAP_NS).any()]


class Truth:
    """The true states, wind included when it comes on a topic of its own."""

    def __init__(self) -> None:
        self.states = Track()
        self.winds = Track()

    @property
    def newest_ns(self) -> int | None:
        """Newest stamp up to which errors can be formed."""
        return self.states.newest_ns

    def at(self, stamps_ns: np.ndarray) -> NavColumns | None:
        """True states at ``stamps_ns``, NaN where there are none; None while empty."""
        states, winds = self.states.at(stamps_ns), self.winds.at(stamps_ns)
        return states if states is None or winds is None else dataclasses.replace(states, wind_n=winds.wind_n)

    def trim(self, before_ns: int) -> None:
        """Forget what is older than ``before_ns`` and no longer needed."""
        self.states.trim(before_ns)
        self.winds.trim(before_ns)


def truth_columns(block: TruthBlock) -> NavColumns:
    """True states of a block as columns."""
    position = np.column_stack([block.lat, block.lon, block.height])
    return blank_columns(block.stamps_ns, position=position, vel_n=block.vel_n, q_nb=block.q_nb, wind_n=block.wind_n[:, :2])


def fix_columns(measurement: GpsPosition | GpsVelocity) -> NavColumns:
    """One withheld GPS measurement as a reference row: position or velocity, the rest absent."""
    stamps = np.array([measurement.stamp_ns], dtype=np.int64)
    if isinstance(measurement, GpsVelocity):
        return blank_columns(stamps, vel_n=np.reshape(measurement.vel_n, (1, 3)).astype(float))
    return blank_columns(stamps, position=np.array([[measurement.lat, measurement.lon, measurement.height]]))


@dataclasses.dataclass(slots=True)
class IntervalRecord:
    """What happened in one outage or withheld window: worst errors, and the error at its end.

    ``satellites`` is the largest number that was seen in an outage of raw observations, None where a receiver's fixes were missing.
    """

    text: str
    start_ns: int
    end_ns: int
    samples: int = 0
    worst_horizontal_m: float | None = None
    worst_3d_m: float | None = None
    satellites: int | None = None
    last: dict[str, float] | None = None

    def add(self, errors: Errors) -> None:
        """Take errors inside the interval in, in order of stamps."""
        if len(errors) == 0:
            return
        self.samples += len(errors)
        self.last = error_row(errors, len(errors) - 1)
        horizontal = np.hypot(errors.axis("north_m"), errors.axis("east_m"))
        if np.isfinite(horizontal).any():
            self.worst_horizontal_m = max(self.worst_horizontal_m or 0.0, float(np.nanmax(horizontal)))
            self.worst_3d_m = max(self.worst_3d_m or 0.0, float(np.nanmax(np.hypot(horizontal, errors.axis("down_m")))))
            row = int(np.flatnonzero(np.isfinite(horizontal))[-1])
            self.last = {**self.last, **error_row(errors, row)}

    def result(self, duration_end_ns: int) -> IntervalErrors:
        """Errors of the interval; without an end it lasts until ``duration_end_ns``."""
        start_s = self.start_ns / 1e9 if self.start_ns > -(2**61) else None
        end_s, worst = min(self.end_ns, duration_end_ns) / 1e9, (self.worst_horizontal_m, self.worst_3d_m)
        return IntervalErrors(self.text, start_s, end_s, self.samples, *worst, self.satellites, self.last)


class Evaluation:
    """Errors of one navigator, by flight, without GPS, per outage and per withheld window.

    Parameters
    ----------
    truth : Truth or None
        The reference; without it the withheld fixes are.
    gaps : GpsGaps
        When there was no GPS.
    windows : iterable of Window
        Withheld windows.

    Attributes
    ----------
    listeners : list of callable
        Each is called with every chunk of errors.
    """

    def __init__(self, truth: Truth | None, gaps: GpsGaps, windows: Iterable[Window]) -> None:
        self.truth = truth
        self.gaps = gaps
        self.windows = [(w, IntervalRecord(w.text, w.start_ns, w.end_ns)) for w in windows]
        self.outages: dict[int, IntervalRecord] = {}
        self.flight = ErrorStatistics()
        self.without_gps = ErrorStatistics()
        self.listeners: list[Callable[[Errors], None]] = []
        self.services = monitors()
        self.coverage = Coverage()
        self._estimates = Track()
        self._pending: list[NavColumns] = []
        self._set_back: list[list[NavColumns]] = []  # solutions after each step back of the clock that the truth has yet to make
        self._newest_ns: int | None = None

    def add_solutions(self, columns: NavColumns) -> None:
        """Take solutions in, in the order in which they came."""
        for part in map(in_order, set_back(columns)):
            if self.truth is None:
                self._estimates.add(part)
                continue
            if self._newest_ns is not None and part.stamps_ns[0] < self._newest_ns - MAX_GAP_NS:
                self._set_back.append([])
            self._newest_ns = int(part.stamps_ns[-1])
            (self._set_back[-1] if self._set_back else self._pending).append(part)

    def begin_anew(self, truth: Truth) -> None:
        """Compare with the truth after a step back of its clock; what came before and has no truth yet gets none."""
        self.truth, self._pending = truth, self._set_back.pop(0) if self._set_back else []

    def add_withheld(self, fix: NavColumns) -> None:
        """Take one withheld fix in (used when there is no truth)."""
        if self.truth is None:
            self._pending.append(fix)

    def advance(self) -> None:
        """Form all errors whose reference has come, and forget what they were formed from."""
        newest = (self.truth or self._estimates).newest_ns
        if newest is None or not self._pending:
            return
        pending = concatenate(self._pending)
        ready = pending.stamps_ns <= newest
        self._pending = [pending[~ready]] if not ready.all() else []
        done = pending[ready]
        if len(done) == 0:
            return
        if (other := (self.truth or self._estimates).at(done.stamps_ns)) is not None:
            self._file(errors_between(done, other) if self.truth else errors_between(other, done))
        if self.truth is None:
            self._estimates.trim(int(done.stamps_ns[-1]))

    @property
    def oldest_pending_ns(self) -> int | None:
        """Oldest stamp that still waits for its reference."""
        return min((int(p.stamps_ns[0]) for p in self._pending if len(p)), default=None)

    def _file(self, errors: Errors) -> None:
        for listener in self.listeners:
            listener(errors)
        self.flight.add(errors)
        self.coverage.add(errors)
        for monitor in self.services.values():
            monitor.add(errors)
        starts = self.gaps.interval_starts(errors.stamps_ns)
        self.without_gps.add(errors[starts >= 0])
        for start in np.unique(starts[starts >= 0]):
            record = self.outages.setdefault(int(start), IntervalRecord("without GPS", int(start), 2**62))
            record.add(errors[starts == start])
        for window, record in self.windows:
            record.add(errors[(errors.stamps_ns >= window.start_ns) & (errors.stamps_ns < window.end_ns)])

    def result(self, end_ns: int) -> NavigatorErrors:
        """Statistics, alarms, outages, windows.

        Parameters
        ----------
        end_ns : int
            Last stamp of the recording.
        """
        for start, end in self.gaps.intervals:
            if start in self.outages:
                self.outages[start].end_ns = end
                self.outages[start].satellites = self.gaps.satellites.get(start)
        services = {name: found for name, monitor in self.services.items() if (found := monitor.result())}
        reference = "truth" if self.truth is not None else "withheld gps"
        whole = self.flight.result()
        return NavigatorErrors(
            reference if whole else None,
            whole,
            self.without_gps.result(),
            services,
            self.coverage.seconds,
            tuple(r.result(end_ns) for _, r in sorted(self.outages.items())),
            tuple(r.result(end_ns) for _, r in self.windows),
            self.truth is not None,
        )


def set_back(columns: NavColumns) -> Iterator[NavColumns]:
    """Columns cut where their stamps go back by more than a gap: there the clock of the recording was set back."""
    cuts = np.flatnonzero(np.diff(columns.stamps_ns) < -MAX_GAP_NS) + 1
    for first, last in pairwise([0, *cuts.tolist(), len(columns)]):
        yield columns[first:last]


def in_order(columns: NavColumns) -> NavColumns:
    """Columns in order of stamps."""
    if np.all(np.diff(columns.stamps_ns) >= 0):
        return columns
    return columns[np.argsort(columns.stamps_ns, kind="stable")]
