"""Faults of values: drifts, steps, wrong factors, noise, spikes, converters that saturate."""

from collections.abc import Iterator
from functools import partial
from itertools import count

import numpy as np

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.simulation.fault import Arrived, Change, Fault, Window, each, enter
from lowcostnav_ros.simulation.faults._sensors import PLACE, SENSORS, Quantity, Sensor, label

SPIKES = {"small": 3.0, "large": 30.0, "huge": 1000.0}
"""Sizes of a single spike, in jumps of its quantity."""


def ramp(quantity: Quantity) -> Change:
    """A value that drifts away from the start on."""
    return each(quantity.changed(lambda v, t_s: v + t_s * np.asarray(quantity.ramp)))


def jump(quantity: Quantity, size: float = 1.0) -> Change:
    """A value with a constant error."""
    return each(quantity.changed(lambda v, t_s: v + size * np.asarray(quantity.jump)))


def factor(quantity: Quantity, by: float) -> Change:
    """A value multiplied."""
    return each(quantity.changed(lambda v, t_s: by * v))


def saturated(quantity: Quantity, limit: float) -> Change:
    """A value that goes no farther than a limit, either sign."""
    return each(quantity.changed(lambda v, t_s: np.clip(v, -limit, limit)))


def noisy(quantity: Quantity, window: Window) -> Iterator[Arrived]:
    """A value with white noise."""

    def noise(v: np.ndarray, t_s: float) -> np.ndarray:
        return v + quantity.noise * window.rng.standard_normal(v.shape)

    return iter(each(quantity.changed(noise))(window))


def spike(quantity: Quantity, size: float, window: Window) -> Iterator[Arrived]:
    """One wrong sample, in one component drawn, at the first measurement of the window."""
    seen = count()
    largest = size * float(np.max(np.abs(quantity.jump)))

    def hit(m: Measurement, t_s: float) -> Measurement:
        if not isinstance(m, quantity.measurement) or next(seen):
            return m
        values = quantity.of(m).copy()
        rows = values.reshape(-1, values.shape[-1] if values.ndim else 1)
        rows[0, window.rng.integers(rows.shape[1])] += largest
        return quantity.put(m, rows.reshape(values.shape))

    return iter(each(hit)(window))


def _enter(sensor: Sensor, quantity: Quantity) -> None:
    head = label(sensor, quantity)
    entries: dict[str, tuple[str, Change]] = {
        "ramp": ("a sensor that drifts away", ramp(quantity)),
        "jump": ("a knock, a cycle slip, a bias after a reset", jump(quantity)),
        "noise_x10": ("interference: ten times the noise", partial(noisy, quantity)),
    }
    entries |= {f"spike_{name}": ("one corrupted sample", partial(spike, quantity, size)) for name, size in SPIKES.items()}
    if quantity.field != PLACE:
        entries["x2"] = ("a wrong gain or range setting", factor(quantity, 2.0))
        entries["sign"] = ("a plug turned over", factor(quantity, -1.0))
    if quantity.limit is not None:
        entries["saturated"] = ("a converter with too small a range", saturated(quantity, quantity.limit))
    entries |= {f"in_{unit}": (f"a driver that publishes {unit}", factor(quantity, by)) for unit, by in quantity.units.items()}
    for name, (imitates, change) in entries.items():
        outage = sensor.outage and name in ("ramp", "jump", "x2", "sign", "spike_large")
        enter(__name__, Fault(f"{head}_{name}", imitates, sensor.sources, change), outage=outage)


for _sensor in SENSORS.values():
    for _quantity in _sensor.quantities:
        _enter(_sensor, _quantity)
