"""Attitude and heading reference (AHRS): gyros carry the attitude, other sensors keep it.

The navigator finds the first attitude, bridges holes in the inertial data, carries mean and covariance on the inertial core and gives the
outputs; the filter that ``settings.filter`` names says which aids are used and when: that of :mod:`lowcostnav_ros.navigators.ahrs.full`
weighs everything by a full covariance, those of :mod:`lowcostnav_ros.navigators.ahrs.constant_gain` have the gains of the source, known
before the flight.  An AHRS reports attitude, heading, rates and specific force; it reports no velocity and no position.

``C_true = (I + [phi_n x]) C_est``; see :mod:`lowcostnav_ros.cores.inertial` for the dynamics (Gebre-Egziabher 2004, chapter 4).
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from lowcostnav_ros.aids._hard_iron import HardIronAid
from lowcostnav_ros.aids.airdata import AIRDATA
from lowcostnav_ros.aids.gps import GPS_VELOCITY
from lowcostnav_ros.aids.gps_attitude import GPS_ATTITUDE
from lowcostnav_ros.aids.level import LEVEL
from lowcostnav_ros.aids.magnetic import MAGNETIC, MagneticSettings
from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import (
    AirVelocity,
    Attitude,
    GpsPosition,
    GpsVelocity,
    ImuBlock,
    MagneticField,
    Measurement,
    NavSolution,
)
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.imu_errors import bias_blocks, core_block
from lowcostnav_ros.cores.inertial import ATT, CORE, GAP_NS, InertialCore
from lowcostnav_ros.estimation.aiding import Aid
from lowcostnav_ros.estimation.cross_checks.axes import UPSIDE_DOWN, AxesCheck
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.estimation.inertial_spikes import Jolt
from lowcostnav_ros.navigators.ahrs.against_vectors import AgainstVectors
from lowcostnav_ros.navigators.ahrs.filter import IMU
from lowcostnav_ros.navigators.ahrs.settings import FILTERS, AhrsOwnSettings
from lowcostnav_ros.navigators.attitude_watch import AttitudeWatch
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.recovery import turned_by
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.navigators.settings import kind_of, listed
from lowcostnav_ros.navigators.silent_axes import SilentAxes
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.magnetic_heading import FieldAtPlace, MagneticReference
from lowcostnav_ros.physics.rotation import euler_jacobian_n, quat_to_euler, wrap
from lowcostnav_ros.starts.attitude_core import begin_core, hold_position, sensor_rows
from lowcostnav_ros.starts.first_attitude import Alignment, FirstAttitude

FIX = "gps/fix"
HEADING_TIMEOUT_S = 5.0
POSITION_HELD_NS = 10_000_000_000
FAR = 0.01
"""Change of latitude or longitude, rad, at which no aircraft flies from one fix to the next; such a place must last for that time."""
NUMBERS = {GpsVelocity: ("vel_n", "cov_n"), AirVelocity: ("vel_b", "cov_b"), Attitude: ("q_nb", "cov_att"), MagneticField: ("field_b",)}
"""What of a measurement must be finite.  The aids see to it, too, but the first attitude and the reset of a velocity use no aid."""


@navigator
class Ahrs(Navigator):
    """Attitude and heading reference; see the module head.

    Modes: ``initialising`` (no data), ``aligning``, ``calibrating`` (with GPS: the gyro biases converge), ``coasting`` (airspeed,
    steady flight or magnetometer), ``gyro_only``, ``failed`` (wrong unit at the start, or a tilt sigma past the limit).

    Attributes
    ----------
    filter : Filter
    core : InertialCore
    layout : Layout
    magnetic : FieldAtPlace
        The magnetic field expected at the place last known.
    """

    name = "ahrs"
    colour = "#b4579a"
    outputs = ("imu/data", "imu/data_fused")
    not_observable = "it takes position, velocity and acceleration from outside its filter; study ins_gps, which estimates them"
    inertial = IMU
    on_grid = True
    tries_headings = tries_any_heading = False
    fix_word = "GPS"
    OwnSettings = AhrsOwnSettings
    sensors = (
        GPS_VELOCITY.but(latency_s=0.0),
        MAGNETIC.but(noise_deg=0.8, hard_iron_ut=0.1, hard_iron_walk_ut_rts=0.0),  # believed until it is contradicted
        AIRDATA,
        LEVEL,
        GPS_ATTITUDE.but(enabled=False),
    )
    required = (IMU,)

    def __init__(self, settings: Any, stations: Any = None) -> None:
        self._kind = FILTERS[settings.filter]
        self.needs = self._kind.needs
        if "gps_attitude" in self.needs and "gps_attitude" in settings.aids:
            settings = replace(settings, gps_attitude=replace(settings.gps_attitude, enabled=True))
        super().__init__(settings, stations)
        layout = Layout([core_block(settings.imu), *bias_blocks(settings.imu), *self.aid_blocks()])
        self._attach(layout, InertialCore(layout))
        field, heading, air = getattr(settings, "magnetic", MagneticSettings()), self.aid("magnetic_heading"), self.aid("airdata")
        self.magnetic = FieldAtPlace(MagneticReference(field.decimal_year, field.declination_deg), settings.place.known())
        for aid in self.aids:
            if hasattr(aid, "reference"):
                aid.reference = self.magnetic
        heading_deg = None if heading is None else heading.settings.noise_deg
        slowest_mps = None if air is None else air.settings.minimum_mps
        self.alignment = Alignment(settings.alignment, settings.imu, settings.level, heading_deg, slowest_mps)
        self.filter, self.axes, self.against_vectors = self._kind(self), AxesCheck(IMU), AgainstVectors(self)
        self.silent = SilentAxes(self)
        self.attitude_watch = AttitudeWatch(self) if self._kind.is_full else None
        self._restart()

    # its list ----------------------------------------------------------------------------------------------------------------

    def own_inputs(self) -> tuple[str, ...]:
        """The IMU, and a position for declination, gravity and the earth's rate."""
        return IMU, FIX

    def wants(self, key: str) -> bool:
        """What its filter has a use for."""
        return kind_of(key) not in self._kind.unused

    def _connect(self, aids: list[Aid]) -> None:
        made = [(form, aid.source) for aid in aids for form in self._kind.forms(aid, self.settings)]
        for form, source in made:
            form.source = source
        super()._connect([form for form, _ in made])

    def applies(self, aid: Aid, measurement: Measurement) -> bool:
        """As its filter rules."""
        return self.filter.applies(aid, measurement)

    def use_aid(self, aid: Aid, measurement: Measurement) -> bool:
        """As every navigator, with the covariance brought to the time of the mean first."""
        self.core.settle()
        self.filter.before(aid, measurement)
        watch = self.attitude_watch
        is_watched = watch is not None and watch.before(aid)
        used = super().use_aid(aid, measurement)
        if watch is not None and is_watched:
            watch.after(aid, measurement, used=used)
        self.against_vectors.take(aid, measurement)
        if used and not isinstance(aid, HardIronAid):
            self.filter.used_ns[kind_of(aid.key)] = measurement.stamp_ns
        return used

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether GPS holds the solution."""
        return self.filter.gps_good(stamp_ns)

    # measurements ------------------------------------------------------------------------------------------------------------

    def contradictions(self) -> tuple[Contradiction, ...]:
        """As every navigator; and of the IMU with gravity, of its gyros with what else shows the attitude."""
        watched = () if self.attitude_watch is None else self.attitude_watch.held
        own = [held for held in (self.axes.held, self.silent.held, self.against_vectors.held, *watched) if held is not None]
        return (*super().contradictions(), *own)

    def doubt(self, stamp_ns: int) -> np.ndarray:
        """As every navigator; of an attitude that may be upside down nothing is known, of one that is contradicted what that shows."""
        doubt, sigmas = super().doubt(stamp_ns), self.against_vectors.sigmas(stamp_ns)
        if self.attitude_watch is not None:
            tilt, heading, _ = self.attitude_watch.moved().tolist()
            sigmas = np.hypot(sigmas, [tilt, tilt, heading])
        if self.axes.held is None and not sigmas.any():
            return doubt
        doubt = doubt.copy()
        doubt[ATT, ATT] += UPSIDE_DOWN if self.axes.held is not None else np.diag(sigmas**2)
        return doubt

    def widen(self, least: np.ndarray) -> None:
        """Raise sigmas to those of ``least`` (n,)."""
        self.core.widen(least)

    def led_one_way(self, stamp_ns: int) -> None:
        """Nothing more: what GPS corrects one way is less well known, and named."""

    def turned(self, stamp_ns: int, apart: float) -> np.ndarray:
        """Sigmas (n,) of gyros that have turned the heading by ``apart``, rad, beyond what wind explains."""
        return turned_by(self.layout, apart)

    def correct(self, dx: np.ndarray) -> None:
        """As every navigator; what goes one way is watched."""
        super().correct(dx)
        if self.attitude_watch is not None:
            self.attitude_watch.note(dx)

    def _restart(self) -> None:
        self._aligned = False
        self.axes.clear()
        self.silent.clear()
        self._forget_doubts()
        self._imu_ns: int | None = None
        self.filter.used_ns = {}
        self._position_held_ns = -(10**18)
        self._far_since_ns: int | None = None
        self._kept: tuple[np.ndarray, np.ndarray] | None = None
        self.restart_channels()
        self.core.rest()
        self.alignment.restart(None)

    def _forget_doubts(self) -> None:
        """The attitude begins anew."""
        self.against_vectors.clear()
        if self.attitude_watch is not None:
            self.attitude_watch.clear()

    def _in_body_axes(self, block: ImuBlock) -> ImuBlock:
        """As every navigator; without the centripetal force of an IMU away from base_link, sample by sample."""
        block, arm_b = super()._in_body_axes(block), self.settings.imu.lever_arm_m
        if not any(arm_b):
            return block
        rate_b = block.angular_rate_b
        return replace(block, specific_force_b=block.specific_force_b - np.cross(rate_b, np.cross(rate_b, np.array(arm_b, dtype=float))))

    def moves(self, measurement: Measurement) -> bool:
        """As every navigator: all of them do while it aligns, and a position at all times."""
        return not self._aligned or isinstance(measurement, GpsPosition) or self.is_wanted(measurement)

    def _fuse(self, item: Measurement) -> None:
        if isinstance(item, ImuBlock):
            self._run(item)
        elif isinstance(item, GpsPosition):
            self._take_place(item)
        elif self._imu_ns != item.stamp_ns:
            self.input_status[item.source].reject("inertial data missing")
        elif not all(np.isfinite(getattr(item, name)).all() for name in NUMBERS.get(type(item), ())):
            self.input_status[item.source].reject("not finite")
        elif not self._aligned and self.trust.excludes(item):
            pass
        elif not self._aligned:
            if isinstance(item, MagneticField):
                self.magnetic.follow(item.stamp_ns)
            self._start(self.alignment.take(item, self.magnetic.known()))
        else:
            self.use(item)
            self._judge()

    def _take_place(self, fix: GpsPosition) -> None:
        """A position serves declination, gravity and the earth's rate; it is not fused."""
        if not (abs(fix.lat) < 0.5 * math.pi and math.isfinite(fix.lon) and math.isfinite(fix.height)):
            self.input_status[fix.source].reject("not a place on earth")
            return
        if self._leaps(fix):
            return
        self.magnetic.place = (fix.lat, fix.lon, fix.height)
        if self._aligned:
            hold_position(self.core, self.magnetic.place)

    def _leaps(self, fix: GpsPosition) -> bool:
        """Whether a fix is far from the place held, and not yet for long."""
        place = self.magnetic.place
        is_near = place is None or max(abs(fix.lat - place[0]), abs(wrap(fix.lon - place[1]))) < FAR
        self._far_since_ns = None if is_near else self._far_since_ns or fix.stamp_ns
        return self._far_since_ns is not None and fix.stamp_ns - self._far_since_ns < POSITION_HELD_NS

    def _run(self, block: ImuBlock) -> None:
        block, start = self._finite(block), 0
        self.trust.witness.take(block)
        while start < len(block):
            if self._in_gap(block, start):
                start += 1
            elif self._aligned:
                start = self._advance(block, start)
            else:
                start = self._align(block, start)

    def _finite(self, block: ImuBlock) -> ImuBlock:
        if math.isfinite(block.specific_force_b.sum() + block.angular_rate_b.sum()):  # one number that is none spoils the sum
            return block
        good = np.isfinite(block.specific_force_b).all(axis=1) & np.isfinite(block.angular_rate_b).all(axis=1)
        self.input_status[IMU].reject("not finite")
        return block[good]

    def _in_gap(self, block: ImuBlock, start: int) -> bool:
        """Whether the sample at ``start`` ends a hole in the inertial data; if so, align anew, keeping the sensor biases.

        A hole's sample always comes whole: the horizon splits none that stands for so long.
        """
        end = int(block.stamps_ns[start])
        if self._imu_ns is None or end - self._imu_ns <= GAP_NS:
            return False
        if self._aligned:
            self._realign("inertial gap", f"inertial data missing for {1e-9 * (end - self._imu_ns):.1f} s")
        self._imu_ns = end
        self.alignment.restart(end, self.reason)
        return True

    def _realign(self, kind: str, reason: str) -> None:
        self.restarts[kind] += 1
        sensors = sensor_rows(self.core)
        self._kept = (self.core.estimate[sensors].copy(), self.P[sensors, sensors].copy())
        self._aligned = False
        self.trust.forget_state()
        self._forget_doubts()
        self.mode, self.reason = Mode.ALIGNING, reason

    # alignment ---------------------------------------------------------------------------------------------------------------

    def _align(self, block: ImuBlock, start: int) -> int:
        following = self.alignment.gather(block, start)
        self._imu_ns = int(block.stamps_ns[following - 1])
        self._start(self.alignment.unaided(self.magnetic.known()))
        return following

    def _start(self, first: FirstAttitude | None) -> None:
        """Begin to navigate when the alignment has an attitude; else report what it waits for."""
        if first is None:
            self.mode = Mode.FAILED if self.alignment.wrong_unit else Mode.ALIGNING
            self.reason = self.alignment.reason
            return
        floor_mps = max((getattr(own, "velocity_floor_mps", 0.0) for _, own in listed(self.settings)), default=0.0)
        imu = self._seen() if self._kept is None else None
        if imu is not None and imu != self.settings.imu:
            self.settings = replace(self.settings, imu=imu)
            layout = Layout([core_block(imu), *bias_blocks(imu), *self.aid_blocks()])
            self._attach(layout, InertialCore(layout))
        begin_core(self.core, first, self.magnetic.place, self._kept, self.settings.alignment.track_speed_mps, floor_mps)
        self._aligned, self._kept = True, None
        self.axes.begin(first.t_ns, -STANDARD_GRAVITY * float(self.core.C_nb()[2, 2]))
        self.restart_channels()
        if self.offsets is not None:
            self.offsets.restart()
        began_with = {"level": True, "gps": first.gps is not None, "airdata": first.air is not None, "magnetic": first.is_magnetic}
        self.filter.used_ns = {sensor: first.t_ns for sensor, was_used in began_with.items() if was_used}
        self.filter.begin(first.t_ns)
        self._judge()

    # navigation --------------------------------------------------------------------------------------------------------------

    def _advance(self, block: ImuBlock, start: int) -> int:
        before = self.core.t_ns
        following = self.core.advance(block, start, self.output_period_ns)
        self.filter.follow(block, start, following)
        self._imu_ns = self.core.t_ns
        self.core.note(block, following - 1)
        if self.core.t_ns // self.output_period_ns != before // self.output_period_ns:
            self._tick()
            if self._aligned:
                self.publish(self._solution(self.core.t_ns, self.core.nav, self.P, self.core.force_b, self.core.rate_b))
        return following

    def _tick(self) -> None:
        """At every output: what the filter does in steady flight, and the mode."""
        now, nav = self.core.t_ns, self.core.nav
        self.axes.take(now, float(self.core.force_b[2]))
        if not (np.isfinite(nav).all() and np.isfinite(self.P[ATT, ATT]).all()):
            self._realign("state not finite", "state not finite")
            self._kept = None
            self.alignment.restart(now, self.reason)
            return
        if now - self._position_held_ns >= POSITION_HELD_NS:
            self._position_held_ns = now
            hold_position(self.core, self.magnetic.place)
        self.silent.look(now)
        self.filter.keep(now)
        for channel in self.clocked:
            self.use_channel(channel, Measurement(now, IMU))
        self.trust.look(now)
        self._judge()

    def _disturb(self, jolt: Jolt) -> None:
        """As every navigator, once aligned."""
        if self._aligned:
            self.trust.witness.disturb(jolt, self.core.t_ns)
            self.core.disturb(jolt.kick, jolt.variance)
            if jolt.silent is not None:
                self.silent.take(self.core.t_ns, jolt.silent)

    # outputs -----------------------------------------------------------------------------------------------------------------

    def _judge(self) -> None:
        """Keep mode and reason in step with what was fused."""
        doubt, limit = self.doubt(self.core.t_ns), self.settings.failed_tilt_deg
        tilt_sigma_deg = math.sqrt(max(self.P[6, 6] + doubt[6, 6], self.P[7, 7] + doubt[7, 7], 0.0)) / DEGREE
        if tilt_sigma_deg > limit:
            self.mode, self.reason = Mode.FAILED, f"roll or pitch sigma {tilt_sigma_deg:.0f} deg is above {limit:.0f} deg"
        else:
            has_heading = self.filter.fresh("magnetic", self.core.t_ns, HEADING_TIMEOUT_S)
            self.mode, self.reason = self.filter.mode(self.core.t_ns, "" if has_heading else ", no magnetic heading")
            if self.trust.suspects_gps:
                self.mode, self.reason = Mode.SUSPECT, self.trust.suspicion()

    def _predict(self) -> NavSolution | None:
        if not self._aligned:
            return None
        block = self.ahead()
        return self._solution(*self.core.predicted(block), *self.core.latest(block))

    def _solution(self, t_ns: int, nav: np.ndarray, P: np.ndarray, force_b: np.ndarray, rate_b: np.ndarray) -> NavSolution:
        last = "heading_bias" if "heading_bias" in self.layout else "gyro_bias"
        return NavSolution(
            stamp_ns=int(t_ns),
            source=self.name,
            q_nb=nav[6:10].copy(),
            angular_rate_b=rate_b,
            specific_force_b=force_b,
            cov_att=P[ATT, ATT] + self.doubt(t_ns)[ATT, ATT],
            mode=self.mode,
            states=self._states(P, CORE, self.layout[last].stop),
        )

    def _sigmas(self) -> dict[str, float]:
        if not self._aligned:
            return {}
        J = euler_jacobian_n(*quat_to_euler(self.core.nav[6:10]))
        P = self.P[ATT, ATT] + self.doubt(self.core.t_ns)[ATT, ATT]
        euler = np.sqrt(np.maximum(np.diag(J @ P @ J.T), 0.0)) / DEGREE
        bias = np.sqrt(np.diag(self.P)[self.layout["gyro_bias"]].max()) / DEGREE
        return {"roll_deg": float(euler[0]), "pitch_deg": float(euler[1]), "heading_deg": float(euler[2]), "gyro_bias_dps": float(bias)}


AhrsSettings = Ahrs.Settings
