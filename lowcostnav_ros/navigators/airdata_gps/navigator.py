"""GPS and air data: position and velocity at the rate of an attitude reference, of an aircraft with no inertial unit at all.

Eggers (1995): airspeed, airflow angles and attitude give a velocity of wide bandwidth, GPS its errors.  The error model is in
:mod:`~lowcostnav_ros.cores.air_corrections`; ``filter: multirate`` and ``fixed_gain`` fly the thesis's cascade of two filters.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from lowcostnav_ros.aids.baro import BARO
from lowcostnav_ros.aids.gps import GPS, PositionAid, VelocityAid
from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity, Attitude, GpsPosition, GpsVelocity, Measurement, NavSolution
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.air_corrections import AirCorrectionsCore, correction_blocks
from lowcostnav_ros.cores.air_corrections_model import WIND
from lowcostnav_ros.cores.reckoning_model import POS
from lowcostnav_ros.estimation.aiding import Aid, unique
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.navigators.airdata_gps.checks import OTHER_NORTH, SIGN, SignWatch, StraightWatch, VaneWatch, other_north
from lowcostnav_ros.navigators.airdata_gps.high_rate import HighRateFilter
from lowcostnav_ros.navigators.airdata_gps.settings import AirDataGpsOwnSettings
from lowcostnav_ros.navigators.reckoning import AIR, ReckoningNavigator
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.physics.geomagnetism import declination, year_of_stamp
from lowcostnav_ros.physics.rotation import quat_from_rotvec, quat_multiply, quat_to_dcm, quat_to_euler

REPEAT, REPEAT_NS = "repeats the last fix", 1_200_000_000
"""A receiver that fixes once a second puts each fix out for so long; one that repeats for longer is frozen."""
FROM_MODEL, VARIATION_NS = 999.0, 60_000_000_000
STEP = 1.2
"""Ratio of the stated variances of two fixes in a row that shows another set of satellites."""
HELD_WORDS = "straight flight: all corrections but the wind are held"
LEARNING = ("core", "wind", "wind_mean", "gust", "airflow", "baro_bias")
"""Blocks that stay observable in straight flight, or decay by themselves."""


@navigator
class AirDataGps(ReckoningNavigator):
    """GPS and air data without an inertial unit.

    Modes: initialising (an input is missing), aligning (no position yet), calibrating (GPS good), coasting, suspect (GPS contradicts itself
    or the prediction), failed (attitude or airspeed timed out).

    Attributes
    ----------
    core : AirCorrectionsCore
    high : HighRateFilter or None
        The second filter of the cascade.
    recovered_in_s : float or None
        How long the last return of GPS took until the position was as certain as before the outage.
    """

    name = "airdata_gps"
    colour = "#0072b2"
    dash = "2 3"
    aiding = "gps/velocity_aiding"
    gusts_mps = 4.0  # its airspeed is taken as measured
    standby = True
    outdone_by = ("dead_reckoning",)
    OwnSettings = AirDataGpsOwnSettings
    sensors = (
        GPS.but(position_floor_m=0.5, velocity_floor_mps=0.1, correlation_s=1.0, timeout_s=3.0, latency_s=0.0),
        BARO.but(sigma_m=1.5, period_s=0.5),
    )

    def __init__(self, settings: Any = None, stations: Any = None) -> None:
        super().__init__(settings or self.Settings(), stations)
        layout = Layout(unique([*correction_blocks(self.settings), *self.aid_blocks()]))
        self._attach(layout, AirCorrectionsCore(self.settings, layout))
        self._fixes = self.aids_of(PositionAid)
        self._observable, self._position_only = layout.mask(*LEARNING), layout.mask("core")
        self._is_joint = self.settings.filter == "joint"
        if not self._is_joint:
            for aid in self._fixes:  # the error estimator runs once a second on GPS velocity
                for channel in (self.channel_of(aid), *(self.channel_of(v) for v in self.aids_of(VelocityAid) if v.key == aid.key)):
                    channel.period_s = max(channel.period_s, 1.0)
        self._restart()

    def own_inputs(self) -> tuple[str, str]:
        """Attitude and air data."""
        return (self.settings.attitude_topic, AIR)

    def required_sources(self) -> tuple[str, str]:
        """Both of them."""
        return self.own_inputs()

    def _restart(self) -> None:
        self._start_over(AirCorrectionsCore(self.settings, self.layout))
        self.movable = None
        self.high = None if self._is_joint else HighRateFilter(self.settings.cascade, self.settings.filter == "fixed_gain")
        self._repeats: dict[str, tuple[tuple[float, ...], int]] = {}
        self._stated: float | None = None
        self._vanes, self._sign = (VaneWatch("incidence"), VaneWatch("sideslip")), SignWatch()
        self._straight, self._is_straight = StraightWatch(self.settings.straight_s), False
        self._variation: float | None = None
        self._variation_ns = -(10**18)
        self._before_m = 0.0
        self._back_ns: int | None = None
        self.recovered_in_s: float | None = None
        self._found: dict[str, str] = {}
        self._since: dict[str, int] = {}

    # measurements ------------------------------------------------------------------------------------------------------------

    def refusal(self, item: Measurement) -> str:
        """Repetitions of a receiver that fixes more seldom than it puts out are no news."""
        if isinstance(item, GpsPosition):
            values: tuple[float, ...] = item.lat, item.lon, item.height
        elif isinstance(item, GpsVelocity):
            values = tuple(item.vel_n.tolist())
        else:
            return ""
        before, first_ns = self._repeats.get(item.source, ((), 0))
        if values != before:
            self._repeats[item.source] = values, item.stamp_ns
            return ""
        return REPEAT if 0 <= item.stamp_ns - first_ns <= REPEAT_NS else ""

    def _fuse(self, item: Measurement) -> None:
        if not self.core.started:
            self._align(item)
            return
        self._advance(item.stamp_ns)
        if not self._hold(item, self.core):
            self._aid(item)
        elif isinstance(item, AirVelocity):
            self._confirm_air(item.stamp_ns)
        elif self.high is not None and isinstance(item, Attitude):
            self.high.step(item.stamp_ns, self.core.velocity()[0])

    def _hold(self, item: Measurement, core: AirCorrectionsCore) -> bool:
        """Let a core hold what carries it; return whether this does.  Vanes are watched once, by the navigator's own."""
        if item.source == self.settings.attitude_topic and isinstance(item, Attitude):
            core.held.take_attitude(self._to_true_north(item))
        elif item.source == AIR and isinstance(item, AirVelocity):
            core.held.take_air(self._without_stuck_vanes(item) if core is self.core else item, self.settings.airspeed)
        else:
            return False
        return True

    def _to_true_north(self, attitude: Attitude) -> Attitude:
        """An attitude whose heading counts from true north."""
        if self.settings.heading_reference == "true" or self._variation is None:
            return attitude
        return replace(attitude, q_nb=quat_multiply(quat_from_rotvec(np.array([0.0, 0.0, self._variation])), attitude.q_nb))

    def _without_stuck_vanes(self, air: AirVelocity) -> AirVelocity:
        """Air data in which an angle that never moves is not measured; it is named."""
        forward = float(air.vel_b[0])
        if forward < self.settings.airspeed.minimum_mps:
            return air
        for watch, axis in zip(self._vanes, (2, 1), strict=True):
            measured = air.cov_b[axis, axis] < UNKNOWN_VARIANCE
            if self._say(f"{watch.name} vane does not move", measured and watch.is_stuck(air.stamp_ns, float(air.vel_b[axis]) / forward)):
                cov_b, vel_b = air.cov_b.copy(), air.vel_b.copy()
                cov_b[axis, :], cov_b[:, axis], cov_b[axis, axis], vel_b[axis] = 0.0, 0.0, UNKNOWN_VARIANCE, 0.0
                air = replace(air, vel_b=vel_b, cov_b=cov_b)
        return air

    def _say(self, words: str, holds: bool) -> bool:
        """Keep a finding while it holds."""
        if holds:
            self._found.setdefault(words, words)
            self._since.setdefault(words, self.core.t_ns)
        else:
            self._found.pop(words, None)
            self._since.pop(words, None)
        return holds

    def _align(self, item: Measurement) -> None:
        """Gather attitude and airspeed, then begin at the first fix."""
        if isinstance(item, GpsPosition):
            self._know_variation(item)
        self._hold(item, self.core)
        outdated = self.core.timed_out(item.stamp_ns)
        if outdated:
            self.mode, self.reason = Mode.INITIALISING, outdated
        elif self.settings.heading_reference == "magnetic" and self._variation is None:
            self.mode, self.reason = Mode.ALIGNING, "magnetic variation unknown: no fix yet, or stamps that are no date; set variation_deg"
        elif isinstance(item, GpsPosition):
            self.core.start(item.stamp_ns, np.array([item.lat, item.lon, item.height]), 100.0 * self._fixes[0].noise(item))
            if self.high is not None:
                self.high.begin(item.stamp_ns, self.core.nav, self.core.velocity()[0])
            self.set_origin(item.lat, item.lon, item.height)
            self._aid(item)
            self._judge()
        else:
            self.mode, self.reason = Mode.ALIGNING, "waiting for the first GPS fix"

    def _know_variation(self, fix: GpsPosition) -> None:
        """The magnetic variation at a place: as set, else of the model, anew each minute; None where neither is known."""
        if self.settings.variation_deg < FROM_MODEL:
            self._variation = self.settings.variation_deg * DEGREE
        elif fix.stamp_ns - self._variation_ns >= VARIATION_NS and (year := year_of_stamp(fix.stamp_ns)) is not None:
            self._variation_ns = fix.stamp_ns
            try:
                self._variation = declination(fix.lat, fix.lon, fix.height, year)
            except ValueError:
                self._variation = None

    def _aid(self, item: Measurement) -> None:
        self.core.settle()
        if isinstance(item, GpsPosition):
            self._know_variation(item)
            self._bump(item)
        was_good = self.gps_good(item.stamp_ns)
        used = self.use(item)
        for aid in used:
            if self._is_joint and isinstance(aid, VelocityAid) and isinstance(item, GpsVelocity):
                self.core.learn(item.vel_n - aid.swing_n, aid.noise(item))
        if self.high is not None and isinstance(item, GpsPosition | GpsVelocity) and not any(aid.rejecting_since_ns for aid in self._fixes):
            self.high.see(item)
        if any(isinstance(aid, VelocityAid) for aid in used):
            self._look(item.stamp_ns)
        if any(aid.is_fix for aid in used):
            self._time_recovery(item.stamp_ns, was_good)
            if self._stands(item.stamp_ns):
                self.core.held.fastest = 0.0

    def use_aid(self, aid: Aid, measurement: Measurement) -> bool:
        """Run one aid; in straight flight, and by position in the cascade, only some states may move."""
        self.movable = self._observable if self._is_straight else None
        if not self._is_joint and isinstance(aid, PositionAid):
            self.movable = self._position_only
        return super().use_aid(aid, measurement)

    def _bump(self, fix: GpsPosition) -> None:
        """Widen the position where the stated sigma steps: other satellites have other errors (the thesis's bump of Q)."""
        stated, before = float(np.trace(fix.cov_n[:2, :2])), self._stated
        self._stated = stated
        if before is not None and not before / STEP < stated < before * STEP:
            self.core.P[POS, POS] += self.settings.bump_m**2 * np.eye(3)

    def _look(self, stamp_ns: int) -> None:
        """Look at the residual of a velocity that was used."""
        core, aid = self.core, self.aids_of(VelocityAid)[0]
        held = core.held
        if aid.status.observation is None or not held.airborne:
            return
        q_nb = held.attitude(stamp_ns)[0]
        self._is_straight = self._straight.is_straight(stamp_ns, quat_to_euler(q_nb)[2], held.speed)
        if held.measured[1]:
            air_n = core.velocity()[0] - core.corrections()[WIND : WIND + 3]
            lateral_n = held.vel_b[1] * quat_to_dcm(q_nb)[:, 1]
            self._say(SIGN, bool(self._sign.take(stamp_ns, lateral_n, aid.status.observation - air_n)))
        if self._variation is not None:
            heading, total = self.settings.heading, core.totals()[2]
            expected = math.hypot(heading.bias_deg, heading.offset_deg) * DEGREE
            args = core.sigmas()[0], expected, self._variation, self.settings.heading_reference == "magnetic"
            self._say(OTHER_NORTH, bool(other_north(float(total), *args)))

    def _time_recovery(self, stamp_ns: int, was_good: bool) -> None:
        """Measure how long GPS takes after an outage to make the position as certain as it was before."""
        sigma = self.core.horizontal_sigma()
        if not was_good and self._before_m > 0.0:
            self._back_ns = stamp_ns
        if self._back_ns is None:
            self._before_m = max(sigma, 0.98 * self._before_m)
        elif sigma <= 1.1 * self._before_m:
            self.recovered_in_s, self._back_ns = 1e-9 * (stamp_ns - self._back_ns), None

    # mode and reason ---------------------------------------------------------------------------------------------------------

    def _judge(self) -> None:
        """Find the mode and its reason."""
        core = self.core
        outdated, found = core.timed_out(), self.trust.suspicion()
        if outdated:
            self.mode, self.reason = Mode.FAILED, f"{outdated}: last value held, error unbounded"
        elif self.gps_good(core.t_ns):
            self.mode, self.reason = Mode.CALIBRATING, "GPS good"
            if not core.held.airborne:
                self.reason += ", " + ("airspeed failed" if core.held.fastest > 0.0 else "on the ground") + ": wind is not observable"
            elif self._is_straight:
                self.reason += f", {HELD_WORDS}"
        else:
            gps = self._without_gps(core.t_ns)
            slow = f"airspeed below {self.settings.airspeed.minimum_mps:g} m/s: landed, or airspeed failed; position held"
            self.mode, self.reason = Mode.COASTING, f"{gps}; {'last corrections held' if core.held.airborne else slow}"
            if found:
                self.mode, self.reason = Mode.SUSPECT, f"{found}; {self.reason}"
        self.reason += "".join(f"; {words}" for words in self._found.values())
        self.reason += self._alert_words()

    def contradictions(self) -> tuple[Contradiction, ...]:
        """Those of every navigator, and what the residuals say of the sensors."""
        own = (Contradiction(words, (AIR, self.settings.attitude_topic), 0.0, "", self._since[words]) for words in self._found)
        return (*super().contradictions(), *own)

    def _details(self) -> dict[str, str]:
        recovered: dict[str, str] = {} if self.recovered_in_s is None else {"recovered_in_s": f"{self.recovered_in_s:.1f}"}
        return {**super()._details(), **recovered, "filter": self.settings.filter}

    # outputs -----------------------------------------------------------------------------------------------------------------

    def _solution(self, core: AirCorrectionsCore) -> NavSolution:
        velocity, G, noise = core.velocity()
        held = core.held
        q_nb, swing = held.attitude(core.t_ns)
        nav, cov_pos, cov_vel = core.nav, core.P[POS, POS], G @ core.P @ G.T + noise
        if self.high is not None:
            in_position, in_velocity = self.high.covariance(cov_vel)
            nav, cov_pos, cov_vel = self.high.ahead(core.t_ns), cov_pos + in_position, in_velocity
            velocity = self.high.vel_n if core is self.core else velocity
        doubt = self.doubt(core.t_ns)
        return NavSolution(
            *(core.t_ns, self.name, float(nav[0]), float(nav[1]), float(nav[2]), velocity.copy()),
            q_nb=q_nb,
            angular_rate_b=held.rate_b,
            specific_force_b=held.force_b,
            cov_pos=cov_pos + doubt[0:3, 0:3],
            cov_vel=cov_vel + doubt[3:6, 3:6],
            cov_att=held.cov_att + swing**2 * np.eye(3),
            wind_n=core.totals()[0:2],
            cov_wind=core.wind_covariance(),
            mode=self.mode,
            states=self._states(core.P, 3),
        )

    def _sigmas(self) -> dict[str, float]:
        core = self.core
        if not core.started:
            return {}
        north, east, down = self._position_sigmas()
        heading, scale, bias = core.sigmas().tolist()
        return {
            "position_horizontal_m": math.hypot(north, east),
            "position_down_m": down,
            "wind_mps": self._wind_sigma(),
            "heading_deg": math.degrees(heading),
            "airspeed_scale": scale,
            "airspeed_bias_mps": bias,
        }


AirDataGpsSettings = AirDataGps.Settings
"""All settings of the GPS and air data navigator."""
