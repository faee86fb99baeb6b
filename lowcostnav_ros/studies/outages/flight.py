"""One pass over a recording that loses GPS at many instants: at each the navigators are copied as they fly, and the copies fly on without.

Up to the first measurement that a window holds back a replay with that window and one without are the same; there the copy is taken,
so that its solutions equal those of a replay from the start to the last bit.
"""

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.cores.rows import Rows
from lowcostnav_ros.navigators.solutions import Solutions
from lowcostnav_ros.replay.links import Chain
from lowcostnav_ros.replay.outages import GAP_NS
from lowcostnav_ros.replay.withhold import Window, split
from lowcostnav_ros.studies.aside import Aside

SETTLED_NS = 2_000_000_000
"""A window is over once the flight's fused solutions are this far beyond its end; longer than any horizon of a chain."""
BEFORE_NS = 3_000_000_000
"""Solutions from this long before a loss are kept, so that there is one on either side of it."""

TOGETHER_NS = 500_000_000
"""Measurements of so long are fed at once."""

STEADY_NS = 10_000_000_000
"""GPS must have been there for so long to be lost; right after an outage the navigators still recover from that one."""

ByNavigator = dict[str, Solutions]


@dataclass(slots=True, eq=False)
class Loss:
    """One window without GPS.

    Attributes
    ----------
    window : Window
    chain : Chain
        The copy that flies through it.
    lost : dict of navigator to Solutions
        What the copy published, preceded by what was published before the loss.
    kept : dict of navigator to Solutions
        What was published with GPS, over the same time.
    is_whole : bool
        False where the recording ended first.
    """

    window: Window
    chain: Chain
    lost: ByNavigator
    kept: ByNavigator = field(default_factory=dict)
    is_whole: bool = False
    _withheld: Window = field(init=False)
    _fed: "Gathered" = field(init=False)

    def __post_init__(self) -> None:
        self._withheld = replace(self.window, end_ns=2**62)  # what comes after its end must not pull at the error there
        self._fed = Gathered(self.chain)

    def feed(self, measurement: Measurement) -> int:
        """Feed the copy all but what is withheld from the start of the window on; return the newest stamp of its solutions."""
        given, _ = split(measurement, (self._withheld,))
        return self._take(self._fed.add(given)) if given is not None else -(2**62)

    def end(self) -> None:
        """Feed what has been gathered, and keep of the solutions what belongs to the window."""
        self._take(self._fed.rest())
        self.lost = _within(self.lost, self.span)

    @property
    def span(self) -> tuple[int, int]:
        """Stamps between which solutions belong to it, ns."""
        return self.window.start_ns - BEFORE_NS, self.window.end_ns

    def _take(self, given: Iterable[tuple[str, NavSolution | Rows]]) -> int:
        newest_ns = -(2**62)
        for name, part in given:
            self.lost[name].append(part)
            newest_ns = max(newest_ns, part.stamp_ns)
        return newest_ns


@dataclass(slots=True, eq=False)
class Deferred(Loss):
    """A window that is flown when all its measurements are there, aside if wanted, so that the flight with GPS goes on meanwhile."""

    _measurements: list[Measurement] = field(default_factory=list)
    aside: "Aside[ByNavigator] | None" = None

    def feed(self, measurement: Measurement) -> int:
        """Keep it; whether the window is over is told by the flight with GPS."""
        self._measurements.append(measurement)
        return -(2**62)

    def end(self) -> None:
        """Nothing yet: it is flown by :meth:`begin`."""

    def begin(self, is_aside: bool) -> None:
        """Fly it, here or aside."""
        self.aside = Aside(self._flown, is_aside)
        if not is_aside:
            self.collect()

    def collect(self) -> None:
        """Wait for its solutions, where they are not here yet."""
        if self.aside is not None:
            self.lost, self.aside = self.aside.result(), None
            self._measurements.clear()

    def _flown(self) -> ByNavigator:
        for measurement in self._measurements:
            Loss.feed(self, measurement)
        Loss.end(self)
        return self.lost


class Gathered:
    """Measurements for a chain, given to it as they come, those of :data:`TOGETHER_NS` at once."""

    def __init__(self, chain: Chain) -> None:
        self.chain, self._waiting = chain, list[Measurement]()

    def add(self, measurement: Measurement) -> Iterable[tuple[str, NavSolution | Rows]]:
        """Take a measurement; return name and solutions of what comes out now."""
        self._waiting.append(measurement)
        return self.rest() if abs(measurement.stamp_ns - self._waiting[0].stamp_ns) >= TOGETHER_NS else ()

    def rest(self) -> Iterable[tuple[str, NavSolution | Rows]]:
        """Give the chain what is there."""
        waiting, self._waiting = self._waiting, []
        return self.chain.feed_all(waiting)


class Losses:
    """The pass.

    Parameters
    ----------
    chain : Chain
        Fresh navigators; they fly with GPS.
    windows : sequence of Window
        In order of their starts.
    to_the_end : bool
        Whether the flight with GPS goes on to the end of the last window, to be compared with, or to the last loss only.
    kind : type
        :class:`Loss`, or :class:`Deferred` where the flight with GPS goes on to the end in any case.

    Attributes
    ----------
    is_done : bool
        Whether all windows are over.
    skipped : list of Window
        There was no GPS to lose: nothing that would be held back came within 3 s of the start, or not steadily for 10 s before it.
    """

    def __init__(self, chain: Chain, windows: Sequence[Window], to_the_end: bool = True, kind: type[Loss] = Loss) -> None:
        self.kind = kind
        self.chain, self.skipped, self.to_the_end = chain, list[Window](), to_the_end
        self._waiting, self._flying = deque(windows), list[Loss]()
        self.is_done = not self._waiting
        self._kept: ByNavigator = defaultdict(Solutions)
        self._newest_ns = self._heard_ns = self._steady_ns = -(2**62)

    def fly(self, measurements: Iterable[Measurement]) -> Iterator[Loss]:
        """Feed a recording, as far as there are windows; yield each when it is over, or with the recording."""
        fed = Gathered(self.chain)
        for measurement in measurements:
            if self._may_lose(measurement):
                self._take_all(fed.rest())
            self.before(measurement)
            if self._waiting or self.to_the_end:
                self._take_all(fed.add(measurement))
            yield from self.over()
            if self.is_done:
                return
        self._take_all(fed.rest())
        yield from self.rest()

    def _take_all(self, given: Iterable[tuple[str, NavSolution | Rows]]) -> None:
        for name, part in given:
            self.take(name, part)

    def before(self, measurement: Measurement) -> None:
        """Lose GPS where a window begins, and feed the copies; the navigators take the measurement afterwards."""
        self._lose(measurement)
        for loss in self._flying:
            self._newest_ns = max(self._newest_ns, loss.feed(measurement))

    def take(self, name: str, part: NavSolution | Rows) -> None:
        """Note a solution of the flight with GPS, or several."""
        if not self.is_done:
            self._kept[name].append(part)
            self._newest_ns = max(self._newest_ns, part.stamp_ns)

    def over(self) -> Iterator[Loss]:
        """Yield the windows that are over."""
        yield from self._over(self._newest_ns)
        self.is_done = not self._waiting and not self._flying

    def rest(self) -> Iterator[Loss]:
        """Yield the windows that the recording ends in."""
        self.skipped += self._waiting
        self._waiting.clear()
        yield from self._over(2**62)
        self.is_done = True

    def _may_lose(self, measurement: Measurement) -> bool:
        """Whether a window may begin with a measurement."""
        window = self._waiting[0] if self._waiting else None
        return window is not None and measurement.source in window.sources and measurement.stamp_ns >= window.start_ns

    def _lose(self, measurement: Measurement) -> None:
        """Copy the navigators for every window that this measurement is the first to be held back by."""
        while self._waiting and self._newest_ns > self._waiting[0].start_ns + GAP_NS:
            self.skipped.append(self._waiting.popleft())
        if not self._waiting or measurement.source not in self._waiting[0].sources:
            return
        stamp_ns = measurement.stamp_ns
        while self._waiting and 0 <= stamp_ns - self._waiting[0].start_ns <= GAP_NS:
            window = self._waiting.popleft()
            if window.start_ns - self._steady_ns < STEADY_NS or abs(stamp_ns - self._heard_ns) > GAP_NS:
                self.skipped.append(window)
            else:
                before = {name: Solutions(solutions.parts) for name, solutions in self._kept.items()}
                self._flying.append(self.kind(window, self.chain.fork(), defaultdict(Solutions, before)))
        if abs(stamp_ns - self._heard_ns) > GAP_NS:  # one bad stamp costs a few starts, not all
            self._steady_ns = stamp_ns
        self._heard_ns = stamp_ns

    def _over(self, now_ns: int) -> Iterator[Loss]:
        done = [loss for loss in self._flying if loss.window.end_ns + SETTLED_NS <= now_ns]
        for loss in done:
            loss.end()
            loss.kept, loss.is_whole = _within(self._kept, loss.span), now_ns < 2**62
            yield loss
        if done:
            self._flying = [loss for loss in self._flying if loss not in done]
        if done or not self._flying:
            self._forget()

    def _forget(self) -> None:
        """Drop solutions that no window asks for any more."""
        starts = [loss.window.start_ns for loss in self._flying] + [window.start_ns for window in list(self._waiting)[:1]]
        oldest_ns = min([*starts, self._newest_ns]) - BEFORE_NS
        for solutions in self._kept.values():
            if len(solutions.parts) > 100 and solutions.parts[50].stamp_ns < oldest_ns:
                solutions.parts = [part for part in solutions.parts if part.stamp_ns >= oldest_ns]


def _within(solutions: ByNavigator, span: tuple[int, int]) -> ByNavigator:
    first_ns, end_ns = span
    return {name: those.between(first_ns, end_ns + SETTLED_NS) for name, those in solutions.items()}
