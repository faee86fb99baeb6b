"""The reckoning core: airspeed along the heading plus wind, with mean and covariance, and how both move between measurements.

Settings are in the units of data sheets; their defaults are the error models of Gebre-Egziabher (2004): table 6.1 gives wind 5 m/s over
400 s, heading 2.5 deg over 120 s plus 0.8 deg white and airspeed 2.6 m/s over 400 s.  The wind is met along the way flown: 400 s are
20 km at the 90 kt of that table; an aircraft of 30 kt meets the same air more slowly.  How large wind, turbulence and heading error are
on the day is learned from GPS velocity (:mod:`~lowcostnav_ros.cores.noise_levels`).
"""

import copy
import math
from dataclasses import dataclass, field

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity, Attitude, Measurement
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores import reckoning_model as model
from lowcostnav_ros.cores.held import HeldAttitude, outdated
from lowcostnav_ros.cores.noise_levels import NoiseLevels
from lowcostnav_ros.cores.reckoning_model import CLIMB, CORE, POS
from lowcostnav_ros.cores.views import Motion, VelocitySeen
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Block, Kind, Layout, along_way, gauss_markov, random_walk
from lowcostnav_ros.estimation.smoothing import History
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.physics.rotation import quat_rotate

LOST_S = 10.0
"""Without attitude or airspeed the unknown velocity is as large as the last airspeed and stays correlated this long."""
UNKNOWN_HEADING, UNKNOWN = 0.5, "heading unknown"
"""Sigma of a heading, rad, beyond which there is none, as if there were no attitude: no filter is linear in it."""
USUAL = 2.0
"""A heading sigma this many times the least that was stated is news."""
UNNOTICED_S = 10.0
"""A heading was wrong for about so long before its reference became unsure of it."""
INCIDENCE_MPS, CHANGE_SHARE = 5.0, 0.7
"""Vertical component of the air-relative velocity that incidence may hide, m/s; share of a change beyond it that may be wrong."""
PATIENCE, MOST_PATIENCE = 1.5, 5.0
"""Steps of an airspeed that comes slowly, and times its limit at most, after which it has timed out."""
STEADY_S = 2.0
"""Airspeed is averaged over this time where its change is wanted: that of its noise is none."""
LANDED = 0.8
"""Share of the minimum airspeed below which an aircraft that was flying counts as landed; the step keeps gusts from toggling it."""


@dataclass(frozen=True)
class HeadingSettings:
    """Errors of the heading that comes in."""

    bias_deg: float = setting(2.5, "Slowly varying heading error, Gauss-Markov sigma.", unit="deg", minimum=0.0, maximum=45.0, within=4)
    bias_tau_s: float = setting(120.0, "Correlation time of the heading error.", unit="s", minimum=1.0)
    offset_deg: float = setting(3.0, "Constant heading error (mounting), sigma; 0: no state.", unit="deg", minimum=0.0, maximum=45.0)
    bank_deg: float = setting(
        10.0, "Heading error in proportion to the sine of the bank, sigma; 0: no state.", unit="deg", minimum=0.0, maximum=45.0
    )
    noise_deg: float = setting(0.8, "White heading noise, sigma at 1 Hz.", unit="deg", minimum=0.0, maximum=45.0)
    timeout_s: float = setting(1.0, "Attitude older than this has timed out.", unit="s", minimum=0.05, maximum=30.0)


@dataclass(frozen=True)
class AirspeedSettings:
    """Errors of the true airspeed that comes in, and the air data that a pitot tube alone does not give."""

    bias_mps: float = setting(2.6, "Airspeed error, Gauss-Markov sigma; 0: no state.", unit="m/s", minimum=0.0, maximum=50.0, within=3)
    bias_tau_s: float = setting(400.0, "Correlation time of the airspeed error.", unit="s", minimum=1.0)
    scale: float = setting(0.03, "Constant scale-factor error, sigma as a fraction; 0: no state.", minimum=0.0, maximum=0.5)
    noise_mps: float = setting(0.3, "White airspeed noise, sigma at 1 Hz.", unit="m/s", minimum=0.0, maximum=10.0)
    incidence_deg: float = setting(0.0, "Incidence in level flight, used without a vane.", unit="deg", minimum=-20.0, maximum=20.0)
    slip_deg: float = setting(0.0, "Steady sideslip, air from the right positive, no vane.", unit="deg", minimum=-20.0, maximum=20.0)
    minimum_mps: float = setting(8.0, "Below this airspeed the aircraft counts as on the ground.", unit="m/s", minimum=0.1, maximum=100.0)
    timeout_s: float = setting(
        2.0, "Airspeed older than this, or one and a half of its steps, has timed out.", unit="s", minimum=0.05, maximum=30.0
    )


@dataclass(frozen=True)
class WindSettings:
    """What the air mass does along the flight."""

    sigma_mps: float = setting(5.0, "Variation of each component, Gauss-Markov sigma.", unit="m/s", minimum=0.01, maximum=50.0, within=3)
    distance_km: float = setting(20.0, "Way flown over which the variation stays correlated; 0: time alone.", unit="km", minimum=0.0)
    tau_s: float = setting(3600.0, "Time in which the variation stays correlated at one place.", unit="s", minimum=1.0)
    mean_mps: float = setting(10.0, "Constant part, sigma before GPS; 0: no state.", unit="m/s", minimum=0.0, maximum=100.0)
    gust_mps: float = setting(1.0, "Turbulence, sigma of each component; 0: no states.", unit="m/s", minimum=0.0, maximum=20.0, within=3)
    gust_distance_m: float = setting(
        300.0, "Way flown over which turbulence stays correlated.", unit="m", minimum=1.0, maximum=1e5, within=2
    )


@dataclass(frozen=True)
class HeightSettings:
    """The vertical channel."""

    climb_mps: float = setting(3.0, "Vertical speed, Gauss-Markov sigma.", unit="m/s", minimum=0.1, maximum=50.0)
    climb_tau_s: float = setting(15.0, "Correlation time of the vertical speed.", unit="s", minimum=0.5, maximum=600.0)


@dataclass(frozen=True)
class ReckoningSettings:
    """What the core is made of."""

    model: str = setting("full", "Error model: full, or position and wind with range bias as noise (G53).", choices=("full", "reduced"))
    learn_s: float = setting(
        200.0, "Memory of the sigmas of wind, turbulence and heading error learned from GPS velocity; 0: as set.", unit="s", minimum=0.0
    )
    ground_walk_mps: float = setting(5.0, "Unknown motion below minimum airspeed, sigma at 1 Hz.", unit="m/s", minimum=0.0, maximum=50.0)
    heading: HeadingSettings = group(HeadingSettings)
    airspeed: AirspeedSettings = group(AirspeedSettings)
    wind: WindSettings = group(WindSettings)
    height: HeightSettings = group(HeightSettings)


def core_blocks(settings: ReckoningSettings) -> list[Block]:
    """Position north, east, down and vertical velocity; the wind; heading and airspeed errors in the full model."""
    wind, height, heading, airspeed = settings.wind, settings.height, settings.heading, settings.airspeed
    labels = ("position_north_m", "position_east_m", "position_down_m", "velocity_down_mps")
    climb = 2.0 * height.climb_mps**2 / height.climb_tau_s
    tau_s = (np.inf, np.inf, np.inf, height.climb_tau_s)
    blocks = [
        Block("core", labels, Kind.CORE, (10.0, 10.0, 10.0, height.climb_mps), tau_s, (0.0, 0.0, 0.0, climb)),
        along_way("wind", _ne("wind_variation"), Kind.WIND, wind.sigma_mps, 1e3 * wind.distance_km or np.inf, wind.tau_s),
    ]
    if wind.mean_mps > 0.0:
        blocks.append(random_walk("wind_mean", _ne("wind_mean"), Kind.WIND, wind.mean_mps))
    if wind.gust_mps > 0.0:
        blocks.append(along_way("gust", _ne("gust"), Kind.WIND, wind.gust_mps, wind.gust_distance_m))
    if settings.model == "reduced":
        return blocks
    if heading.bias_deg > 0.0:
        label = ["heading_bias_rad"]
        blocks.append(gauss_markov("heading_bias", label, Kind.HEADING_BIAS, heading.bias_deg * DEGREE, heading.bias_tau_s))
    if heading.offset_deg > 0.0:
        blocks.append(random_walk("heading_offset", ["heading_offset_rad"], Kind.HEADING_BIAS, heading.offset_deg * DEGREE))
    if heading.bank_deg > 0.0:
        blocks.append(random_walk("heading_bank", ["heading_bank_rad"], Kind.HEADING_BANK, heading.bank_deg * DEGREE))
    if airspeed.scale > 0.0:
        blocks.append(random_walk("airspeed_scale", ["airspeed_scale"], Kind.AIRSPEED_SCALE, airspeed.scale))
    if airspeed.bias_mps > 0.0:
        blocks.append(gauss_markov("airspeed_bias", ["airspeed_bias_mps"], Kind.AIRSPEED_BIAS, airspeed.bias_mps, airspeed.bias_tau_s))
    return blocks


def _ne(name: str) -> list[str]:
    return [f"{name}_{axis}_mps" for axis in ("north", "east")]


@dataclass(slots=True)
class HeldInputs(HeldAttitude):
    """Last attitude and air data; ``vel_b`` (3,) m/s air-relative, FRD; ``speed`` true airspeed as measured, m/s."""

    vel_b: np.ndarray = field(default_factory=lambda: np.zeros(3))
    steady_b: np.ndarray = field(default_factory=lambda: np.zeros(3))  # vel_b, averaged
    speed: float = 0.0
    air_ns: int | None = None
    air_steps_ns: tuple[int, int] = (0, 0)  # between the last three
    airborne: bool = False
    fastest: float = 0.0  # while airborne and since GPS last saw the aircraft on the ground, m/s

    def take_air(self, air: AirVelocity, settings: AirspeedSettings) -> None:
        """Hold a new air-relative velocity and decide whether the aircraft flies."""
        self.vel_b, step_ns = body_velocity(air, settings), 0 if self.air_ns is None else max(air.stamp_ns - self.air_ns, 0)
        self.air_steps_ns = self.air_steps_ns[1], step_ns
        share = 1.0 if self.air_ns is None else min(1e-9 * step_ns / STEADY_S, 1.0)
        self.steady_b = self.steady_b + share * (self.vel_b - self.steady_b)
        self.speed, self.air_ns = math.sqrt(self.vel_b @ self.vel_b), air.stamp_ns
        self.airborne = self.speed >= settings.minimum_mps * (LANDED if self.airborne else 1.0) and self.vel_b[0] > 0.0
        if self.airborne:
            self.fastest = max(self.fastest, self.speed)

    @property
    def steady_speed(self) -> float:
        """True airspeed averaged over :data:`STEADY_S`, m/s."""
        return math.sqrt(self.steady_b @ self.steady_b)

    def air_n(self, t_ns: int) -> tuple[np.ndarray, float]:
        """Air-relative velocity (3,) in n and sine of the bank at a time, the attitude turned on with its rate."""
        q = self.attitude(t_ns)[0]
        return quat_rotate(q, self.vel_b), float(2.0 * (q[2] * q[3] + q[0] * q[1]))  # how far the right wing points down

    def timed_out(self, t_ns: int, attitude_s: float, air_s: float) -> str:
        """Which input is older than it may be at ``t_ns``, or knows nothing, in words; empty when both are fresh."""
        usual_s = 1e-9 * min(self.air_steps_ns)  # the lesser of two: a gap is not usual
        patience_s = min(max(air_s, PATIENCE * usual_s), MOST_PATIENCE * air_s)
        late = outdated("attitude", self.attitude_ns, t_ns, attitude_s) or outdated("airspeed", self.air_ns, t_ns, patience_s)
        return late or (UNKNOWN if self.cov_att[2, 2] > UNKNOWN_HEADING**2 else "")


def body_velocity(air: AirVelocity, settings: AirspeedSettings) -> np.ndarray:
    """Air-relative velocity (3,) m/s in b: as measured with vanes, else true airspeed turned by the set incidence and slip."""
    tas = float(air.vel_b[0])
    out = np.array([tas, air.vel_b[1], air.vel_b[2]])
    incidence, slip = settings.incidence_deg * DEGREE, settings.slip_deg * DEGREE
    if air.cov_b[1, 1] >= UNKNOWN_VARIANCE:
        out[1] = tas * math.sin(slip)
        out[0] *= math.cos(slip)
    if air.cov_b[2, 2] >= UNKNOWN_VARIANCE:
        out[2] = out[0] * math.sin(incidence)
        out[0] *= math.cos(incidence)
    return out


class ReckoningCore:
    """Mean and covariance, and the attitude and air data that carry them.

    Attributes
    ----------
    layout : Layout
    held : HeldInputs
        Last attitude and air data.
    nav : ndarray (3,)
        lat, lon [rad], height [m above the ellipsoid].
    estimate : ndarray (n,)
        Estimates of the states in ``layout``; the first three are unused (they live in ``nav``).
    P : ndarray (n, n)
    t_ns : int
        Time of the mean.
    started : bool
    wind_rows : ndarray (2, n)
        Sum all that makes up the wind, north and east; turbulence is none of it.
    ranging : ndarray (n,)
        1 for states that a range, a bearing or a horizontal fix may move: all but the vertical channel and what is only considered.
    """

    velocity_rows = None
    climbs_by_aids = True
    history: History | None = None

    def __init__(self, settings: ReckoningSettings, layout: Layout) -> None:
        layout.forget()
        self.settings, self.layout, self.held = settings, layout, HeldInputs()
        self.nav, self.estimate, self.P = np.zeros(3), np.zeros(layout.size), layout.initial_covariance()
        self.t_ns, self.started = 0, False
        self.guard_actions = 0
        self._sums = np.zeros(model.SUMS)
        self._holds = slice(0, 0) if settings.model == "full" else layout["wind"]
        self.levels = NoiseLevels(layout, settings.learn_s)
        self.wind_rows = layout.components(Kind.WIND, 2)
        if "gust" in layout:
            self.wind_rows[:, layout["gust"]] = 0.0
        self._floor, self._ceiling = 1e-12 * np.maximum(layout.sigma0, 1e-9) ** 2, np.full(layout.size, 1e14)
        self.ranging = (layout.kind != Kind.HELD).astype(float)
        self.ranging[2:CORE] = 0.0
        self._down_mps: float | None = None
        self._expect(layout.kind == int(Kind.HEADING_BIAS), layout.kind == int(Kind.AIRSPEED_BIAS))

    def start(self, t_ns: int, nav: np.ndarray, cov_n: np.ndarray) -> None:
        """Begin at a position (lat, lon [rad], height [m]) with its covariance (3, 3), NED m^2."""
        self.nav[:], self.t_ns, self.started = nav, int(t_ns), True
        kalman.reset_block(self.P, POS, cov_n)

    def know_wind(self, wind_n: np.ndarray, sigma: float) -> None:
        """Take a wind (2,), m/s, as known to ``sigma``: one measurement of all that makes up the wind."""
        H = self.wind_rows
        self.P[:] = 0.5 * (self.P + self.P.T)
        y = np.asarray(wind_n, float) - H @ self.estimate
        self.correct(kalman.update(self.P, y, H, max(sigma, 1e-6) ** 2 * np.eye(2), np.ones(self.layout.size)))

    def branch(self) -> "ReckoningCore":
        """A copy that may be moved on alone."""
        twin = copy.copy(self)
        twin.history, twin.held, twin.layout = None, copy.copy(self.held), self.layout.branch()
        twin.P, twin.nav, twin.estimate, twin._sums = self.P.copy(), self.nav.copy(), self.estimate.copy(), self._sums.copy()
        return twin

    def hold(self, item: Measurement) -> None:
        """Hold the attitude or the air data that carry it from now on."""
        if isinstance(item, Attitude):
            self.held.take_attitude(item)
            if self.started:
                self._heed_heading(float(item.cov_att[2, 2]))
                self.heed_climb()
        elif isinstance(item, AirVelocity):
            self.held.take_air(item, self.settings.airspeed)

    def fly(self, item: Measurement, until_ns: int, output_ns: int) -> bool:
        """Move to the stamp of what carries it and hold that, if it is no later than ``until_ns``; return whether it was."""
        if item.stamp_ns > until_ns:
            return False
        self.move(item.stamp_ns)
        self.hold(item)
        return True

    def arrive(self, t_ns: int) -> None:
        """Come to a time with what is held."""
        self.move(t_ns)
        self.settle()

    def become(self, other: "ReckoningCore") -> None:
        """Take over the state of another core of the same layout and time."""
        self.nav[:], self.estimate[:], self.P[:] = other.nav, other.estimate, other.P
        self._sums[:], self.held, self._down_mps = other._sums, copy.copy(other.held), other._down_mps

    def motion(self) -> Motion:
        """Place and velocity with their covariance; the attitude is not its own."""
        velocity, G, noise = self.velocity()
        P = np.zeros((9, 9))
        P[0:3, 0:3], P[3:6, 3:6] = self.P[POS, POS], G @ self.P @ G.T + noise
        return Motion((self.nav[0], self.nav[1], self.nav[2]), velocity, self.held.q_nb, P)

    def move(self, to_ns: int) -> None:
        """Move the mean to ``to_ns`` with what is held; the covariance follows in :meth:`settle`."""
        if to_ns <= self.t_ns:
            return
        layout, (air_n, bank) = self.layout, self.held.air_n((self.t_ns + to_ns) // 2)
        dt, rate = 1e-9 * (to_ns - self.t_ns), layout.rate
        if self._holds.stop:
            rate = rate.copy()
            rate[self._holds] = 0.0
        args = (rate, layout.rate[CLIMB], air_n, bank, self.held.airborne, dt, self._sums)
        model.move(self.nav, self.estimate, layout.kind, layout.axis, *args)
        self.t_ns = to_ns

    def settle(self) -> None:
        """Bring the covariance to the time of the mean."""
        sums, layout, settings = self._sums, self.layout, self.settings
        if sums[0] <= 0.0:
            return
        layout.pace(max(math.hypot(sums[1], sums[2]) / sums[0], self._unseen_speed()))
        heading, airspeed = (settings.heading.noise_deg * DEGREE) ** 2, settings.airspeed.noise_mps**2
        track = kalman.NO_TRACK if self.history is None else self.history.begin(self.P)
        model.carry_covariance(self.P, sums, layout.kind, layout.axis, layout.rate, layout.psd, heading, airspeed, self._walk(), track)
        if self.history is not None:
            self.history.end(self.P)

    def _expect(self, headings: np.ndarray, along: np.ndarray) -> None:
        """Note which states, masks (n,), are errors of the heading and of the airspeed: of the heading that much is expected."""
        self._heading, self._along = np.flatnonzero(headings)[:1], np.flatnonzero(along)[:1]
        self._least_stated = math.inf
        self._expected = self._stated = float(np.sum(self.layout.sigma0[headings] ** 2)) if headings.any() else math.inf

    def _heed_heading(self, variance: float) -> None:
        """Know the heading no better than the attitude reference does, rad^2, where that is worse than expected and than it has been.

        What a reference always states of itself is a guess, and the bias is learnt better.
        One that is off by d takes V (1 - cos d) off along the way, and of a Gaussian d of variance s^2 the mean of 1 - cos d is
        1 - exp(-s^2 / 2).  What the reference has become unsure of it was wrong about for a while: V d T / 2 of the position.
        """
        self._least_stated = min(self._least_stated, variance)
        usual = max(self._expected, USUAL**2 * self._least_stated)
        if not usual < variance < math.inf:
            self._stated = usual
            return
        self.settle()
        known, fastest = min(variance, UNKNOWN_HEADING**2), self.held.fastest
        least = np.zeros(self.layout.size)
        least[self._heading], least[self._along] = math.sqrt(known), fastest * -math.expm1(-0.5 * known)
        kalman.raise_sigmas(self.P, least, self.history)
        if variance > self._stated:
            moved = (0.5 * fastest * UNNOTICED_S) ** 2 * (variance - self._stated)
            kalman.add_variance(self.P, slice(0, 2), moved, self.history)
            self._stated = variance

    def heed_climb(self) -> None:
        """Let the vertical velocity follow attitude and airspeed where they change more than incidence can hide: a dive, a loop.

        The model of the vertical velocity knows climbs and descents only; in level flight the barometer shows more than the attitude.
        """
        held = self.held
        if not held.airborne or self.timed_out():
            self._down_mps = None
            return
        down = float(held.air_n(self.t_ns)[0][2])
        if self._down_mps is None:
            self._down_mps = down
        change = down - self._down_mps
        if abs(change) <= INCIDENCE_MPS:
            return
        dx = np.zeros(self.layout.size)
        dx[CLIMB] = change - math.copysign(INCIDENCE_MPS, change)
        self._down_mps += dx[CLIMB]
        self.settle()
        kalman.add_variance(self.P, slice(CLIMB, CLIMB + 1), (CHANGE_SHARE * dx[CLIMB]) ** 2, self.history)
        self.correct(dx)

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (n,): the estimate moves, the error state is zero again."""
        self.nav[:] = displace(self.nav[0], self.nav[1], self.nav[2], dx[POS])
        self.estimate[CLIMB:] += dx[CLIMB:]
        if self.history is not None:
            self.history.correct(dx)
        self.guard_actions += kalman.guard_covariance(self.P, self._floor, self._ceiling)

    def timed_out(self, t_ns: int | None = None) -> str:
        """Which of attitude and airspeed is too old to move on, now or at ``t_ns``, in words; empty when both are fresh."""
        settings = self.settings
        return self.held.timed_out(self.t_ns if t_ns is None else t_ns, settings.heading.timeout_s, settings.airspeed.timeout_s)

    def totals(self) -> np.ndarray:
        """The estimates summed by what they act on (5,): wind north, east, heading bias, airspeed scale, airspeed bias."""
        return model.sum_estimates(self.estimate, self.layout.kind, self.layout.axis, self.held.air_n(self.t_ns)[1])

    def velocity(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Estimated velocity over ground (3,), m/s NED, now, its derivative (3, n) by the error states, and what they do not explain of it.

        The last (3, 3) is white heading and airspeed noise.
        """
        settings, held, layout, (air_n, bank) = self.settings, self.held, self.layout, self.held.air_n(self.t_ns)
        out, air = np.zeros(3), np.zeros(2)
        if held.airborne:
            total = model.sum_estimates(self.estimate, layout.kind, layout.axis, bank)
            air = model.corrected_air(air_n, total)
            out[0:2] = air + total[0:2]
        out[2] = self.estimate[CLIMB]
        noise = model.unmodelled_velocity(air_n, settings.heading.noise_deg * DEGREE, settings.airspeed.noise_mps)
        swing = held.attitude(self.t_ns)[1]
        if swing > 0.0:
            noise = noise + swing**2 * (float(air_n @ air_n) * np.eye(3) - np.outer(air_n, air_n))
        if self.timed_out() or not held.airborne:
            noise[0:2, 0:2] += held.fastest**2 * np.eye(2)
        return out, model.coupling(air[0], air[1], bank, float(held.airborne), layout.kind, layout.axis), noise

    def learn(self, vel_n: np.ndarray, noise: np.ndarray) -> None:
        """Learn how large wind, turbulence and heading error are from a velocity over ground (3,), m/s NED, of noise (3, 3), now."""
        if self.held.airborne and self.levels.wants(self.t_ns) and not self.timed_out():
            air_n, bank = self.held.air_n(self.t_ns)
            settings = self.settings
            white = model.unmodelled_velocity(air_n, settings.heading.noise_deg * DEGREE, settings.airspeed.noise_mps)
            self.levels.take(self.t_ns, air_n, bank, vel_n, noise + white)

    def dynamics(self) -> np.ndarray:
        """Continuous error dynamics F (n, n): vertical velocity, wind, heading and airspeed errors move position, each state decays."""
        F = -np.diag(self.layout.rate)
        F[:3] += self.velocity()[1]
        return F

    def wind_covariance(self) -> np.ndarray:
        """Covariance (2, 2) of the whole wind, (m/s)^2."""
        return self.wind_rows @ self.P @ self.wind_rows.T

    def horizontal_sigma(self) -> float:
        """Estimated horizontal error, m: root of the sum of both variances."""
        return math.sqrt(self.P[0, 0] + self.P[1, 1])

    def sigmas(self) -> np.ndarray:
        """Sigmas (3,) of heading bias, rad, airspeed scale and airspeed bias, m/s, each the sum of its states."""
        return model.sigmas_of_sums(self.P, self.layout.kind, self.held.air_n(self.t_ns)[1])

    def _walk(self) -> float:
        """Density of the unknown motion, m^2/s: taxiing on the ground, all of the airspeed when inputs are gone.

        Airspeed that collapses where no GPS sees a landing may be a blocked pitot tube: the aircraft may fly as fast as before.
        """
        settings = self.settings
        if self.timed_out() or not self.held.airborne:
            return max(2.0 * LOST_S * self.held.fastest**2, settings.ground_walk_mps**2)
        return 0.0

    def _unseen_speed(self) -> float:
        """Airspeed at which the aircraft may fly on while none is measured, m/s: what varies along the way goes on to vary."""
        return self.held.fastest if self.timed_out() or not self.held.airborne else 0.0

    def course_n(self) -> np.ndarray:
        """Velocity (3,), m/s, by which the true one changes but for what is estimated: that through the air."""
        return quat_rotate(self.held.attitude(self.t_ns)[0], self.held.steady_b)

    def state_rate(self) -> np.ndarray:
        """How fast the true state moves, in the coordinates of the error state (n,) per second."""
        out = np.zeros(self.layout.size)
        out[POS] = self.velocity()[0]
        return out

    def output_rows(self) -> dict[str, np.ndarray]:
        """Quantities of a solution by the error states, (m, n) each, for the smoother."""
        return {"pos": np.eye(self.layout.size)[POS], "vel": self.velocity()[1], "wind": self.wind_rows}

    # views of aids -----------------------------------------------------------------------------------------------------------

    @property
    def speed_mps(self) -> float:
        """True airspeed as measured, m/s."""
        return self.held.speed

    def lever_n(self, lever_b: np.ndarray) -> np.ndarray:
        """Lever arm (3,), m, turned to n by the attitude held."""
        return quat_rotate(self.held.q_nb, lever_b)

    def height_residual(self, height: float, bias: float) -> float:
        """A height, m, less the estimated one and an estimated bias."""
        return height - (self.nav[2] + bias)

    def velocity_at(self, lever_b: np.ndarray) -> VelocitySeen | str:
        """Velocity of an antenna: air-relative velocity plus wind, and what the lever arm adds; unknown without fresh inputs in flight."""
        if not self.held.airborne:
            return "below the minimum airspeed"
        outdated = self.timed_out()
        if outdated:
            return outdated
        vel_n, H, noise = self.velocity()
        swing_n = quat_rotate(self.held.q_nb, np.cross(self.held.rate_b, lever_b)) if lever_b.any() else np.zeros(3)
        return VelocitySeen(vel_n, swing_n, H, noise, np.array([1.0, 1.0, 0.0]))

    def wind_n(self) -> np.ndarray:
        """Estimated wind (2,), m/s, north and east."""
        return self.wind_rows @ self.estimate
