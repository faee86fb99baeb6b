"""The supervisor: judges GPS, picks the solution to fly on and passes from one to another without a jump.

The mode logic is the table of :mod:`~lowcostnav_ros.navigators.supervisor.modes`.  While GPS is good the GPS/INS solution is flown; in an
outage the one with the smaller believed horizontal error, with hysteresis; and whatever lives when nothing else does.
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.measurements import Attitude, GpsPosition, Measurement, NavSolution
from lowcostnav_ros.base.modes import Level, Mode
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.navigators.supervisor.blend import Blend, carried_to
from lowcostnav_ros.navigators.supervisor.modes import Facts, Gps, next_mode
from lowcostnav_ros.physics.earth import difference_n

SOURCES = {"ins_gps/odometry_fused": "ins_gps", "dead_reckoning/odometry_fused": "dead_reckoning"}
"""Solutions to choose from, in the order of preference while GPS is good."""

SWITCHES_KEPT = 100
LANDED = 0.5
"""Share of the airborne speed below which the aircraft counts as landed."""


@dataclass(frozen=True)
class SupervisorHorizon(HorizonSettings):
    """The fusion horizon, longer than those of the navigators that are listened to."""

    lag_s: float = setting(0.5, "Judging stays this far behind the newest stamp to outlast transport.", unit="s", minimum=0.0, maximum=10.0)


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

    solution_timeout_s: float = setting(1.0, "A solution older than this is dead.", unit="s", minimum=0.1, maximum=60.0)
    airborne_mps: float = setting(15.0, "Ground speed above which the aircraft flies.", unit="m/s", minimum=0.1, maximum=200.0)
    start_s: float = setting(60.0, "GPS must be good within this long of the start, else there is no departure.", unit="s", minimum=1.0)
    switch_ratio: float = setting(0.7, "In an outage change when the other's sigma is below this share.", minimum=0.05, maximum=1.0)
    switch_s: float = setting(2.0, "... and has been for this long, or disagrees with GPS this long.", unit="s", minimum=0.0, maximum=600.0)
    blend_s: float = setting(3.0, "Time constant with which the difference at a change dies away.", unit="s", minimum=0.01, maximum=60.0)
    jump_m: float = setting(15.0, "A solution that jumps farther than this is blended like a change.", unit="m", minimum=0.1, maximum=1e4)
    alert_nm: float = setting(0.5, "Believed horizontal sigma above which an alert is raised.", unit="NM", minimum=0.01, maximum=100.0)
    horizon: SupervisorHorizon = group(SupervisorHorizon)
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
    """Picks and blends.

    Attributes
    ----------
    active : str or None
        Name of the navigator whose solution is flown.
    switches : deque of Switch
        The last changes, oldest first.
    """

    name: ClassVar[str] = "supervisor"
    Settings = SupervisorSettings
    room = "nav"
    colour = "#009e73"
    dash = "7 4"  # it flies on another navigator's solution: one sees which
    modes = {"no_go": ("#8e3b2f", ""), "re_acquiring": ("#66a6d9", "")}
    not_observable = "it has no filter of its own; watch the navigator it flies on"

    def __init__(self, settings: SupervisorSettings | None = None) -> None:
        settings = settings or SupervisorSettings()
        super().__init__(settings)
        self.threshold = chi_square.threshold(settings.gps.agree_probability, 2)
        self._restart()

    def own_inputs(self) -> tuple[str, ...]:
        """The navigators it picks from, the attitude reference and GPS fixes."""
        return (*SOURCES, "imu/data_fused", "gps/fix")

    def _restart(self) -> None:
        self.active: str | None = None
        self.switches: deque[Switch] = deque(maxlen=SWITCHES_KEPT)
        self._solutions: dict[str, NavSolution] = {}
        self._attitude: Attitude | None = None
        self._flown: NavSolution | None = None
        self._published: NavSolution | None = None
        self._blend = Blend(self.settings.blend_s)
        self._t_ns: int | None = None
        self._first_ns: int | None = None
        self._fix: GpsPosition | None = None
        self._agreed_ns: int | None = None
        self._streak_ns: int | None = None
        self._strays: dict[str, int] = {}
        self._better_since_ns: int | None = None
        self._airborne = False

    def _fuse(self, item: Measurement) -> None:
        if self._first_ns is None:
            self._first_ns = self._t_ns = item.stamp_ns
        self._advance(item.stamp_ns)
        if isinstance(item, NavSolution) and item.lat is not None and item.cov_pos is not None:
            self._solutions[SOURCES[item.source]] = item
        elif isinstance(item, Attitude):
            self._attitude = item
        elif isinstance(item, GpsPosition):
            self._see_fix(item)

    def _advance(self, stamp_ns: int) -> None:
        """Judge and publish at every multiple of the output period before ``stamp_ns``."""
        period = self.output_period_ns
        due = (self._t_ns // period + 1) * period
        while due < stamp_ns:
            self._judge(due)
            due += period
        self._t_ns = due - period

    def _see_fix(self, fix: GpsPosition) -> None:
        """Compare a fix with every solution; it agrees when one of them does, or there is none to compare with."""
        if self._streak_ns is not None and fix.stamp_ns - self._fix.stamp_ns > 1e9 * self.settings.gps.timeout_s:
            self._streak_ns = None
        self._fix = fix
        alive = self._alive(fix.stamp_ns)
        agreeing = [name for name, own in alive.items() if _distance_squared(fix, own) <= self.threshold]
        self._strays = {name: self._strays.get(name, fix.stamp_ns) for name in alive if name not in agreeing}
        if alive and not agreeing:
            self._streak_ns = None
            return
        self._agreed_ns = fix.stamp_ns
        if self._streak_ns is None:
            self._streak_ns = fix.stamp_ns

    def _gps(self, now_ns: int) -> Gps:
        settings = self.settings.gps
        if self._fix is None or now_ns - self._fix.stamp_ns > 1e9 * settings.timeout_s:
            return Gps.LOST
        outage = self.mode in (Mode.COASTING, Mode.RE_ACQUIRING, Mode.FAILED)
        if self._agreed_ns is None or now_ns - self._agreed_ns > 1e9 * settings.timeout_s:
            return Gps.SEEN if outage else Gps.LOST
        if outage and (self._streak_ns is None or now_ns - self._streak_ns < 1e9 * settings.agree_s):
            return Gps.SEEN
        cov = self._fix.cov_n
        return Gps.GOOD if math.sqrt(max(cov[0, 0], cov[1, 1])) <= settings.precise_m else Gps.COARSE

    def _judge(self, now_ns: int) -> None:
        """One step of the table, the choice, and the solution that goes out."""
        gps = self._gps(now_ns)
        alive = self._alive(now_ns)
        waited = now_ns - self._first_ns > 1e9 * self.settings.start_s
        self.mode = next_mode(self.mode, Facts(gps, self._flies(alive), bool(alive), waited))
        if not alive:
            self.reason = self._sentence(now_ns)
            return
        self._choose(alive, now_ns)
        self._publish(alive[self.active], now_ns)
        self.reason = self._sentence(now_ns)

    def _alive(self, now_ns: int) -> dict[str, NavSolution]:
        """Fresh solutions by navigator, carried to ``now_ns``, in order of preference."""
        limit_ns = 1e9 * self.settings.solution_timeout_s
        names = (name for name in SOURCES.values() if name in self._solutions)
        return {name: carried_to(self._solutions[name], now_ns) for name in names if now_ns - self._solutions[name].stamp_ns <= limit_ns}

    def _flies(self, alive: dict[str, NavSolution]) -> bool:
        chosen = alive.get(self.active) or next(iter(alive.values()), None)
        if chosen is not None and chosen.vel_n is not None:
            speed = math.hypot(chosen.vel_n[0], chosen.vel_n[1])
            self._airborne = speed > self.settings.airborne_mps * (LANDED if self._airborne else 1.0)
        return self._airborne

    def _choose(self, alive: dict[str, NavSolution], now_ns: int) -> None:
        """Pick the solution to fly on, and note a change with its reason."""
        preferred = next((name for name in alive if not self._strayed(name, now_ns)), next(iter(alive)))
        if self.active is None:
            self._switch(preferred, now_ns, "first solution")
        elif self.active not in alive:
            self._switch(preferred, now_ns, f"{self.active} is silent")
        elif self.mode in (Mode.CALIBRATING, Mode.GPS, Mode.NO_GO, Mode.INITIALISING):
            if self.active != preferred:
                strayed = self._strayed(self.active, now_ns)
                self._switch(preferred, now_ns, f"{self.active} disagrees with GPS" if strayed else "GPS is good")
        elif len(alive) > 1:
            self._choose_smaller(alive, now_ns)

    def _strayed(self, name: str, now_ns: int) -> bool:
        """Whether every fix has disagreed with a solution for a while."""
        since_ns = self._strays.get(name)
        return since_ns is not None and now_ns - since_ns >= 1e9 * self.settings.switch_s

    def _choose_smaller(self, alive: dict[str, NavSolution], now_ns: int) -> None:
        """In an outage: change when another has been believed clearly better for a while."""
        sigma = {name: _horizontal_sigma(s) for name, s in alive.items()}
        best = min(sigma, key=sigma.get)
        if best == self.active or sigma[best] > self.settings.switch_ratio * sigma[self.active]:
            self._better_since_ns = None
            return
        if self._better_since_ns is None:
            self._better_since_ns = now_ns
        if now_ns - self._better_since_ns >= 1e9 * self.settings.switch_s:
            self._switch(best, now_ns, f"believed error {sigma[best]:.0f} m against {sigma[self.active]:.0f} m")

    def _switch(self, name: str, now_ns: int, reason: str) -> None:
        self.switches.append(Switch(now_ns, self.active, name, reason))
        self.active, self._better_since_ns = name, None

    def _publish(self, source: NavSolution, now_ns: int) -> None:
        source, flown = self._with_attitude(source), self._flown
        if flown is not None and now_ns - flown.stamp_ns <= 1e9 * self.settings.solution_timeout_s:
            self._blend.decay(1e-9 * (now_ns - flown.stamp_ns))
            expected = carried_to(flown, now_ns)
            if self.switches[-1].stamp_ns == now_ns or _apart(expected, source) > self.settings.jump_m:
                self._blend.bridge(expected, source)
        else:
            self._blend = Blend(self.settings.blend_s)
        self._flown = source
        out = replace(self._blend.applied(source), source=self.name, mode=self.mode)
        self.set_origin(out.lat, out.lon, out.height)
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
            return "no live solution: the last one is held"
        flown = f"flying on {self.active} ({self.switches[-1].reason})"
        return f"{self._gps_sentence(now_ns)}; {flown}{self._alert_sentence()}"

    def _gps_sentence(self, now_ns: int) -> str:
        if self.mode in (Mode.CALIBRATING, Mode.GPS):
            return "GPS good" if self.mode == Mode.CALIBRATING else "GPS stand-alone: no precision approach"
        if self.mode == Mode.RE_ACQUIRING:
            return "GPS is back and must agree first"
        if self._agreed_ns is None:
            return "no GPS since the start" + (": do not depart" if self.mode == Mode.NO_GO else "")
        age_s = 1e-9 * (now_ns - self._agreed_ns)
        fresh = self._fix is not None and now_ns - self._fix.stamp_ns <= 1e9 * self.settings.gps.timeout_s
        what = "GPS disagrees with the solution" if fresh else "no GPS"
        return f"{what} for {age_s:.0f} s" + (": do not depart" if self.mode == Mode.NO_GO else "")

    def _alert(self) -> bool:
        return self._published is not None and _horizontal_sigma(self._published) > self.settings.alert_nm * 1852.0

    def _alert_sentence(self) -> str:
        if not self._alert():
            return ""
        return f"; ALERT: believed error {_horizontal_sigma(self._published) / 1852.0:.2f} NM is above {self.settings.alert_nm:g} NM"

    def _level(self) -> Level:
        return Level.ERROR if self._alert() else super()._level()

    def _details(self) -> dict[str, str]:
        """On which navigator it flies."""
        return {"flying_on": self.active or ""}

    def _predict(self) -> NavSolution | None:
        """The solution flown, from the newest one of the active navigator, carried by its velocity to the newest stamp."""
        if self._published is None:
            return None
        newest = self._solutions.get(self.active)
        for item in self.horizon.ahead()[1]:
            if isinstance(item, NavSolution) and SOURCES[item.source] == self.active and item.lat is not None and item.cov_pos is not None:
                newest = item
        carried = self._blend.applied(self._with_attitude(carried_to(newest, self.horizon.newest_ns)))
        return replace(carried, source=self.name, mode=self.mode)

    def _sigmas(self) -> dict[str, float]:
        out = {f"{name}_horizontal_m": _horizontal_sigma(s) for name, s in self._solutions.items()}
        if self._published is not None:
            out["position_horizontal_m"] = _horizontal_sigma(self._published)
            out["position_down_m"] = math.sqrt(self._published.cov_pos[2, 2])
        return out


def _distance_squared(fix: GpsPosition, own: NavSolution) -> float:
    """Normalised squared horizontal distance of a fix from a solution at its stamp."""
    d = difference_n(fix.lat, fix.lon, fix.height, own.lat, own.lon, own.height)[0:2]
    return float(d @ np.linalg.solve(fix.cov_n[0:2, 0:2] + own.cov_pos[0:2, 0:2], d))


def _apart(a: NavSolution, b: NavSolution) -> float:
    """Distance between two solutions of one stamp, m."""
    d = difference_n(a.lat, a.lon, a.height, b.lat, b.lon, b.height)
    return math.sqrt(d @ d)


def _horizontal_sigma(solution: NavSolution) -> float:
    """Believed horizontal error, m: root of the sum of both variances."""
    return math.sqrt(solution.cov_pos[0, 0] + solution.cov_pos[1, 1])
