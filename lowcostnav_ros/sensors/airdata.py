"""Air data: simulated pressures, temperature and vanes, and the computer that makes an air velocity of them.

Errors (Gebre-Egziabher 2004, eq. 3.30-3.34): airspeed Gauss-Markov 2.6 m/s (5 kt, the certification limit), 400 s; altitude
Gauss-Markov 23 m (75 ft), 400 s.  Airspeed error enters through the impact pressure and altitude error through the static
pressure, so that everything computed from the pressures carries it.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirTemperature, AirVelocity, Measurement, Pressure
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.physics import atmosphere
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.stochastic import GaussMarkov
from lowcostnav_ros.sensors.drift import DriftBank
from lowcostnav_ros.sensors.registry import SimulatorSettings, simulator
from lowcostnav_ros.sensors.sampling import SampleClock, to_body

SLOWEST_MPS = 5.0
"""Below this a pitot tube hardly answers; errors per speed are taken at this speed."""
BLIND_INCIDENCE = 0.005
"""Without vanes true airspeed stands for its forward component: 1 - cos of about 6 degrees, as a share of the airspeed."""


@dataclass(frozen=True)
class AirDataSimulatorSettings(SimulatorSettings):
    """Settings of the air data simulator."""

    rate_hz: float = setting(10.0, "Output rate.", unit="Hz", minimum=0.1, maximum=200.0)
    airspeed_error_mps: float = setting(2.6, "Slow airspeed error, 1 sigma (5 kt).", unit="m/s", minimum=0.0, maximum=50.0)
    airspeed_error_tau_s: float = setting(400.0, "Correlation time of the airspeed error.", unit="s", minimum=0.1)
    airspeed_noise_mps: float = setting(0.2, "White airspeed noise of one sample, 1 sigma.", unit="m/s", minimum=0.01, maximum=50.0)
    altitude_error_m: float = setting(23.0, "Slow altitude error, 1 sigma (75 ft).", unit="m", minimum=0.0, maximum=1000.0)
    altitude_error_tau_s: float = setting(400.0, "Correlation time of the altitude error.", unit="s", minimum=0.1)
    static_noise_pa: float = setting(2.0, "White noise of the static pressure, 1 sigma.", unit="Pa", minimum=0.01, maximum=1000.0)
    temperature_noise_k: float = setting(0.5, "White noise of the air temperature, 1 sigma.", unit="K", minimum=0.01, maximum=20.0)
    scale: float = setting(0.0, "Constant scale error: it reads true airspeed times one plus this ...", minimum=-0.5, maximum=0.5)
    offset_mps: float = setting(0.0, "... plus this.", unit="m/s", minimum=-50.0, maximum=50.0)
    axial: bool = setting(False, "The pitot tube lies along the body axis and sees the forward component alone.")
    computer: bool = setting(True, "An air data computer is aboard: air/velocity comes with the pressures.")
    vanes: bool = setting(False, "Incidence and sideslip vanes are fitted.")
    vane_offset_deg: float = setting(0.5, "Constant error of each vane, 1 sigma.", unit="deg", minimum=0.0, maximum=10.0)
    vane_noise_deg: float = setting(0.3, "White noise of each vane, 1 sigma.", unit="deg", minimum=0.0, maximum=10.0)
    qnh_pa: float = setting(101325.0, "Pressure at mean sea level on the day.", unit="Pa", minimum=85_000.0, maximum=110_000.0)
    isa_deviation_k: float = setting(0.0, "Temperature above standard on the day.", unit="K", minimum=-60.0, maximum=60.0)
    geoid_undulation_m: float = setting(-32.5, "Mean sea level above the ellipsoid.", unit="m", minimum=-110.0, maximum=90.0)


@dataclass(frozen=True, slots=True)
class Vanes:
    """Measured ``incidence`` (nose above the airflow +) and ``sideslip`` (airflow from the right +), rad, with their ``sigma``."""

    incidence: float
    sideslip: float
    sigma: float


def air_velocity(
    static: Pressure, impact: Pressure, temperature: AirTemperature, vanes: Vanes | None, source: str, axial: bool = False
) -> AirVelocity:
    """Compute the air-relative velocity, as an air data computer does.

    Parameters
    ----------
    static, impact : Pressure
        Static pressure and impact pressure (pitot minus static), Pa, with their variances.
    temperature : AirTemperature
        Static air temperature, K.
    vanes : Vanes or None
        None leaves y and z unmeasured; x is then the true airspeed itself.
    source : str
        Source name of the result.
    axial : bool
        The tube sees the forward component alone, so that the whole is larger by 1 / (cos incidence cos sideslip).

    Returns
    -------
    AirVelocity
        FRD, m/s, stamped as ``impact``; the covariance follows from the variances to first order.
    """
    pressure, kelvin = static.pressure_pa, temperature.temperature_k
    tas = float(atmosphere.tas_from_impact(impact.pressure_pa, pressure, kelvin))
    slope = float(atmosphere.density(pressure, kelvin)) * max(tas, SLOWEST_MPS)  # d(impact)/d(airspeed) at low Mach number
    variance = impact.variance / slope**2
    variance += (0.5 * tas) ** 2 * (static.variance / pressure**2 + temperature.variance / kelvin**2)  # airspeed goes with sqrt(T/p)
    if vanes is None:
        cov_b = np.diag([variance + (BLIND_INCIDENCE * tas) ** 2, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])
        return AirVelocity(impact.stamp_ns, source, np.array([tas, 0.0, 0.0]), cov_b)
    unit, across_incidence, across_sideslip = _airflow(vanes.incidence, vanes.sideslip)
    unit = unit / unit[0] if axial else unit
    jacobian = np.column_stack((unit, max(tas, SLOWEST_MPS) * across_incidence, max(tas, SLOWEST_MPS) * across_sideslip))
    cov_b = jacobian @ np.diag([variance, vanes.sigma**2, vanes.sigma**2]) @ jacobian.T
    return AirVelocity(impact.stamp_ns, source, tas * unit, 0.5 * (cov_b + cov_b.T))


def _airflow(incidence: float, sideslip: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the direction of the air-relative velocity, FRD, and its derivatives by incidence and by sideslip."""
    sa, ca, sb, cb = math.sin(incidence), math.cos(incidence), math.sin(sideslip), math.cos(sideslip)
    return np.array([ca * cb, sb, sa * cb]), np.array([-sa * cb, 0.0, ca * cb]), np.array([-ca * sb, cb, -sa * sb])


@simulator(
    "air_data",
    Settings=AirDataSimulatorSettings,
    truth=("truth/odometry", "truth/wind"),
    topics=("air/static_pressure", "air/dynamic_pressure", "air/temperature", "air/velocity"),
    usual=3,
)
class AirDataSimulator:
    """Turn truth into air data; keeps its errors from call to call.

    Each epoch gives static and impact pressure, temperature and the velocity the air data computer makes of them.  Variances
    are those of the whole error, slow part included.
    """

    def __init__(self, settings: AirDataSimulatorSettings, prefix: str = "air") -> None:
        self.settings, self._prefix = settings, prefix
        self._clock = SampleClock(settings.rate_hz)
        drift = (
            GaussMarkov(settings.airspeed_error_mps, settings.airspeed_error_tau_s),
            GaussMarkov(settings.altitude_error_m, settings.altitude_error_tau_s),
        )
        self._drift = DriftBank(drift, 1.0 / settings.rate_hz, stream(settings.seed, "air_data.drift"))
        self._noise_rng = stream(settings.seed, "air_data.noise")
        self._vane_offset = np.radians(settings.vane_offset_deg) * stream(settings.seed, "air_data.vanes").standard_normal(2)

    def simulate(self, truth: TruthBlock) -> list[Measurement]:
        """Return the air data that fall into ``truth``."""
        rows = self._clock.rows(truth.stamps_ns)
        if len(rows) == 0:
            return []
        air_b = to_body(truth.q_nb[rows], truth.vel_n[rows] - truth.wind_n[rows])
        drift = self._drift.draw(len(rows))
        normals = self._noise_rng.standard_normal((len(rows), 5))
        epochs = zip(truth.stamps_ns[rows], truth.height[rows], air_b, drift, normals, strict=True)
        return [m for epoch in epochs for m in self._epoch(*epoch)]

    def _epoch(self, stamp_ns: int, height: float, air_b: np.ndarray, drift: np.ndarray, normals: np.ndarray) -> list[Measurement]:
        settings, stamp_ns, prefix = self.settings, int(stamp_ns), self._prefix
        altitude = height - settings.geoid_undulation_m
        pressure, kelvin = self._air(altitude)
        seen_pressure = self._air(altitude + drift[1])[0] + settings.static_noise_pa * float(normals[0])
        seen = float(air_b[0]) if settings.axial else math.sqrt(air_b @ air_b)
        read = (1.0 + settings.scale) * seen + settings.offset_mps
        tas = max(read + float(drift[0]) + settings.airspeed_noise_mps * float(normals[1]), 0.0)
        rho = float(atmosphere.density(pressure, kelvin))
        static_variance = (rho * STANDARD_GRAVITY * settings.altitude_error_m) ** 2 + settings.static_noise_pa**2
        speed_variance = settings.airspeed_error_mps**2 + settings.airspeed_noise_mps**2
        static = Pressure(stamp_ns, f"{prefix}/static_pressure", seen_pressure, static_variance)
        impact_pa = float(atmosphere.impact_from_tas(tas, pressure, kelvin))
        impact = Pressure(stamp_ns, f"{prefix}/dynamic_pressure", impact_pa, (rho * max(tas, SLOWEST_MPS)) ** 2 * speed_variance)
        seen_kelvin = kelvin + settings.temperature_noise_k * float(normals[2])
        temperature = AirTemperature(stamp_ns, f"{prefix}/temperature", seen_kelvin, settings.temperature_noise_k**2)
        vanes = self._vanes(air_b, normals[3:5])
        if not settings.computer:
            return [static, impact, temperature]
        return [static, impact, temperature, air_velocity(static, impact, temperature, vanes, f"{prefix}/velocity", settings.axial)]

    def _air(self, altitude: float) -> tuple[float, float]:
        """Return static pressure, Pa, and temperature, K, of the day at a geometric altitude above mean sea level, m."""
        settings = self.settings
        geopotential = atmosphere.geopotential_altitude(altitude)
        pressure = float(atmosphere.pressure_at(geopotential, settings.qnh_pa, settings.isa_deviation_k))
        return pressure, float(atmosphere.temperature(atmosphere.pressure_altitude(pressure), settings.isa_deviation_k))

    def _vanes(self, air_b: np.ndarray, normals: np.ndarray) -> Vanes | None:
        settings = self.settings
        speed = math.sqrt(air_b @ air_b)
        if not settings.vanes or speed < SLOWEST_MPS:
            return None
        errors = self._vane_offset + np.radians(settings.vane_noise_deg) * normals
        sigma = math.radians(math.hypot(settings.vane_offset_deg, settings.vane_noise_deg))
        incidence, sideslip = math.atan2(air_b[2], air_b[0]), math.asin(air_b[1] / speed)
        return Vanes(incidence + float(errors[0]), sideslip + float(errors[1]), sigma)
