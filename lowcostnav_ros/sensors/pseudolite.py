"""Simulator of a receiver of ground transmitters: code, carrier and Doppler of a synchronised network, and the weather at it.

    code = |p - r| + T + clock + multipath + noise,     carrier = (|p - r| + T + clock + multipath + noise)/wavelength + N,
    Doppler = -(rate + drift)/wavelength

The troposphere T is that of :mod:`lowcostnav_ros.radionav.air_column`, which no filter's model equals.  A transmitter is received within
its reach; near one, all others are masked (near and far).  Where the airframe shadows the antenna, carriers slip besides
(:mod:`lowcostnav_ros.sensors.airframe`).
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.measurements import CarrierEpoch, Measurement, StationWeather
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.base.units import SPEED_OF_LIGHT, kelvin
from lowcostnav_ros.gnss.observables import range_and_rate
from lowcostnav_ros.gnss.receiver_clock import CLOCKS
from lowcostnav_ros.gnss.receiver_clock import simulate as simulate_clock
from lowcostnav_ros.physics.earth import LocalFrame, dcm_ne, geodetic_to_ecef
from lowcostnav_ros.physics.rotation import quat_to_dcm
from lowcostnav_ros.radionav.air_column import AirColumn
from lowcostnav_ros.radionav.stations import StationTable
from lowcostnav_ros.radionav.transmitters import PSEUDOLITE
from lowcostnav_ros.radionav.weather import Weather
from lowcostnav_ros.sensors.airframe import AirframeSettings, slips_per_s
from lowcostnav_ros.sensors.carrier_errors import CarrierErrors, CarrierErrorSettings
from lowcostnav_ros.sensors.reception import ReceiverSettings, outage_windows
from lowcostnav_ros.sensors.registry import simulator
from lowcostnav_ros.sensors.sampling import SampleClock

WAVELENGTH_M = SPEED_OF_LIGHT / 2434.6e6
"""0.12314 m: the carrier that the slip thresholds printed in centimetres imply."""


@dataclass(frozen=True)
class AirSettings:
    """The true air over the network."""

    height_m: float = setting(1250.0, "Height at which the following holds.", unit="m", minimum=-400.0, maximum=6000.0)
    pressure_hpa: float = setting(875.0, "Static pressure.", unit="hPa", minimum=400.0, maximum=1100.0)
    temperature_c: float = setting(10.0, "Temperature.", unit="degC", minimum=-60.0, maximum=55.0)
    humidity_pct: float = setting(30.0, "Relative humidity.", unit="%", minimum=0.0, maximum=100.0)
    lapse_k_per_km: float = setting(5.5, "How temperature falls with height.", unit="K/km", minimum=0.5, maximum=9.8)
    vapour_m: float = setting(1800.0, "Height over which water vapour falls to 1/e.", unit="m", minimum=200.0, maximum=10000.0)
    gradient_per_km: float = setting(0.05, "Growth of the refractivity eastward.", unit="N/km", minimum=-10.0, maximum=10.0)

    def column(self) -> AirColumn:
        """The air that these numbers describe."""
        weather = Weather(100.0 * self.pressure_hpa, kelvin(self.temperature_c), 0.01 * self.humidity_pct)
        return AirColumn(weather, self.height_m, 1e-3 * self.lapse_k_per_km, self.vapour_m, 1e-3 * self.gradient_per_km)


@dataclass(frozen=True)
class PseudoliteSimulatorSettings(ReceiverSettings):
    """Settings of the simulator of ground transmitters."""

    receiver = "Pseudolites"
    rate_hz: float = setting(10.0, "Output rate.", unit="Hz", minimum=0.1, maximum=50.0)
    stations_file: str = setting("pseudolites_range.csv", "Station table in the config directory, or a path.")
    wavelength_m: float = setting(WAVELENGTH_M, "Wavelength of the carrier.", unit="m", minimum=0.01, maximum=2.0)
    lever_arm_b_m: list = setting([0.0, 0.0, 0.0], "Antenna relative to the IMU, forward, right, down.", unit="m", minimum=-100.0)
    clock: str = setting("ovenized_crystal", "Receiver oscillator.", choices=tuple(CLOCKS))
    clock_bias_m: float = setting(3000.0, "Receiver clock at switch-on, 1 sigma.", unit="m", minimum=0.0)
    clock_drift_mps: float = setting(10.0, "Receiver clock drift at switch-on, 1 sigma.", unit="m/s", minimum=0.0)
    clock_step: list = setting([], "The receiver sets its clock: time (s), step (m), time, step, ...")
    near_far_m: float = setting(200.0, "Closer to a transmitter than this no other is received.", unit="m", minimum=0.0)
    lost_sync: list = setting([], "Transmitters out of step: start (s), ident as a number, offset (m), rate (m/s), start, ...")
    errors: CarrierErrorSettings = group(CarrierErrorSettings)
    airframe: AirframeSettings = group(AirframeSettings)
    air: AirSettings = group(AirSettings)
    weather_period_s: float = setting(60.0, "Time between reports of the weather; 0: none.", unit="s", minimum=0.0)
    weather_pressure_hpa: float = setting(0.5, "Error of a station's pressure, 1 sigma, constant.", unit="hPa", minimum=0.0)
    weather_temperature_k: float = setting(0.5, "Error of a station's temperature, 1 sigma, constant.", unit="K", minimum=0.0)
    weather_humidity_pct: float = setting(3.0, "Error of a station's humidity, 1 sigma, constant.", unit="%", minimum=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.lost_sync) % 4 or len(self.clock_step) % 2:
            raise SettingsError("Pseudolites: 'lost_sync' needs four numbers each, 'clock_step' two; add what is missing.")
        if len(self.lever_arm_b_m) != 3:
            raise SettingsError("Pseudolites: 'lever_arm_b_m' needs three numbers, forward, right, down.")


@simulator(
    "pseudolite",
    Settings=PseudoliteSimulatorSettings,
    truth=("truth/odometry",),
    topics=("pseudolite/raw", "pseudolite/weather"),
    needs="stations_file",
)
class PseudoliteSimulator:
    """Turn truth into epochs and reports of weather; keeps clock, errors and locks from call to call.

    Parameters
    ----------
    settings : PseudoliteSimulatorSettings
    table : StationTable
        Its pseudolites transmit.
    source, weather_source : str
        Source names of the measurements.

    Attributes
    ----------
    errors : CarrierErrors
    delays_m : ndarray (n,)
        Of the troposphere at the last epoch.

    Raises
    ------
    SettingsError
        When the table holds no pseudolite.
    """

    def __init__(
        self,
        settings: PseudoliteSimulatorSettings,
        table: StationTable,
        source: str = "pseudolite/raw",
        weather_source: str = "pseudolite/weather",
    ) -> None:
        self.settings, self.source, self.weather_source = settings, source, weather_source
        self.stations = [s for s in table if s.kind == PSEUDOLITE]
        if not self.stations:
            raise SettingsError(f"{settings.stations_file} holds no station of kind {PSEUDOLITE}; name a table that does.")
        n = len(self.stations)
        self._ident = np.array([s.ident for s in self.stations])
        self._pos_e = np.array([geodetic_to_ecef(s.lat, s.lon, s.height) for s in self.stations])
        self._heights, self._reach = np.array([s.height for s in self.stations]), np.array([s.reach_m for s in self.stations])
        frame = LocalFrame(self.stations[0].lat, self.stations[0].lon, self.stations[0].height)
        self._frame, self._east = frame, np.array([frame.to_ned(s.lat, s.lon, s.height)[1] for s in self.stations])
        self.errors = CarrierErrors(settings.errors, n, settings.rate_hz, settings.seed, "pseudolite")
        self._lever_b, self._air = np.array(settings.lever_arm_b_m, dtype=float), settings.air.column()
        self._epochs = SampleClock(settings.rate_hz)
        self._reports = SampleClock(1.0 / settings.weather_period_s) if settings.weather_period_s > 0.0 else None
        sigmas = 100.0 * settings.weather_pressure_hpa, settings.weather_temperature_k, 0.01 * settings.weather_humidity_pct
        self._weather_errors = np.outer(sigmas, np.ones(n)) * stream(settings.seed, "pseudolite.weather").standard_normal((3, n))
        self._clock_rng = stream(settings.seed, "pseudolite.clock")
        switch_on = np.array([settings.clock_bias_m, settings.clock_drift_mps])
        self.clock_state = switch_on * self._clock_rng.standard_normal(2)
        self.delays_m = np.zeros(n)
        self._start_ns: int | None = None

    def simulate(self, truth: TruthBlock) -> list[Measurement]:
        """Return the epochs and reports whose time falls in ``truth``."""
        if len(truth) == 0:
            return []
        self._start_ns = int(truth.stamps_ns[0]) if self._start_ns is None else self._start_ns
        out: list[Measurement] = []
        if self._reports is not None:
            out += [self._report(int(truth.stamps_ns[row])) for row in self._reports.rows(truth.stamps_ns)]
        rows = self._epochs.rows(truth.stamps_ns)
        clocks = simulate_clock(CLOCKS[self.settings.clock], 1.0 / self.settings.rate_hz, len(rows), self._clock_rng, self.clock_state)
        out += [e for e in (self._epoch(truth, int(row), clock) for row, clock in zip(rows, clocks, strict=True)) if e is not None]
        return sorted(out, key=lambda m: m.stamp_ns)

    def _report(self, stamp_ns: int) -> StationWeather:
        air = [self._air.at(height) for height in self._heights]
        true = np.array([[w.pressure_pa, w.temperature_k, w.humidity] for w in air]).T
        pressure, temperature, humidity = true + self._weather_errors
        return StationWeather(stamp_ns, self.weather_source, self._ident, pressure, temperature, np.clip(humidity, 0.0, 1.0))

    def _epoch(self, truth: TruthBlock, row: int, clock: np.ndarray) -> CarrierEpoch | None:
        own, stamp_ns = self.settings, int(truth.stamps_ns[row])
        t_s = (stamp_ns - (self._start_ns or 0)) * 1e-9
        C_en, C_nb = dcm_ne(truth.lat[row], truth.lon[row]).T, quat_to_dcm(truth.q_nb[row])
        swing_n = C_nb @ np.cross(truth.angular_rate_b[row], self._lever_b)
        position = geodetic_to_ecef(truth.lat[row], truth.lon[row], truth.height[row]) + C_en @ C_nb @ self._lever_b
        velocity = C_en @ (truth.vel_n[row] + swing_n)
        ranges, rates, sight_e = range_and_rate(position, velocity, self._pos_e, np.zeros_like(self._pos_e))
        height = float(truth.height[row] - (C_nb @ self._lever_b)[2])
        middle = 0.5 * (self._east + self._frame.to_ned(truth.lat[row], truth.lon[row], truth.height[row])[1])
        self.delays_m = self._air.delays(self._heights, height, ranges, middle)
        banked = abs(math.atan2(C_nb[2, 1], C_nb[2, 2])) > math.radians(own.errors.bank_deg)
        slips_hz = slips_per_s(own.airframe, sight_e @ C_en @ C_nb, own.wavelength_m)
        errors = self.errors.draw(self._received(ranges, t_s), banked, slips_hz)
        if not errors.locked.any():
            return None
        offset, rate = self._sync(t_s)
        whole = ranges + self.delays_m + clock[0] + offset + sum(step for at, step in _pairs(own.clock_step) if t_s >= at)
        wave = np.full(len(ranges), own.wavelength_m)
        carrier = (whole + errors.carrier_m) / wave + errors.cycles
        doppler = -(rates + clock[1] + rate) / wave + errors.doppler_hz
        used = errors.locked
        valid = np.ones(int(np.count_nonzero(used)), dtype=bool)
        observed = (whole + errors.code_m)[used], carrier[used], doppler[used], wave[used], np.zeros(len(valid))
        return CarrierEpoch(stamp_ns, self.source, self._ident[used], *observed, valid, valid)

    def _received(self, ranges: np.ndarray, t_s: float) -> np.ndarray:
        """Which transmitters are received at these ranges (n,), m."""
        if any(start <= t_s < end for start, end in outage_windows(self.settings.outages_s)):
            return np.zeros(len(ranges), dtype=bool)
        received = (ranges >= self._reach[:, 0]) & (ranges <= self._reach[:, 1])
        return received & (ranges == ranges.min()) if ranges.min() < self.settings.near_far_m else received

    def _sync(self, t_s: float) -> tuple[np.ndarray, np.ndarray]:
        """By how much each transmitter is out of step, m and m/s."""
        offset, rate, own = np.zeros(len(self._ident)), np.zeros(len(self._ident)), self.settings.lost_sync
        for start, ident, metres, mps in zip(own[0::4], own[1::4], own[2::4], own[3::4], strict=True):
            these = (self._ident == f"{ident:.0f}") & (t_s >= start)
            offset[these] += metres + mps * (t_s - start)
            rate[these] += mps
        return offset, rate


def _pairs(listed: list) -> list[tuple[float, float]]:
    return list(zip(listed[0::2], listed[1::2], strict=True))
