"""The supervisor: judges GPS, picks the solution to fly on and changes from one to another without a jump.

The mode logic is the table of :mod:`~lowcostnav_ros.navigators.supervisor.modes`.  A solution that contradicts itself or whose own
navigator doubts it is left for one that does not.  Among equals the GPS/INS solution is flown while GPS is good; in an outage the one with
the smaller estimated horizontal error, with hysteresis, as long as both agree: where they do not and nobody can tell which of them is
wrong, nothing is changed and the covariance covers both.  So it does where a position or an attitude merely differs from the other one by
more than chance in a hundred: too little to say that one is wrong, too much to vouch for either.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import Attitude, GpsPosition, GpsVelocity, Health, Measurement, NavSolution
from lowcostnav_ros.base.modes import Level, Mode
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import NAUTICAL_MILE
from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
from lowcostnav_ros.navigators.registry import NAVIGATORS, navigator
from lowcostnav_ros.navigators.supervisor.attitudes import AttitudeCheck
from lowcostnav_ros.navigators.supervisor.blend import Blend
from lowcostnav_ros.navigators.supervisor.candidate import Candidate
from lowcostnav_ros.navigators.supervisor.modes import Facts, Gps, next_mode
from lowcostnav_ros.navigators.supervisor.motion import Motion
from lowcostnav_ros.physics.earth import difference_n

SOURCES = {"ins_gps/odometry_fused": "ins_gps", "dead_reckoning/odometry_fused": "dead_reckoning"}
"""Solutions to choose from, in the order of preference while GPS is good."""


def standby() -> dict[str, str]:
    """Solutions of the navigators that are flown when nothing else is sound, by topic, as each declares it."""
    return {f"{name}/odometry_fused": name for name in NAVIGATORS if NAVIGATORS.label(name).standby}


INERTIAL, REFERENCE = next(iter(SOURCES.values())), "imu/data_fused"
"""The one of them with an attitude of its own, and the attitude that the other has, too."""


GPS = "gps"
"""The receiver's own fixes and velocities as a solution: tested like the others, flown when nothing else is sound."""
VELOCITY_NS = 500_000_000
"""A velocity of the receiver this far from a fix still belongs to it."""
APART, DIFFERENT = 25.0, chi_square.threshold(0.99, 2)
"""Squared difference of two solutions over both covariances, two degrees of freedom, above which they contradict each other; and differ."""
AGREED_S = 10.0
"""A doubted solution that agrees with a sound one for this long is believed again."""
TRUSTED, SUSPECT, USELESS = 2, 1, 0

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
    chooses = True
    colour = "#009e73"
    dash = "7 4"  # it publishes another navigator's solution; both lines stay visible
    modes = {"no_go": ("#8e3b2f", ""), "re_acquiring": ("#66a6d9", "")}
    not_observable = "it has no filter of its own; study the navigator whose solution it publishes"

    def __init__(self, settings: SupervisorSettings | None = None) -> None:
        settings = settings or SupervisorSettings()
        super().__init__(settings)
        self._sources = SOURCES | standby()
        self.threshold = chi_square.threshold(settings.gps.agree_probability, 2)
        self._restart()

    def own_inputs(self) -> tuple[str, ...]:
        """The navigators it selects from, the attitude reference and GPS fixes."""
        sources = SOURCES | standby()
        return (*sources, *(f"{name}/health" for name in sources.values()), REFERENCE, "gps/fix", "gps/vel")

    def _restart(self) -> None:
        self.active: str | None = None
        self.switches: deque[Switch] = deque(maxlen=SWITCHES_KEPT)
        self._candidates = {name: Candidate(name, fixes=name == GPS) for name in (*self._sources.values(), GPS)}
        self._motion = Motion()
        self._attitude: Attitude | None = None
        self._flown: NavSolution | None = None
        self._published: NavSolution | None = None
        self._blend = Blend(self.settings.blend_s)
        self._t_ns, self._first_ns = 0, NEVER_NS
        self._fix: GpsPosition | None = None
        self._velocity: GpsVelocity | None = None
        self._waiting: GpsPosition | None = None
        self._agreed_ns, self._streak_ns, self._better_since_ns, self._worse_since_ns = NEVER_NS, NEVER_NS, NEVER_NS, NEVER_NS
        self._strays: dict[str, int] = {}
        self._apart: Contradiction | None = None
        self._agree_since_ns = NEVER_NS
        self._differ = False
        self._covered = np.zeros((3, 3))
        self._attitudes = AttitudeCheck(INERTIAL, REFERENCE)
        self._airborne = False

    def _fuse(self, item: Measurement) -> None:
        if self._first_ns == NEVER_NS:
            self._first_ns = self._t_ns = item.stamp_ns
        self._advance(item.stamp_ns)
        if isinstance(item, NavSolution) and item.has_position:
            self._candidates[self._sources[item.source]].take(item)
        elif isinstance(item, Health):
            self._candidates[item.source.partition("/")[0]].health = item
        elif isinstance(item, Attitude):
            self._attitude = item
            self._motion.see(item)
        elif isinstance(item, GpsVelocity):
            self._pair(item)
            self._velocity = item
        elif isinstance(item, GpsPosition):
            self._pair(None)
            self._waiting = item
            self._compare_fix(item)

    def _pair(self, later: GpsVelocity | None) -> None:
        """Give the fix that waits its velocity, as a solution of the receiver's own; None: none has come before the next fix."""
        fix, self._waiting = self._waiting, None
        if fix is not None:
            self._candidates[GPS].take(self._as_solution(fix, later))

    def _as_solution(self, fix: GpsPosition, later: GpsVelocity | None) -> NavSolution:
        """A fix with the receiver's velocity at its stamp, else with that of the solution flown, as a solution.

        An older velocity is not that of the fix: half a second's turning is as much as the way may be off.
        """
        before, flown = self._velocity, self._flown
        vel_n: np.ndarray | None
        cov_vel: np.ndarray | None
        if later is not None and later.stamp_ns - fix.stamp_ns <= VELOCITY_NS:
            vel_n, cov_vel = later.vel_n, later.cov_n
            if before is not None and fix.stamp_ns - before.stamp_ns <= VELOCITY_NS:
                share = (fix.stamp_ns - before.stamp_ns) / (later.stamp_ns - before.stamp_ns)
                vel_n = before.vel_n + share * (later.vel_n - before.vel_n)
        elif flown is not None and flown.vel_n is not None and abs(fix.stamp_ns - flown.stamp_ns) <= 1e9 * self.settings.solution_timeout_s:
            vel_n, cov_vel = flown.vel_n, flown.cov_vel
        else:
            vel_n, cov_vel = None, None
        return NavSolution(fix.stamp_ns, GPS, fix.lat, fix.lon, fix.height, vel_n, cov_pos=fix.cov_n, cov_vel=cov_vel)

    def _advance(self, stamp_ns: int) -> None:
        """Judge and publish at every multiple of the output period before ``stamp_ns``."""
        period = self.output_period_ns
        due = (self._t_ns // period + 1) * period
        while due < stamp_ns:
            self._judge(due)
            due += period
        self._t_ns = due - period

    def _compare_fix(self, fix: GpsPosition) -> None:
        """Compare a fix with every solution; it agrees when a sound one of them does, or there is none to compare with.

        A solution that has just jumped to the fixes says nothing for them, nor does anything for fixes that contradict themselves.
        """
        if self._fix is not None and fix.stamp_ns - self._fix.stamp_ns > 1e9 * self.settings.gps.timeout_s:
            self._streak_ns = NEVER_NS
        self._fix = fix
        alive = self._alive(fix.stamp_ns)
        agreeing = [name for name, own in alive.items() if _distance_squared(fix, own) <= self.threshold]
        self._strays = {name: self._strays.get(name, fix.stamp_ns) for name in alive if name not in agreeing}
        witnesses = [name for name in alive if self._trust(name) != USELESS]
        sound = self._trust(GPS) == TRUSTED and (not witnesses or any(self._trust(name) == TRUSTED for name in agreeing))
        if not sound:
            self._streak_ns = NEVER_NS
            return
        self._agreed_ns = fix.stamp_ns
        if self._streak_ns == NEVER_NS:
            self._streak_ns = fix.stamp_ns

    def _trust(self, name: str) -> int:
        return self._candidates[name].trust()

    def _gps(self, now_ns: int) -> Gps:
        settings = self.settings.gps
        if self._fix is None or not self._fix_is_fresh(now_ns):
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
        self._compare(alive, now_ns)
        self._compare_attitudes(alive.get(INERTIAL), now_ns)
        if all(self._trust(name) == USELESS for name in alive):
            spare = (name for name in self._sources.values() if name not in SOURCES.values())
            alive |= {name: s for name, s in self._fresh(spare, now_ns).items() if self._trust(name) != USELESS}
        if gps in (Gps.GOOD, Gps.COARSE) and all(self._trust(name) == USELESS for name in alive):
            alive |= self._gps_alone(now_ns)
            gps = Gps.COARSE
        waited = now_ns - self._first_ns > 1e9 * self.settings.start_s
        self.mode = next_mode(self.mode, Facts(gps, self._flies(alive), bool(alive), waited))
        if alive:
            active = self._choose(alive, now_ns)
            self._covered = self._cover(active, alive, now_ns)
            self._fly(alive[active], now_ns)
        self.reason = self._sentence(now_ns)
        if alive and self._published is not None:
            self.publish(self._published)

    def _alive(self, now_ns: int) -> dict[str, NavSolution]:
        """Fresh solutions of the navigators that are preferred, carried to ``now_ns``, in that order."""
        return self._fresh(SOURCES.values(), now_ns)

    def _fresh(self, names: Iterable[str], now_ns: int) -> dict[str, NavSolution]:
        newest = {name: self._candidates[name].newest for name in names}
        fresh = {name: s for name, s in newest.items() if s is not None and self._is_fresh(s, now_ns)}
        return {name: self._motion.carried(solution, now_ns) for name, solution in fresh.items()}

    def _fix_is_fresh(self, now_ns: int) -> bool:
        return self._fix is not None and now_ns - self._fix.stamp_ns <= 1e9 * self.settings.gps.timeout_s

    def _gps_alone(self, now_ns: int) -> dict[str, NavSolution]:
        newest = self._candidates[GPS].newest
        velocity, fresh = self._velocity, self._fix_is_fresh(now_ns)
        if newest is None or velocity is None or not fresh or abs(newest.stamp_ns - velocity.stamp_ns) > VELOCITY_NS or self.active is None:
            return {}
        return {GPS: self._motion.carried(newest, now_ns)}

    def _compare(self, alive: dict[str, NavSolution], now_ns: int) -> None:
        """Whether the navigators' solutions contradict each other; a doubted one is believed again after agreeing with a sound one."""
        if len(alive) < len(SOURCES):
            self._apart, self._differ, self._agree_since_ns = None, False, NEVER_NS
            return
        (first, a), (second, b) = alive.items()
        apart_n, cov = difference_n(*a.place, *b.place), a.place_cov + b.place_cov
        horizontal = float(apart_n[0:2] @ np.linalg.solve(cov[0:2, 0:2], apart_n[0:2]))
        self._differ = horizontal > DIFFERENT and self._trust(first) == self._trust(second)
        if max(horizontal, apart_n[2] ** 2 / cov[2, 2]) > APART:
            since_ns = now_ns if self._apart is None else self._apart.since_ns
            suspect = next((name for name, other in ((first, second), (second, first)) if self._trust(name) < self._trust(other)), "")
            size = math.sqrt(float(apart_n @ apart_n))
            self._apart, self._agree_since_ns = Contradiction("solutions disagree", (first, second), size, "m", since_ns, suspect), NEVER_NS
            return
        self._apart = None
        self._agree_since_ns = now_ns if self._agree_since_ns == NEVER_NS else self._agree_since_ns
        if TRUSTED not in (self._trust(first), self._trust(second)):
            return
        for candidate in (self._candidates[first], self._candidates[second]):
            if candidate.contradiction is not None and now_ns - max(self._agree_since_ns, candidate.doubted_ns) >= 1e9 * AGREED_S:
                candidate.forgive()

    def _compare_attitudes(self, solution: NavSolution | None, now_ns: int) -> None:
        """Whether the attitude of the GPS/INS solution contradicts that of the attitude reference."""
        reference, own = self._attitude, None if solution is None else solution.q_nb
        if reference is None or not self._is_fresh(reference, now_ns) or solution is None or own is None or solution.cov_att is None:
            self._attitudes.clear()
            return
        q_nb, sigma = self._motion.attitude(now_ns)
        self._attitudes.compare(now_ns, (own, solution.cov_att), (q_nb, reference.cov_att + sigma**2 * np.eye(3)))

    def _is_fresh(self, item: Measurement, now_ns: int) -> bool:
        return now_ns - item.stamp_ns <= 1e9 * self.settings.solution_timeout_s

    def _cover(self, active: str, alive: dict[str, NavSolution], now_ns: int) -> np.ndarray:
        """What the contradictions that are known add to the covariance of the position, (3, 3): the solution flown may be the wrong one."""
        offsets, own = [self._candidates[active].offset_n], alive[active]
        doubt = self._doubt_of_gps(active, alive)
        others = {name: solution for name, solution in alive.items() if name != active}
        if self._differ or (self._apart is not None and self._apart.suspect in ("", active)):
            offsets += [difference_n(*own.place, *other.place) for other in others.values()]
        fixed = self._candidates[GPS].newest
        if active in self._strays and self._trust(GPS) == TRUSTED and fixed is not None and self._fix_is_fresh(now_ns):
            offsets.append(difference_n(*own.place, *self._motion.carried(fixed, now_ns).place))
        return sum((np.outer(offset, offset) for offset in offsets), doubt)

    def _doubt_of_gps(self, active: str, alive: dict[str, NavSolution]) -> np.ndarray:
        """Covariance (3, 3) of another solution held by GPS whose navigator suspects GPS, where that of the one flown does not."""
        own = self._candidates[active].health
        others = (name for name in alive if name != active and self._trust(name) == SUSPECT and name not in self._strays)
        doubting = next(others, None) if own is not None and own.mode in (Mode.CALIBRATING, Mode.GPS) else None
        return np.zeros((3, 3)) if doubting is None else alive[doubting].place_cov

    def _flies(self, alive: dict[str, NavSolution]) -> bool:
        chosen = alive.get(self.active or "") or next(iter(alive.values()), None)
        if chosen is not None and chosen.vel_n is not None:
            speed = math.hypot(chosen.vel_n[0], chosen.vel_n[1])
            self._airborne = speed > self.settings.airborne_mps * (LANDED if self._airborne else 1.0)
        return self._airborne

    def _choose(self, alive: dict[str, NavSolution], now_ns: int) -> str:
        """Select the solution to fly on, and note a change with its reason."""
        active, rank = self.active, {name: self._rank(name, now_ns) for name in alive}
        best = max(rank.values())
        preferred = next(name for name in alive if rank[name] == best)
        if active is None:
            return self._switch(preferred, now_ns, "first solution")
        if active not in alive:
            return self._switch(preferred, now_ns, f"{active} timed out")
        if rank[active] < best:
            self._worse_since_ns = now_ns if self._worse_since_ns == NEVER_NS else self._worse_since_ns
            if self._candidates[active].contradiction is None and now_ns - self._worse_since_ns < 1e9 * self.settings.switch_s:
                return active
            strayed = self._strayed(active, now_ns) and self._holds(now_ns)
            why = f"{active} disagrees with GPS" if strayed else self._candidates[active].why() or "GPS is good"
            return self._switch(preferred, now_ns, why)
        self._worse_since_ns = NEVER_NS
        if self.mode not in (Mode.CALIBRATING, Mode.GPS, Mode.NO_GO, Mode.INITIALISING):
            equals = {name: solution for name, solution in alive.items() if rank[name] == best}
            return self._choose_smaller(active, equals, now_ns) if len(equals) > 1 and self._apart is None else active
        return active if active == preferred else self._switch(preferred, now_ns, "GPS is good")

    def _holds(self, now_ns: int) -> bool:
        """Whether GPS is trusted and there."""
        return self.mode in (Mode.CALIBRATING, Mode.GPS) and now_ns - self._agreed_ns <= 1e9 * self.settings.gps.timeout_s

    def _rank(self, name: str, now_ns: int) -> int:
        """How far a solution can be trusted, one less when GPS, which is trusted, has disagreed with it for a while."""
        trust = self._trust(name)
        return min(trust, SUSPECT) if self._holds(now_ns) and self._strayed(name, now_ns) else trust

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
        self.active, self._better_since_ns, self._worse_since_ns = name, NEVER_NS, NEVER_NS
        return name

    def _fly(self, source: NavSolution, now_ns: int) -> None:
        source, flown = self._with_attitude(source, self._attitude, self._motion), self._flown
        if flown is not None and now_ns - flown.stamp_ns <= 1e9 * self.settings.solution_timeout_s:
            self._blend.decay(1e-9 * (now_ns - flown.stamp_ns))
            expected = self._motion.carried(flown, now_ns)
            apart_n = difference_n(*expected.place, *source.place)
            if self.switches[-1].stamp_ns == now_ns or math.sqrt(apart_n @ apart_n) > self.settings.jump_m:
                self._blend.bridge(expected, source)
        else:
            self._blend = Blend(self.settings.blend_s)
        self._flown = source
        self._published = self._outgoing(source)
        if self.origin is None:
            self._begin_map(self._published)

    def _begin_map(self, first: NavSolution) -> None:
        """Use the map frame of the navigator that is flown first: a supervisor that is started again so finds its own again."""
        origin = self.map_origins.get(self.active or "")
        self.set_origin(*first.place if origin is None else (origin.lat, origin.lon, origin.height))

    def _outgoing(self, source: NavSolution) -> NavSolution:
        """What is published of a solution: with the offsets that die away, and covering what contradicts it."""
        out = self._blend.applied(source)
        cov_att = None if out.cov_att is None else out.cov_att + self._attitudes.covered
        return replace(out, source=self.name, mode=self.mode, cov_pos=out.place_cov + self._covered, cov_att=cov_att, health=None)

    def _with_attitude(self, source: NavSolution, attitude: Attitude | None, motion: Motion) -> NavSolution:
        """Give a solution that has no attitude the one of the AHRS, turned on to its stamp, when that is fresh."""
        if source.q_nb is not None or attitude is None or not self._is_fresh(attitude, source.stamp_ns):
            return source
        q_nb, sigma = motion.attitude(source.stamp_ns)
        return replace(source, q_nb=q_nb, cov_att=attitude.cov_att + sigma**2 * np.eye(3), angular_rate_b=attitude.angular_rate_b)

    def _sentence(self, now_ns: int) -> str:
        if self._published is None:
            return f"no solution yet: check that {' or '.join(self._sources.values())} runs and is aligned"
        if self.mode == Mode.FAILED:
            return "all solutions timed out: the last one is held"
        sigma_nm, limit_nm = self._published.horizontal_sigma_m / NAUTICAL_MILE, self.settings.alert_nm
        alert = f"; ALERT: estimated error {sigma_nm:.2f} NM is above {limit_nm:g} NM" if self._alert() else ""
        doubts = self._doubts()
        return f"{self._gps_sentence(now_ns)}; flying on {self.active} ({self.switches[-1].reason}){doubts and '; ' + doubts}{alert}"

    def _gps_sentence(self, now_ns: int) -> str:
        if self.mode in (Mode.CALIBRATING, Mode.GPS):
            return "GPS good" if self.mode == Mode.CALIBRATING else "GPS stand-alone: no precision approach"
        if self.mode == Mode.RE_ACQUIRING:
            return "GPS is back and must agree first"
        order = ": do not depart" if self.mode == Mode.NO_GO else ""
        if self._agreed_ns == NEVER_NS:
            return "no GPS since the start" + order
        what = "GPS disagrees with the solution" if self._fix_is_fresh(now_ns) else "no GPS"
        return f"{what} for {1e-9 * (now_ns - self._agreed_ns):.0f} s{order}"

    def _alert(self) -> bool:
        return self._published is not None and self._published.horizontal_sigma_m > self.settings.alert_nm * NAUTICAL_MILE

    def _doubts(self) -> str:
        """What speaks against the solution that is flown, or keeps it from being judged; empty for nothing."""
        flown = self._candidates.get(self.active or "")
        own = "" if flown is None or flown.trust() == TRUSTED else flown.why()
        apart = [found.words(max(self._t_ns, found.since_ns)) for found in (self._apart, self._attitudes.held) if found is not None]
        receiver = self._candidates[GPS].why() if self._trust(GPS) != TRUSTED else ""
        alone = "neither navigator has a sound solution" if self.active == GPS else ""
        return "; ".join(words for words in (own, *apart, receiver, alone) if words)

    def contradictions(self) -> tuple[Contradiction, ...]:
        """Of each solution with itself, of solutions and attitudes with each other, and of clocks."""
        held = (candidate.contradiction for candidate in self._candidates.values())
        return (*super().contradictions(), *(each for each in (*held, self._apart, self._attitudes.held) if each is not None))

    def _level(self) -> Level:
        if self._alert():
            return Level.ERROR
        return max(super()._level(), Level.WARN) if self._doubts() else super()._level()

    def _details(self) -> dict[str, str]:
        """Name of the navigator whose solution is flown."""
        return {"flying_on": self.active or ""}

    def _predict(self) -> NavSolution | None:
        """The solution flown, from the newest one of the active navigator, carried to the newest stamp."""
        newest = self._candidates[self.active].newest if self.active is not None else None
        if self._published is None or newest is None:
            return None
        waiting = self.horizon.ahead()[1]
        for item in waiting:
            if isinstance(item, NavSolution) and self._sources[item.source] == self.active and item.has_position:
                newest = item
        attitudes = [item for item in waiting if isinstance(item, Attitude)]
        motion = self._motion.with_newer(attitudes)
        carried = motion.carried(newest, max(self.horizon.newest_ns or 0, newest.stamp_ns))
        return self._outgoing(self._with_attitude(carried, attitudes[-1] if attitudes else self._attitude, motion))

    def _sigmas(self) -> dict[str, float]:
        newest = {name: candidate.newest for name, candidate in self._candidates.items() if name != GPS}
        out = {f"{name}_horizontal_m": solution.horizontal_sigma_m for name, solution in newest.items() if solution is not None}
        if self._published is not None:
            out["position_horizontal_m"] = self._published.horizontal_sigma_m
            out["position_down_m"] = math.sqrt(self._published.place_cov[2, 2])
        return out


def _distance_squared(fix: GpsPosition, own: NavSolution) -> float:
    """Normalised squared horizontal distance of a fix from a solution at its stamp."""
    d = difference_n(fix.lat, fix.lon, fix.height, *own.place)[0:2]
    return float(d @ np.linalg.solve(fix.cov_n[0:2, 0:2] + own.place_cov[0:2, 0:2], d))
