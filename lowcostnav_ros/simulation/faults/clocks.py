"""Faults of clocks: stamps of a wrong second, hour or epoch, a clock that drifts, a delay that nobody declared, one odd stamp."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.simulation.fault import Arrived, Change, Fault, Window, each, enter
from lowcostnav_ros.simulation.faults._sensors import ALL, SENSORS

OFFSETS_S = {
    "plus_1_s": (1.0, "stamps of the next second"),
    "minus_1_s": (-1.0, "stamps of the second before"),
    "plus_18_s": (18.0, "GPS time for UTC"),
    "minus_18_s": (-18.0, "leap seconds taken off twice"),
    "plus_1_h": (3600.0, "summer time"),
    "minus_1_h": (-3600.0, "summer time taken off twice"),
    "minus_1024_weeks": (-1024.0 * 604800.0, "the week number rolled over"),
}
DRIFT_PPM = 100.0
DELAY_S = 0.3
ODD_S = {"half_a_second_ahead": 0.5, "9_s_ahead": 9.0, "9_s_behind": -9.0, "a_day_ahead": 86400.0}

ENOUGH = ("plus_1_s", "minus_18_s", "plus_1_h", "minus_1024_weeks", "9_s_ahead", "a_day_ahead")
"""Those that are injected into sensors other than the IMU and the receiver."""


def restamped(measurement: Measurement, by_ns: Callable[[int], int]) -> Measurement:
    """A measurement with later stamps."""
    if isinstance(measurement, ImuBlock):
        stamps = measurement.stamps_ns + by_ns(measurement.stamp_ns)
        return replace(measurement, stamp_ns=int(stamps[-1]), stamps_ns=stamps)
    return replace(measurement, stamp_ns=measurement.stamp_ns + by_ns(measurement.stamp_ns))


def offset(by_s: float) -> Change:
    """A clock that is wrong by a constant."""
    return each(lambda m, t_s: restamped(m, lambda _: round(1e9 * by_s)))


def drift(ppm: float) -> Change:
    """A clock that runs fast."""
    return each(lambda m, t_s: restamped(m, lambda _: round(1e3 * ppm * t_s)))


def delayed(by_s: float, window: Window) -> Iterator[Arrived]:
    """Messages that come late and are stamped when they come."""
    by_ns = round(1e9 * by_s)
    return (Arrived(a.at_ns + by_ns, restamped(a.measurement, lambda _: by_ns)) for a in window.arrived)


def odd(by_s: float, window: Window) -> Iterator[Arrived]:
    """One message with a wrong stamp."""
    for k, a in enumerate(window.arrived):
        yield a if k else Arrived(a.at_ns, restamped(a.measurement, lambda _: round(1e9 * by_s)))


for _sensor in SENSORS.values():
    if _sensor.name in ("gps_fix", "gps_vel"):  # one receiver, one clock
        continue
    _head, _sources = _sensor.name, _sensor.sources
    for _name, (_by_s, _imitates) in OFFSETS_S.items():
        if _head in ("imu", "gps") or _name in ENOUGH:
            enter(__name__, Fault(f"{_head}_clock_{_name}", _imitates, _sources, offset(_by_s)))
    enter(__name__, Fault(f"{_head}_clock_drift", "a quartz that runs 100 ppm fast", _sources, drift(DRIFT_PPM), 0.0, 1e6))
    enter(__name__, Fault(f"{_head}_late", "0.3 s of undeclared latency", _sources, partial(delayed, DELAY_S)))
    for _name, _by_s in ODD_S.items():
        if _head == "imu" or _name in ENOUGH:
            enter(__name__, Fault(f"{_head}_stamp_{_name}", "one wrong stamp", _sources, partial(odd, _by_s)), outage=_sensor.outage)

for _name, _by_s in (("plus_3_s", 3.0), ("minus_3_s", -3.0)):
    enter(__name__, Fault(f"all_clocks_{_name}", "the clock of the computer is set", ALL, offset(_by_s), clock_s=_by_s))
