"""Magnetic faults: a load whose current switches, a magnet brought aboard."""

import numpy as np

from lowcostnav_ros.base.measurements import MagneticField, Measurement
from lowcostnav_ros.simulation.fault import Change, Fault, each, enter
from lowcostnav_ros.simulation.faults._sensors import SENSORS

_SOURCES, (_FIELD,) = SENSORS["mag"].sources, SENSORS["mag"].quantities


def load(field_b: tuple[float, float, float], on_s: float, off_s: float) -> Change:
    """A field of a load (tesla, FRD) that is switched on and off."""

    def change(m: Measurement, t_s: float) -> Measurement:
        on = isinstance(m, MagneticField) and t_s % (on_s + off_s) < on_s
        return _FIELD.put(m, _FIELD.of(m) + np.array(field_b)) if on else m

    return each(change)


enter(
    __name__,
    Fault("mag_load_switches", "a servo or lamp: 4 microtesla, 3 s on, 5 s off", _SOURCES, load((3e-6, 3e-6, 0.0), 3.0, 5.0)),
    outage=True,
)
enter(__name__, Fault("mag_heater_on", "a heater switched on: 8 microtesla", _SOURCES, load((0.0, 8e-6, 0.0), 1e6, 0.0)), outage=True)
