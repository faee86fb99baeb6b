"""Faults of the inertial unit alone: an axis that dies, clipped vibration, a mounting that gives way."""

import numpy as np

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.simulation.fault import Change, Fault, each, enter
from lowcostnav_ros.simulation.faults._sensors import SENSORS

_SOURCES, (_ACCEL, _GYRO) = SENSORS["imu"].sources, SENSORS["imu"].quantities


def axis_dead(axis: int) -> Change:
    """A gyro that reads zero."""
    return each(_GYRO.changed(lambda v, t_s: v * (np.arange(3) != axis)))


def vibration(amplitude: float, hz: float) -> Change:
    """Vibration of the accelerometers, aliased by the sampling."""

    def change(m: Measurement, t_s: float) -> Measurement:
        return _ACCEL.changed(lambda v, t: v + amplitude * np.sin(2.0 * np.pi * hz * t) * np.array([1.0, 0.5, 1.0]))(m, t_s)

    return each(change)


enter(__name__, Fault("imu_gyro_z_dead", "an axis that reads zero", _SOURCES, axis_dead(2)), outage=True)
enter(__name__, Fault("imu_vibration", "an engine mount that is broken: 3 m/s^2 at 7 Hz", _SOURCES, vibration(3.0, 7.0)), outage=True)
enter(
    __name__,
    Fault("imu_gyro_bias_always", "turn-on biases of 1 deg/s", _SOURCES, each(_GYRO.changed(lambda v, t_s: v + DEGREE)), 0.0, 1e6),
    outage=True,
)
