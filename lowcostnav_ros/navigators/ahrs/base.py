"""Attitude and heading reference (AHRS): gyros carry the attitude, other sensors keep it.

This is what all its filters share: the first attitude, holes in the inertial data, the inertial core that carries mean and covariance,
outputs and modes.  The filter is a setting: :class:`~lowcostnav_ros.navigators.ahrs.full.FullAhrs` weighs everything by a full
covariance, :class:`~lowcostnav_ros.navigators.ahrs.constant_gain.ConstantGainAhrs` is the family of the source, with constant gains
that are known before the flight.  An AHRS owes attitude, heading, rates and specific force; it reports no velocity and no position.

``C_true = (I + [phi_n x]) C_est``; see :mod:`lowcostnav_ros.cores.inertial` for the dynamics (Gebre-Egziabher 2004, chapter 4).
"""

import math

import numpy as np

from lowcostnav_ros.aids.ins_gps_aids import MagneticAid
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
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import ATT, CORE, GAP_NS, VEL, InertialCore
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Block, Layout
from lowcostnav_ros.navigators.ahrs.settings import FULL, AhrsSettings
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.physics.magnetic_heading import FieldAtPlace, MagneticReference
from lowcostnav_ros.physics.rotation import euler_jacobian_n, quat_to_euler
from lowcostnav_ros.starts.attitude_core import begin_core, configured_place, hold_position
from lowcostnav_ros.starts.first_attitude import DECLINATION_UNKNOWN, Alignment, FirstAttitude

IMU, MAG, VELOCITY, FIX, AIR, ATTITUDE = "imu/data_raw", "imu/mag", "gps/vel", "gps/fix", "air/velocity", "gps/attitude"
HEADING_TIMEOUT_NS = 5_000_000_000
LEVEL_TIMEOUT_NS = 5_000_000_000
HELD_VELOCITY_SIGMA = 0.01
POSITION_HELD_NS = 10_000_000_000
NEVER = -(10**18)


def rows_of(block: ImuBlock, rows: slice | np.ndarray) -> ImuBlock:
    """Some rows of a block; its head stamp stays, so that no rows at all are a block too."""
    return ImuBlock(block.stamp_ns, block.source, block.stamps_ns[rows], block.specific_force_b[rows], block.angular_rate_b[rows])


def is_finite(item: GpsVelocity | AirVelocity | MagneticField | Attitude) -> bool:
    """Whether a vector measurement and its covariance are numbers."""
    if isinstance(item, GpsVelocity):
        return bool(np.isfinite(item.vel_n).all() and np.isfinite(item.cov_n).all())
    if isinstance(item, AirVelocity):
        return bool(np.isfinite(item.vel_b).all() and np.isfinite(item.cov_b).all())
    if isinstance(item, Attitude):
        return bool(np.isfinite(item.q_nb).all() and np.isfinite(item.cov_att).all())
    return bool(np.isfinite(item.field_b).all())


def unbroken(block: ImuBlock) -> list[ImuBlock]:
    """The block cut before every sample that comes after a hole in the data."""
    if len(block) == 0 or block.stamps_ns[-1] - block.stamps_ns[0] <= GAP_NS:
        return [block]
    cuts = np.flatnonzero(np.diff(block.stamps_ns) > GAP_NS) + 1
    if not len(cuts):
        return [block]
    return [rows_of(block, slice(a, b)) for a, b in zip([0, *cuts], [*cuts, len(block)], strict=True)]


@navigator
class Ahrs(Navigator):
    """Attitude and heading reference; made with settings, it is the filter that ``settings.filter`` names.

    Modes: ``initialising`` (no data), ``aligning``, ``calibrating`` (GPS is heard: the gyro biases converge), ``coasting`` (airspeed,
    steady flight or magnetometer), ``gyro_only``, ``failed`` (wrong unit at the start, or a tilt sigma past the limit).

    A filter gives ``inputs``, ``aids`` and the verbs ``_blocks``, ``_begun``, ``_follow``, ``_keep``, ``_aid`` and ``_mode``.
    """

    name = "ahrs"
    Settings = AhrsSettings
    colour = "#b4579a"
    outputs = ("imu/data", "imu/data_fused")
    not_observable = "it is told position, velocity and acceleration from outside its filter; watch ins_gps, which estimates them"
    inertial = IMU

    def __new__(cls, settings: AhrsSettings) -> "Ahrs":
        """Choose the filter, as ``pathlib.Path`` chooses the flavour of a path."""
        if cls is Ahrs:
            from lowcostnav_ros.navigators.ahrs.constant_gain import ConstantGainAhrs  # the filters import this module
            from lowcostnav_ros.navigators.ahrs.full import FullAhrs

            cls = FullAhrs if settings.filter == FULL else ConstantGainAhrs
        return super().__new__(cls)

    def __init__(self, settings: AhrsSettings) -> None:
        super().__init__(settings, latency_s=settings.gps.latency_s)
        self.layout = Layout(self._blocks(settings))
        self.core = InertialCore(self.layout)
        reference = MagneticReference(settings.magnetic.decimal_year, settings.magnetic.declination_deg)
        self.magnetic = FieldAtPlace(reference, configured_place(settings.place))
        self.magnetic_aid = MagneticAid(settings.magnetic)
        self.alignment = Alignment(settings)
        self._restart()

    # what aids ask of their host ---------------------------------------------------------------------------------------------

    @property
    def P(self) -> np.ndarray:
        """Covariance of the whole error state."""
        return self.core.P

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (an aid calls this)."""
        self.core.correct(dx)

    # what each filter has of its own -----------------------------------------------------------------------------------------

    @staticmethod
    def _blocks(settings: AhrsSettings) -> list[Block]:
        """Blocks of the error state, the inertial core first."""
        raise TypeError("Make an Ahrs, not a part of one.")

    # measurements ------------------------------------------------------------------------------------------------------------

    def _restart(self) -> None:
        self._aligned = False
        self._imu_ns: int | None = None
        self._gps_ns = self._air_ns = self._magnetic_ns = self._steady_ns = self._attitude_ns = NEVER
        self._tried_air_ns = self._tried_magnetic_ns = self._position_held_ns = NEVER
        self.level_since_ns: int | None = None
        self.rate_b, self.force_b = np.zeros(3), np.zeros(3)
        self._kept: tuple[np.ndarray, np.ndarray] | None = None
        self.alignment.restart(None)

    def _fuse(self, item: Measurement) -> None:
        if isinstance(item, ImuBlock):
            self._run(item)
        elif isinstance(item, GpsPosition):
            self._take_place(item)
        elif self._imu_ns != item.stamp_ns:
            self.input_status[item.source].reject("inertial data missing")
        elif not is_finite(item):
            self.input_status[item.source].reject("not finite")
        elif not self._aligned:
            self._prepare(item)
        else:
            self._aid(item)
            self._judge()

    def _take_place(self, fix: GpsPosition) -> None:
        """A position serves declination, gravity and the earth's rate; it is not fused."""
        if not (abs(fix.lat) < 0.5 * math.pi and math.isfinite(fix.lon) and math.isfinite(fix.height)):
            self.input_status[FIX].reject("not a place on earth")
            return
        self.magnetic.place = (fix.lat, fix.lon, fix.height)
        if self._aligned:
            hold_position(self.core, self.magnetic.place)

    def _run(self, block: ImuBlock) -> None:
        for part in unbroken(self._finite(block)):
            start = 0
            while start < len(part):
                if self._in_gap(part, start):
                    start += 1
                elif self._aligned:
                    start = self._advance(part, start)
                else:
                    start = self._align(part, start)

    def _finite(self, block: ImuBlock) -> ImuBlock:
        if math.isfinite(block.specific_force_b.sum() + block.angular_rate_b.sum()):  # one number that is none spoils the sum
            return block
        good = np.isfinite(block.specific_force_b).all(axis=1) & np.isfinite(block.angular_rate_b).all(axis=1)
        self.input_status[IMU].reject("not finite")
        return rows_of(block, good)

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
        sensors = slice(CORE, self.layout["gyro_bias"].stop)
        self._kept = (self.core.estimate[sensors].copy(), self.P[sensors, sensors].copy())
        self._aligned = False
        self.mode, self.reason = "aligning", reason

    # alignment ---------------------------------------------------------------------------------------------------------------

    def _align(self, block: ImuBlock, start: int) -> int:
        following = self.alignment.gather(block, start)
        self._imu_ns = int(block.stamps_ns[following - 1])
        self._start(self.alignment.unaided(self.magnetic.known()))
        return following

    def _prepare(self, item: Measurement) -> None:
        if isinstance(item, MagneticField):
            self.alignment.magnetic(item)
        elif isinstance(item, Attitude):
            self._start(self.alignment.attitude(item))
        elif isinstance(item, GpsVelocity):
            self._start(self.alignment.gps(item, self.magnetic.known()))
        elif isinstance(item, AirVelocity) and self.settings.airflow.enabled:
            self._start(self.alignment.air(item, self.magnetic.known()))

    def _start(self, first: FirstAttitude | None) -> None:
        """Begin to navigate when the alignment has an attitude; else say what it waits for."""
        if first is None:
            self.mode = "failed" if self.alignment.wrong_unit else "aligning"
            self.reason = self.alignment.reason
            return
        begin_core(self.core, self.settings, first, self.magnetic.place, self._kept)
        self._aligned, self._kept = True, None
        self._gps_ns = first.t_ns if first.gps is not None else NEVER
        self._air_ns = first.t_ns if first.air is not None else NEVER
        self._magnetic_ns = first.t_ns if first.is_magnetic else NEVER
        self._attitude_ns = NEVER
        self._steady_ns = first.t_ns
        self.level_since_ns = None
        self._begun(first.t_ns)
        self._judge()

    # navigation --------------------------------------------------------------------------------------------------------------

    def _advance(self, block: ImuBlock, start: int) -> int:
        before = self.core.t_ns
        following = self.core.advance(block, start, self.output_period_ns)
        self._follow(block, start, following)
        self._imu_ns = self.core.t_ns
        self.force_b, self.rate_b = self.core.corrected(block.specific_force_b[following - 1], block.angular_rate_b[following - 1])
        if self.core.t_ns // self.output_period_ns != before // self.output_period_ns:
            self._tick()
            if self._aligned:
                self._out.append(self._solution(self.core.t_ns, self.core.nav[6:10], self.force_b, self.rate_b))
        return following

    def _tick(self) -> None:
        """At every output: what the filter does in steady flight, and the mode."""
        now, nav = self.core.t_ns, self.core.nav
        if not (np.isfinite(nav).all() and np.isfinite(self.P[ATT, ATT]).all()):
            self._realign("state not finite", "state not finite")
            self._kept = None
            self.alignment.restart(now, self.reason)
            return
        if now - self._position_held_ns >= POSITION_HELD_NS:
            self._position_held_ns = now
            hold_position(self.core, self.magnetic.place)
        self._keep(now)
        self._judge()

    def _hold_velocity(self, now: int) -> None:
        """Without any measure of velocity, count it from zero: only its change over the next span matters."""
        self.core.settle()
        self.core.nav[VEL] = 0.0
        kalman.reset_block(self.P, VEL, np.eye(3) * HELD_VELOCITY_SIGMA**2)
        self.level_since_ns = now

    def _aid_magnetic(self, item: MagneticField) -> None:
        if item.stamp_ns - self._tried_magnetic_ns < 1e9 * self.settings.magnetic.period_s - 1e6:
            return
        self._tried_magnetic_ns = item.stamp_ns
        if self.magnetic.known() is None:
            self.magnetic_aid.status.accepted, self.magnetic_aid.status.reason = False, DECLINATION_UNKNOWN
            return
        self.core.settle()
        if self.use_aid(self.magnetic_aid, item):
            self._magnetic_ns = item.stamp_ns

    # outputs -----------------------------------------------------------------------------------------------------------------

    def _judge(self) -> None:
        """Keep mode and reason in step with what was fused."""
        tilt_sigma_deg = math.sqrt(max(self.P[6, 6], self.P[7, 7], 0.0)) / DEGREE
        if tilt_sigma_deg > self.settings.failed_tilt_deg:
            limit = self.settings.failed_tilt_deg
            self.mode, self.reason = "failed", f"roll or pitch sigma {tilt_sigma_deg:.0f} deg is past {limit:.0f} deg"
        else:
            has_heading = self.core.t_ns - self._magnetic_ns <= HEADING_TIMEOUT_NS
            self.mode, self.reason = self._mode(self.core.t_ns, has_heading)

    def _predict(self) -> NavSolution | None:
        if not self._aligned:
            return None
        block, _ = self.horizon.ahead()
        t_ns, nav = self.core.predicted(block)
        if block is None:
            return self._solution(t_ns, nav[6:10], self.force_b, self.rate_b)
        return self._solution(t_ns, nav[6:10], *self.core.corrected(block.specific_force_b[-1], block.angular_rate_b[-1]))

    def _solution(self, t_ns: int, q_nb: np.ndarray, force_b: np.ndarray, rate_b: np.ndarray) -> NavSolution:
        sigma = np.sqrt(np.maximum(np.diag(self.P), 0.0))
        reported = range(CORE, self.layout["heading_bias"].stop if "heading_bias" in self.layout else self.layout["gyro_bias"].stop)
        states = {self.layout.labels[i]: (float(self.core.estimate[i]), float(sigma[i])) for i in reported}
        return NavSolution(
            stamp_ns=int(t_ns),
            source=self.name,
            q_nb=q_nb.copy(),
            angular_rate_b=rate_b,
            specific_force_b=force_b,
            cov_att=self.P[ATT, ATT].copy(),
            mode=self.mode,
            states=states,
        )

    def _sigmas(self) -> dict[str, float]:
        if not self._aligned:
            return {}
        J = euler_jacobian_n(*quat_to_euler(self.core.nav[6:10]))
        euler = np.sqrt(np.maximum(np.diag(J @ self.P[ATT, ATT] @ J.T), 0.0)) / DEGREE
        bias = np.sqrt(np.diag(self.P)[self.layout["gyro_bias"]].max()) / DEGREE
        return {"roll_deg": float(euler[0]), "pitch_deg": float(euler[1]), "heading_deg": float(euler[2]), "gyro_bias_dps": float(bias)}
