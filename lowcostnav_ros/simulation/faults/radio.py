"""Faults of radio navigation: the wrong station, the wrong end of the radial, another north."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lowcostnav_ros.base.measurements import Measurement, SlantRange, VorBearing
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.simulation.fault import Arrived, Change, Fault, Window, each, enter

DECLINATION = 13.0 * DEGREE


def wrong_station(window: Window) -> Iterator[Arrived]:
    """Each reply under the name of another station that was asked; under a foreign one where there is but one."""
    names = sorted({a.measurement.part for a in window.arrived})
    other = dict(zip(names, [*names[1:], names[0]], strict=True)) if len(names) > 1 else dict.fromkeys(names, "LOC")
    for a in window.arrived:
        assert isinstance(a.measurement, SlantRange | VorBearing)
        yield Arrived(a.at_ns, replace(a.measurement, station=other[a.measurement.station]))


def radial(by: float, sign: float = 1.0) -> Change:
    """Radials counted from elsewhere."""

    def change(m: Measurement, t_s: float) -> Measurement:
        return replace(m, bearing_rad=float(np.mod(sign * m.bearing_rad + by, 2.0 * np.pi))) if isinstance(m, VorBearing) else m

    return each(change)


enter(__name__, Fault("dme_wrong_station", "an interrogator locked to the wrong station", ("dme/range",), wrong_station), outage=True)
enter(__name__, Fault("vor_wrong_station", "a receiver tuned to the wrong station", ("vor/bearing",), wrong_station), outage=True)
for _name, _imitates, _by, _sign in (
    ("plus_90", "a receiver set up a quarter turn off", 90.0 * DEGREE, 1.0),
    ("to_for_from", "bearing to the station for the radial", np.pi, 1.0),
    ("true_north", "radials counted from true north", DECLINATION, 1.0),
    ("counterclockwise", "radials counted counterclockwise", 0.0, -1.0),
):
    enter(__name__, Fault(f"vor_{_name}", _imitates, ("vor/bearing",), radial(_by, _sign)), outage=True)
