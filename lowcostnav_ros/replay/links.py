"""How one navigator receives another's solution in a replay: through the very messages that carry its solution in flight."""

import copy
import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock, Measurement, NavSolution
from lowcostnav_ros.base.settings import parts_of
from lowcostnav_ros.catalogue.navigator_topics import fused_topics
from lowcostnav_ros.cores.rows import Rows
from lowcostnav_ros.estimation.aiding import AidStatus
from lowcostnav_ros.estimation.air_data.computer import AirDataComputer
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.decode import Decoder, DecodeRules, Rejected
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.solutions import Solutions

LONGEST_BURST_NS = 50_000_000
"""Where one navigator takes another's solution, inertial blocks are fed in pieces no longer than this: of a second of samples at once the
first would publish a whole second before the other publishes anything, which is late by the horizon and never happens in flight."""


def output_topic(name: str) -> str:
    """Topic of a navigator's fused solution."""
    return fused_topics(name)[0]


COMPILES_S = 0.3


class Link:
    """Turns one navigator's solutions into messages, and messages into what the others are fed.

    Parameters
    ----------
    name : str
        Name of the navigator.
    navigator : Navigator
    rules : DecodeRules
        Shared by all links, so that the map origin is known wherever an odometry is decoded.

    Attributes
    ----------
    seconds : float
        Time the navigator has taken, s.
    """

    def __init__(self, name: str, navigator: Navigator, rules: DecodeRules) -> None:
        self.navigator = navigator
        self.topic, *_, self._health_topic = fused_topics(name)
        self.msgtype = topics.spec(self.topic).msgtype
        self.is_attitude = self.msgtype == topics.IMU
        self._room = self.topic.rpartition("/")[0]
        self._decoder = Decoder(rules)
        navigator.map_origins = rules.origins
        self._origin: Any = None
        self.seconds = 0.0

    def feed(self, measurements: Sequence[Measurement]) -> Solutions:
        """Feed the navigator, and note the time it takes; one that takes :data:`COMPILES_S` is the compiler's, of a first run."""
        start = perf_counter()
        solutions = self.navigator.feed(measurements[0]) if len(measurements) == 1 else self.navigator.feed_all(measurements)
        taken_s = perf_counter() - start
        self.seconds += taken_s if taken_s < COMPILES_S else 0.0
        return solutions

    def sends(self, wanted: Collection[str]) -> bool:
        """Whether any of ``wanted`` is a topic of its fused solution."""
        return not {self.topic, self._health_topic, f"{self._room}/wind_fused"}.isdisjoint(wanted)

    def message(self, solution: NavSolution) -> Any:
        """The fused message of a solution, as the live node would publish it; None while there is nothing to publish."""
        if self.is_attitude:
            return None if solution.q_nb is None else encode.imu_from_solution(solution)
        origin = self.navigator.origin
        if origin is None:
            return None
        if origin is not self._origin:
            self._origin = origin  # subscribers take it from the message, in degrees, which is not always the same last bit
            self._decoder.decode(f"{self._room}/origin", topics.NAV_SAT_FIX, to_cdr(encode.origin_fix(solution.stamp_ns, origin)))
        return encode.odometry_from_solution(solution, origin)

    def received(self, solution: NavSolution, message: Any, wanted: Collection[str]) -> Iterator[Measurement]:
        """What subscribers receive, decoded from bytes as in flight.

        Parameters
        ----------
        solution : NavSolution
        message : message object
            The fused message of the solution.
        wanted : collection of str
            Topics some navigator takes.
        """
        published = [(self.topic, self.msgtype, message)]
        if solution.health is not None:
            published.insert(0, (self._health_topic, topics.DIAGNOSTICS, encode.health_from(solution.health)))
        if not self.is_attitude:
            published.append((f"{self._room}/wind_fused", topics.TWIST, encode.wind_from_solution(solution)))
        for topic, msgtype, sent in published:
            if topic in wanted and sent is not None:
                measurement = self._decoder.decode(topic, msgtype, to_cdr(sent))
                if not isinstance(measurement, Rejected):
                    yield measurement


class Chain:
    """Navigators of which some take others' solutions, fed as one.

    Parameters
    ----------
    navigators : mapping of name to Navigator
    rules : DecodeRules, optional
    air_data : AirDataComputer, optional
        Where nothing else gives an airspeed, this makes it of the pressures.

    Attributes
    ----------
    links : dict of name to Link
        In the order in which they are fed, each after those whose solutions it takes.
    """

    def __init__(
        self,
        navigators: Mapping[str, Navigator],
        rules: DecodeRules | None = None,
        air_data: AirDataComputer | None = None,
    ) -> None:
        rules, self.air_data = rules or DecodeRules(), air_data
        self._decoder = Decoder(rules)
        self.links = {name: Link(name, navigators[name], rules) for name in in_order(navigators)}
        self._wanted = {source for link in self.links.values() for source in link.navigator.inputs}
        self._replaced = {topic for name in self.links for topic in fused_topics(name)}
        self._is_linked = not self._replaced.isdisjoint(self._wanted)
        self._sending = {name for name, link in self.links.items() if link.sends(self._wanted)}

    def takes(self, measurement: Measurement) -> bool:
        """Whether a measurement is fed at all: solutions of its own navigators it makes anew."""
        return measurement.source not in self._replaced

    def feed(self, measurement: Measurement) -> Iterator[tuple[str, NavSolution]]:
        """Feed one measurement to all that take its source; yield name and solution in order."""
        for piece in self._fed(measurement):
            yield from self._distribute(piece)

    def feed_all(self, measurements: Sequence[Measurement]) -> Iterator[tuple[str, NavSolution | Rows]]:
        """The same of many: where no navigator takes another's solution, each takes them at once, and gives rows as it makes them."""
        if self._is_linked:
            yield from (found for measurement in measurements for found in self.feed(measurement))
            return
        fed = [piece for measurement in measurements for piece in self._fed(measurement)]
        for name, link in self.links.items():
            taken = [piece for piece in fed if piece.source in link.navigator.inputs]
            yield from ((name, part) for part in (link.feed(taken).parts if taken else ()))

    def _fed(self, measurement: Measurement) -> Iterator[Measurement]:
        """What becomes of a measurement before it is fed, in order."""
        if self.takes(measurement):
            yield from _pieces(measurement) if self._is_linked else (measurement,)
            for velocity in () if self.air_data is None else self.air_data.feed(measurement):
                yield self._as_received(velocity)

    def _as_received(self, velocity: Measurement) -> Measurement:
        """What subscribers of the air data computer's node receive."""
        received = self._decoder.decode(velocity.source, topics.spec(velocity.source).msgtype, to_cdr(encode.encode(velocity)))
        return velocity if isinstance(received, Rejected) else received

    def fork(self) -> "Chain":
        """Return a copy that flies on from the present state on its own; settings and stations, which do not change, are shared.

        Nobody hears of the aids of the copy.
        """
        navigators = [link.navigator for link in self.links.values()]
        kept = [part for navigator in navigators for part in (*parts_of(navigator.settings), navigator.stations)]
        unheard = {id(n.on_aid): _unheard for n in navigators if n.on_aid is not None}
        return copy.deepcopy(self, {id(part): part for part in kept} | unheard)

    def _distribute(self, measurement: Measurement) -> Iterator[tuple[str, NavSolution]]:
        for name, link in self.links.items():
            if measurement.source in link.navigator.inputs:
                for solution in link.feed((measurement,)):
                    message = link.message(solution) if name in self._sending else None
                    yield name, solution
                    if message is not None:
                        for published in link.received(solution, message, self._wanted):
                            yield from self._distribute(published)


def _unheard(status: AidStatus) -> None:
    """Observer of the aids of a copy."""


def _pieces(measurement: Measurement) -> Iterator[Measurement]:
    """Inertial blocks in pieces of :data:`LONGEST_BURST_NS`, on multiples of it; anything else as it is."""
    if not isinstance(measurement, ImuBlock) or measurement.stamp_ns - measurement.stamps_ns[0] < LONGEST_BURST_NS:
        yield measurement
        return
    cuts = np.flatnonzero(np.diff(measurement.stamps_ns // LONGEST_BURST_NS)) + 1
    for first, last in itertools.pairwise([0, *cuts.tolist(), len(measurement)]):
        yield measurement[first:last]


def in_order(navigators: Mapping[str, Navigator]) -> list[str]:
    """Names so that each comes after those whose solutions it takes."""
    waiting: list[str] = list(navigators)
    done: list[str] = []
    while waiting:
        taken = {n: [w for w in waiting if w != n and any(t in navigators[n].inputs for t in fused_topics(w))] for n in waiting}
        free = [n for n in waiting if not taken[n]] or waiting[:1]  # a circle cannot be ordered; the horizon of each still sorts by stamp
        done += free
        waiting = [n for n in waiting if n not in free]
    return done
