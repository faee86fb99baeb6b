"""Dead reckoning: airspeed along the heading plus wind, taught by GPS while it lasts, held together by DME ranges when it is gone.

Gebre-Egziabher (2004), sections 5.3, 6.4, 6.5 and 8.2 (systems G41, G42, G52, G53 and G61).  The error model is in
:mod:`~lowcostnav_ros.cores.reckoning_model`, what it listens to in :mod:`~lowcostnav_ros.aids.dead_reckoning_aids`.
"""

import copy
import math
from typing import ClassVar

import numpy as np

from lowcostnav_ros.aids.dead_reckoning_aids import BaroAid, DmeAid, GpsPositionAid, GpsVelocityAid
from lowcostnav_ros.aids.uplink import RadarFixAid, WindUplinkAid
from lowcostnav_ros.aids.vor import BLOCK as VOR_BIAS
from lowcostnav_ros.aids.vor import BearingState, VorAid
from lowcostnav_ros.base.measurements import (
    AirVelocity,
    Attitude,
    GpsPosition,
    GpsVelocity,
    Measurement,
    NavSolution,
    Pressure,
    SlantRange,
    VorBearing,
)
from lowcostnav_ros.cores.reckoning import DeadReckoningState
from lowcostnav_ros.cores.reckoning_inputs import HeldInputs
from lowcostnav_ros.cores.reckoning_model import NM, POS
from lowcostnav_ros.cores.reckoning_settings import DeadReckoningSettings
from lowcostnav_ros.estimation.aiding import Aid
from lowcostnav_ros.estimation.error_state import Kind
from lowcostnav_ros.navigators.base import ERROR, Navigator
from lowcostnav_ros.navigators.dead_reckoning.geometry import HeardStations
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.radionav.stations import StationTable

HEARD_S = 120.0
"""A station counts for the geometry this long after its last accepted range."""
UPLINK_S = 120.0
"""What the ground sent is named this long after it was used."""


@navigator
class DeadReckoning(Navigator):
    """DME-aided dead reckoning with full attitude and air data.

    Modes: initialising (an input is missing), aligning (no position yet), calibrating (GPS good), dme_aided, vor_aided (radials
    alone), coasting, failed (attitude or airspeed silent).

    Parameters
    ----------
    settings : DeadReckoningSettings
    stations : StationTable or None
        Where the DME and VOR stations stand; without it every range and radial is refused by name.

    Attributes
    ----------
    state : DeadReckoningState
    held : HeldInputs
    geometry : str
        What is wrong with the geometry of the stations heard, empty when nothing is.
    """

    name: ClassVar[str] = "dead_reckoning"
    Settings = DeadReckoningSettings
    colour = "#d55e00"
    modes = {"dme_aided": ("#7570b3", ""), "vor_aided": ("#a17fa6", "")}

    def __init__(self, settings: DeadReckoningSettings | None = None, stations: StationTable | None = None) -> None:
        settings = settings or DeadReckoningSettings()
        uplinks = (topic for topic in (settings.radar.topic, settings.wind_uplink.topic) if topic)
        radials = ("vor/bearing",) if settings.vor.enabled else ()
        optional = ("air/static_pressure", "gps/fix", "gps/vel", "dme/range", *radials, *uplinks)
        self.inputs = {settings.attitude_topic: True, "air/velocity": True, **dict.fromkeys(optional, False)}
        super().__init__(settings)
        self.stations = stations
        self._restart()

    @property
    def P(self) -> np.ndarray:
        """Error covariance (n, n); its states are named by ``state.layout.labels``."""
        return self.state.P

    def start_at(self, stamp_ns: int, lat: float, lon: float, height: float, sigma_m: float = 10.0) -> None:
        """Begin at a given position (rad, rad, m above the ellipsoid) known to ``sigma_m`` per axis, instead of at the first fix."""
        self.state.start(stamp_ns, np.array([lat, lon, height]), sigma_m**2 * np.eye(3))
        self.set_origin(lat, lon, height)
        self._judge()

    def correct(self, dx: np.ndarray) -> None:
        """Inject the correction (n,) of an aid."""
        self.state.correct(dx)

    def gps_good(self) -> bool:
        """Whether a fix was accepted within the time-out."""
        return self._accepted_within(self._gps_position, self.settings.gps.timeout_s)

    def dme_good(self) -> bool:
        """Whether a range was accepted within the time-out."""
        return self._accepted_within(self._dme, self.settings.dme.timeout_s)

    def bearing_state(self) -> BearingState:
        """What the VOR aid asks for; while GPS is good a radial moves the error of its station alone, and never height."""
        state = self.state
        free = state.layout.mask(VOR_BIAS) if self.gps_good() else state.free_for_ranges
        return BearingState(tuple(state.nav.tolist()), self.held.speed, state.layout, state.estimate, free)

    def _restart(self) -> None:
        settings = self.settings
        self.state, self.held, self.geometry = DeadReckoningState(settings), HeldInputs(), ""
        self._last_out_ns: int | None = None
        self._looked_s: int | None = None
        self._heard = HeardStations(self.stations, HEARD_S)
        self._gps_position = GpsPositionAid(settings.gps)
        self._gps_velocity = GpsVelocityAid(settings.gps, settings.wind)
        self._baro = BaroAid(settings.height, settings.gps.gate)
        self._dme, self._vor = DmeAid(settings.dme, self.stations), VorAid(settings.vor, self.stations, self.state.layout)
        self._radar, self._wind_uplink = RadarFixAid(settings.radar), WindUplinkAid(settings.wind_uplink)
        self.aids = [self._gps_position, self._gps_velocity, self._baro, self._dme]
        self.aids += [self._vor] if settings.vor.enabled else []
        self.aids += [aid for aid in (self._radar, self._wind_uplink) if aid.settings.topic]

    def _fuse(self, item: Measurement) -> None:
        if self.state.t_ns is None:
            self._align(item)
            return
        self._advance(item.stamp_ns)
        if isinstance(item, Attitude | AirVelocity):
            self._hold(item, self.held)
        else:
            self._aid(item)

    def _align(self, item: Measurement) -> None:
        """Gather attitude and airspeed, then begin at the first fix."""
        if isinstance(item, Attitude | AirVelocity):
            self._hold(item, self.held)
        silent = self.held.silent(item.stamp_ns, self.settings.heading.timeout_s, self.settings.airspeed.timeout_s)
        if silent:
            self.mode, self.reason = "initialising", silent
        elif isinstance(item, GpsPosition):
            vague = 100.0 * self._gps_position.noise(item)  # the fix itself is fused next
            self.state.start(item.stamp_ns, np.array([item.lat, item.lon, item.height]), vague)
            self.set_origin(item.lat, item.lon, item.height)
            self._aid(item)
            self._judge()
        else:
            self.mode, self.reason = "aligning", "waiting for the first GPS fix"

    def _hold(self, item: Attitude | AirVelocity, held: HeldInputs) -> None:
        if isinstance(item, Attitude):
            held.take_attitude(item)
        else:
            held.take_air(item, self.settings.airspeed)

    def _aid(self, item: Measurement) -> None:
        self.state.settle(self.held)
        if isinstance(item, GpsPosition):
            if self.use_aid(self._gps_position, item) and not self.held.airborne:
                self.held.fastest = 0.0
        elif isinstance(item, GpsVelocity):
            self.use_aid(self._gps_velocity, item)
        elif isinstance(item, Pressure):
            self.use_aid(self._baro, item)
        elif isinstance(item, NavSolution):
            self.use_aid(self._radar if item.source == self.settings.radar.topic else self._wind_uplink, item)
        elif isinstance(item, VorBearing):
            if self._vor.due(item):
                self.use_aid(self._vor, item)
        elif isinstance(item, SlantRange) and self.use_aid(self._dme, item):
            self._heard.heard(item.station, item.stamp_ns)

    def _advance(self, stamp_ns: int) -> None:
        """Move to ``stamp_ns``; the solution at a multiple of the output period goes out once all that bears its stamp is fused."""
        period, state = self.output_period_ns, self.state
        due = -(-state.t_ns // period) * period
        while due < stamp_ns:
            state.move(self.held, due)
            state.settle(self.held)
            if due != self._last_out_ns:
                self._judge()
                self._out.append(self._solution(state, self.held))
                self._last_out_ns = due
            due += period
        state.move(self.held, stamp_ns)

    def _accepted_within(self, aid: Aid, limit_s: float) -> bool:
        age = aid.status.age_s(self.state.t_ns)
        return age is not None and age <= limit_s

    def _judge(self) -> None:
        """Find the mode and say why."""
        silent = self.state.silent(self.held)
        if silent:
            self.mode, self.reason = "failed", f"{silent}: the last values are carried on and nobody knows how wrong they are"
        elif self.gps_good():
            self.geometry = ""
            self.mode, self.reason = "calibrating", "GPS good" if self.held.airborne else "GPS good, on the ground: wind is not learned"
        else:
            self._judge_outage()
            self.reason += self._uplinks_used()
        if self._alert():
            sigma, limit = self.state.horizontal_sigma() / NM, self.settings.alert_nm
            self.reason += f"; ALERT: believed error {sigma:.2f} NM is above {limit:g} NM"

    def _judge_outage(self) -> None:
        state, age = self.state, self._gps_position.status.age_s(self.state.t_ns)
        gps = "no GPS yet" if age is None else f"no GPS for {age:.0f} s"
        if not self.held.airborne:
            slow = f"airspeed below {self.settings.airspeed.minimum_mps:g} m/s: landed, or it failed"
            self.mode, self.reason = "coasting", f"{gps}; {slow}; position held"
            return
        radials = ", ".join(self._vor.heard(state.t_ns))
        if not self.dme_good():
            self.geometry = ""
            self.mode, self.reason = "coasting", f"{gps}; reckoning on airspeed, heading and learned wind"
            if radials:
                self.mode, self.reason = "vor_aided", f"{gps}; VOR {radials}"
            return
        self._look_at_geometry()
        if radials:
            self.geometry = ""  # a radial tells what ranges of one station, or along the track, do not
        parts = (gps, f"DME {', '.join(self._heard.idents(state.t_ns))}", f"VOR {radials}" if radials else "", self.geometry)
        self.mode, self.reason = "dme_aided", "; ".join(part for part in parts if part)

    def _uplinks_used(self) -> str:
        """Name what the ground contributed lately."""
        words = (("radar fix", self._radar), ("wind from the ground", self._wind_uplink))
        ages = [(name, aid.status.age_s(self.state.t_ns)) for name, aid in words]
        return "".join(f"; {name} {age:.0f} s ago" for name, age in ages if age is not None and age <= UPLINK_S)

    def _look_at_geometry(self) -> None:
        """Judge the geometry of the stations heard, once a second."""
        state = self.state
        second = state.t_ns // 1_000_000_000
        if second == self._looked_s:
            return
        self._looked_s = second
        velocity = state.velocity(self.held)[0]
        course = math.atan2(velocity[1], velocity[0])
        self.geometry = self._heard.judge(state.t_ns, state.nav, course, lambda u: math.sqrt(u @ state.P[0:2, 0:2] @ u))

    def _alert(self) -> bool:
        return self.state.t_ns is not None and self.state.horizontal_sigma() > self.settings.alert_nm * NM

    def _level(self) -> int:
        return ERROR if self._alert() else super()._level()

    def _predict(self) -> NavSolution | None:
        if self.state.t_ns is None:
            return None
        state, held = self.state.branch(), copy.copy(self.held)
        for item in self.horizon.ahead()[1]:
            if isinstance(item, Attitude | AirVelocity):
                state.move(held, item.stamp_ns)
                self._hold(item, held)
        state.move(held, self.horizon.newest_ns)
        return self._solution(state, held)

    def _solution(self, state: DeadReckoningState, held: HeldInputs) -> NavSolution:
        velocity, G = state.velocity(held)
        return NavSolution(
            stamp_ns=state.t_ns,
            source=self.name,
            lat=float(state.nav[0]),
            lon=float(state.nav[1]),
            height=float(state.nav[2]),
            vel_n=velocity,
            q_nb=held.q_nb,
            angular_rate_b=held.rate_b,
            specific_force_b=held.force_b,
            cov_pos=state.P[POS, POS].copy(),
            cov_vel=G @ state.P @ G.T + state.velocity_noise(held),
            cov_att=held.cov_att,
            wind_n=state.totals()[0:2],
            cov_wind=state.wind_covariance(),
            mode=self.mode,
            states=self._states(state),
        )

    def _states(self, state: DeadReckoningState) -> dict[str, tuple[float, float]]:
        total = state.totals()
        return {
            "heading_bias_rad": (float(total[2]), state.sigma_of(Kind.HEADING_BIAS)),
            "airspeed_scale": (float(total[3]), state.sigma_of(Kind.AIRSPEED_SCALE)),
            "airspeed_bias_mps": (float(total[4]), state.sigma_of(Kind.AIRSPEED_BIAS)),
        }

    def _sigmas(self) -> dict[str, float]:
        if self.state.t_ns is None:
            return {}
        state = self.state
        north, east, down = (math.sqrt(state.P[i, i]) for i in range(3))
        wind = state.wind_covariance()
        return {
            "horizontal_m": state.horizontal_sigma(),
            "north_m": north,
            "east_m": east,
            "height_m": down,
            "wind_mps": math.sqrt(wind[0, 0] + wind[1, 1]),
            "heading_bias_deg": math.degrees(state.sigma_of(Kind.HEADING_BIAS)),
        }
