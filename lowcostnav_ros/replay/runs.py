"""What a replay keeps per navigator: solutions out, digest, modes, innovations, errors, time spent."""

import dataclasses
from collections import Counter, defaultdict
from collections.abc import Callable, Collection
from itertools import groupby
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.estimation.aiding import AidStatus, Reason
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.replay import result_files as files
from lowcostnav_ros.replay.columns import NavColumns, columns_of
from lowcostnav_ros.replay.digest import Comparison, records_of_solutions
from lowcostnav_ros.replay.evaluation import Evaluation
from lowcostnav_ros.replay.integrity import IntegrityRecord
from lowcostnav_ros.replay.links import Link
from lowcostnav_ros.replay.metrics import Errors
from lowcostnav_ros.replay.result import AidSummary, ContradictionSummary, InputSummary, NavigatorResult, StampSummary


@dataclasses.dataclass(slots=True)
class AidStatistics:
    """Innovation statistics of one aid: NIS per degree of freedom is 1 on average when the filter's predicted sigmas fit."""

    components: int
    used: int = 0
    rejected: Counter = dataclasses.field(default_factory=Counter)
    tested: int = 0
    nis_sum: float = 0.0
    innovation_sum: np.ndarray | float = 0.0
    innovation_squares: np.ndarray | float = 0.0
    innovation_products: np.ndarray | float = 0.0
    before: np.ndarray | float = 0.0

    def add(self, status: AidStatus, computed: bool) -> None:
        """Count one use of the aid."""
        if status.accepted:
            self.used += 1
        if status.reason:
            self.rejected[Reason.phrase_of(status.reason)] += 1
        if computed and status.innovation is not None:
            self.tested += 1
            self.nis_sum += status.nis
            self.innovation_sum = self.innovation_sum + status.innovation
            self.innovation_squares = self.innovation_squares + status.innovation**2
            self.innovation_products = self.innovation_products + status.innovation * self.before
            self.before = status.innovation

    def result(self, labels: tuple[str, ...]) -> AidSummary:
        """Counts, and the statistics of the innovations by their labels."""
        counts = self.used, dict(sorted(self.rejected.items())), self.tested
        if not self.tested:
            return AidSummary(*counts)
        squares = np.asarray(self.innovation_squares)
        correlation = self.innovation_products / np.where(squares > 0.0, squares, 1.0)
        moments = self.innovation_sum / self.tested, np.sqrt(squares / self.tested), correlation
        named = (dict(zip(labels, np.asarray(values).tolist(), strict=True)) for values in moments)
        return AidSummary(*counts, self.nis_sum / self.tested / self.components, *named)


class ContradictionRecord:
    """What contradicted what over a flight, by name, parties and suspect."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, tuple[str, str], str], ContradictionSummary] = {}

    def add(self, stamp_ns: int, seconds: float, contradictions: Collection[Contradiction]) -> None:
        """Count the contradictions that hold at a stamp for so long."""
        for new in contradictions:
            key = new.name, new.parties, new.suspect
            old = self._found.get(key)
            held, largest = (old.seconds, old.largest) if old else (0.0, 0.0)
            first_s = old.first_s if old else 1e-9 * stamp_ns
            self._found[key] = ContradictionSummary(*key, first_s, held + seconds, max(largest, new.size), new.unit, new.advice)

    def result(self) -> tuple[ContradictionSummary, ...]:
        """All of them, in order of their beginning."""
        return tuple(self._found.values())


class NavigatorFiles:
    """The result files of one navigator."""

    def __init__(self, folder: Path, name: str, smooth: bool = False) -> None:
        wanted = files.NAVIGATOR_FILES | (files.SMOOTHED_FILES if smooth else {})
        self._tables = [files.Table(folder / f"{name}{ending}.csv", header) for ending, header in wanted.items()]
        self.solutions, self.errors, self.aids, self.states, self.integrity, *self.smoothed = self._tables
        self._sampled_ns: int | None = None

    def add(self, solutions: list[NavSolution], columns: NavColumns) -> None:
        """Write solutions, given as columns too, and, once a second, their further states and integrity."""
        self.solutions.rows(files.solution_rows(columns, [s.mode for s in solutions]))
        for solution in solutions:
            if self._sampled_ns is None or solution.stamp_ns - self._sampled_ns >= files.STATES_PERIOD_NS:
                self._sampled_ns = solution.stamp_ns
                self.states.rows(files.state_rows(solution))
                if solution.integrity is not None:
                    self.integrity.rows([files.integrity_row(solution.stamp_ns, solution.integrity)])

    def add_errors(self, errors: Errors) -> None:
        """Write errors."""
        self.errors.rows(files.error_rows(errors))

    def add_smoothed(self, solutions: list[NavSolution]) -> None:
        """Write the smoothed solutions."""
        self.smoothed[0].rows(files.solution_rows(columns_of(solutions), [s.mode for s in solutions]))

    def add_smoothed_errors(self, errors: Errors) -> None:
        """Write the errors of the smoothed solutions."""
        self.smoothed[1].rows(files.error_rows(errors))

    def close(self) -> None:
        """Close all files."""
        for table in self._tables:
            table.close()


TIMEOUT_S = 2.0
"""Without a solution for longer than this, s, the last mode of a navigator no longer holds; it counts as ``Mode.SILENT``."""


class NavigatorRun:
    """One navigator in a replay.

    Parameters
    ----------
    link : Link
        The navigator and its fused message.
    evaluation : Evaluation
        Where its solutions are compared with the reference.
    out : NavigatorFiles or None
    compare : bool
        Whether the recording holds a fused solution of this navigator to compare with.
    smoothed : Evaluation or None
        Where its smoothed solutions are compared with the reference; None: they are not wanted.

    Attributes
    ----------
    meant : callable or None
        What is evaluated in place of a solution: where clocks are set, one with the stamp of the moment that it means, None for no moment.
    """

    def __init__(
        self, link: Link, evaluation: Evaluation, out: NavigatorFiles | None, compare: bool, smoothed: Evaluation | None = None
    ) -> None:
        self.link = link
        self.navigator: Navigator = link.navigator
        self.evaluation = evaluation
        self.smoothed = smoothed
        self.out = out
        self.comparison = Comparison(expected=compare)
        self.integrity, self.contradictions = IntegrityRecord(), ContradictionRecord()
        evaluation.listeners += [self.integrity.add_errors, *([out.add_errors] if out is not None else [])]
        if smoothed is not None:
            self.navigator.keep_history()
            smoothed.listeners += [out.add_smoothed_errors] if out is not None else []
        self.solutions = 0
        self.mode_seconds: dict[str, float] = defaultdict(float)
        self.aids: dict[str, AidStatistics] = {}
        self.labels: dict[str, tuple[str, ...]] = {}
        self._pending: list[NavSolution] = []
        self._origins: list[LocalFrame | None] = []
        self._last: tuple[int, str] | None = None
        self._innovations: dict[str, np.ndarray | None] = {}
        self.navigator.on_aid = self._on_aid
        self.meant: Callable[[NavSolution], NavSolution | None] | None = None

    def take(self, solution: NavSolution) -> None:
        """Take in a solution of the navigator."""
        self.solutions += 1
        self.contradictions.add(solution.stamp_ns, 1e-9 * self.navigator.output_period_ns, self.navigator.contradictions())
        if self._last is not None:
            since_s = max(0.0, (solution.stamp_ns - self._last[0]) / 1e9)
            longest_s = max(TIMEOUT_S, 3e-9 * self.navigator.output_period_ns)
            self.mode_seconds[self._last[1] if since_s <= longest_s else Mode.SILENT] += since_s
        self._last = (solution.stamp_ns, solution.mode)
        evaluated = solution if self.meant is None else self.meant(solution)
        if evaluated is not None:
            self._pending.append(evaluated)
            self._origins.append(self.navigator.origin)

    def flush(self) -> None:
        """Write and evaluate what has come since the last flush."""
        if self._pending:
            columns = columns_of(self._pending)
            self._fingerprint(columns)
            if self.out is not None:
                self.out.add(self._pending, columns)
            self.integrity.add(self._pending)
            self.evaluation.add_solutions(columns)
            self._pending, self._origins = [], []
        self.evaluation.advance()

    def _fingerprint(self, columns: NavColumns) -> None:
        """Take in what a node would publish of the pending solutions: nothing before there is an attitude, or an origin."""
        first = 0
        for origin, group in groupby(self._origins):
            last = first + len(list(group))
            rows = np.arange(first, last)
            if self.link.is_attitude:
                rows, origin = rows[np.isfinite(columns.q_nb[rows, 0])], None
            if len(rows) and (self.link.is_attitude or origin is not None):
                solutions = [self._pending[row] for row in rows.tolist()]
                self.comparison.add_replayed(columns.stamps_ns[rows], records_of_solutions(solutions, columns[rows], origin))
            first = last

    def smooth(self) -> None:
        """Smooth the whole pass, write and evaluate what comes of it."""
        history = self.navigator.history
        solutions = [] if history is None else list(history.smoothed())
        if self.smoothed is not None and solutions:
            if self.out is not None:
                self.out.add_smoothed(solutions)
            self.smoothed.add_solutions(columns_of(solutions))
            self.smoothed.advance()

    def _on_aid(self, status: AidStatus) -> None:
        computed = status.innovation is not None and status.innovation is not self._innovations.get(status.name)
        self._innovations[status.name] = status.innovation
        self.labels[status.name] = status.labels
        self.aids.setdefault(status.name, AidStatistics(len(status.labels))).add(status, computed)
        if self.out is not None:
            self.out.aids.rows(files.aid_rows(status, computed))

    def result(self, end_ns: int) -> NavigatorResult:
        """Everything about this navigator; ``end_ns`` is the last stamp of the recording."""
        status = self.navigator.status()
        return NavigatorResult(
            self.comparison.result(),
            self.solutions,
            status.mode,
            status.reason,
            dict(self.mode_seconds),
            dict(self.navigator.restarts),
            self.evaluation.result(end_ns),
            self.integrity.result(),
            {name: statistics.result(self.labels[name]) for name, statistics in sorted(self.aids.items())},
            {i.source: InputSummary(i.required, i.received, dict(sorted(i.rejected.items()))) for i in status.inputs},
            self.link.seconds,
            None if self.smoothed is None else self.smoothed.result(end_ns),
            self.contradictions.result(),
            self._stamps(),
        )

    def _stamps(self) -> dict[str, StampSummary]:
        """What became known of the stamps of each device."""
        known = {} if self.navigator.offsets is None else self.navigator.offsets.known
        return {name: StampSummary(o.late_s + o.rest_s, o.sigma_s, o.late_s, o.is_observed) for name, o in sorted(known.items())}
