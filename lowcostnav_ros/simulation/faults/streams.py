"""Faults of any stream: values or messages that hang, are lost, doubled, held up or exchanged."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.simulation.fault import NOTHING, Arrived, Change, Fault, Window, enter
from lowcostnav_ros.simulation.faults._sensors import ALL, SENSORS, Sensor

LOST_SHARE = 0.3
BURST_S = 2.0
SHUFFLED_S = 0.3


def again(held: Measurement, like: Measurement) -> Measurement:
    """A measurement repeated with the stamps of another."""
    if isinstance(held, ImuBlock) and isinstance(like, ImuBlock):
        first = [0] * len(like)
        return replace(like, specific_force_b=held.specific_force_b[first], angular_rate_b=held.angular_rate_b[first])
    return replace(held, stamp_ns=like.stamp_ns)


def _key(measurement: Measurement) -> tuple[str, str]:
    return measurement.source, measurement.part


def stuck(window: Window) -> Iterator[Arrived]:
    """The first value of each source (and station), with new stamps."""
    held: dict[tuple[str, str], Measurement] = {}
    for a in window.arrived:
        yield Arrived(a.at_ns, again(held.setdefault(_key(a.measurement), a.measurement), a.measurement))


def frozen(window: Window) -> Iterator[Arrived]:
    """The first message of each source again and again, stamp and all."""
    held: dict[tuple[str, str], Measurement] = {}
    return (Arrived(a.at_ns, held.setdefault(_key(a.measurement), a.measurement)) for a in window.arrived)


def dropped(window: Window) -> Iterator[Arrived]:
    """Nothing."""
    return iter(())


def thinned(window: Window) -> Iterator[Arrived]:
    """What is left when a share of the messages is lost, sample by sample."""
    for a in window.arrived:
        if isinstance(a.measurement, ImuBlock):
            left = a.measurement[window.rng.random(len(a.measurement)) >= LOST_SHARE]
            if len(left):
                yield Arrived(a.at_ns, left)
        elif window.rng.random() >= LOST_SHARE:
            yield a


def repeated(window: Window) -> Iterator[Arrived]:
    """Every message twice."""
    return (a for a in window.arrived for _ in range(2))


def reordered(window: Window) -> Iterator[Arrived]:
    """Messages held up by anything up to 0.3 s, so that they overtake each other."""
    return (replace(a, at_ns=a.at_ns + int(1e9 * SHUFFLED_S * window.rng.random())) for a in window.arrived)


def burst(window: Window) -> Iterator[Arrived]:
    """Messages held back and handed over together, every 2 s."""
    step = round(1e9 * BURST_S)
    return (replace(a, at_ns=window.start_ns + ((a.at_ns - window.start_ns) // step + 1) * step) for a in window.arrived)


def stepping(window: Window) -> Iterator[Arrived]:
    """Each value given for two messages: a driver that is read twice as fast as the sensor measures."""
    by_source: dict[tuple[str, str], list[Arrived]] = {}
    for a in window.arrived:
        by_source.setdefault(_key(a.measurement), []).append(a)
    for arrived in by_source.values():
        yield arrived[0]
        for count, (before, a) in enumerate(pairwise(arrived)):
            yield a if count % 2 else Arrived(a.at_ns, again(before.measurement, a.measurement))


KINDS: dict[str, tuple[str, Change]] = {
    "stuck": ("a receiver or converter that hangs while the driver goes on", stuck),
    "frozen": ("a driver that sends its last message for ever", frozen),
    "dropped": ("a plug that comes off", dropped),
    "thinned": ("a bad contact: 30 % of the messages are lost", thinned),
    "repeated": ("a network that delivers twice", repeated),
    "reordered": ("a network that delivers out of order, up to 0.3 s late", reordered),
    "burst": ("a buffer that is emptied every 2 s", burst),
    "stepping": ("a driver that is read twice as fast as the sensor measures", stepping),
}


def _enter(sensor: Sensor) -> None:
    for name, (imitates, change) in KINDS.items():
        enter(
            __name__,
            Fault(f"{sensor.name}_{name}", imitates, sensor.sources, change),
            outage=sensor.outage and name in ("stuck", "dropped"),
        )


for _sensor in SENSORS.values():
    _enter(_sensor)
enter(__name__, Fault(NOTHING, "a healthy flight: nothing may be reported", ALL, lambda window: window.arrived), outage=True)
