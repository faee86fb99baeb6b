"""What the sensors measure, and how large a wrong value of each plausibly is: the parameters of the faults that many sensors share."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import (
    AirVelocity,
    GnssEpoch,
    GpsPosition,
    GpsVelocity,
    ImuBlock,
    MagneticField,
    Measurement,
    Pressure,
    SlantRange,
    VorBearing,
)
from lowcostnav_ros.base.units import DEGREE, FOOT, KNOT, NAUTICAL_MILE, STANDARD_GRAVITY
from lowcostnav_ros.physics.earth import displace

PLACE = "place"
"""Stands for the position of a fix, which is falsified in metres north, east, down and never scaled."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """One quantity of one sensor.

    Attributes
    ----------
    name : str
        As in the names of faults; empty for the only quantity of a sensor.
    measurement : type
    field : str
        Attribute that holds it, or :data:`PLACE`.
    jump : float or tuple
        A step that a defect causes, SI, NED or FRD.
    ramp : float or tuple
        A drift that a defect causes, per second.
    noise : float
        Sigma of white noise, ten times that of a sound sensor.
    limit : float or None
        Where a converter of too small a range saturates, either sign; None: no sensor of this kind does.
    units : mapping of str to float
        What the number is multiplied by where a driver publishes it in that unit.
    """

    name: str
    measurement: type[Measurement]
    field: str
    jump: Any
    ramp: Any
    noise: float
    limit: float | None = None
    units: Mapping[str, float] = dataclass_field(default_factory=dict)

    def of(self, measurement: Any) -> np.ndarray:
        """The values, (), (k,) or, for several samples, (n, k); zeros for a position."""
        return np.zeros(3) if self.field == PLACE else np.asarray(getattr(measurement, self.field), dtype=float)

    def put(self, measurement: Any, values: Any) -> Any:
        """The measurement with other values; a position moved by them, m north, east, down."""
        if self.field == PLACE:
            lat, lon, height = displace(measurement.lat, measurement.lon, measurement.height, np.asarray(values, dtype=float))
            return replace(measurement, lat=lat, lon=lon, height=height)
        return replace(measurement, **{self.field: float(values) if np.ndim(values) == 0 else np.ascontiguousarray(values)})

    def changed(self, function: Callable[[np.ndarray, float], Any]) -> Callable[[Measurement, float], Measurement]:
        """A change of measurements by a function of the values and the seconds; measurements of another type pass."""
        return lambda m, t_s: self.put(m, function(self.of(m), t_s)) if isinstance(m, self.measurement) else m


@dataclass(frozen=True, slots=True)
class Sensor:
    """One sensor: the sources that fail together, what they measure, and whether its faults matter in an outage of GPS, too."""

    name: str
    sources: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    outage: bool = True


_SPEEDS = {"knots": 1.0 / KNOT, "km_per_h": 3.6}

SENSORS = {
    sensor.name: sensor
    for sensor in (
        Sensor(
            "imu",
            ("imu/data_raw",),
            (
                Quantity(
                    "accel", ImuBlock, "specific_force_b", (0.0, 1.5, 0.0), (0.02, 0.0, 0.0), 1.0, 10.0, {"g": 1.0 / STANDARD_GRAVITY}
                ),
                Quantity(
                    "gyro",
                    ImuBlock,
                    "angular_rate_b",
                    (0, 0, 5 * DEGREE),
                    (0, 0, 0.05 * DEGREE),
                    5 * DEGREE,
                    4 * DEGREE,
                    {"deg": 1 / DEGREE},
                ),
            ),
        ),
        Sensor(
            "mag",
            ("imu/mag",),
            (
                Quantity(
                    *("", MagneticField, "field_b", (0.0, 10.0e-6, 0.0), (0.0, 0.3e-6, 0.0), 1.0e-6, 2.0e-5),
                    {"gauss": 1.0e4, "microtesla": 1.0e6},
                ),
            ),
        ),
        Sensor(
            "air",
            ("air/velocity",),
            (Quantity("", AirVelocity, "vel_b", (15.0, 0.0, 0.0), (0.3, 0.0, 0.0), 2.0, 40.0, _SPEEDS),),
        ),
        Sensor(
            "static",
            ("air/static_pressure",),
            (Quantity("", Pressure, "pressure_pa", 500.0, 10.0, 20.0, 9.0e4, {"hectopascal": 0.01}),),
            outage=False,
        ),
        Sensor("gps", ("gps/fix", "gps/vel"), (), outage=False),
        Sensor("gps_fix", ("gps/fix",), (Quantity("", GpsPosition, PLACE, (40.0, 30.0, 0.0), (0.0, 2.0, 0.0), 20.0),), outage=False),
        Sensor(
            "gps_vel",
            ("gps/vel",),
            (Quantity("", GpsVelocity, "vel_n", (0.0, 10.0, 0.0), (0.3, 0.0, 0.0), 1.0, 30.0, _SPEEDS),),
            outage=False,
        ),
        Sensor(
            "gnss",
            ("gnss/raw",),
            (
                Quantity("range", GnssEpoch, "pseudorange_m", 3.0e5, 5.0, 55.0, None, {"km": 1.0e-3}),
                Quantity("doppler", GnssEpoch, "doppler_mps", 20.0, 0.5, 2.0, None, {"knots": 1.0 / KNOT}),
            ),
            outage=False,
        ),
        Sensor(
            "dme",
            ("dme/range",),
            (
                Quantity(
                    *("", SlantRange, "range_m", 2000.0, 20.0, 74.0, 20.0e3),
                    {"nautical_miles": 1.0 / NAUTICAL_MILE, "km": 1.0e-3, "feet": 1.0 / FOOT},
                ),
            ),
        ),
        Sensor(
            "vor",
            ("vor/bearing",),
            (Quantity("", VorBearing, "bearing_rad", 10 * DEGREE, 0.5 * DEGREE, 3 * DEGREE, None, {"deg": 1.0 / DEGREE}),),
        ),
    )
}

ALL = tuple(dict.fromkeys(source for sensor in SENSORS.values() for source in sensor.sources))
"""Every source that can fail."""


def label(sensor: Sensor, quantity: Quantity) -> str:
    """How names of faults of a quantity begin."""
    return f"{sensor.name}_{quantity.name}" if quantity.name else sensor.name
