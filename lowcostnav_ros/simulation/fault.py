"""Faults of sensors as values: a fault changes what arrives from some sources within a window of a flight, and nothing else.

Faults act on measurements as they arrive, so that the same fault flies in memory, is written into a recording and is played live.  Each is
registered where it is defined, in a module of :mod:`lowcostnav_ros.simulation.faults`.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.registry import Registry
from lowcostnav_ros.base.seeds import stream

START_S, END_S = 80.0, 140.0
"""A fault begins and ends this long after the first measurement, s, unless it says otherwise: a climb, level flight, a turn."""

OUTAGE_S = (70.0, 180.0)
"""When GPS is lost, for faults that are injected into an outage, s."""

GPS = ("gps/fix", "gps/vel", "gnss/raw")
"""Sources that are silent in an outage."""


@dataclass(frozen=True, slots=True)
class Arrived:
    """A measurement and when it arrived (ns, in the time of the flight, whatever its stamp says)."""

    at_ns: int
    measurement: Measurement


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """What a fault is given: what arrives from its sources within the window, and what surrounds it.

    Attributes
    ----------
    start_ns, end_ns : int
        Arrival times; the window is open at the end.
    arrived : tuple of Arrived
        From the sources of the fault, in order of arrival.
    flight : sequence of Arrived
        Everything that arrives on the flight, without the fault.
    rng : numpy Generator
        Of the fault and the seed.
    """

    start_ns: int
    end_ns: int
    arrived: tuple[Arrived, ...]
    flight: Sequence[Arrived]
    rng: np.random.Generator

    def since_s(self, arrived: Arrived) -> float:
        """Seconds since the start of the fault."""
        return 1e-9 * (arrived.at_ns - self.start_ns)

    def of(self, source: str) -> list[Measurement]:
        """The measurements of one source within the window, in order."""
        return [a.measurement for a in self.flight if a.measurement.source == source and self.start_ns <= a.at_ns < self.end_ns]


Change = Callable[[Window], Iterable[Arrived]]
"""What arrives instead; in any order."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    Attributes
    ----------
    name : str
        ``<sensor>_<what is wrong>``, with ``_in_outage`` where GPS is lost about it.
    imitates : str
        What in the world does this, in a few words.
    sources : tuple of str
        Topics it falsifies.
    change : callable
        What becomes of what arrives within the window.
    start_s, end_s : float
        Window, seconds after the first arrival.
    outage : bool
        GPS is silent for :data:`OUTAGE_S` as well.
    clock_s : float
        What all clocks are set by within the window, s: a solution with a stamp of theirs is of the moment at which they showed it.
    """

    name: str
    imitates: str
    sources: tuple[str, ...]
    change: Change
    start_s: float = START_S
    end_s: float = END_S
    outage: bool = False
    clock_s: float = 0.0


FAULTS: Registry[Fault] = Registry("fault", "lowcostnav_ros.simulation.faults", many=True)

IN_OUTAGE = "_in_outage"
NOTHING = "nothing"
"""Name of the fault that changes nothing."""


def enter(origin: str, fault: Fault, *, outage: bool = False) -> None:
    """Register a fault; with ``outage`` a second time with GPS lost about it.

    Raises
    ------
    RegistryError
        When another module has entered one of this name.
    """
    FAULTS.register(fault.name, fault, origin)
    if outage:
        lost = replace(fault, name=fault.name + IN_OUTAGE, outage=True)
        FAULTS.register(lost.name, lost, origin)


def each(change: Callable[[Measurement, float], Measurement]) -> Change:
    """Make a change of a function of one measurement and the seconds since the start of the fault."""

    def changed(window: Window) -> Iterator[Arrived]:
        return (Arrived(a.at_ns, change(a.measurement, window.since_s(a))) for a in window.arrived)

    return changed


def arrivals(measurements: Iterable[Measurement]) -> list[Arrived]:
    """Give measurements in order of arrival their arrival times: the newest stamp so far."""
    kept = list(measurements)
    times = accumulate((m.stamp_ns for m in kept), max)
    return [Arrived(at, m) for at, m in zip(times, kept, strict=True)]


def inject(flight: Sequence[Arrived], fault: Fault, seed: int = 1) -> list[Arrived]:
    """Return what arrives on a flight with a fault, in order of arrival.

    Parameters
    ----------
    flight : sequence of Arrived
        In order; it is not changed.
    fault : Fault
    seed : int
        Of what the fault draws.
    """
    begin_ns = flight[0].at_ns
    sound = without_gps(flight) if fault.outage else flight
    start_ns, end_ns = (begin_ns + round(1e9 * s) for s in (fault.start_s, fault.end_s))

    def hit(arrived: Arrived) -> bool:
        return arrived.measurement.source in fault.sources and start_ns <= arrived.at_ns < end_ns

    rng = stream(seed, fault.name.removesuffix(IN_OUTAGE))
    window = Window(start_ns, end_ns, tuple(a for a in sound if hit(a)), sound, rng)
    out = [*(a for a in sound if not hit(a)), *fault.change(window)]
    return sorted(out, key=lambda a: a.at_ns)


def without_gps(flight: Sequence[Arrived]) -> list[Arrived]:
    """Take GPS away for :data:`OUTAGE_S`."""
    start_ns, end_ns = (flight[0].at_ns + round(1e9 * s) for s in OUTAGE_S)
    return [a for a in flight if a.measurement.source not in GPS or not start_ns <= a.at_ns < end_ns]
