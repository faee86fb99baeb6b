"""Air data as an aid of an inertial navigator: airspeed and sideslip teach the wind while GPS is good and hold the velocity without it."""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.views import Attitude, Velocity
from lowcostnav_ros.estimation.aiding import Aid, GateSettings, Host, Innovation, Sensor, SensorSettings, each
from lowcostnav_ros.estimation.error_state import Block, Kind, gauss_markov
from lowcostnav_ros.physics.rotation import skew

SLOW = "below minimum airspeed"


@dataclass(frozen=True)
class AirDataSettings(SensorSettings):
    """Airspeed and sideslip: they teach the wind while GPS is good and hold the position in an outage."""

    enabled: bool = setting(True, "Use airspeed and sideslip.")
    noise_mps: float = setting(
        1.0, "White noise of the true airspeed, turbulence included.", unit="m/s", minimum=0.01, maximum=50.0, within=3
    )
    bias_mps: float = setting(1.5, "Slow airspeed error, Gauss-Markov sigma.", unit="m/s", minimum=0.0, maximum=50.0, within=3)
    bias_tau_s: float = setting(400.0, "Correlation time of the slow airspeed error.", unit="s", minimum=1.0)
    sideslip_deg: float = setting(2.0, "Sigma of the sideslip where no vane measures it.", unit="deg", minimum=0.05, maximum=30.0)
    minimum_mps: float = setting(12.0, "Below this airspeed nothing is used.", unit="m/s", minimum=0.0, maximum=200.0)
    wind_mps: float = setting(5.0, "Wind change, Gauss-Markov sigma of each component.", unit="m/s", minimum=0.1, maximum=50.0, within=3)
    wind_tau_s: float = setting(400.0, "Correlation time of the wind change.", unit="s", minimum=1.0, within=2)
    wind_start_mps: float = setting(10.0, "Sigma of the wind at the start.", unit="m/s", minimum=0.1, maximum=100.0)
    period_s: float = setting(1.0, "Use at most one measurement in this time (its errors are slow).", unit="s", minimum=0.0, maximum=60.0)
    gate: GateSettings = group(GateSettings)


class AirDataAid(Aid):
    """What airspeed and sideslip share: the air-relative velocity predicted from velocity, wind and attitude."""

    measurement, topic, views = AirVelocity, "air/velocity", (Velocity, Attitude)
    teaches = ("wind", "airspeed_bias")

    def blocks(self) -> list[Block]:
        """Wind, m/s north and east, and the slow airspeed error, m/s."""
        air, bias = self.settings, self.own("airspeed_bias")
        wind = ["wind_north_mps", "wind_east_mps"]
        return [
            gauss_markov("wind", wind, Kind.WIND, air.wind_mps, air.wind_tau_s, air.wind_start_mps),
            gauss_markov(bias, [f"{bias}_mps"], Kind.AIRSPEED_BIAS, air.bias_mps, air.bias_tau_s),
        ]

    def air_n(self, host: Host) -> np.ndarray:
        """Predicted air-relative velocity (3,), m/s NED."""
        core = host.core
        air_n: np.ndarray = core.nav[3:6].copy()
        air_n[:2] -= core.estimate[host.layout["wind"]]
        return air_n


class AirspeedAid(AirDataAid):
    """True airspeed against the length of velocity minus wind, m/s."""

    name, labels = "airspeed", ("tas_mps",)

    def innovation(self, measurement: AirVelocity, host: Host) -> Innovation | str:
        """y = TAS - (|v - w| + b)."""
        tas = float(np.linalg.norm(measurement.vel_b))
        if tas < self.settings.minimum_mps:
            return SLOW
        air_n = self.air_n(host)
        speed = float(np.linalg.norm(air_n))
        if speed < 1.0:
            return "predicted airspeed is zero"
        bias = host.layout[self.own("airspeed_bias")]
        H = np.zeros((1, host.layout.size))
        H[0, host.core.velocity_rows] = air_n / speed
        H[0, host.layout["wind"]] = -air_n[:2] / speed
        H[0, bias] = 1.0
        y = tas - speed - host.core.estimate[bias][0]
        stated = measurement.cov_b[0, 0] - self.settings.bias_mps**2  # what the message states beyond the slow error, a state here
        variance = max(self.settings.noise_mps**2, stated)
        free = self.free(measurement.stamp_ns, host)
        return Innovation(np.array([y]), H, np.array([[variance]]), np.array([tas]), free)


class SideslipAid(AirDataAid):
    """Sideways air-relative velocity: a vane's measurement, else zero within the sideslip sigma, m/s."""

    name, labels = "sideslip", ("lateral_mps",)

    def innovation(self, measurement: AirVelocity, host: Host) -> Innovation | str:
        """y = v_lateral - (C' (v - w))_y; not before the wind is known well enough for a direction of the air."""
        tas = float(np.linalg.norm(measurement.vel_b))
        if tas < self.settings.minimum_mps:
            return SLOW
        if float(np.sqrt(np.diag(host.P)[host.layout["wind"]].max())) > 0.5 * tas:
            return "wind not known yet"
        air_n, C = self.air_n(host), host.core.C_nb()
        H = np.zeros((1, host.layout.size))
        H[0, host.core.velocity_rows], H[0, host.core.attitude_rows] = C.T[1], (C.T @ skew(air_n))[1]
        H[0, host.layout["wind"]] = -C.T[1, :2]
        measured = measurement.cov_b[1, 1] < UNKNOWN_VARIANCE
        lateral = measurement.vel_b[1] if measured else 0.0
        sigma = tas * self.settings.sideslip_deg * DEGREE
        variance = max(measurement.cov_b[1, 1], (0.25 * sigma) ** 2) if measured else sigma**2
        y, free = np.array([lateral - (C.T @ air_n)[1]]), self.free(measurement.stamp_ns, host)
        return Innovation(y, H, np.array([[variance]]), np.array([lateral]), free)


AIRDATA = AIDS.register("airdata", Sensor("airdata", AirDataSettings, each(AirspeedAid, SideslipAid)), __name__)
