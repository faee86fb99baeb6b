"""The supervisor: judges GPS, picks the solution to fly on and changes from one to another without a jump.

The mode logic is the table of :mod:`~lowcostnav_ros.navigators.supervisor.modes`.  While GPS is good the GPS/INS solution is flown; in an
outage the one with the smaller estimated horizontal error, with hysteresis; and the only live one when the other has timed out.
"""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.measurements import Attitude, GpsPosition, Measurement, NavSolution
from lowcostnav_ros.base.modes import Level, Mode
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.navigators.supervisor.blend import Blend, carried_to
from lowcostnav_ros.navigators.supervisor.modes import Facts, Gps, next_mode
from lowcostnav_ros.physics.earth import difference_n

SOURCES = {"ins_gps/odometry_fused": "ins_gps", "dead_reckoning/odometry_fused": "dead_reckoning"}
"""Solutions to choose from, in the order of preference while GPS is good."""

NEVER_NS = -(10**18)
SWITCHES_KEPT = 100
LANDED = 0.5
"""Share of the airborne speed below which the aircraft counts as landed."""


@dataclass(frozen=True)
class GpsHealthSettings:
    """When GPS is trusted."""

    timeout_s: float = setting(3.0, "Without an agreeing fix for this long GPS counts as lost.", unit="s", minimum=0.2, maximum=60.0)
    agree_probability: float = setting(0.9995, "Share of true fixes that pass as agreeing.", minimum=0.5, maximum=0.9999999)
    agree_s: float = setting(5.0, "After an outage fixes must agree for this long.", unit="s", minimum=0.0, maximum=600.0)
    precise_m: float = setting(5.0, "Horizontal sigma of a fix above which GPS counts as coarse.", unit="m", minimum=0.1, maximum=1e3)


@dataclass(frozen=True)
class SupervisorSettings:
    """All settings of the supervisor."""

    solution_timeout_s: float = setting(1.0, "A solution older than this has timed out.", unit="s", minimum=0.1, maximum=60.0)
    airborne_mps: float = setting(15.0, "Ground speed above which the aircraft flies.", unit="m/s", minimum=0.1, maximum=200.0)
    start_s: float = setting(60.0, "GPS must be good within this long of the start, else there is no departure.", unit="s", minimum=1.0)
    switch_ratio: float = setting(0.7, "In an outage change when the other's sigma is below this share.", minimum=0.05, maximum=1.0)
    switch_s: float = setting(2.0, "... and has been for this long, or disagrees with GPS this long.", unit="s", minimum=0.0, maximum=600.0)
    blend_s: float = setting(3.0, "Time constant with which the difference at a change dies away.", unit="s", minimum=0.01, maximum=60.0)
    jump_m: float = setting(15.0, "A solution that jumps farther than this is blended like a change.", unit="m", minimum=0.1, maximum=1e4)
    alert_nm: float = setting(0.5, "Estimated horizontal sigma above which an alert is raised.", unit="NM", minimum=0.01, maximum=100.0)
    horizon: HorizonSettings = group(HorizonSettings, lag_s=0.5)  # longer than those of the navigators it subscribes to
    gps: GpsHealthSettings = group(GpsHealthSettings)


@dataclass(frozen=True, slots=True)
class Switch:
    """One change of the solution flown: from None at the start."""

    stamp_ns: int
    before: str | None
    after: str
    reason: str


@navigator
class Supervisor(Navigator):
    """Selects a solution and blends over changes.

    Attributes
    ----------
    active : str or None
        Name of the navigator whose solution is flown.
    switches : deque of Switch
        The last changes, oldest first.
    """

    name = "supervisor"
    Settings = SupervisorSettings
    room = "nav"
    colour = "#009e73"
    dash = "7 4"  # it publishes another navigator's solution; both lines stay visible
    modes = {"no_go": ("#8e3b2f", ""), "re_acquiring": ("#66a6d9", "")}
    not_observable = "it has no filter of its own; study the navigator whose solution it publishes"

    def __init__(self, settings: SupervisorSettings | None = None) -> None:
        settings = settings or SupervisorSettings()
        super().__init__(settings)
        self.threshold = chi_square.threshold(settings.gps.agree_probability, 2)
        self._restart()

    def own_inputs(self) -> tuple[str, ...]:
        """The navigators it selects from, the attitude reference and GPS fixes."""
        return (*SOURCES, "imu/data_fused", "gps/fix")

    def _restart(self) -> None:
        self.active: str | None = None
        self.switches: deque[Switch] = deque(maxlen=SWITCHES_KEPT)
        self._solutions: dict[str, NavSolution] = {}
        self._attitude: Attitude | None = None
        self._flown: NavSolution | None = None
        self._published: NavSolution | None = None
        self._blend = Blend(self.settings.blend_s)
        self._t_ns, self._first_ns = 0, NEVER_NS
        self._fix: GpsPosition | None = None
        self._agreed_ns, self._streak_ns, self._better_since_ns = NEVER_NS, NEVER_NS, NEVER_NS
        self._strays: dict[str, int] = {}
        self._airborne = False

    def _fuse(self, item: Measurement) -> None:
        if self._first_ns == NEVER_NS:
            self._first_ns = self._t_ns = item.stamp_ns
        self._advance(item.stamp_ns)
        if isinstance(item, NavSolution) and item.has_position:
            self._solutions[SOURCES[item.source]] = item
        elif isinstance(item, Attitude):
            self._attitude = item
        elif isinstance(item, GpsPosition):
            self._compare_fix(item)

    def _advance(self, stamp_ns: int) -> None:
        """Judge and publish at every multiple of the output period before ``stamp_ns``."""
        period = self.output_period_ns
        due = (self._t_ns // period + 1) * period
        while due < stamp_ns:
            self._judge(due)
            due += period
        self._t_ns = due - period

    def _compare_fix(self, fix: GpsPosition) -> None:
        """Compare a fix with every solution; it agrees when one of them does, or there is none to compare with."""
        if self._fix is not None and fix.stamp_ns - self._fix.stamp_ns > 1e9 * self.settings.gps.timeout_s:
            self._streak_ns = NEVER_NS
        self._fix = fix
        alive = self._alive(fix.stamp_ns)
        agreeing = [name for name, own in alive.items() if _distance_squared(fix, own) <= self.threshold]
        self._strays = {name: self._strays.get(name, fix.stamp_ns) for name in alive if name not in agreeing}
        if alive and not agreeing:
            self._streak_ns = NEVER_NS
            return
        self._agreed_ns = fix.stamp_ns
        if self._streak_ns == NEVER_NS:
            self._streak_ns = fix.stamp_ns

    def _gps(self, now_ns: int) -> Gps:
        settings = self.settings.gps
        if self._fix is None or now_ns - self._fix.stamp_ns > 1e9 * settings.timeout_s:
            return Gps.LOST
        outage = self.mode in (Mode.COASTING, Mode.RE_ACQUIRING, Mode.FAILED)
        if now_ns - self._agreed_ns > 1e9 * settings.timeout_s:
            return Gps.SEEN if outage else Gps.LOST
        if outage and (self._streak_ns == NEVER_NS or now_ns - self._streak_ns < 1e9 * settings.agree_s):
            return Gps.SEEN
        cov = self._fix.cov_n
        return Gps.GOOD if math.sqrt(max(cov[0, 0], cov[1, 1])) <= settings.precise_m else Gps.COARSE

    def _judge(self, now_ns: int) -> None:
        """One step of the table, the choice, and the solution that goes out."""
        gps = self._gps(now_ns)
        alive = self._alive(now_ns)
        waited = now_ns - self._first_ns > 1e9 * self.settings.start_s
        self.mode = next_mode(self.mode, Facts(gps, self._flies(alive), bool(alive), waited))
        if alive:
            active = self._choose(alive, now_ns)
            self._publish(alive[active], now_ns)
        self.reason = self._sentence(now_ns)

    def _alive(self, now_ns: int) -> dict[str, NavSolution]:
        """Fresh solutions by navigator, carried to ``now_ns``, in order of preference."""
        limit_ns = 1e9 * self.settings.solution_timeout_s
        names = (name for name in SOURCES.values() if name in self._solutions)
        return {name: carried_to(self._solutions[name], now_ns) for name in names if now_ns - self._solutions[name].stamp_ns <= limit_ns}

    def _flies(self, alive: dict[str, NavSolution]) -> bool:
        chosen = alive.get(self.active or "") or next(iter(alive.values()), None)
        if chosen is not None and chosen.vel_n is not None:
            speed = math.hypot(chosen.vel_n[0], chosen.vel_n[1])
            self._airborne = speed > self.settings.airborne_mps * (LANDED if self._airborne else 1.0)
        return self._airborne

    def _choose(self, alive: dict[str, NavSolution], now_ns: int) -> str:
        """Select the solution to fly on, and note a change with its reason."""
        active, preferred = self.active, next((name for name in alive if not self._strayed(name, now_ns)), next(iter(alive)))
        if active is None:
            return self._switch(preferred, now_ns, "first solution")
        if active not in alive:
            return self._switch(preferred, now_ns, f"{active} timed out")
        if self.mode not in (Mode.CALIBRATING, Mode.GPS, Mode.NO_GO, Mode.INITIALISING):
            return self._choose_smaller(active, alive, now_ns) if len(alive) > 1 else active
        if active == preferred:
            return active
        return self._switch(preferred, now_ns, f"{active} disagrees with GPS" if self._strayed(active, now_ns) else "GPS is good")

    def _strayed(self, name: str, now_ns: int) -> bool:
        """Whether every fix has disagreed with a solution for a while."""
        since_ns = self._strays.get(name)
        return since_ns is not None and now_ns - since_ns >= 1e9 * self.settings.switch_s

    def _choose_smaller(self, active: str, alive: dict[str, NavSolution], now_ns: int) -> str:
        """In an outage: change when another has had a clearly smaller estimated error for a while."""
        sigma = {name: solution.horizontal_sigma_m for name, solution in alive.items()}
        best = min(sigma, key=sigma.__getitem__)
        if best == active or sigma[best] > self.settings.switch_ratio * sigma[active]:
            self._better_since_ns = NEVER_NS
            return active
        if self._better_since_ns == NEVER_NS:
            self._better_since_ns = now_ns
        if now_ns - self._better_since_ns < 1e9 * self.settings.switch_s:
            return active
        return self._switch(best, now_ns, f"estimated error {sigma[best]:.0f} m against {sigma[active]:.0f} m")

    def _switch(self, name: str, now_ns: int, reason: str) -> str:
        self.switches.append(Switch(now_ns, self.active, name, reason))
        self.active, self._better_since_ns = name, NEVER_NS
        return name

    def _publish(self, source: NavSolution, now_ns: int) -> None:
        source, flown = self._with_attitude(source), self._flown
        if flown is not None and now_ns - flown.stamp_ns <= 1e9 * self.settings.solution_timeout_s:
            self._blend.decay(1e-9 * (now_ns - flown.stamp_ns))
            expected = carried_to(flown, now_ns)
            apart_n = difference_n(*expected.place, *source.place)
            if self.switches[-1].stamp_ns == now_ns or math.sqrt(apart_n @ apart_n) > self.settings.jump_m:
                self._blend.bridge(expected, source)
        else:
            self._blend = Blend(self.settings.blend_s)
        self._flown = source
        out = replace(self._blend.applied(source), source=self.name, mode=self.mode)
        self.set_origin(*out.place)
        self._published = out
        self._out.append(out)

    def _with_attitude(self, source: NavSolution) -> NavSolution:
        """Give a solution that has no attitude the one of the AHRS, when that is fresh."""
        attitude = self._attitude
        if source.q_nb is not None or attitude is None or source.stamp_ns - attitude.stamp_ns > 1e9 * self.settings.solution_timeout_s:
            return source
        return replace(source, q_nb=attitude.q_nb, cov_att=attitude.cov_att, angular_rate_b=attitude.angular_rate_b)

    def _sentence(self, now_ns: int) -> str:
        if self._published is None:
            return "no solution yet: check that ins_gps or dead_reckoning runs and is aligned"
        if self.mode == Mode.FAILED:
            return "all solutions timed out: the last one is held"
        sigma_nm, limit_nm = self._published.horizontal_sigma_m / NAUTICAL_MILE, self.settings.alert_nm
        alert = f"; ALERT: estimated error {sigma_nm:.2f} NM is above {limit_nm:g} NM" if self._alert() else ""
        return f"{self._gps_sentence(now_ns)}; flying on {self.active} ({self.switches[-1].reason}){alert}"

    def _gps_sentence(self, now_ns: int) -> str:
        if self.mode in (Mode.CALIBRATING, Mode.GPS):
            return "GPS good" if self.mode == Mode.CALIBRATING else "GPS stand-alone: no precision approach"
        if self.mode == Mode.RE_ACQUIRING:
            return "GPS is back and must agree first"
        order = ": do not depart" if self.mode == Mode.NO_GO else ""
        if self._agreed_ns == NEVER_NS:
            return "no GPS since the start" + order
        fresh = self._fix is not None and now_ns - self._fix.stamp_ns <= 1e9 * self.settings.gps.timeout_s
        what = "GPS disagrees with the solution" if fresh else "no GPS"
        return f"{what} for {1e-9 * (now_ns - self._agreed_ns):.0f} s{order}"

    def _alert(self) -> bool:
        return self._published is not None and self._published.horizontal_sigma_m > self.settings.alert_nm * NAUTICAL_MILE

    def _level(self) -> Level:
        return Level.ERROR if self._alert() else super()._level()

    def _details(self) -> dict[str, str]:
        """Name of the navigator whose solution is flown."""
        return {"flying_on": self.active or ""}

    def _predict(self) -> NavSolution | None:
        """The solution flown, from the newest one of the active navigator, carried by its velocity to the newest stamp."""
        if self._published is None or self.active is None:
            return None
        newest = self._solutions[self.active]
        for item in self.horizon.ahead()[1]:
            if isinstance(item, NavSolution) and SOURCES[item.source] == self.active and item.has_position:
                newest = item
        carried = self._blend.applied(self._with_attitude(carried_to(newest, self.horizon.newest_ns or newest.stamp_ns)))
        return replace(carried, source=self.name, mode=self.mode)

    def _sigmas(self) -> dict[str, float]:
        out = {f"{name}_horizontal_m": solution.horizontal_sigma_m for name, solution in self._solutions.items()}
        if self._published is not None:
            out["position_horizontal_m"] = self._published.horizontal_sigma_m
            out["position_down_m"] = math.sqrt(self._published.place_cov[2, 2])
        return out


def _distance_squared(fix: GpsPosition, own: NavSolution) -> float:
    """Normalised squared horizontal distance of a fix from a solution at its stamp."""
    d = difference_n(fix.lat, fix.lon, fix.height, *own.place)[0:2]
    return float(d @ np.linalg.solve(fix.cov_n[0:2, 0:2] + own.place_cov[0:2, 0:2], d))
