"""GPS/INS: an error-state extended Kalman filter around a strapdown mechanisation, loosely coupled.

Fifteen states (core nine, accelerometer and gyro biases) with GPS position and velocity; blocks for scale factors, baro, magnetic
heading, wind, airspeed and the receiver's slow error come and go by settings.  While GPS is good the air data teaches the wind and
moves nothing else; in an outage it holds the velocity.
"""

from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids.ins_gps_aids import (
    AirDataSettings,
    AirspeedAid,
    BaroAid,
    BaroSettings,
    GpsSettings,
    MagneticAid,
    MagneticSettings,
    PositionAid,
    SideslipAid,
    VelocityAid,
    WheelAid,
    WheelSettings,
)
from lowcostnav_ros.aids.vor import BLOCK as VOR_BIAS
from lowcostnav_ros.aids.vor import BearingState, VorAid, VorSettings
from lowcostnav_ros.aids.vor import bias_blocks as vor_bias_blocks
from lowcostnav_ros.base.measurements import (
    AirVelocity,
    GpsPosition,
    GpsVelocity,
    ImuBlock,
    MagneticField,
    Measurement,
    NavSolution,
    Pressure,
    VorBearing,
)
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerCalibration
from lowcostnav_ros.cores.inertial import ATT, CORE, DEG, GAP_NS, POS, VEL, ImuSettings, InertialCore, bias_blocks, core_block, typical
from lowcostnav_ros.estimation.error_state import Block, Kind, Layout, gauss_markov, random_walk
from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.physics.magnetic_heading import MagneticReference, magnetic_heading
from lowcostnav_ros.physics.rotation import euler_to_quat
from lowcostnav_ros.radionav.stations import StationTable
from lowcostnav_ros.starts.levelling import (
    AlignmentSettings,
    Levelling,
    MasterState,
    agrees_with_track,
    gyrocompass,
    gyrocompass_sigma,
    tilt_from_specific_force,
    transferred,
    unit_error,
)

IMU, FIX, VELOCITY = "imu/data_raw", "gps/fix", "gps/vel"
MAG, PRESSURE, AIR, VOR = "imu/mag", "air/static_pressure", "air/velocity", "vor/bearing"
GRAVITY_N = np.array([0.0, 0.0, -9.80665])
ACCELERATION_SPAN_NS = 2_100_000_000
"""GPS velocities this far apart give the acceleration of an alignment on the move; shorter, their noise tilts it."""


@dataclass(frozen=True)
class InsGpsSettings:
    """All settings of the GPS/INS navigator."""

    horizon: HorizonSettings = group(HorizonSettings)
    imu: ImuSettings = group(ImuSettings)
    split_turn_on: bool = setting(False, "Estimate turn-on biases beside Gauss-Markov drifts (21 or 27 states instead of 15).")
    gps: GpsSettings = group(GpsSettings)
    baro: BaroSettings = group(BaroSettings)
    magnetometer: MagnetometerCalibration = group(MagnetometerCalibration)
    magnetic: MagneticSettings = group(MagneticSettings)
    airdata: AirDataSettings = group(AirDataSettings)
    wheels: WheelSettings = group(WheelSettings)
    vor: VorSettings = group(VorSettings)
    alignment: AlignmentSettings = group(AlignmentSettings)
    failed_sigma_m: float = setting(10000.0, "Horizontal sigma beyond which the solution counts as failed.", unit="m", minimum=10.0)


def chosen_blocks(settings: InsGpsSettings) -> list[Block]:
    """The list of blocks the settings ask for."""
    blocks = [core_block(settings.imu), *bias_blocks(settings.imu, split_turn_on=settings.split_turn_on)]
    if settings.gps.position_bias_m > 0.0:
        labels = [f"gps_position_bias_{axis}_m" for axis in ("north", "east", "down")]
        gps = settings.gps
        blocks.append(gauss_markov("gps_position_bias", labels, Kind.FREE, gps.position_bias_m, gps.position_bias_tau_s))
    if settings.baro.enabled:
        blocks.append(random_walk("baro_bias", ["baro_bias_m"], Kind.FREE, settings.baro.bias_m, settings.baro.walk_m_rts))
    if settings.magnetic.enabled and settings.magnetic.bias_deg > 0.0:
        mag = settings.magnetic
        blocks.append(gauss_markov("heading_bias", ["magnetic_heading_bias_rad"], Kind.FREE, mag.bias_deg * DEG, mag.bias_tau_s))
    if settings.airdata.enabled:
        air = settings.airdata
        wind = ["wind_north_mps", "wind_east_mps"]
        blocks.append(gauss_markov("wind", wind, Kind.WIND, air.wind_mps, air.wind_tau_s, air.wind_start_mps))
        blocks.append(gauss_markov("airspeed_bias", ["airspeed_bias_mps"], Kind.AIRSPEED_BIAS, air.bias_mps, air.bias_tau_s))
    return blocks + vor_bias_blocks(settings.vor)


@navigator
class InsGps(Navigator):
    """GPS/INS navigator; see the module head.

    Modes: ``initialising`` (no data), ``aligning``, ``gps``, ``coasting`` (no accepted fix within the time-out), ``failed``.

    Parameters
    ----------
    settings : InsGpsSettings
    stations : StationTable or None
        Where the VOR stations stand; without it every radial is refused by name.
    behind_s : float
        How far an input that is another navigator's fused solution may be behind the rest, s.
    """

    name = "ins_gps"
    Settings = InsGpsSettings
    colour = "#0072b2"
    inertial = IMU
    inputs = {IMU: True, FIX: True, VELOCITY: True, MAG: False, PRESSURE: False, AIR: False}

    def __init__(self, settings: InsGpsSettings, stations: StationTable | None = None, behind_s: float = 0.0) -> None:
        if settings.vor.enabled:  # few aircraft feed it: who does not ask for it need not see it missing
            self.inputs = {**self.inputs, VOR: False}
        if settings.alignment.master:
            self.inputs = {**self.inputs, settings.alignment.master: False}
        super().__init__(settings, latency_s=settings.gps.latency_s + behind_s)
        self.layout = Layout(self.blocks())
        self.core = InertialCore(self.layout)
        self.magnetic = MagneticReference(settings.magnetic.decimal_year, settings.magnetic.declination_deg)
        self.position_aid, self.velocity_aid = PositionAid(settings.gps), VelocityAid(settings.gps)
        self.baro_aid, self.magnetic_aid = BaroAid(settings.baro), MagneticAid(settings.magnetic)
        self.airspeed_aid, self.sideslip_aid = AirspeedAid(settings.airdata), SideslipAid(settings.airdata)
        self.wheel_aid = WheelAid(settings.wheels)
        self.stations, self.vor_aid = stations, VorAid(settings.vor, stations, self.layout)
        self.aids = [self.position_aid, self.velocity_aid]
        optional = (
            (settings.baro.enabled, [self.baro_aid]),
            (settings.magnetic.enabled, [self.magnetic_aid]),
            (settings.airdata.enabled, [self.airspeed_aid, self.sideslip_aid]),
            (settings.wheels.enabled, [self.wheel_aid]),
            (settings.vor.enabled, [self.vor_aid]),
        )
        self.aids += [aid for enabled, aids in optional if enabled for aid in aids]
        self._air_only, self._vor_only = self.layout.mask("wind", "airspeed_bias"), self.layout.mask(VOR_BIAS)
        self._all_free = np.ones(self.layout.size)
        self.levelling = Levelling(settings.alignment.still_s)
        self._restart()

    def blocks(self) -> list[Block]:
        """The list of state blocks; a navigator with further states overrides it."""
        return chosen_blocks(self.settings)

    @property
    def P(self) -> np.ndarray:
        """Covariance of the whole error state."""
        return self.core.P

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (an aid calls this)."""
        self.core.correct(dx)

    def air_free(self) -> np.ndarray:
        """States the air data may move: wind and airspeed bias while GPS is good, all in an outage."""
        return self._air_only if self.mode == "gps" else self._all_free

    def bearing_state(self) -> BearingState:
        """What the VOR aid asks for; while GPS is good a radial moves the error of its station alone."""
        nav, free = self.core.nav, self._vor_only if self.mode == "gps" else None
        return BearingState((nav[0], nav[1], nav[2]), float(np.hypot(nav[3], nav[4])), self.layout, self.core.estimate, free)

    def wind_sigma(self) -> float:
        """Larger 1-sigma of the two wind components, m/s."""
        rows = self.layout["wind"]
        return float(np.sqrt(np.diag(self.P)[rows].max()))

    def feed(self, measurement: Measurement) -> list[NavSolution]:
        """Take one measurement in, as every navigator does; what the master of a transfer alignment says is no fix."""
        if isinstance(measurement, NavSolution) and measurement.source == self.settings.alignment.master:
            measurement = MasterState(measurement.stamp_ns, measurement.source, measurement)
        return super().feed(measurement)

    def _restart(self) -> None:
        self._aligned = False
        self._no_compass = ""
        self._fix: GpsPosition | None = None
        self._velocities: list[GpsVelocity] = []
        self._field_b: np.ndarray | None = None
        self._emitted = -1
        self._fused_fix_ns: int | None = None
        self._used_ns: dict[str, int] = {}
        self._newest: ImuBlock | None = None
        self.rate_b = np.zeros(3)
        self.force_b = -GRAVITY_N
        self.levelling.clear()

    def _fuse(self, item: Measurement) -> None:
        if isinstance(item, ImuBlock):
            self._run(item)
        elif isinstance(item, MasterState):
            self._transfer(item)
        elif not self._aligned:
            self._prepare(item)
        elif self.core.t_ns != item.stamp_ns:
            self.input_status[item.source].reject("inertial data missing")
        else:
            self.core.settle()
            self._aid(item)
            self._judge()

    def _run(self, block: ImuBlock) -> None:
        gap_ns = block.stamps_ns[0] - self.core.t_ns
        if len(block) > 1:
            gap_ns = max(gap_ns, np.diff(block.stamps_ns).max())
        if self._aligned and gap_ns > GAP_NS:
            self.realign(f"inertial data missing for more than {1e-9 * GAP_NS:.1f} s")
        if not self._aligned:
            self.levelling.add(block)
            return
        start = 0
        while start < len(block):
            start = self.core.advance(block, start, self.output_period_ns)
            epoch = self.core.t_ns // self.output_period_ns
            if epoch != self._emitted:
                self._emitted = epoch
                self._note_sample(block, start - 1)
                if self.settings.wheels.enabled and self._due("wheels", self.core.t_ns, self.settings.wheels.period_s):
                    self.use_aid(self.wheel_aid, Measurement(self.core.t_ns, IMU))
                self._judge()
                self._out.append(self._solution(self.core.t_ns, self.core.nav, self.force_b, self.rate_b))
        self._newest = block

    def _note_sample(self, block: ImuBlock, row: int) -> None:
        """Keep the corrected specific force and rate of a sample: outputs and the lever arm's velocity need them."""
        self.force_b, self.rate_b = self.core.corrected(block.specific_force_b[row], block.angular_rate_b[row])

    def _aid(self, item: Measurement) -> None:
        settings = self.settings
        if isinstance(item, GpsPosition):
            if self._due("fix", item.stamp_ns, settings.gps.period_s) and self.use_aid(self.position_aid, item):
                self._fused_fix_ns = item.stamp_ns
        elif isinstance(item, GpsVelocity):
            if self._due("velocity", item.stamp_ns, settings.gps.period_s):
                if self._newest is not None:
                    self._note_sample(self._newest, -1)
                self.use_aid(self.velocity_aid, item)
        elif isinstance(item, Pressure) and settings.baro.enabled and self._due("baro", item.stamp_ns, settings.baro.period_s):
            self.use_aid(self.baro_aid, item)
        elif isinstance(item, MagneticField) and settings.magnetic.enabled and self._due("mag", item.stamp_ns, settings.magnetic.period_s):
            self.use_aid(self.magnetic_aid, item)
        elif isinstance(item, AirVelocity) and settings.airdata.enabled and self._due("air", item.stamp_ns, settings.airdata.period_s):
            self.use_aid(self.airspeed_aid, item)
            self.use_aid(self.sideslip_aid, item)
        elif isinstance(item, VorBearing) and settings.vor.enabled and self.vor_aid.due(item):
            self.use_aid(self.vor_aid, item)

    def _due(self, what: str, stamp_ns: int, period_s: float) -> bool:
        """Thin a source to one measurement a period: its errors are slow, more would only feign certainty."""
        if stamp_ns - self._used_ns.get(what, -(10**18)) < 1e9 * period_s - 1e6:
            return False
        self._used_ns[what] = stamp_ns
        return True

    def _judge(self) -> None:
        """Keep mode and reason in step with what was fused."""
        now, last = self.core.t_ns, self._fused_fix_ns
        sigma = self._horizontal_sigma()
        if sigma > self.settings.failed_sigma_m:
            self.mode, self.reason = "failed", f"horizontal sigma {sigma:.0f} m is past {self.settings.failed_sigma_m:.0f} m"
        elif last is not None and now - last <= 1e9 * self.settings.gps.timeout_s:
            self.mode, self.reason = "gps", "GPS position accepted"
        else:
            since = 0.0 if last is None else 1e-9 * (now - last)
            why = self.position_aid.status.reason if self.position_aid.status.stamp_ns > now - 3_000_000_000 else "no GPS fix"
            radials = self.vor_aid.heard(now)
            self.mode, self.reason = "coasting", f"{why or 'no GPS fix'} for {since:.0f} s"
            self.reason += f"; VOR {', '.join(radials)}" if radials else ""

    def _horizontal_sigma(self) -> float:
        return float(np.sqrt(max(self.P[0, 0] + self.P[1, 1], 0.0)))

    # alignment ---------------------------------------------------------------------------------------------------------------

    def _prepare(self, item: Measurement) -> None:
        """Gather what alignment needs; align on a GPS velocity."""
        if isinstance(item, MagneticField):
            self._field_b = item.field_b
        elif isinstance(item, GpsPosition):
            self._fix = item
            self.set_origin(item.lat, item.lon, item.height)
        elif isinstance(item, GpsVelocity):
            self._velocities = [v for v in self._velocities if item.stamp_ns - v.stamp_ns <= ACCELERATION_SPAN_NS] + [item]
            self.mode, (self._aligned, self.reason) = "aligning", self._align(self._velocities[0], item)
            if self._aligned:
                self._judge()

    def _align(self, earlier: GpsVelocity, velocity: GpsVelocity) -> tuple[bool, str]:
        """Start the core when an attitude can be had; return whether, and the reason why not."""
        choice = self.settings.alignment
        if self._fix is None or velocity.stamp_ns - self._fix.stamp_ns > 2_000_000_000:
            return False, "waiting for a GPS position"
        speed = float(np.hypot(velocity.vel_n[0], velocity.vel_n[1]))
        still = speed < choice.still_speed_mps
        span_s = choice.still_s if still else 1e-9 * (velocity.stamp_ns - earlier.stamp_ns)
        means = self.levelling.mean(max(span_s, 0.2))
        if means is None:
            return False, "waiting for inertial data"
        wrong = unit_error(*means)
        if wrong:
            return False, wrong
        force_n = GRAVITY_N
        if still:
            if not self.levelling.still(span_s):
                return False, "standing by GPS, but the inertial data moves"
        elif speed < choice.moving_speed_mps:
            return False, f"speed {speed:.1f} m/s: too fast to level, too slow for a track"
        elif span_s < 0.9:
            return False, "waiting for two GPS velocities a second apart"
        else:
            force_n = (velocity.vel_n - earlier.vel_n) / span_s + GRAVITY_N
        heading, sigma = self._first_heading(*means, force_n, velocity, still)
        if heading is None:
            return False, f"levelled; waiting for a heading ({self._no_compass}magnetometer, motion or alignment.heading_deg)"
        self._start(means[0], force_n, heading, sigma, velocity, still)
        return True, ""

    def _first_heading(self, f_b, w_b, force_n, velocity, still: bool) -> tuple[float | None, float]:
        choice, fix = self.settings.alignment, self._fix
        if choice.gyrocompass and still:
            sigma, limits = gyrocompass_sigma(self.layout, fix.lat, choice.still_s)
            if sigma <= choice.gyrocompass_limit_deg * DEG:
                return gyrocompass(f_b, w_b), sigma
            told = f"would be good to {sigma / DEG:.1f} deg" if sigma < np.pi / 2.0 else "would tell nothing"
            self._no_compass = f"gyrocompass refused, it {told}, {limits}; "
        if self.settings.magnetic.enabled and self._field_b is not None:
            reference = self.magnetic.at(fix.lat, fix.lon, fix.height)
            if not reference.refusal(self._field_b):
                heading = 0.0
                for _ in range(5):  # tilt on the move depends on heading, and heading on tilt
                    roll, pitch = tilt_from_specific_force(f_b, force_n, heading)
                    heading = magnetic_heading(roll, pitch, self._field_b, reference.declination)
                return heading, choice.magnetic_sigma_deg * DEG
        track = float(np.arctan2(velocity.vel_n[1], velocity.vel_n[0]))
        if choice.heading_deg and (still or agrees_with_track(choice.heading_deg[0] * DEG, track, choice)):
            return choice.heading_deg[0] * DEG, choice.heading_sigma_deg * DEG
        return (None, 0.0) if still else (track, choice.track_sigma_deg * DEG)

    def begin(self, stamp_ns: int, nav: np.ndarray, core_covariance: np.ndarray) -> None:
        """Start at a state known from elsewhere (transfer alignment): ``nav`` (10,) and the covariance (9, 9) of the core states."""
        self.set_origin(*(float(x) for x in nav[:3]))
        self.core.start(stamp_ns, nav, core_covariance)
        self._emitted = stamp_ns // self.output_period_ns
        self._aligned, self.reason = True, ""

    def _transfer(self, item: MasterState) -> None:
        """Start at the state of the master; once aligned it is not listened to."""
        means = None if self._aligned else self.levelling.mean(0.2)
        if means is None:
            return
        state = transferred(item.solution, self.settings.alignment.master_sigma_deg)
        wrong = unit_error(*means)
        if state is None or wrong:
            self.input_status[item.source].reject(wrong or "no position, velocity or attitude with covariance")
            return
        self.begin(item.stamp_ns, *state)
        self._fused_fix_ns = item.stamp_ns - round(1e9 * self.settings.gps.timeout_s) - 1  # no fix yet: it coasts until there is one
        self._judge()

    def _start(self, f_b, force_n, heading: float, sigma: float, velocity: GpsVelocity, still: bool) -> None:
        fix, choice = self._fix, self.settings.alignment
        roll, pitch = tilt_from_specific_force(f_b, force_n, heading)
        nav = np.array([fix.lat, fix.lon, fix.height, *velocity.vel_n, *euler_to_quat(roll, pitch, heading)])
        lag_s = 1e-9 * (velocity.stamp_ns - fix.stamp_ns)
        accel_sigma = np.hypot(typical(self.settings.imu.accel_turn_on_mg), typical(self.settings.imu.accel_bias_mg)) * 1e-3
        tilt = np.hypot(accel_sigma, (0.2 if still else choice.tilt_sigma_deg) * DEG)
        cov = np.zeros((CORE, CORE))
        cov[POS, POS] = fix.cov_n + np.eye(3) * (0.5 + (lag_s * np.linalg.norm(velocity.vel_n)) ** 2)
        cov[VEL, VEL] = velocity.cov_n + np.eye(3) * 0.1**2
        cov[ATT, ATT] = np.diag([tilt**2, tilt**2, sigma**2])
        self.begin(velocity.stamp_ns, nav, cov)
        self._fused_fix_ns = fix.stamp_ns

    # outputs -----------------------------------------------------------------------------------------------------------------

    def _predict(self) -> NavSolution | None:
        if not self._aligned:
            return None
        block, _ = self.horizon.ahead()
        t_ns, nav = self.core.predicted(block)
        block = self._newest if block is None else block
        if block is None:
            return self._solution(t_ns, nav, self.force_b, self.rate_b)
        return self._solution(t_ns, nav, *self.core.corrected(block.specific_force_b[-1], block.angular_rate_b[-1]))

    def _solution(self, t_ns: int, nav: np.ndarray, force_b: np.ndarray, rate_b: np.ndarray) -> NavSolution:
        P, estimate, layout = self.P, self.core.estimate, self.layout
        wind = layout.get("wind")
        sigma = np.sqrt(np.maximum(np.diag(P), 0.0))
        states = {layout.labels[i]: (float(estimate[i]), float(sigma[i])) for i in range(CORE, layout.size)}
        return NavSolution(
            stamp_ns=int(t_ns),
            source=self.name,
            lat=float(nav[0]),
            lon=float(nav[1]),
            height=float(nav[2]),
            vel_n=nav[3:6].copy(),
            q_nb=nav[6:10].copy(),
            angular_rate_b=rate_b,
            specific_force_b=force_b,
            cov_pos=P[POS, POS].copy(),
            cov_vel=P[VEL, VEL].copy(),
            cov_att=P[ATT, ATT].copy(),
            wind_n=None if wind is None or not self.airspeed_aid.status.fused else estimate[wind].copy(),
            cov_wind=None if wind is None or not self.airspeed_aid.status.fused else P[wind, wind].copy(),
            mode=self.mode,
            states=states,
        )

    def _sigmas(self) -> dict[str, float]:
        if not self._aligned:
            return {}
        s = np.sqrt(np.maximum(np.diag(self.P), 0.0))
        return {
            "position_horizontal_m": float(np.hypot(s[0], s[1])),
            "position_down_m": float(s[2]),
            "velocity_horizontal_mps": float(np.hypot(s[3], s[4])),
            "tilt_deg": float(np.hypot(s[6], s[7]) / DEG),
            "heading_deg": float(s[8] / DEG),
        }
