"""Faults of axes and references: half a conversion, a box mounted sideways, a height above the sea."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import GpsPosition, Measurement
from lowcostnav_ros.base.units import FOOT
from lowcostnav_ros.simulation.fault import Change, Fault, each, enter
from lowcostnav_ros.simulation.faults._sensors import SENSORS, Quantity

Vectors = Callable[[np.ndarray], np.ndarray]

_C, _S = np.cos(np.radians(10.0)), np.sin(np.radians(10.0))
_ABOUT_Z_10 = np.array([[_C, -_S, 0.0], [_S, _C, 0.0], [0.0, 0.0, 1.0]])

TURNS: dict[str, tuple[str, Vectors]] = {
    "ned_for_enu": ("axes half converted: first two exchanged, third turned over", lambda v: v[..., [1, 0, 2]] * (1.0, 1.0, -1.0)),
    "frd_for_flu": ("forward-right-down where forward-left-up is meant", lambda v: v * (1.0, -1.0, -1.0)),
    "turned_90": ("a box mounted sideways", lambda v: v[..., [1, 0, 2]] * (-1.0, 1.0, 1.0)),
    "turned_10": ("a box mounted askew, 10 degrees about the vertical", lambda v: v @ _ABOUT_Z_10.T),
}


def turned(quantities: tuple[Quantity, ...], how: Vectors) -> Change:
    """All vectors of a sensor in other axes."""

    def change(m: Measurement, t_s: float) -> Measurement:
        for quantity in quantities:
            m = quantity.changed(lambda v, t_s: how(v))(m, t_s)
        return m

    return each(change)


def place(how: Callable[[GpsPosition], dict[str, Any]]) -> Change:
    """A fix with other coordinates."""
    return each(lambda m, t_s: replace(m, **how(m)) if isinstance(m, GpsPosition) else m)


for _name, _turns in {
    "imu": ("ned_for_enu", "frd_for_flu", "turned_90", "turned_10"),
    "mag": ("ned_for_enu", "frd_for_flu", "turned_90", "turned_10"),
    "gps_vel": ("ned_for_enu", "turned_90", "turned_10"),
}.items():
    for _turn in _turns:
        _imitates, _how = TURNS[_turn]
        _sensor = SENSORS[_name]
        enter(
            __name__,
            Fault(f"{_name}_{_turn}", _imitates, _sensor.sources, turned(_sensor.quantities, _how)),
            outage=_sensor.outage and _turn != "turned_10",
        )
        if _turn != "turned_10":  # as a wrong driver has it: from the beginning
            enter(__name__, Fault(f"{_name}_{_turn}_always", _imitates, _sensor.sources, turned(_sensor.quantities, _how), 0.0, 1e6))

for _name, _imitates, _place in (
    ("height_in_feet", "a driver that publishes feet", lambda fix: {"height": fix.height / FOOT}),
    ("height_above_sea", "height above the sea for that above the ellipsoid", lambda fix: {"height": fix.height + 32.5}),
    ("lat_lon_exchanged", "latitude and longitude exchanged", lambda fix: {"lat": fix.lon, "lon": fix.lat}),
    ("lon_sign", "west taken for east", lambda fix: {"lon": -fix.lon}),
    ("old_datum", "coordinates of a map of 1927", lambda fix: {"lat": fix.lat + 1.1e-6, "lon": fix.lon + 1.65e-5}),
):
    enter(__name__, Fault(f"gps_fix_{_name}", _imitates, ("gps/fix",), place(_place)))
