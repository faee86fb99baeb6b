"""The flight of the fault study: simulated once a seed, flown by the chain of navigators as often as there are faults."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.building import complete_settings, make_navigator
from lowcostnav_ros.catalogue.navigator_topics import fused_topics
from lowcostnav_ros.messages.decode import Decoder, DecodeRules, Rejected
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.metrics import Errors
from lowcostnav_ros.replay.session import Session, simulated
from lowcostnav_ros.simulation.fault import Arrived, Fault, arrivals, inject, without_gps
from lowcostnav_ros.simulation.scenario import Scenario, load_scenario
from lowcostnav_ros.simulation.simulator import Simulation

SCENARIO = "faults"
POLL_S = 0.5
"""What the navigators say of themselves is noted this often."""

IMU = {"imu.profile": "automotive"}
CHAIN: dict[str, tuple[str, dict[str, Any]]] = {
    "ahrs": ("ahrs", IMU),
    "ins_gps": ("ins_gps", IMU),
    "dead_reckoning": ("dead_reckoning", {}),
    "supervisor": ("supervisor", {}),
    "ins_gnss": ("ins_gnss", IMU),
    "gnss_only": ("gnss_only", {}),
    "ins_gnss_loose": ("ins_gnss", {**IMU, "coupling": "loose"}),
}
"""Navigators flown: name in the results, name in the registry, settings that are not the default."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """One flight: the truth, and everything that arrives, in order."""

    truth: tuple[TruthBlock, ...]
    arrived: tuple[Arrived, ...]

    @property
    def start_ns(self) -> int:
        """Arrival of the first measurement; seconds of the flight count from here."""
        return self.arrived[0].at_ns

    @property
    def end_ns(self) -> int:
        """Arrival of the last."""
        return self.arrived[-1].at_ns


def scenario(seed: int) -> Scenario:
    """The scenario that is flown."""
    return load_scenario(SCENARIO, seed)


@cache
def flight(seed: int) -> Flight:
    """Fly a seed, once a process."""
    items = list(simulated(Simulation(scenario(seed)).blocks()))
    truth = tuple(item for item in items if isinstance(item, TruthBlock))
    return Flight(truth, tuple(arrivals(item for item in items if not isinstance(item, TruthBlock))))


def navigator(name: str) -> Navigator:
    """A fresh navigator of the chain."""
    kind, values = CHAIN[name]
    cls: Any = NAVIGATORS[kind]
    return make_navigator(complete_settings(cls.Settings, values, name), cls)


@cache
def suppliers(name: str) -> frozenset[str]:
    """Navigators of the chain whose solutions one of them takes, directly or not, itself included."""
    inputs = navigator(name).inputs
    direct = [other for other in CHAIN if other != name and any(topic in inputs for topic in fused_topics(other))]
    return frozenset({name}.union(*(suppliers(other) for other in direct)))


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


class Wire:
    """Takes changed measurements over the wire: what a decoder refuses reaches no navigator, and is counted by name."""

    def __init__(self) -> None:
        self.decoder = Decoder(DecodeRules())

    def passed(self, measurement: Measurement) -> Iterator[Measurement]:
        """What the navigators get of a measurement."""
        for _, source, msgtype, raw in encode_cdr(measurement):
            received = self.decoder.decode(source, msgtype, raw)
            if not isinstance(received, Rejected):
                yield received


@dataclass(frozen=True, slots=True)
class Aboard:
    """Fresh navigators by their names in the results, and the sessions that feed them."""

    navigators: dict[str, Navigator]
    sessions: list[Session]

    @classmethod
    def of(cls, names: Collection[str]) -> "Aboard":
        """Make navigators; those that publish under one name are fed in sessions of their own."""
        navigators = {name: navigator(name) for name in names}
        groups: list[dict[str, Navigator]] = [{}, {}]
        for name, made in navigators.items():
            groups[name != CHAIN[name][0]][CHAIN[name][0]] = made
        return cls(navigators, [Session(group, has_truth=True) for group in groups if group])

    def on_errors(self, name: str, listener: Callable[[Errors], None]) -> None:
        """Have the errors of a navigator handed over as they are formed."""
        for session in self.sessions:
            for run in session.runs.values():
                if run.navigator is self.navigators[name]:
                    run.evaluation.listeners.append(listener)


def fly(arrived: Collection[Arrived], sound: Flight, aboard: Aboard, wire: Wire, each_poll: Callable[[int], None]) -> None:
    """Feed what arrives to navigators.

    Parameters
    ----------
    arrived : collection of Arrived
        In order; what is not of the sound flight goes over the wire.
    sound : Flight
    aboard : Aboard
    wire : Wire
    each_poll : callable
        Called every :data:`POLL_S` with the time, ns.
    """
    untouched = {id(a.measurement) for a in sound.arrived}
    truth, next_ns = iter(sound.truth), sound.start_ns
    block = next(truth, None)
    for a in arrived:
        while block is not None and block.stamps_ns[0] <= a.at_ns:
            for session in aboard.sessions:
                session.feed_truth(block)
            block = next(truth, None)
        while next_ns <= a.at_ns:
            each_poll(next_ns)
            next_ns += round(1e9 * POLL_S)
        for measurement in (a.measurement,) if id(a.measurement) in untouched else wire.passed(a.measurement):
            for session in aboard.sessions:
                session.feed(measurement)
    each_poll(next_ns)
    for session in aboard.sessions:
        session.flush()


def faulty(seed: int, fault: Fault | None, outage: bool) -> list[Arrived]:
    """What arrives on the flight of a seed with a fault; the reference without one."""
    sound = flight(seed)
    if fault is not None:
        return inject(sound.arrived, fault, seed)
    return without_gps(sound.arrived) if outage else list(sound.arrived)
