"""Dead reckoning: airspeed along the heading plus wind, observed with GPS while it lasts, held together by DME ranges when it is gone.

Gebre-Egziabher (2004), sections 5.3, 6.4, 6.5 and 8.2 (systems G41, G42, G52, G53 and G61).  The error model is in
:mod:`~lowcostnav_ros.cores.reckoning_model`.
"""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.aids._station import StationAid
from lowcostnav_ros.aids.baro import BARO
from lowcostnav_ros.aids.dme import DME, DmeAid
from lowcostnav_ros.aids.gps import GPS, PositionAid, VelocityAid
from lowcostnav_ros.aids.radar import RADAR
from lowcostnav_ros.aids.vor import VOR, VorAid
from lowcostnav_ros.aids.wind_uplink import WIND_UPLINK
from lowcostnav_ros.base.measurements import AirVelocity, Attitude, GpsPosition, GpsVelocity, Health, Measurement, NavSolution, SlantRange
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.cores.reckoning import ReckoningCore, core_blocks
from lowcostnav_ros.cores.reckoning_model import POS
from lowcostnav_ros.estimation.aiding import Aid, unique
from lowcostnav_ros.estimation.error_state import Block, Layout
from lowcostnav_ros.navigators.dead_reckoning.geometry import ReceivedStations
from lowcostnav_ros.navigators.dead_reckoning.mirror import AGAIN_NS, Mirror
from lowcostnav_ros.navigators.dead_reckoning.settings import DeadReckoningOwnSettings, baro_walk
from lowcostnav_ros.navigators.reckoning import AIR, ReckoningNavigator
from lowcostnav_ros.navigators.registry import navigator

AHRS_HEALTH = "ahrs/health"
STATES = ("heading_bias_rad", "airspeed_scale", "airspeed_bias_mps")
"""Estimates beside position, velocity and wind that a solution carries, each the sum of its states."""
RECEIVED_S = 120.0
"""A station counts for the geometry this long after its last accepted range."""


@navigator
class DeadReckoning(ReckoningNavigator):
    """DME-aided dead reckoning with full attitude and air data.

    Modes: initialising (an input is missing), aligning (no position yet), calibrating (GPS good), dme_aided, vor_aided (radials
    alone), coasting, suspect (GPS contradicts itself or the reckoning), failed (attitude or airspeed timed out).

    Attributes
    ----------
    core : ReckoningCore
    layout : Layout
    geometry : str
        What is wrong with the geometry of the stations received, empty when nothing is.
    """

    name = "dead_reckoning"
    colour = "#d55e00"
    modes = {"dme_aided": ("#7570b3", ""), "vor_aided": ("#a17fa6", "")}
    OwnSettings = DeadReckoningOwnSettings
    sensors = (
        GPS.but(position_floor_m=1.5, velocity_floor_mps=0.1, correlation_s=1.0, timeout_s=3.0, latency_s=0.0),
        DME,
        VOR,
        BARO.but(sigma_m=1.5, stated_scale=1.0, walk_m_rts=baro_walk(), period_s=0.0),
        RADAR,
        WIND_UPLINK,
    )

    def __init__(self, settings: Any = None, stations: Any = None) -> None:
        super().__init__(settings or self.Settings(), stations)
        layout = Layout(self.blocks())
        self._attach(layout, ReckoningCore(self.settings, layout))
        self._fixes, self._ranges, self._radials = self.aids_of(PositionAid), self.aids_of(DmeAid), self.aids_of(VorAid)
        self._others = [aid for aid in self.aids if not isinstance(aid, StationAid)]
        self._restart()

    def own_inputs(self) -> tuple[str, ...]:
        """Attitude, air data, and what our own attitude reference says of itself: its gyros know a slow spoofer, the wind does not."""
        health = (AHRS_HEALTH,) if self.settings.attitude_topic == "imu/data_fused" else ()
        return (self.settings.attitude_topic, AIR, *health)

    def required_sources(self) -> tuple[str, ...]:
        """Attitude and air data."""
        return self.own_inputs()[:2]

    def blocks(self) -> list[Block]:
        """The list of state blocks: the core's and what the aids need; errors of stations are noise in the reduced model."""
        full = self.settings.model == "full"
        aids = (aid for aid in self.aids if full or not isinstance(aid, StationAid))
        return unique([*core_blocks(self.settings), *(block for aid in aids for block in aid.blocks())])

    # measurements ------------------------------------------------------------------------------------------------------------

    def _restart(self) -> None:
        self._start_over(ReckoningCore(self.settings, self.layout))
        self.geometry = ""
        self.mirror = Mirror()
        self._looked_s: int | None = None
        self._received = ReceivedStations(self.stations, RECEIVED_S)

    def _fuse(self, item: Measurement) -> None:
        if not self.core.started:
            self._align(item)
            return
        self._advance(item.stamp_ns)
        self.mirror.carry(item.stamp_ns)
        if isinstance(item, Health):
            self.trust.told = item.mode == Mode.SUSPECT
        elif self._hold(item, self.core):
            self.mirror.hold(item)
            self.trust.witness.take(item)
            if isinstance(item, AirVelocity):
                self._confirm_air(item.stamp_ns)
        else:
            self._aid(item)

    def _hold(self, item: Measurement, core: ReckoningCore) -> bool:
        """Let the core hold what carries it; return whether this does."""
        kind = {self.settings.attitude_topic: Attitude, AIR: AirVelocity}.get(item.source)
        if kind is None or not isinstance(item, kind):
            return False
        core.hold(item)
        return True

    def _cores(self) -> tuple[ReckoningCore, ...]:
        """The core of its own place, and that of the mirror image while it is possible."""
        return (self.core,) if self.mirror.core is None else (self.core, self.mirror.core)

    def _align(self, item: Measurement) -> None:
        """Gather attitude and airspeed, then begin at the first fix."""
        self._hold(item, self.core)
        outdated = self.core.timed_out(item.stamp_ns)
        if outdated:
            self.mode, self.reason = Mode.INITIALISING, outdated
        elif isinstance(item, GpsPosition):
            vague = 100.0 * self._fixes[0].noise(item)  # the fix itself is fused next
            self.core.start(item.stamp_ns, np.array([item.lat, item.lon, item.height]), vague)
            self.set_origin(item.lat, item.lon, item.height)
            self._aid(item)
            self._judge()
        else:
            self.mode, self.reason = Mode.ALIGNING, "waiting for the first GPS fix"

    def _aid(self, item: Measurement) -> None:
        self.core.settle()
        used = self.use(item)
        for aid in used:
            if isinstance(aid, VelocityAid) and isinstance(item, GpsVelocity):
                self.core.learn(item.vel_n - aid.swing_n, aid.noise(item))
        if any(aid.is_fix for aid in used) and self._stands(item.stamp_ns):
            self.core.held.fastest = 0.0
        if used and isinstance(item, SlantRange):
            self._received.received(item.station, item.stamp_ns)

    def use_aid(self, aid: Aid, measurement: Measurement) -> bool:
        """As every navigator; while two places are possible, the other takes the measurement, too."""
        if self.mirror.core is None:
            return super().use_aid(aid, measurement)
        before = self.mirror.foresee(aid, measurement, self)
        used = super().use_aid(aid, measurement)
        self.mirror.take(aid, measurement, self, before)
        return used

    def doubt(self, stamp_ns: int) -> np.ndarray:
        """As every navigator; of two places the other one is in doubt."""
        doubt = super().doubt(stamp_ns)
        if self.mirror.core is None:
            return doubt
        doubt = doubt.copy()
        doubt[POS, POS] += self.mirror.doubt(self.core)
        return doubt

    def _before_output(self, due_ns: int) -> None:
        self.trust.look(due_ns)

    # mode and reason ---------------------------------------------------------------------------------------------------------

    def _judge(self) -> None:
        """Find the mode and its reason."""
        core = self.core
        outdated, found = core.timed_out(), self.trust.suspicion()
        if outdated:
            self.mode, self.reason = Mode.FAILED, f"{outdated}: last value held, error unbounded"
        elif self.gps_good(core.t_ns):
            self.geometry = ""
            self.mirror.close()
            self.mode = Mode.CALIBRATING
            failed = "airspeed failed" if core.held.fastest > 0.0 else "on the ground"
            self.reason = "GPS good" if core.held.airborne else f"GPS good, {failed}: wind is not observable"
            if self.trust.led_away is not None:
                self.mode, self.reason = Mode.SUSPECT, found
        else:
            self._judge_outage(core.t_ns)
            if found:
                self.mode, self.reason = Mode.SUSPECT, f"{found}; {self.reason}"
            words = (aid.words(core.t_ns) for aid in self._others)
            self.reason += "".join(f"; {each}" for each in words if each)
        self.reason += self._alert_words()

    def _judge_outage(self, now_ns: int) -> None:
        gps = self._without_gps(now_ns)
        if not self.core.held.airborne:
            slow = f"airspeed below {self.settings.airspeed.minimum_mps:g} m/s: landed, or airspeed failed"
            self.mode, self.reason = Mode.COASTING, f"{gps}; {slow}; position held"
            return
        radials = ", ".join(name for aid in self._radials for name in aid.used_lately(now_ns))
        if not any(aid.is_fresh(now_ns) for aid in self._ranges):
            self.geometry = ""
            self.mode, self.reason = Mode.COASTING, f"{gps}; reckoning on airspeed, heading and estimated wind"
            if radials:
                self.mode, self.reason = Mode.VOR_AIDED, f"{gps}; VOR {radials}"
            return
        self._look_at_geometry(now_ns)
        if radials:
            self.geometry = ""  # a radial observes what ranges of one station, or along the track, do not
        moved_ns = self.mirror.moved_ns
        moved = "taken to the mirror place" if moved_ns is not None and now_ns - moved_ns < AGAIN_NS else ""
        parts = (gps, f"DME {', '.join(self._received.idents(now_ns))}", f"VOR {radials}" if radials else "", self.geometry, moved)
        self.mode, self.reason = Mode.DME_AIDED, "; ".join(part for part in parts if part)

    def _look_at_geometry(self, now_ns: int) -> None:
        """Judge the geometry of the stations received, once a second."""
        second = now_ns // 1_000_000_000
        if second == self._looked_s:
            return
        self._looked_s = second
        core = self.core
        velocity = core.velocity()[0]
        course = math.atan2(velocity[1], velocity[0])
        self.geometry = self._received.judge(now_ns, core.nav, course, lambda u: math.sqrt(u @ core.P[0:2, 0:2] @ u))
        if self._received.mirror_n is not None:
            self.mirror.begin(core, self._received.mirror_n)

    # outputs -----------------------------------------------------------------------------------------------------------------

    def _solution(self, core: ReckoningCore) -> NavSolution:
        velocity, G, noise = core.velocity()
        total, held = core.totals(), core.held
        q_nb, swing = held.attitude(core.t_ns)
        doubt = self.doubt(core.t_ns)
        return NavSolution(
            *(core.t_ns, self.name, float(core.nav[0]), float(core.nav[1]), float(core.nav[2]), velocity),
            q_nb=q_nb,
            angular_rate_b=held.rate_b,
            specific_force_b=held.force_b,
            cov_pos=core.P[POS, POS] + doubt[0:3, 0:3],
            cov_vel=G @ core.P @ G.T + noise + doubt[3:6, 3:6],
            cov_att=held.cov_att + swing**2 * np.eye(3),
            wind_n=core.wind_n(),
            cov_wind=core.wind_covariance(),
            mode=self.mode,
            states=dict(zip(STATES, zip(total[2:].tolist(), core.sigmas().tolist(), strict=True), strict=True)),
        )

    def _sigmas(self) -> dict[str, float]:
        core = self.core
        if not core.started:
            return {}
        north, east, down = self._position_sigmas()
        return {
            "position_horizontal_m": math.hypot(north, east),
            "position_north_m": north,
            "position_east_m": east,
            "position_down_m": down,
            "wind_mps": self._wind_sigma(),
            "heading_bias_deg": math.degrees(core.sigmas()[0]),
        }


DeadReckoningSettings = DeadReckoning.Settings
