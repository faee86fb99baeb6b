"""The flight of the fault study: simulated once a seed, flown by the chain of navigators as often as there are faults."""

from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.building import complete_settings, is_of_node, make_navigator
from lowcostnav_ros.catalogue.config_files import config_dir, read_parameters
from lowcostnav_ros.catalogue.navigator_topics import fused_topics
from lowcostnav_ros.messages.decode import Decoder, DecodeRules, Rejected
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.session import Session, simulated
from lowcostnav_ros.simulation.fault import START_S, Arrived, Fault, arrivals, inject, without_gps
from lowcostnav_ros.simulation.scenario import Scenario, load_scenario
from lowcostnav_ros.simulation.simulator import Simulation
from lowcostnav_ros.studies.faults.record import Record

SCENARIO = "faults"
POLL_S = 0.5
"""What the navigators say of themselves is noted this often."""

BEHIND_NS, AHEAD_NS = 550_000_000, 400_000_000
"""A solution is of a moment this far behind or ahead of what has arrived: fusion lags, and what is carried on may lead."""

IMU = {"imu.profile": "automotive"}
CHAIN: dict[str, tuple[str, dict[str, Any]]] = {
    "ahrs": ("ahrs", IMU),
    "ins_gps": ("ins_gps", IMU),
    "dead_reckoning": ("dead_reckoning", {"vor.enabled": True}),
    "supervisor": ("supervisor", {}),
    "ins_gnss": ("ins_gnss", IMU),
    "gnss_only": ("gnss_only", {}),
    "ins_gnss_loose": ("ins_gnss", {**IMU, "coupling": "loose"}),
}
"""Navigators flown: name in the results, name in the registry, settings that are not those of the package."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """One flight: the truth, everything that arrives, in order, and the identities of those measurements."""

    truth: tuple[TruthBlock, ...]
    arrived: tuple[Arrived, ...]
    ids: frozenset[int]

    @property
    def start_ns(self) -> int:
        """Arrival of the first measurement; seconds of the flight count from here."""
        return self.arrived[0].at_ns


def scenario(seed: int) -> Scenario:
    """The scenario that is flown."""
    return load_scenario(SCENARIO, seed)


@cache
def flight(seed: int) -> Flight:
    """Fly a seed, once a process."""
    items = list(simulated(Simulation(scenario(seed)).blocks()))
    truth = tuple(item for item in items if isinstance(item, TruthBlock))
    arrived = tuple(arrivals(item for item in items if not isinstance(item, TruthBlock)))
    return Flight(truth, arrived, frozenset(id(a.measurement) for a in arrived))


def navigator(name: str) -> Navigator:
    """A fresh navigator of the chain, as the package configures it."""
    kind, own = CHAIN[name]
    cls: Any = NAVIGATORS[kind]
    values = {key: value for key, value in read_parameters(config_dir() / f"{kind}.yaml", kind).items() if not is_of_node(key)}
    return make_navigator(complete_settings(cls.Settings, values | own, name), cls)


@cache
def suppliers(name: str) -> tuple[str, ...]:
    """Navigators of the chain whose solutions one of them takes, directly or not, itself first."""
    inputs = navigator(name).inputs
    direct = [other for other in CHAIN if other != name and any(topic in inputs for topic in fused_topics(other))]
    return tuple(dict.fromkeys([name, *(supplier for other in direct for supplier in suppliers(other))]))


def concerned(sources: Collection[str]) -> list[str]:
    """Navigators that some of the sources reach, directly or through others."""
    return [name for name in CHAIN if any(source in _used(supplier) for supplier in suppliers(name) for source in sources)]


@cache
def _used(name: str) -> frozenset[str]:
    """Sources that a navigator does more with than to hear them."""
    made = navigator(name)
    return frozenset({*made.own_inputs(), *made.required_sources(), *(aid.source for aid in made.aids)})


def crew(names: Collection[str]) -> list[str]:
    """The navigators that must fly so that these do."""
    return [name for name in CHAIN if any(name in suppliers(wanted) for wanted in names)]


class Pass:
    """One pass of a flight through fresh navigators, with everything noted.

    Parameters
    ----------
    sound : Flight
    names : collection of str
        Of the chain.  Those that publish under one name are fed in sessions of their own.

    Attributes
    ----------
    records : dict of str to Record
        By the names of the chain.
    refused_s : dict of str to float
        What the wire refused, and when in the flight it first did.
    fault : Fault or None
        What is wrong on this flight.
    """

    fault: Fault | None = None

    def __init__(self, sound: Flight, names: Collection[str]) -> None:
        self._navigators = {name: navigator(name) for name in names}
        self.records = {name: Record(sound.start_ns) for name in names}
        self.refused_s: dict[str, float] = {}
        self._start_ns = self._next_ns = self._now_ns = sound.start_ns
        self._decoder = Decoder(DecodeRules())
        self._blocks = 0
        groups: list[dict[str, str]] = [{}, {}]
        for name in names:
            groups[name != CHAIN[name][0]][CHAIN[name][0]] = name
        self._sessions = []
        for group in filter(None, groups):
            session = Session({kind: self._navigators[name] for kind, name in group.items()}, has_truth=True)
            for kind, name in group.items():
                session.runs[kind].evaluation.listeners.append(self.records[name].add)
                session.runs[kind].meant = self._meant
            self._sessions.append(session)

    def feed(self, arrived: Iterable[Arrived], sound: Flight) -> "Pass":
        """Feed what arrives, in order; what is not of the sound flight goes over the wire."""
        for a in arrived:
            while self._blocks < len(sound.truth) and sound.truth[self._blocks].stamps_ns[0] <= a.at_ns:
                for session in self._sessions:
                    session.feed_truth(sound.truth[self._blocks])
                self._blocks += 1
            self._now_ns = a.at_ns
            while self._next_ns <= a.at_ns:
                self._poll()
            for measurement in (a.measurement,) if id(a.measurement) in sound.ids else self._over_the_wire(a.measurement):
                for session in self._sessions:
                    session.feed(measurement)
        return self

    def _meant(self, solution: NavSolution) -> NavSolution | None:
        """A solution at the time that it means: where a clock is set, that at which it shows its stamp about now, None if it never does."""
        by_ns = 0 if self.fault is None else round(1e9 * self.fault.clock_s)
        if not by_ns:
            return solution
        times = [t for t in (solution.stamp_ns, solution.stamp_ns - by_ns) if -BEHIND_NS <= t - self._now_ns <= AHEAD_NS]
        return replace(solution, stamp_ns=times[0]) if times else None

    def finish(self) -> "Pass":
        """End the pass."""
        self._poll()
        for session in self._sessions:
            session.flush()
        return self

    def _poll(self) -> None:
        """Note what the navigators say of themselves."""
        for name, record in self.records.items():
            record.poll(self._next_ns, self._navigators[name])
        for source, reason in self._decoder.rejected:
            self.refused_s.setdefault(f"{source}: {reason}", 1e-9 * (self._next_ns - self._start_ns))
        self._next_ns += round(1e9 * POLL_S)

    def _over_the_wire(self, measurement: Measurement) -> Iterator[Measurement]:
        """What subscribers receive of a measurement: nothing of what a decoder refuses."""
        for _, source, msgtype, raw in encode_cdr(measurement):
            received = self._decoder.decode(source, msgtype, raw)
            if not isinstance(received, Rejected):
                yield received


def flown(seed: int, fault: Fault | None, outage: bool, names: Collection[str]) -> Pass:
    """Fly a seed with a fault, or without one; what comes before the fault is flown once a process and copied."""
    sound = flight(seed)
    arrived = inject(sound.arrived, fault, seed) if fault else without_gps(sound.arrived) if outage else sound.arrived
    if fault is None or fault.start_s < START_S:
        made = Pass(sound, names)
    else:
        first = bisect_left(arrived, sound.start_ns + round(1e9 * START_S), key=lambda a: a.at_ns)
        arrived, made = arrived[first:], deepcopy(_before_the_fault(seed, outage, tuple(names)))
    made.fault = fault
    return made.feed(arrived, sound).finish()


@cache
def _before_the_fault(seed: int, outage: bool, names: tuple[str, ...]) -> Pass:
    sound = flight(seed)
    arrived = without_gps(sound.arrived) if outage else sound.arrived
    return Pass(sound, names).feed((a for a in arrived if a.at_ns < sound.start_ns + round(1e9 * START_S)), sound)
