"""Accelerometers as a level: in steady flight specific force is minus gravity; the last resort of an attitude."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.views import Velocity
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Host, Innovation, Sensor, each
from lowcostnav_ros.estimation.manoeuvre import ManoeuvreSwitch, SteadyLimits

MANOEUVRING = "manoeuvring"


@dataclass(frozen=True)
class LevelSettings(SteadyLimits):
    """Plain levelling by the accelerometers, the last resort, and the switch that allows it."""

    period_s: float = setting(1.0, "Span over which the velocity must not have changed.", unit="s", minimum=0.2, maximum=10.0)
    acceleration_mps2: float = setting(0.3, "Acceleration left in steady flight, sigma.", unit="m/s^2", minimum=0.01, maximum=5.0)
    gate: GateSettings = group(GateSettings)


class SteadyFlightAid(Aid):
    """Plain levelling: over a span of steady flight the velocity has not changed, so the specific force was minus gravity.

    Attributes
    ----------
    switch : ManoeuvreSwitch
        Follows the inertial samples that its host passes on.
    since_ns : int or None
        When the host, for want of any measure of velocity, set it to zero; None while it has one.
    """

    name, labels, views = "accelerometer_level", ("north_mps", "east_mps"), (Velocity,)

    def __init__(self, settings: LevelSettings, key: str = "", stations: object = None) -> None:
        super().__init__(settings, key, stations)
        self.switch = ManoeuvreSwitch(settings)
        self.since_ns: int | None = None

    def innovation(self, measurement: Measurement, host: Host) -> Innovation | str:
        """``y = 0 - v`` of a velocity that was set to zero at the beginning of the span; sigma is acceleration times span."""
        if self.since_ns is None:
            return "velocity is measured"
        if not self.switch.steady_over(self.since_ns):
            return MANOEUVRING
        span_s = 1e-9 * (measurement.stamp_ns - self.since_ns)
        rows, horizontal = host.core.velocity_rows, host.core.nav[3:5]
        H = np.zeros((2, host.layout.size))
        H[0, rows.start], H[1, rows.start + 1] = 1.0, 1.0
        R = np.eye(2) * (self.settings.acceleration_mps2 * span_s) ** 2
        return Innovation(-horizontal, H, R, horizontal / span_s)


LEVEL = AIDS.register("level", Sensor("level", LevelSettings, each(SteadyFlightAid)), __name__)
