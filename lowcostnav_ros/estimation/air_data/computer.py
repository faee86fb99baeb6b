"""An air data computer: static and impact pressure and temperature to CAS, EAS, TAS, Mach number, pressure altitude and ``air/velocity``.

Order: pneumatic lag of both lines, position error of the static port, airspeeds.  What arrives is paired by stamp, not by order of arrival:
an impact pressure waits for the static pressure of its stamp or a later one, and the static pressure is interpolated to it.
"""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from lowcostnav_ros.base.measurements import AirTemperature, AirVelocity, GpsVelocity, Measurement, Pressure
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.tally import Tally
from lowcostnav_ros.estimation.air_data.pitot import PitotSettings, PitotWatch
from lowcostnav_ros.physics import atmosphere
from lowcostnav_ros.sensors.airdata import SLOWEST_MPS, air_velocity

STATIC, IMPACT, TEMPERATURE, GPS_VELOCITY, AIR = "air/static_pressure", "air/dynamic_pressure", "air/temperature", "gps/vel", "air/velocity"
INPUTS = (STATIC, IMPACT, TEMPERATURE, GPS_VELOCITY)
REQUIRED = (STATIC, IMPACT)
WAITS_NS = 250_000_000
"""An impact pressure waits no longer than this, in stamps, for the static pressure of its time."""
STALE_NS = 1_000_000_000
"""A static pressure older than this is none."""
ANY_DAY_K = 15.0
"""Sigma of the temperature where none is measured: days differ by so much from the standard atmosphere."""
STANDARD_DAY = "no air temperature: standard atmosphere"
NO_STATIC, BACKWARDS = "no static pressure of its time", "stamp goes back"
MOST_WAITING = 100


@dataclass(frozen=True)
class AirDataComputerSettings:
    """Settings of the air data computer."""

    position_error_mps: list = setting(
        [], "Position error of the static port as pairs: indicated airspeed, CAS minus indicated; between them linear.", unit="m/s"
    )
    lag_s: float = setting(0.0, "First-order lag of the pressure lines, taken out.", unit="s", minimum=0.0, maximum=3.0)
    recovery: float = setting(
        0.0, "Recovery factor of a probe that measures total temperature; 0: static temperature.", minimum=0.0, maximum=1.0
    )
    isa_deviation_k: float = setting(0.0, "Day against standard, used without a probe.", unit="K", minimum=-60.0, maximum=60.0)
    temperature_timeout_s: float = setting(60.0, "A temperature older than this is none.", unit="s", minimum=1.0, maximum=3600.0)
    pitot: PitotSettings = group(PitotSettings)

    def __post_init__(self) -> None:
        table = self.position_error_mps
        if len(table) % 2 or any(isinstance(v, bool) or not isinstance(v, int | float) or not math.isfinite(v) for v in table):
            raise SettingsError("'position_error_mps' must be pairs of numbers: indicated airspeed, correction, ...")
        if any(later <= earlier for earlier, later in zip(table[::2], table[2::2], strict=False)):
            raise SettingsError("'position_error_mps' must give indicated airspeeds in increasing order.")


@dataclass(frozen=True, slots=True)
class AirData:
    """All that follows from one impact pressure: speeds m/s, altitude geopotential m; ``is_measured``: the temperature was."""

    velocity: AirVelocity
    ias: float
    cas: float
    eas: float
    mach: float
    pressure_altitude: float
    temperature_k: float
    is_measured: bool

    @property
    def tas(self) -> float:
        """True airspeed, m/s."""
        return float(self.velocity.vel_b[0])


class Slope:
    """Slope of a pressure over a short time, by least squares, to take a lag out."""

    def __init__(self, lag_s: float) -> None:
        self.lag_s, self._span_ns = lag_s, round(1e9 * max(2.0 * lag_s, 0.5))
        self._kept: deque[tuple[int, float]] = deque(maxlen=1000)

    def leads(self, stamp_ns: int, value: float) -> float:
        """The pressure at the port that a lagging line shows as ``value``: p + tau dp/dt."""
        if self.lag_s == 0.0:
            return value
        if self._kept and stamp_ns - self._kept[-1][0] > self._span_ns:
            self._kept.clear()
        self._kept.append((stamp_ns, value))
        while stamp_ns - self._kept[0][0] > self._span_ns:
            self._kept.popleft()
        if len(self._kept) < 3:
            return value
        t = np.array([1e-9 * (s - stamp_ns) for s, _ in self._kept])
        p = np.array([v for _, v in self._kept])
        t -= t.mean()
        return value + self.lag_s * float(t @ p / (t @ t))


class AirDataComputer:
    """Feed it pressures, temperature and GPS velocity; it gives ``air/velocity``.

    Attributes
    ----------
    latest : AirData or None
        What was computed last, whether it went out or not.
    computed, rejected : int, Tally
        What went out; what did not, by reason.
    standard_days : int
        How many of those that went out had no measured temperature.
    reason : str
        Why nothing goes out at present; empty while something does.
    """

    def __init__(self, settings: AirDataComputerSettings | None = None) -> None:
        self.settings = settings or AirDataComputerSettings()
        self._table = np.array(self.settings.position_error_mps, float).reshape(-1, 2)
        self.rejected: Tally[str] = Tally()
        self.computed = self.standard_days = 0
        self.reset()

    def reset(self) -> None:
        """Forget what was received; the counters stay."""
        self.latest: AirData | None = None
        self.reason = "waiting for pressures"
        self.watch = PitotWatch(self.settings.pitot)
        self._lags = {source: Slope(self.settings.lag_s) for source in REQUIRED}
        self._statics: deque[Pressure] = deque(maxlen=2)
        self._temperatures: deque[AirTemperature] = deque(maxlen=3)
        self._waiting: deque[Pressure] = deque()
        self._last_ns = -(10**18)

    def feed(self, measurement: Measurement) -> list[AirVelocity]:
        """Take one measurement in; return the air velocities that became known, oldest first."""
        if isinstance(measurement, Pressure) and measurement.source == STATIC:
            if self._statics and measurement.stamp_ns <= self._statics[-1].stamp_ns:
                return self._backwards(measurement, self._statics[-1].stamp_ns)
            self._statics.append(self._at_the_port(measurement))
        elif isinstance(measurement, Pressure) and measurement.source == IMPACT:
            newest = self._waiting[-1].stamp_ns if self._waiting else self._last_ns
            if measurement.stamp_ns <= newest:
                return self._backwards(measurement, newest)
            if len(self._waiting) >= MOST_WAITING:
                self._refuse(NO_STATIC)
                self._waiting.popleft()
            self._waiting.append(measurement)
        elif isinstance(measurement, AirTemperature) and measurement.source == TEMPERATURE:
            self._temperatures.append(measurement)
        elif isinstance(measurement, GpsVelocity) and measurement.source == GPS_VELOCITY:
            self.watch.see_motion(measurement)
        return self._ready()

    def _backwards(self, measurement: Measurement, newest_ns: int) -> list[AirVelocity]:
        """Refuse a stamp that goes back; one that goes far back is a time base that started again."""
        self._refuse(BACKWARDS)
        if newest_ns - measurement.stamp_ns > 10 * STALE_NS:
            self.reset()
        return []

    def _at_the_port(self, pressure: Pressure) -> Pressure:
        return replace(pressure, pressure_pa=self._lags[pressure.source].leads(pressure.stamp_ns, pressure.pressure_pa))

    def _ready(self) -> list[AirVelocity]:
        out = []
        while self._waiting and self._statics:
            impact, newest_ns = self._waiting[0], self._waiting[-1].stamp_ns
            if self._statics[-1].stamp_ns < impact.stamp_ns and newest_ns - impact.stamp_ns < WAITS_NS:
                break
            self._waiting.popleft()
            self._last_ns = impact.stamp_ns
            static = self._static_at(impact.stamp_ns)
            if static is None:
                self._refuse(NO_STATIC)
                continue
            found = self._compute(static, self._at_the_port(impact))
            if found is not None:
                out.append(found)
        return out

    def _static_at(self, stamp_ns: int) -> Pressure | None:
        """The static pressure of a time: between the two last, else the nearest that is not stale."""
        first, last = self._statics[0], self._statics[-1]
        if abs(stamp_ns - last.stamp_ns) > STALE_NS:
            return None
        if not first.stamp_ns < stamp_ns < last.stamp_ns or last.stamp_ns - first.stamp_ns > STALE_NS:
            return first if abs(first.stamp_ns - stamp_ns) < abs(last.stamp_ns - stamp_ns) else last
        share = (stamp_ns - first.stamp_ns) / (last.stamp_ns - first.stamp_ns)
        return replace(last, pressure_pa=first.pressure_pa + share * (last.pressure_pa - first.pressure_pa))

    def _compute(self, static: Pressure, impact: Pressure) -> AirVelocity | None:
        ias = float(atmosphere.cas_from_impact(impact.pressure_pa))
        static, impact = self._without_position_error(static, impact, ias)
        temperature, is_measured = self._air_temperature(static, impact)
        velocity = air_velocity(static, impact, temperature, None, AIR)
        density = float(atmosphere.density(static.pressure_pa, temperature.temperature_k))
        sea_level = float(atmosphere.density(atmosphere.SEA_LEVEL_PRESSURE, atmosphere.SEA_LEVEL_TEMPERATURE))
        tas = float(velocity.vel_b[0])
        self.latest = AirData(
            velocity,
            ias,
            float(atmosphere.cas_from_impact(impact.pressure_pa)),
            tas * math.sqrt(density / sea_level),
            float(atmosphere.mach_number(impact.pressure_pa, static.pressure_pa)),
            float(atmosphere.pressure_altitude(static.pressure_pa)),
            temperature.temperature_k,
            is_measured,
        )
        fault = self.watch.judge(impact.stamp_ns, static, impact, tas)
        if not math.isfinite(velocity.cov_b[0, 0] + tas):
            fault = "airspeed is not finite"
        if fault:
            self._refuse(fault)
            return None
        self.reason, self.computed = "", self.computed + 1
        self.standard_days += not is_measured
        return velocity

    def _refuse(self, reason: str) -> None:
        self.reason = reason
        self.rejected[getattr(reason, "phrase", reason)] += 1

    def _without_position_error(self, static: Pressure, impact: Pressure, ias: float) -> tuple[Pressure, Pressure]:
        """Take the error of the static port, which is in both pressures, out."""
        if not len(self._table) or ias < SLOWEST_MPS:
            return static, impact
        cas = max(ias + float(np.interp(ias, self._table[:, 0], self._table[:, 1])), 0.0)
        error = float(atmosphere.impact_from_cas(cas)) - impact.pressure_pa
        return replace(static, pressure_pa=static.pressure_pa - error), replace(impact, pressure_pa=impact.pressure_pa + error)

    def _air_temperature(self, static: Pressure, impact: Pressure) -> tuple[AirTemperature, bool]:
        """The static air temperature, and whether it is measured rather than that of the standard atmosphere."""
        settings, older = self.settings, (t for t in reversed(self._temperatures) if t.stamp_ns < impact.stamp_ns)
        probe = next(older, None)  # the one before: that of the same stamp may come before or after
        if probe is None or impact.stamp_ns - probe.stamp_ns > 1e9 * settings.temperature_timeout_s:
            altitude = atmosphere.pressure_altitude(static.pressure_pa)
            standard = float(atmosphere.temperature(altitude, settings.isa_deviation_k))
            return AirTemperature(impact.stamp_ns, TEMPERATURE, standard, ANY_DAY_K**2), False
        if settings.recovery == 0.0:
            return probe, True
        mach = float(atmosphere.mach_number(impact.pressure_pa, static.pressure_pa))
        return replace(probe, temperature_k=probe.temperature_k / (1.0 + 0.2 * settings.recovery * mach * mach)), True

    def sentence(self) -> str:
        """How it is, for people."""
        if self.latest is None or self.reason:
            return self.reason
        data = self.latest
        day = "" if data.is_measured else f"; {STANDARD_DAY}"
        return f"CAS {data.cas:.1f}, TAS {data.tas:.1f} m/s, Mach {data.mach:.3f}, pressure altitude {data.pressure_altitude:.0f} m{day}"

    def remarks(self) -> dict[str, int]:
        """What there is to say of a recording, with counts."""
        found = {f"{AIR} computed from pressures": self.computed} if self.computed else {}
        found |= {STANDARD_DAY: self.standard_days} if self.standard_days else {}
        return found | {f"{AIR} not computed: {reason}": count for reason, count in sorted(self.rejected.items())}
