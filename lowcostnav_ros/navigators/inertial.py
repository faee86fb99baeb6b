"""What all inertial navigators with an error-state filter share: the strapdown core, the way of measurements to aids, modes, outputs."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lowcostnav_ros.aids.airdata import AirDataAid
from lowcostnav_ros.aids.gps import VelocityAid
from lowcostnav_ros.aids.magnetic import MagneticAid
from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, ImuBlock, Measurement, NavSolution
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.calibration.magnetometer_fit import MagnetometerCalibration
from lowcostnav_ros.cores import rows
from lowcostnav_ros.cores.imu_errors import ImuSettings, bias_blocks, core_block
from lowcostnav_ros.cores.inertial import ATT, CORE, GAP_NS, POS, VEL, InertialCore
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision, Reason
from lowcostnav_ros.estimation.cross_checks.axes import UPSIDE_DOWN, AxesCheck
from lowcostnav_ros.estimation.error_state import Block, Layout
from lowcostnav_ros.estimation.inertial_spikes import Jolt
from lowcostnav_ros.estimation.vibration import Vibration
from lowcostnav_ros.navigators.against_air import AgainstAir
from lowcostnav_ros.navigators.attitude_watch import AttitudeWatch
from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
from lowcostnav_ros.navigators.channel import Channel
from lowcostnav_ros.navigators.headings import NARROW, UNSEEN, Headings, all_but_heading
from lowcostnav_ros.navigators.recovery import BEYOND_SPOOFING, Recovery
from lowcostnav_ros.navigators.silent_axes import SilentAxes
from lowcostnav_ros.navigators.solutions import position_sigmas
from lowcostnav_ros.navigators.trust import COVERED
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, displace
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, quat_to_dcm, rotvec_from_quat, skew
from lowcostnav_ros.starts.gps_start import GpsStart, Start
from lowcostnav_ros.starts.levelling import AlignmentSettings, transferred, unit_error
from lowcostnav_ros.starts.point_solution import SlopeVelocity

IMU = "imu/data_raw"
COAST_NS = 30_000_000_000
"""A hole in the inertial data is bridged so far; beyond it nothing is known of the attitude that aligning anew would not know better."""
VAGUE_TILT = 10.0 * DEGREE
"""A filter that is linear in the tilt cannot be trusted with a larger sigma, as long as GPS velocity would show it wrong within a step."""
LEVELLING_NS = 4_000_000_000
"""Levelling after a hole takes two GPS velocities a second or two apart."""
RECENT_NS = 3_000_000_000
"""A refused fix this recent is the reason why there is none; an older one is not."""
UNEXPLAINED = 3.0
"""Of a unit that contradicts its settings the attitude is known half as well as a filter of biases believes."""
NOTHING = (None,) * 6
TRANSFER_SPAN_S = 0.2
"""Inertial data of this length is tested before a transfer alignment."""


@dataclass(frozen=True)
class InertialSettings:
    """Settings of an inertial navigator that are no sensor's."""

    horizon: HorizonSettings = group(HorizonSettings)
    imu: ImuSettings = group(ImuSettings)
    split_turn_on: bool = setting(False, "Estimate turn-on biases beside Gauss-Markov drifts (21 or 27 states instead of 15).")
    magnetometer: MagnetometerCalibration = group(MagnetometerCalibration)
    alignment: AlignmentSettings = group(AlignmentSettings)
    failed_sigma_m: float = setting(10000.0, "Horizontal sigma beyond which the solution counts as failed.", unit="m", minimum=10.0)


class InertialNavigator(Navigator):
    """An inertial navigator: its subclass is a list of sensors.

    Modes: ``initialising`` (no data), ``aligning``, ``gps``, ``coasting`` (no accepted fix within the time-out), ``suspect`` (GPS
    contradicts itself or the inertial sensors), ``failed``.

    Attributes
    ----------
    core : InertialCore
    layout : Layout
    headings : Headings
        The cores of several headings while it does not know its own.
    tries_headings : bool
        Whether it ever has several.
    lever_b, imu_arm_b : ndarray (3,)
        GPS antenna relative to the IMU, IMU relative to base_link, m.
    fix_word : str
        What a fix is called in a reason.
    """

    inertial = IMU
    smooths = True
    on_grid = True
    tries_headings = True
    fix_word = "GPS fix"

    def __init__(self, settings: Any, stations: Any = None, latency_s: float = 0.0) -> None:
        super().__init__(settings, stations, latency_s)
        if settings.alignment.any_heading and not self.tries_headings:
            raise SettingsError(f"{self.name} does not try several headings: 'alignment.any_heading' is for ins_gps and ins_gnss.")
        gps, layout = getattr(settings, "gps", None), Layout(self.blocks())
        self.imu_arm_b = np.array(settings.imu.lever_arm_m, dtype=float)
        self._is_off_base = bool(self.imu_arm_b.any())
        self.lever_b = np.array(gps.lever_arm_b_m if gps is not None else [0.0] * 3, dtype=float) - self.imu_arm_b
        self.headings = Headings()
        self._attach(layout, InertialCore(layout))
        self.start = GpsStart(settings.alignment, settings.imu, layout, next(iter(self.aids_of(MagneticAid)), None))
        self.slope = SlopeVelocity()
        self.axes = AxesCheck(IMU)
        self._remember(settings.imu, layout)
        self._wind_aids = [aid for aid in self.aids if "wind" in aid.teaches]
        self._restart()

    def _remember(self, imu: ImuSettings, layout: Layout) -> None:
        """Begin to remember recoveries and corrections of an IMU with these settings."""
        self.recovery = Recovery(imu, layout)
        self.attitude_watch, self.against_air, self.silent = AttitudeWatch(self), AgainstAir(layout, IMU), SilentAxes(self)
        self.vibration = Vibration(np.sqrt(np.array(layout.blocks[0].psd[3:])))

    def own_inputs(self) -> list[str]:
        """The IMU, and the master of a transfer alignment."""
        return [IMU, *filter(None, [self.settings.alignment.master])]

    def blocks(self) -> list[Block]:
        """The list of state blocks: the core, the inertial sensors' errors, what the aids need."""
        settings = self.settings
        return [core_block(settings.imu), *bias_blocks(settings.imu, split_turn_on=settings.split_turn_on), *self.aid_blocks()]

    # what aids ask of their host ---------------------------------------------------------------------------------------------

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether GPS holds the solution."""
        return self.mode == Mode.GPS or self._led_away

    def explains(self) -> bool:
        """Whether a bias was found to be so large that the inertial sensors were wrong; what a spoofer pretends is smaller."""
        found = self.recovery.contradiction(self.core.estimate)
        return found is not None and found.size > BEYOND_SPOOFING

    def return_to(self, core: InertialCore) -> None:
        """As every navigator; what was learnt of the IMU was learnt of GPS."""
        super().return_to(core)
        self._close_headings()
        self.recovery.acquit()
        self.inertial_is_suspect = False

    def excluded(self, aid: Aid) -> str:
        """As every navigator; after an alignment without it the magnetometer waits until GPS has shown the heading."""
        if isinstance(aid, MagneticAid) and self.recovery.compass_waits(self.core.t_ns, self.P):
            return "heading comes from GPS"
        return UNSEEN if self.headings.cores and aid.keeps_slots else super().excluded(aid)

    @property
    def _unexplained(self) -> bool:
        """Whether the IMU contradicts its settings in a way that wider biases do not explain."""
        return self.inertial_is_suspect and not self.recovery.explains

    def recovery_s(self, aid: Aid, stamp_ns: int) -> float:
        """A second recovery to GPS within a minute comes sooner, and is another one."""
        return self.recovery.patience_s(stamp_ns, aid.gate.recovery_s) if aid in self.trust.receivers else aid.gate.recovery_s

    def contradictions(self) -> tuple[Contradiction, ...]:
        """As every navigator; and of the IMU with gravity and with its settings."""
        beyond = self.recovery.contradiction(self.core.estimate) if self._aligned else None
        own = self.axes.held, *self.attitude_watch.held, self.against_air.held, self.silent.held, beyond
        others = super().contradictions()
        return others if own == NOTHING else (*others, *(held for held in own if held is not None))

    # measurements ------------------------------------------------------------------------------------------------------------

    def _restart(self) -> None:
        self._aligned = self._led_away = False
        self.headings.close()
        self.axes.clear()
        self.against_air.clear()
        self.silent.clear()
        self.attitude_watch.clear()
        self._began_over = False
        self.recovery.restart()
        self._emitted = -1
        self._sampled_ns = self._levelling_until_ns = 0
        self._fused_fix_ns: int | None = None
        self.start_is_fed = False
        self.restart_channels()
        self.core.rest()
        self.slope.clear()
        self.start.clear()

    def moves(self, measurement: Measurement) -> bool:
        """As every navigator: all of them do while it aligns or levels."""
        return not self._aligned or measurement.stamp_ns <= self._levelling_until_ns or self.is_wanted(measurement)

    def _fuse(self, item: Measurement) -> None:
        if isinstance(item, ImuBlock):
            self._run(item)
        elif item.source == self.settings.alignment.master and isinstance(item, NavSolution):
            self._transfer(item)
        elif not self._aligned or (self.core.t_ns != item.stamp_ns and not self._coast(item.stamp_ns)):
            self._begin_with(item)
        else:
            self.core.settle()
            self.headings.settle()
            self._aid(item)
            if self._levelling_until_ns:
                self._level_again(item)
            else:
                self._recover(item)
            self._judge(speaks=False)

    def _recover(self, item: Measurement) -> None:
        """Follow what became of GPS; begin anew in motion when it has been recovered to again and again."""
        recovery = self.recovery
        for aid in self.trust.receivers:
            if type(item) is aid.measurement and item.source == aid.source and aid.decision is not None:
                decision: Decision | None = aid.decision
                if decision is Decision.REJECT and self.excluded(aid):
                    decision = None
                elif decision is Decision.RECOVER and aid.measurement is GpsPosition and self.trust.agreement().get(GpsVelocity, False):
                    decision = Decision.REJECT  # where the velocity agrees it is not the IMU
                off = aid.status.innovation if aid.measurement is GpsVelocity else None
                recovery.note(item.stamp_ns, decision, off, aid.status.nis)
                if decision is Decision.RECOVER and off is not None:
                    self.widen(recovery.seen())
                found = recovery.contradiction(self.core.estimate) or self.attitude_watch.one_way.held
                self.inertial_is_suspect = recovery.is_widened or found is not None
        if not recovery.gathers:
            self.start_is_fed = False
            return
        start = None if self.trust.excludes(item) else self._gather(item)
        if recovery.is_lost and start is not None:
            self._begin_anew(start)

    def _gather(self, item: Measurement) -> Start | None:
        """Gather for an alignment in motion while GPS is rejected; the state that this measurement gives."""
        if not self.start_is_fed:
            self.start.clear()
            self.start_is_fed = True
        self.start.widening, self.start.compass = self.recovery.widening, False
        return self.start.take(item)

    def _begin_anew(self, start: Start) -> None:
        """Begin at a state from GPS in motion, with biases and noise as wide as the IMU must be by what was seen."""
        self.restarts["re-aligned in motion"] += 1
        if self.history is not None:
            self.history.cut()
        self.headings.close()
        self.core.start(start.stamp_ns, start.nav, start.covariance)
        if self.offsets is not None:
            self.offsets.restart()
        self.attitude_watch.begin_anew()
        self._look_at_axes(start.stamp_ns)
        self.recovery.begin(start.stamp_ns, self.P, moving=self.start.moving)
        self.inertial_is_suspect = True
        self._fused_fix_ns, self._sampled_ns = start.fix_ns, start.stamp_ns
        for aid in self.trust.receivers:
            aid.rejecting_since_ns = aid.unresolved = None

    def _run(self, block: ImuBlock) -> None:
        first, end = 0, len(block)
        self.trust.witness.take(block)
        in_hole = self._aligned and not self._levelling_until_ns and block.stamps_ns[0] - self._sampled_ns > GAP_NS
        if in_hole and self._coast(int(block.stamps_ns[0])):
            first = 1  # the sample says nothing about all of the hole before it
            self._end_hole()
        if not self._aligned or self._levelling_until_ns or self.start_is_fed:
            self.start.add(block)
        if self._aligned and self._levelling_until_ns:
            first = self._coast_levelling(block)
        if not self._aligned:
            self.vibration.take(block)
            return
        while first < end:
            page = self._page(block.stamp_ns)
            self.headings.advance(block, first, self.output_period_ns)
            begun, first = first, self.core.advance(block, first, self.output_period_ns, page)
            self.vibration.take(block, begun, first)
            self._sampled_ns = self.core.t_ns
            if page is not rows.NO_PAGE:
                self._put_out_all(page)
            elif self.core.t_ns // self.output_period_ns != self._emitted:
                self.axes.take(self.core.t_ns, self.core.force_b[2])
                self._put_out()
        self.core.passed(block)

    # holes in the inertial data ----------------------------------------------------------------------------------------------

    def _end_hole(self) -> None:
        """Go on with the inertial data; but a tilt that is hardly known makes a filter wrong: with GPS it is levelled first."""
        for aid in self.aids_of(VelocityAid):
            aid.sound_since_ns = None
        sigma, last = math.sqrt(max(self.P[6, 6], self.P[7, 7])), self._fused_fix_ns
        if sigma > VAGUE_TILT and last is not None and self.core.t_ns - last <= 1e9 * self.settings.gps.timeout_s:
            self._levelling_until_ns = self.core.t_ns + LEVELLING_NS
            self.start.clear()
        else:
            self._sampled_ns = self.core.t_ns

    def _coast_levelling(self, block: ImuBlock) -> int:
        """Let the last motion go on, on the grid of outputs, while samples are gathered; return the first one to run."""
        until = self._levelling_until_ns
        if block.stamp_ns < until:
            self._coast(block.stamp_ns // self.output_period_ns * self.output_period_ns)
            return len(block)
        self._coast(until)
        self._levelling_until_ns, self._sampled_ns = 0, self.core.t_ns
        return int(np.searchsorted(block.stamps_ns, until, side="right"))

    def _level_again(self, item: Measurement) -> None:
        """Take the attitude that an alignment would begin with as a measurement of the present one."""
        start = self.start.take(item)
        if start is None:
            return
        y, H = rotvec_from_quat(quat_multiply(start.nav[6:10], quat_conjugate(self.core.nav[6:10]))), np.zeros((3, self.layout.size))
        H[:, ATT] = np.eye(3)
        self.correct(kalman.update(self.P, y, H, start.covariance[ATT, ATT].copy(), np.ones(self.layout.size)))
        self._levelling_until_ns, self._sampled_ns = 0, self.core.t_ns

    def _coast(self, t_ns: int) -> bool:
        """Bridge a hole in the inertial data up to ``t_ns``; beyond :data:`COAST_NS` align anew and return False."""
        if t_ns - self._sampled_ns > COAST_NS:
            self.realign(f"inertial data missing for more than {1e-9 * COAST_NS:.0f} s")
            return False
        self._close_headings()  # of a turn in a hole nothing is known: what comes after it is cut anew
        while self.core.t_ns < t_ns:
            self.core.bridge(min(t_ns, (self.core.t_ns // self.output_period_ns + 1) * self.output_period_ns))
            if self.core.t_ns // self.output_period_ns != self._emitted:
                self._put_out()
        return True

    def _put_out(self) -> None:
        """Give out the solution of an output period."""
        self._look()
        row = self._row(self.core.t_ns, self.core.nav, self.P, self.core.force_b, self.core.rate_b)
        if row is None:
            self._is_lost = True
        else:
            self._give_out(row, is_looked_at=True)

    def _page(self, end_ns: int) -> rows.Page:
        """Where the core writes the solutions up to a stamp that need no look on the way; :data:`.NO_PAGE` where each does.

        Between two measurements nothing changes in what the sources say of each other and of the state.  While they say nothing, what is
        left to be looked at falls due at times that are known, and every output may be written as the core comes by.
        """
        now, period = self.core.t_ns, self.output_period_ns
        room = end_ns // period - now // period
        if not room or not self._is_calm(end_ns):
            return rows.NO_PAGE
        quiet_ns = self.trust.quiet_until(now)
        if quiet_ns is None:
            return rows.NO_PAGE
        until_ns = min(quiet_ns, self.vibration.due_ns, self.news_due_ns(), self.attitude_watch.flow.due_ns)
        return rows.Page(self.layout.size, room + 1, until_ns, self.doubt(now), self._wind_shown())

    def _is_calm(self, end_ns: int) -> bool:
        """Whether nothing but time may change how it is before a stamp, as long as nothing is measured."""
        now, last, P = self.core.t_ns, self._fused_fix_ns, self.core.P
        if self.mode == Mode.GPS:
            is_held = last is not None and end_ns - last <= 1e9 * self.settings.gps.timeout_s
            is_steady = is_held and any(aid.is_fresh(end_ns) for aid in self.trust.receivers)  # where transmitters hold it, too
        else:
            told = self.reason.startswith(f"no {self.fix_word} for ")
            is_steady = self.mode == Mode.COASTING and told and not any(self._refused_fixes(now))
        if not is_steady or self.headings.cores or self.clocked or self._is_off_base or self.history is not None or not self.axes.is_still:
            return False
        grown = math.sqrt(max(P[0, 0] + P[1, 1], 0.0)) + math.sqrt(max(P[3, 3] + P[4, 4], 0.0)) + STANDARD_GRAVITY  # in a second, at most
        is_quiet = self.attitude_watch.is_quiet(held=self.gps_good(now)) and self.silent.is_quiet and not self._unexplained
        is_undoubted = is_quiet and grown < self.settings.failed_sigma_m and self._shown_doubt(now) is self.trust.added
        return is_undoubted and not self.contradictions() and self._integrity() is None

    def _put_out_all(self, page: rows.Page) -> None:
        """Give out the solutions of a page; look at what fell due with the last."""
        self._emitted = self.core.t_ns // self.output_period_ns
        self._is_lost |= page.is_lost
        stamps = page.stamps_ns.tolist()
        if not stamps:
            return
        for stamp_ns, force in zip(stamps, page.table[:, rows.FORCE.stop - 1].tolist(), strict=True):
            self.axes.take(stamp_ns, force)
        is_due = stamps[-1] >= page.until_ns
        if is_due:
            self._look()
        else:
            self.trust.pass_by(stamps[-1])
        self._give_out(self._rows(page), is_looked_at=is_due)

    def _give_out(self, given: rows.Rows, *, is_looked_at: bool) -> None:
        """Give out rows; with the last of those that are looked at goes what there is to say."""
        stamps, last = given.stamps_ns.tolist(), len(given) - 1
        self._out_ns = stamps[last]
        health = self._news(stamps[last]) if is_looked_at else None
        if health is not None:
            given.health[last] = health
        self._out.append(given)
        if self.offsets is not None:
            self.offsets.note_rows(stamps, given.table[:, VEL])
        if self.history is not None:
            self.history.output(given.solution(last), self.P, self.core.output_rows())

    def _look(self) -> None:
        """Look at everything, at an output: vibration, headings, what is applied then, GPS and its witness, mode and reason."""
        self._emitted = self.core.t_ns // self.output_period_ns
        if self.vibration.look(self.core.t_ns):
            self.layout.set_levels({"core": self.vibration.level()})
        if self.headings.cores:
            self._show_headings()
        self.silent.look(self.core.t_ns)
        held, blind_s = self.gps_good(self.core.t_ns), self.silent.blind_s(self.core.t_ns)
        self.attitude_watch.look(1e-9 * self.output_period_ns, held=held, is_wrong=self._unexplained, blind_s=blind_s)
        for channel in self.clocked:
            self.use_channel(channel, Measurement(self.core.t_ns, IMU))
        self.trust.look(self.core.t_ns)
        self._judge()

    def _aid(self, item: Measurement) -> None:
        if self.tries_headings and not self._levelling_until_ns and self._holds_position(item):
            self.headings.divide(self.core)
        if any(aid.is_fix for aid in self.use(item)):
            self._fused_fix_ns = item.stamp_ns

    def _holds_position(self, item: Measurement) -> bool:
        return any(aid.is_fix for channel in self.channels.get(item.source, ()) for aid in channel.aids)

    def use_aid(self, aid: Aid, measurement: Measurement) -> bool:
        """As every navigator; while it tries several headings, each takes the measurement."""
        is_hidden = aid.seeds and self.tries_headings and self.P[8, 8] > NARROW**2 and self.core.hides_heading()
        self.movable = all_but_heading(self.core) if is_hidden else None
        if not self.headings.cores:
            is_watched = self.attitude_watch.before(aid)
            used = super().use_aid(aid, measurement)
            if is_watched:
                self.attitude_watch.after(aid, measurement, used=used)
            if isinstance(aid, AirDataAid | MagneticAid) and not self.gps_good(measurement.stamp_ns):
                self._heed(aid)
            return used
        used = super().use_aid(aid, measurement)
        if used:
            self.headings.take(aid, measurement, self)
            self._show_headings()
        return used

    def _heed(self, aid: Aid) -> None:
        """Without GPS, lose what the air contradicts across the flight; what it goes on to contradict then is no gust."""
        least = self.against_air.take(aid, self.core.speed_mps)
        if least is not None:
            self.widen(least)
            if self.against_air.lasts(aid.status.stamp_ns):
                self.recovery.note(aid.status.stamp_ns, Decision.RECOVER)

    def use_channel(self, channel: Channel, measurement: Measurement) -> list[Aid]:
        """As every navigator; where a rate of turn is needed, that of the newest sample is taken."""
        if channel.aids[0].needs_rate and channel.is_due(measurement.stamp_ns):
            self.core.note()
        return super().use_channel(channel, measurement)

    def widen(self, least: np.ndarray) -> None:
        """Raise sigmas to those of ``least`` (n,); of several headings, go on with what they say together."""
        if self.headings.cores:
            self._close_headings()
        self.core.widen(least)

    def correct(self, dx: np.ndarray) -> None:
        """As every navigator."""
        super().correct(dx)
        self.attitude_watch.note(dx)

    @property
    def tries_any_heading(self) -> bool:
        """Whether it begins with any heading."""
        return self.settings.alignment.any_heading

    def led_one_way(self, stamp_ns: int) -> None:
        """GPS corrects attitude and biases one way again and again: they are lost."""
        self.recovery.lose(stamp_ns)

    def turned(self, stamp_ns: int, apart: float) -> np.ndarray:
        """Note a heading that was off by ``apart``, rad; sigmas (n,) that there must be at least."""
        return self.recovery.turned(stamp_ns, apart)

    # several headings --------------------------------------------------------------------------------------------------------

    def _show_headings(self) -> None:
        """Hold what all headings together say; with fixes no longer there to tell them apart, go on with that alone."""
        last = self._fused_fix_ns
        lost = last is not None and self.core.t_ns - last > 1e9 * self.settings.gps.timeout_s
        if self.history is not None:
            self.history.cut()  # what moves the state now is no linear filter's
        if self.headings.show(self.core) or lost:
            self._close_headings()

    def _close_headings(self) -> None:
        """Go on with one core."""
        self.headings.close()
        if self.offsets is not None:
            self.offsets.rest(self.core.t_ns)

    def _judge(self, *, speaks: bool = True) -> None:
        """Keep mode and reason in step with what was fused; what changes in the reason alone is told at outputs (``speaks``)."""
        now, last = self.core.t_ns, self._fused_fix_ns
        sigma, self._led_away = self._horizontal_sigma(), False
        if sigma > self.settings.failed_sigma_m:
            self.mode, self.reason = Mode.FAILED, f"horizontal sigma {sigma:.0f} m is above {self.settings.failed_sigma_m:.0f} m"
        elif now - self._sampled_ns > GAP_NS:
            self.mode, self.reason = Mode.COASTING, f"no inertial data for {1e-9 * (now - self._sampled_ns):.1f} s: the last motion goes on"
        elif last is not None and now - last <= 1e9 * self.settings.gps.timeout_s:
            self.mode, self.reason = Mode.GPS, "GPS position accepted"
            self.against_air.clear()
            if self.trust.led_away is not None:
                self.mode, self.reason, self._led_away = Mode.SUSPECT, self.trust.suspicion(), True
        elif found := self.trust.suspicion():
            self.mode, self.reason = Mode.SUSPECT, found
        elif speaks or self.mode != Mode.COASTING:
            since = 0.0 if last is None else 1e-9 * (now - last)
            self.mode, self.reason = Mode.COASTING, f"{self._why_no_fix(now)} for {since:.0f} s{self.outage_words(now)}"

    def _why_no_fix(self, now_ns: int) -> str:
        return next(self._refused_fixes(now_ns), "") or f"no {self.fix_word}"

    def _refused_fixes(self, now_ns: int) -> Iterator[str]:
        """Reasons of the fixes of late, empty for those that were used."""
        return (aid.status.reason for aid in self.aids if aid.is_fix and aid.status.stamp_ns > now_ns - RECENT_NS)

    def _horizontal_sigma(self) -> float:
        P = self.core.P
        return math.sqrt(max(P[0, 0] + P[1, 1], 0.0))

    # alignment ---------------------------------------------------------------------------------------------------------------

    def _begin_with(self, item: Measurement) -> None:
        """Align with what is not excluded; where the velocity is, the slope of the fixes serves."""
        refused = self.trust.excludes(item)
        if refused:
            self.start.refused = Reason(refused, f"{item.source} is not begun with; are fixes in degrees, velocities east-north-up in m/s?")
            return
        self._prepare(item)
        if isinstance(item, GpsPosition) and any(check.excluded(GpsVelocity) for check in self.trust.checks.receivers):
            velocity = self.slope.add(item)
            if velocity is not None and not self._aligned:
                self._prepare(velocity)

    def _prepare(self, item: Measurement) -> None:
        """Gather what alignment needs; begin when there is a first state."""
        if isinstance(item, GpsPosition):
            self.set_origin(item.lat, item.lon, item.height)
        start = self.start.take(item)
        if start is not None and self._still_looks():
            self.mode, self.reason = Mode.ALIGNING, "looking at the IMU"
        elif start is not None:
            self._begin(start)
        elif self.start.reason:
            self.mode, self.reason = Mode.ALIGNING, self.start.reason

    def _begin(self, start: Start) -> None:
        imu = self._seen()
        if imu is not None and imu != self.settings.imu:
            self._fly_on(imu)
        self.begin(start.stamp_ns, start.nav, start.covariance)
        if start.headings:
            self.headings.begin(self.core, start.headings)
        self._look_at_axes(start.stamp_ns)
        if self.start.turned is not None:
            self.recovery.distrust_compass(start.stamp_ns)
        self._fused_fix_ns = start.fix_ns
        self._judge()

    def _look_at_axes(self, stamp_ns: int) -> None:
        """Note an alignment upside down."""
        if self.start.force_b is not None:
            self.axes.begin(stamp_ns, self.start.force_b[2])
            self._began_over = self.axes.held is not None

    def begin(self, stamp_ns: int, nav: np.ndarray, core_covariance: np.ndarray) -> None:
        """Start at a state known from elsewhere (transfer alignment): ``nav`` (10,) and the covariance (9, 9) of the core states."""
        self.set_origin(*(float(x) for x in nav[:3]))
        self.core.start(stamp_ns, nav, core_covariance)
        self._emitted = stamp_ns // self.output_period_ns
        self._sampled_ns = stamp_ns
        self._aligned, self.reason = True, ""

    def _fly_on(self, imu: ImuSettings) -> None:
        """Take other numbers of the IMU, before a state is there."""
        self.settings = replace(self.settings, imu=imu)
        layout = Layout(self.blocks())
        self._attach(layout, InertialCore(layout))
        self._remember(imu, layout)

    def _transfer(self, item: NavSolution) -> None:
        """Start at the state of the master; once aligned, its solutions are ignored."""
        means = None if self._aligned else self.start.levelling.mean(TRANSFER_SPAN_S)
        if means is None:
            return
        state = transferred(item, self.settings.alignment.master_sigma_deg)
        wrong = unit_error(*means)
        if state is None or wrong:
            self.input_status[item.source].reject(wrong or "no position, velocity or attitude with covariance")
            return
        no_fix_ns = item.stamp_ns - round(1e9 * self.settings.gps.timeout_s) - 1  # it coasts until there is a fix
        self._begin(Start(item.stamp_ns, *state, no_fix_ns))

    def _disturb(self, jolt: Jolt) -> None:
        """As every navigator, once aligned."""
        if self._aligned:
            self.trust.witness.disturb(jolt, self.core.t_ns)
            self.core.disturb(jolt.kick, jolt.variance)
            self.headings.disturb(jolt)
            if jolt.silent is not None:
                self.silent.take(self.core.t_ns, jolt.silent)

    # outputs -----------------------------------------------------------------------------------------------------------------

    def _details(self) -> dict[str, str]:
        """As every navigator; and how the IMU is shaken."""
        words = self.vibration.words()
        return {**super()._details(), **({"vibration": words} if words else {})}

    def _predict(self) -> NavSolution | None:
        if not self._aligned:
            return None
        block = self.ahead()
        row = self._row(*self.core.predicted(block), *self.core.latest(block))
        return None if row is None else row.solution(0)

    def _row(self, t_ns: int, nav: np.ndarray, P: np.ndarray, force_b: np.ndarray, rate_b: np.ndarray) -> rows.Rows | None:
        """The solution of a state; None where it is none."""
        if self._is_off_base:
            nav, P = at_base(nav, P, rate_b, self.imu_arm_b)
        page = rows.Page(self.layout.size, 1, t_ns, self.doubt(t_ns), self._wind_shown())
        page.stamps_ns[0] = t_ns
        is_sound = rows.write(nav, P, page.added, self.core.estimate, force_b, rate_b, page.wind, page.table[0])
        return self._rows(page) if is_sound else None

    def _rows(self, page: rows.Page) -> rows.Rows:
        """Solutions as they are given out."""
        return rows.Rows(self.name, page.stamps_ns, page.table, self.layout.labels[CORE:], page.wind, self.mode, self._integrity())

    def _wind_shown(self) -> int:
        """First of the states of the wind, once it was measured."""
        wind = self.layout.get("wind") if any(aid.status.fused for aid in self._wind_aids) else None
        return rows.NO_WIND if wind is None else wind.start

    def doubt(self, t_ns: int) -> np.ndarray:
        """As every navigator; of an attitude that may be upside down nothing is known, of another what the other sensors show of it."""
        doubt, moved = self._shown_doubt(t_ns), self.attitude_watch.moved()
        if not moved.any() and not self._unexplained:
            return doubt
        doubt = doubt.copy()
        doubt[ATT, ATT] += np.diag(moved[[0, 0, 1]] ** 2) + self.P[ATT, ATT] * (UNEXPLAINED if self._unexplained else 0.0)
        if self.attitude_watch.led_m > 0.0:
            doubt[VEL, VEL] += self.attitude_watch.slip_mps(moved) ** 2 * np.eye(3)
            doubt[POS, POS] += self.attitude_watch.led_m**2 * np.eye(3)
        return doubt

    def _shown_doubt(self, t_ns: int) -> np.ndarray:
        """What GPS, compass and air data show now to be wrong."""
        doubt, is_over = self.trust.doubt(t_ns), self._began_over and self.axes.held is not None
        tilt, heading = self.attitude_watch.apart(t_ns)
        if is_over or heading or self.recovery.shows:
            doubt = doubt.copy()
            doubt[ATT, ATT] += UPSIDE_DOWN if is_over else np.diag(self.recovery.seen()[ATT] ** 2)
            doubt[ATT, ATT] += np.diag(np.array([tilt, tilt, heading]) ** 2) * COVERED**2
        astray = self.against_air.doubt(t_ns, self.core.speed_mps)
        return doubt if astray is None else doubt + astray

    def _sigmas(self) -> dict[str, float]:
        if not self._aligned:
            return {}
        P = self.P[:CORE, :CORE] + self.doubt(self.core.t_ns)
        north, east, down = np.sqrt(np.maximum(np.diag(P)[ATT], 0.0)) / DEGREE
        return position_sigmas(P) | {"tilt_deg": float(np.hypot(north, east)), "heading_deg": float(down)}


def at_base(nav: np.ndarray, P: np.ndarray, rate_b: np.ndarray, arm_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """State (10,) and covariance (n, n) of base_link: those of an IMU that stands ``arm_b`` (3,), m, from it, turning at ``rate_b``.

    p - C l and v - C (w x l), so that with the error phi_n of the attitude J = [C l]x and [C (w x l)]x.
    """
    C = quat_to_dcm(nav[6:10])
    arm_n, swing_n = C @ arm_b, C @ np.cross(rate_b, arm_b)
    base, J = nav.copy(), np.eye(len(P))
    base[0:3] = displace(nav[0], nav[1], nav[2], -arm_n)
    base[3:6] -= swing_n
    J[POS, ATT], J[VEL, ATT] = skew(arm_n), skew(swing_n)
    return base, J @ P @ J.T
