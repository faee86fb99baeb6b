"""Faults of pitot and static port: slow icing, blockage in climb, cruise and descent."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lowcostnav_ros.base.measurements import AirVelocity, Measurement, Pressure
from lowcostnav_ros.simulation.fault import Arrived, Change, Fault, Window, each, enter
from lowcostnav_ros.simulation.faults._sensors import SENSORS

DENSITY = 1.1
"""Of the air at the heights of these flights, kg/m^3; it only shapes the fault."""

PHASES = {"climb": (58.0, 115.0), "cruise": (110.0, 165.0), "descent": (165.0, 222.0)}
"""Seconds of the flight of :mod:`lowcostnav_ros.studies.faults`."""


def _airspeed(measurement: AirVelocity, speed: float) -> AirVelocity:
    return replace(measurement, vel_b=np.array([speed, *measurement.vel_b[1:]]))


def iced(over_s: float) -> Change:
    """The airspeed goes slowly to zero as ice closes the pitot, its drain open."""

    def change(m: Measurement, t_s: float) -> Measurement:
        return _airspeed(m, float(m.vel_b[0]) * np.sqrt(max(0.0, 1.0 - t_s / over_s))) if isinstance(m, AirVelocity) else m

    return each(change)


def emptied(m: Measurement, t_s: float) -> Measurement:
    """The pitot blocked, its drain open: no dynamic pressure at all."""
    return _airspeed(m, 0.0) if isinstance(m, AirVelocity) else m


def trapped(window: Window) -> Iterator[Arrived]:
    """Pitot and drain blocked: the total pressure is that of the moment, so the airspeed reads as an altimeter does."""
    static = window.of("air/static_pressure")
    stamps, pressures = np.array([m.stamp_ns for m in static]), np.array([m.pressure_pa for m in static if isinstance(m, Pressure)])
    total = None
    for a in window.arrived:
        if not isinstance(a.measurement, AirVelocity) or not len(stamps):
            yield a
            continue
        pressure = float(np.interp(a.measurement.stamp_ns, stamps, pressures))
        total = pressure + 0.5 * DENSITY * a.measurement.vel_b[0] ** 2 if total is None else total
        yield Arrived(a.at_ns, _airspeed(a.measurement, float(np.sqrt(max(0.0, 2.0 * (total - pressure) / DENSITY)))))


def static_blocked(window: Window) -> Iterator[Arrived]:
    """The static port blocked: the pressure stays, and the airspeed errs by what it would have changed."""
    held: Pressure | None = None
    now = 0.0
    for a in window.arrived:
        m = a.measurement
        if isinstance(m, Pressure):
            held, now = held or m, m.pressure_pa
            yield Arrived(a.at_ns, replace(m, pressure_pa=held.pressure_pa))
        elif isinstance(m, AirVelocity) and held is not None:
            dynamic = 0.5 * DENSITY * m.vel_b[0] ** 2 + now - held.pressure_pa
            yield Arrived(a.at_ns, _airspeed(m, float(np.sqrt(max(0.0, 2.0 * dynamic / DENSITY)))))
        else:
            yield a


_AIR, _STATIC = SENSORS["air"].sources, SENSORS["static"].sources
for _phase, (_from_s, _to_s) in PHASES.items():
    enter(__name__, Fault(f"pitot_blocked_in_{_phase}", "pitot and drain blocked", _AIR, trapped, _from_s, _to_s), outage=True)
    enter(
        __name__, Fault(f"pitot_iced_in_{_phase}", "ice that closes the pitot within 40 s", _AIR, iced(40.0), _from_s, _to_s), outage=True
    )
enter(__name__, Fault("pitot_emptied", "a cover on the pitot, or an insect", _AIR, each(emptied)), outage=True)
enter(__name__, Fault("static_port_blocked", "a taped static port", _AIR + _STATIC, static_blocked, *PHASES["climb"]), outage=True)
