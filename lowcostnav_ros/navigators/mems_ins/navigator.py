"""MEMS navigator: position and velocity from what an attitude reference (AHRS) gives, nine channels, and GPS (Njenga 2008).

The reference has the attitude; its accelerations are turned to n, freed of gravity and integrated twice.  ``filter: joint`` estimates
position, velocity and the errors of the reference in one filter (:mod:`~lowcostnav_ros.cores.carried`), of nine states with
``reference.tilt_deg: 0``; ``filter: cascade`` is the thesis's, two filters of three biases beside an inertial solution that runs free
(:mod:`~lowcostnav_ros.cores.cascade`).  By which sign the accelerometers count is told by the first seconds, and said.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from lowcostnav_ros.aids.gps import GPS, PositionAid
from lowcostnav_ros.aids.offsets import CASCADE as CASCADE_SENSOR
from lowcostnav_ros.aids.offsets import OffsetAid
from lowcostnav_ros.base.measurements import Attitude, GpsPosition, GpsVelocity, ImuBlock, Measurement, NavSolution
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.base.units import DEGREE, FOOT, MILLI_G
from lowcostnav_ros.calibration.reference_rest import GRAVITY_POSITIVE, SIGNS, accel_sign
from lowcostnav_ros.cores.carried import CORE, POS, VEL, CarriedCore, carried_blocks, sensed
from lowcostnav_ros.cores.cascade import CascadeCore, cascade_blocks
from lowcostnav_ros.estimation.aiding import RECOVERED, Aid, Reason, unique
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.estimation.offset_watch import OffsetWatch
from lowcostnav_ros.estimation.rates import RateMonitor, coast_time
from lowcostnav_ros.navigators.mems_ins.settings import AS_PRINTED, AUTO, CASCADE, MemsInsOwnSettings
from lowcostnav_ros.navigators.reckoning import ReckoningNavigator
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.navigators.settings import kind_of
from lowcostnav_ros.navigators.solutions import Solutions, position_sigmas
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import quat_rotate
from lowcostnav_ros.starts.point_solution import SlopeVelocity

GPS_ONLY = "gps_only"
TOGETHER_NS = 1_500_000_000
"""A velocity this near to a fix is of the same moment, as far as a start is concerned."""
NEITHER = "accelerations along gravity determine no sign"
UNFELT = "the reference gives no accelerations"


@navigator
class MemsIns(ReckoningNavigator):
    """MEMS navigator; see the module head.

    Modes: initialising (an input is missing), aligning (sign, fix or velocity not known yet), gps, coasting (the inertial solution alone),
    gps_only (the reference has timed out), suspect (GPS contradicts itself or the prediction), failed.

    Attributes
    ----------
    core : CarriedCore or CascadeCore
    watch : OffsetWatch
        Of the cascade.
    rates : RateMonitor
    sign : str
        By which sign the accelerometers count; empty until it is told.
    """

    name = "mems_ins"
    colour = "#a6761d"
    modes = {"gps_only": ("#8c6d31", "")}
    smooths = False
    outdone_by = ("dead_reckoning", "ins_gps")
    OwnSettings = MemsInsOwnSettings
    sensors = (
        GPS.but(position_floor_m=1.0, velocity_floor_mps=0.1, correlation_s=1.0, latency_s=0.0),
        CASCADE_SENSOR,
    )
    core: CarriedCore | CascadeCore

    def __init__(self, settings: Any = None, stations: Any = None) -> None:
        self.rates = RateMonitor()
        super().__init__(settings or self.Settings(), stations)
        self._is_cascade = self.settings.filter == CASCADE
        own = cascade_blocks(self.settings.cascade) if self._is_cascade else carried_blocks(self.settings.reference)
        layout = Layout(unique([*own, *self.aid_blocks()]))
        self._attach(layout, self._new_core(layout))
        self._fixes = self.aids_of(PositionAid)
        self._offset_aids = self.aids_of(OffsetAid)
        self._restart()

    def _new_core(self, layout: Layout) -> CarriedCore | CascadeCore:
        own = self.settings.reference
        if not self._is_cascade:
            return CarriedCore(own, layout)
        bias = math.hypot(own.accel_bias_mg * MILLI_G, own.tilt_deg * DEGREE * STANDARD_GRAVITY)
        coast = bias, own.force_noise_mps2**2 * 0.05
        printed = self.settings.accel_sign == AS_PRINTED
        return CascadeCore(self.settings.cascade, layout, own.timeout_s, coast, as_printed=printed)

    # its list ----------------------------------------------------------------------------------------------------------------

    def own_inputs(self) -> tuple[str]:
        """The reference."""
        return (self.settings.attitude_topic,)

    def required_sources(self) -> tuple[str, ...]:
        """The reference and a fix."""
        return (self.settings.attitude_topic, *([self._fix_source()] if "gps" in self.settings.aids else []))

    def _fix_source(self) -> str:
        return next((aid.source for aid in self.aids_of(PositionAid) if aid.key == "gps"), "gps/fix")

    def wants(self, key: str) -> bool:
        """The thesis's filters belong to the cascade, which takes nothing but GPS."""
        is_cascade = self.settings.filter == CASCADE
        return is_cascade if key == "cascade" else not is_cascade or kind_of(key) == "gps"

    def applies(self, aid: Aid, measurement: Measurement) -> bool:
        """In the cascade only its own filters are used, when it steps; what else there is of GPS serves the checks."""
        return isinstance(aid, OffsetAid) and measurement.source != self.name if self._is_cascade else True

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether a fix is fresh and not doubted."""
        if not self._is_cascade:
            return super().gps_good(stamp_ns)
        return not self._doubt and not self.core.is_stale(stamp_ns)  # type: ignore[union-attr]

    # measurements ------------------------------------------------------------------------------------------------------------

    def feed(self, measurement: Measurement) -> Solutions:
        """As every navigator; notes when what has arrived."""
        if not isinstance(measurement, ImuBlock) and measurement.source in self.input_status:
            self.rates.take(measurement.source, measurement.stamp_ns, is_slow=isinstance(measurement, GpsPosition))
        out = super().feed(measurement)
        for solution in out:
            self.rates.take(self.name, solution.stamp_ns)
        return out

    def feed_all(self, measurements: Iterable[Measurement]) -> Solutions:
        """As every navigator; one by one, since it matters when each has arrived."""
        out = Solutions()
        for measurement in measurements:
            out.extend(self.feed(measurement))
        return out

    def _restart(self) -> None:
        self._start_over(self._new_core(self.layout))
        self.watch, self._doubt, self._doubted_ns = OffsetWatch(), "", 0
        self._slope = SlopeVelocity()
        self._velocity: GpsVelocity | None = None
        self._along: list[tuple[int, float]] = []
        self.sign = "" if self.settings.accel_sign == AUTO else self.settings.accel_sign
        if self.sign == AS_PRINTED:
            self.sign = GRAVITY_POSITIVE
        for aid in self.aids_of(OffsetAid):
            aid.doubted = ""

    def refusal(self, item: Measurement) -> str:
        """What has a number that is none is no measurement."""
        if isinstance(item, Attitude):
            total = item.q_nb.sum() + item.cov_att.sum() + item.specific_force_b.sum() + item.angular_rate_b.sum()
        elif isinstance(item, GpsPosition):
            total = item.lat + item.lon + item.height + item.cov_n.sum()
        else:
            total = item.vel_n.sum() + item.cov_n.sum() if isinstance(item, GpsVelocity) else 0.0
        return "" if math.isfinite(total) else "not finite"

    def _fuse(self, item: Measurement) -> None:
        if not self.core.started:
            self._align(item)
            return
        self._advance(item.stamp_ns)
        if not self._hold(item, self.core):
            self._aid(item)
            return
        if isinstance(self.core, CascadeCore):
            if self.settings.cascade.filter_rate == "attitude":
                self.step(item)
        else:
            self.core.settle()
            self.trust.witness.take(item)

    def _hold(self, item: Measurement, core: CarriedCore | CascadeCore) -> bool:
        """Let a core hold a sample of the reference; return whether this is one."""
        if item.source != self.settings.attitude_topic or not isinstance(item, Attitude):
            return False
        core.settle()
        core.hold(sensed(item, SIGNS[self.sign]))
        return True

    def _aid(self, item: Measurement) -> None:
        if isinstance(self.core, CascadeCore):
            if isinstance(item, GpsPosition) and item.source == self._fix_source():
                self._take_fix(item, self.core)
            return
        self.core.settle()
        self.use(item)

    # the cascade -------------------------------------------------------------------------------------------------------------

    def step(self, item: Measurement) -> None:
        """One step of both filters."""
        core = self.core
        assert isinstance(core, CascadeCore)
        factor = core.step()
        for aid in self._offset_aids:
            aid.r_factor, aid.doubted = factor, self._doubt
        for channel in self.clocked:
            self.use_channel(channel, item)

    def _take_fix(self, fix: GpsPosition, core: CascadeCore) -> None:
        """Take a fix in, and judge GPS by its offset from the INS."""
        since = core.fix_ns
        core.take_fix(fix)
        if core.timed_out():
            core.follow_gps()
        self._doubt = self._judge_gps(fix, core)
        if not self._doubt:
            core.note(0.0 if since is None else 1e-9 * (fix.stamp_ns - since))
        if self.settings.cascade.filter_rate == "gps":
            self.step(fix)

    def _judge_gps(self, fix: GpsPosition, core: CascadeCore) -> str:
        """What speaks against GPS; when nothing does any longer, the position filter begins anew."""
        excluded = next(filter(None, (self.trust.excluded(aid) for aid in self._fixes)), "")
        gps, ins, was = core.gps, core.ins, self._doubt
        if gps is None or ins is None:
            return excluded
        faulty = self.watch.fault
        offset, rows = ins.position - gps.position, core.layout["position_bias"]
        off = offset - core.estimate[rows]
        if self.settings.cascade.watch and gps.velocity is not None and ins.velocity is not None and not core.timed_out():
            sigma = np.sqrt(self._offset_aids[-1].variance() + core.covariances()[0].diagonal())
            self.watch.take(fix.stamp_ns, offset, ins.velocity, gps.velocity, off, sigma)
        if excluded and faulty and not self.watch.fault:  # it has strayed from the INS and come back to it for good
            for aid in self._fixes:
                self.trust.agrees_again(aid)
            excluded = ""
        doubt = excluded or self.watch.fault
        if doubt and not was:
            self._doubted_ns = fix.stamp_ns
        if doubt and not excluded and fix.stamp_ns - self._doubted_ns > 1e9 * self.settings.cascade.gate.recovery_s:
            self.watch.clear()  # GPS has stayed where it is for so long that the INS is the less credible
            self._offset_aids[-1].status.rejected[RECOVERED] += 1
            doubt = ""
        if was and not doubt:
            core.restart_position()
            core.forget_fixes()
        return doubt

    # alignment ---------------------------------------------------------------------------------------------------------------

    def _align(self, item: Measurement) -> None:
        """Tell the sign, then begin at a fix with a velocity."""
        if isinstance(item, Attitude) and item.source == self.settings.attitude_topic:
            self._tell_sign(item)
            if self.sign:
                self._hold(item, self.core)
        elif isinstance(item, GpsVelocity):
            self._velocity = item
        if isinstance(item, GpsPosition) and item.source == self._fix_source() and not self.trust.excludes(item):
            self.set_origin(item.lat, item.lon, item.height)
            slope = self._slope.add(item)
            velocity, last = slope, self._velocity
            if last is not None and item.stamp_ns - last.stamp_ns <= TOGETHER_NS:
                velocity = last
            if self._is_ready(item.stamp_ns) and velocity is not None:
                self._begin(item, velocity)
                return
            if self._is_ready(item.stamp_ns):
                self.mode, self.reason = Mode.ALIGNING, "waiting for a velocity, by GPS or by fixes over three seconds"
        elif self._is_ready(item.stamp_ns):
            self.mode, self.reason = Mode.ALIGNING, "waiting for a GPS fix with a velocity"

    def _is_ready(self, now_ns: int) -> bool:
        """Whether the reference can carry a state; else why not."""
        outdated = self.core.held.timed_out(now_ns, self.settings.reference.timeout_s) if self.sign else ""
        if not self.sign:
            along = f"{np.mean([a for _, a in self._along]):.2f} g" if self._along else ""
            told = self._along and now_ns - self._along[0][0] > 1e9 * self.settings.told_s
            self.mode = Mode.ALIGNING
            self.reason = Reason(NEITHER, along) if told else "telling the sign of the accelerometers"
            if not self._along:
                self.mode, self.reason = Mode.INITIALISING, "no attitude yet"
        elif outdated:
            self.mode, self.reason = Mode.INITIALISING, outdated
        return bool(self.sign) and not outdated

    def _tell_sign(self, sample: Attitude) -> None:
        """Follow the acceleration along gravity, in g, until it tells the sign."""
        if self.sign:
            return
        along = float(quat_rotate(sample.q_nb, sample.specific_force_b)[2]) / STANDARD_GRAVITY
        self._along = [(t, a) for t, a in self._along if sample.stamp_ns - t <= 2e9 * self.settings.told_s] + [(sample.stamp_ns, along)]
        if sample.stamp_ns - self._along[0][0] >= 1e9 * self.settings.told_s:
            self.sign = accel_sign(float(np.mean([a for _, a in self._along])))

    def _begin(self, fix: GpsPosition, velocity: GpsVelocity) -> None:
        nav = np.array([fix.lat, fix.lon, fix.height, *velocity.vel_n])
        if isinstance(self.core, CascadeCore):
            self.core.start(fix.stamp_ns, nav)
            self._take_fix(fix, self.core)
        else:
            aid = self._fixes[0]
            self.core.start(fix.stamp_ns, nav, 100.0 * aid.noise(fix), velocity.cov_n + np.eye(3))
            self.use(fix)
        self._judge()

    # mode and reason ---------------------------------------------------------------------------------------------------------

    def _before_output(self, due_ns: int) -> None:
        if not self._is_cascade:
            self.trust.look(due_ns)

    def _judge(self) -> None:
        """Find the mode and its reason."""
        core = self.core
        outdated, found, good = core.timed_out(), self.trust.suspicion(), self.gps_good(core.t_ns)
        if outdated and good:
            self.mode, self.reason = GPS_ONLY, f"{outdated}: GPS alone"
        elif outdated:
            self.mode, self.reason = Mode.FAILED, f"{outdated} and no GPS: last velocity held, error unbounded"
        elif good:
            self.mode, self.reason = Mode.GPS, "GPS position accepted"
            if self.trust.led_away is not None:
                self.mode, self.reason = Mode.SUSPECT, found
        else:
            gone = self._doubt or self._without_gps(core.t_ns)
            self.mode, self.reason = Mode.COASTING, f"{gone}; inertial solution alone"
            if found or self._doubt:
                self.mode, self.reason = Mode.SUSPECT, f"{found or self._doubt}; inertial solution alone"
        if not core.is_felt:
            self.reason += f"; {UNFELT}"
        self.reason += self._alert_words()

    def _without_gps(self, now_ns: int) -> str:
        if isinstance(self.core, CascadeCore):
            return "no GPS yet" if self.core.fix_ns is None else f"no GPS for {1e-9 * (now_ns - self.core.fix_ns):.0f} s"
        return super()._without_gps(now_ns)

    def _stands(self, stamp_ns: int) -> bool:
        return False

    def coast_s(self) -> float:
        """Seconds without GPS from now until the horizontal sigma exceeds the limit."""
        core, own = self.core, self.settings.reference
        cov = core.motion().P
        position, velocity = (math.sqrt(max(cov[i, i] + cov[i + 1, i + 1], 0.0)) for i in (0, 3))
        if isinstance(core, CascadeCore):
            bias, density = math.sqrt(2.0) * core.coast_bias, 2.0 * core.coast_density
        else:
            tilt = core.layout.get("attitude_error")
            bias_rows = core.layout["accel_bias"]
            lean = 0.0 if tilt is None else STANDARD_GRAVITY**2 * float(np.trace(core.P[tilt, tilt][:2, :2]))
            bias = math.sqrt(max(float(np.trace(core.P[bias_rows, bias_rows][:2, :2])) + lean, 0.0))
            density = 2.0 * own.force_noise_mps2**2 / max(self.rates.rate_hz(self.settings.attitude_topic), 1.0)
        return coast_time(self.settings.coast_limit_m, position, velocity, bias, density)

    def _details(self) -> dict[str, str]:
        own = {**super()._details(), "filter": self.settings.filter}
        own["accelerometers"] = self.sign.replace("_", " ") if self.sign else "sign not determined yet"
        attitude, fix = self.settings.attitude_topic, self._fix_source()
        rates = (("rate of the reference", attitude), ("rate of GPS", fix), ("rate of solutions", self.name))
        own |= {words: f"{self.rates.rate_hz(source):.1f} Hz" for words, source in rates}
        late = " (late)" if self.rates.lag_s > self.settings.lag_limit_s else ""
        own["GPS lags by"] = f"{self.rates.lag_s:.2f} s{late}"
        if self.core.started:
            own["without GPS"] = f"below {self.settings.coast_limit_m:.0f} m for {self.coast_s():.0f} s"
        if self._is_cascade:
            correlation = "" if self.watch.correlation is None else f", velocities correlate by {self.watch.correlation:.2f}"
            own["offset of INS and GPS"] = f"{self.watch.offset_std_m:.1f} m and {self.watch.rate_std_mps:.2f} m/s over 30 s{correlation}"
        return own

    # outputs -----------------------------------------------------------------------------------------------------------------

    def _solution(self, core: CarriedCore | CascadeCore) -> NavSolution:
        q_nb, cov_att = core.attitude()
        held, doubt = core.held, self.doubt(core.t_ns)
        if isinstance(core, CascadeCore):
            (cov_pos, cov_vel), first = core.covariances(), 0
        else:
            cov_pos, cov_vel, first = core.P[POS, POS], core.P[VEL, VEL], CORE
        return NavSolution(
            *(core.t_ns, self.name, float(core.nav[0]), float(core.nav[1]), float(core.nav[2]), core.nav[3:6].copy()),
            q_nb=q_nb,
            angular_rate_b=held.rate_b,
            specific_force_b=held.force_b,
            cov_pos=cov_pos + doubt[0:3, 0:3],
            cov_vel=cov_vel + doubt[3:6, 3:6],
            cov_att=cov_att,
            mode=self.mode,
            states=self._states(core.P, first),
        )

    def _sigmas(self) -> dict[str, float]:
        if not self.core.started:
            return {}
        sigmas = position_sigmas(self.core.motion().P + self.doubt(self.core.t_ns))
        return sigmas | {"position_horizontal_ft": sigmas["position_horizontal_m"] / FOOT}


MemsInsSettings = MemsIns.Settings
"""All settings of the MEMS navigator."""
