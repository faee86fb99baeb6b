"""Satellites alone: an extended Kalman filter on pseudoranges and Dopplers without inertial sensors.

    PV  (8):  dp/dt = v,  dv/dt = w                       velocity a random walk of density q_v, m^2/s^3
    PVA (11): dp/dt = v,  dv/dt = a,  da/dt = -a/T + w    acceleration Gauss-Markov of driving density q_a, m^2/s^5

and the receiver clock's bias and drift in both (Solimeno 2007, section 5.2.1).  Errors are metres north, east, down, true minus
estimated, at the current place, where p' = v holds; the mean turns with n.  The printed -diag(T) of the acceleration is -diag(1/T).
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.aids.gnss_integrity import GnssIntegrity
from lowcostnav_ros.aids.satellites import RECOVERED, ClockHost, GnssSettings, RangeAid, RangeRateAid
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import GnssEpoch, Integrity, NavSolution
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.inertial import POS, VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Block, Kind, Layout
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
from lowcostnav_ros.navigators.ins_gnss import ENOUGH, EPOCH, THESIS_POSITION_PSD, clock_block
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.physics.earth import displace, transport_rate_n
from lowcostnav_ros.starts.point_solution import point_solution, unknown_velocity

ACC = slice(6, 9)
STEP_S = 0.25
"""Longest step of a prediction."""


@dataclass(frozen=True)
class GnssOnlyHorizon(HorizonSettings):
    """The fusion horizon of a navigator with one source: its silence is an outage, not a clock that jumped."""

    jump_s: float = setting(130.0, "Stamps this far from the newest are suspect.", unit="s", minimum=1.0, maximum=3600.0)


@dataclass(frozen=True)
class GnssOnlySettings:
    """All settings of the satellites-only navigator."""

    horizon: GnssOnlyHorizon = group(GnssOnlyHorizon)
    model: str = setting("pva", "Motion model: velocity (pv) or acceleration (pva) as the driven state.", choices=("pv", "pva"))
    velocity_psd: float = setting(3.0, "Driving density of the velocity (pv).", unit="m^2/s^3", minimum=0.0, maximum=1e4)
    acceleration_psd: float = setting(1.0, "Driving density of the acceleration (pva).", unit="m^2/s^5", minimum=0.0, maximum=1e4)
    acceleration_tau_s: float = setting(10.0, "Correlation time of the acceleration (pva).", unit="s", minimum=0.1)
    tuning: str = setting("consistent", "Position noise: none, or the thesis's.", choices=("consistent", "thesis"))
    minimum_satellites: int = setting(ENOUGH, "With fewer the solution is held back and the state only predicted.", minimum=1, maximum=12)
    latency_s: float = setting(0.2, "Longest delay between validity and arrival of an epoch.", unit="s", minimum=0.0, maximum=5.0)
    timeout_s: float = setting(2.5, "No solution for this long is an outage.", unit="s", minimum=0.1, maximum=600.0)
    restart_s: float = setting(120.0, "An outage beyond this starts the filter afresh.", unit="s", minimum=1.0, maximum=3600.0)
    gnss: GnssSettings = group(GnssSettings)


def motion_blocks(settings: GnssOnlySettings) -> list[Block]:
    """Position, velocity, acceleration where modelled, clock."""

    def block(name: str, unit: str, sigma: float, psd: tuple[float, ...], tau_s: float = np.inf) -> Block:
        return Block(name, tuple(f"{name}_{axis}_{unit}" for axis in ("north", "east", "down")), Kind.FREE, (sigma,) * 3, tau_s, psd)

    jitter = THESIS_POSITION_PSD if settings.tuning == "thesis" else (0.0, 0.0, 0.0)
    accelerated = settings.model == "pva"
    blocks = [block("position", "m", 30.0, jitter), block("velocity", "mps", 3.0, (0.0 if accelerated else settings.velocity_psd,) * 3)]
    if accelerated:
        blocks.append(block("acceleration", "mps2", 3.0, (settings.acceleration_psd,) * 3, settings.acceleration_tau_s))
    return [*blocks, clock_block(settings.gnss)]


@kernel
def motion_dynamics(n, rate):
    """Continuous dynamics F (n, n) of 8 or 11 states; ``rate`` (n,) holds the decay of the acceleration."""
    F = np.zeros((n, n))
    for i in range(n - 5):
        F[i, i + 3] = 1.0
    for i in range(6, n - 2):
        F[i, i] = -rate[i]
    F[n - 2, n - 1] = 1.0
    return F


@kernel
def predict(nav, estimate, P, rate, psd, dt):
    """Carry mean and covariance over ``dt`` s, in place, in steps of at most :data:`STEP_S`."""
    n = P.shape[0]
    steps = max(1, math.ceil(dt / STEP_S - 1e-9))
    h = dt / steps
    F = motion_dynamics(n, rate)
    Phi, Phi_half = kalman.transition(F, h), kalman.transition(F, 0.5 * h)
    GQG = np.zeros((n, n))
    for i in range(n):
        GQG[i, i] = psd[i]
    for _ in range(steps):
        acceleration = estimate[6:9].copy() if n > 8 else np.zeros(3)
        turn = transport_rate_n(nav[0], nav[2], nav[3:6])
        v0 = nav[3:6].copy()
        nav[3] += h * (acceleration[0] - turn[1] * v0[2] + turn[2] * v0[1])
        nav[4] += h * (acceleration[1] - turn[2] * v0[0] + turn[0] * v0[2])
        nav[5] += h * (acceleration[2] - turn[0] * v0[1] + turn[1] * v0[0])
        nav[0], nav[1], nav[2] = displace(nav[0], nav[1], nav[2], 0.5 * h * (v0 + nav[3:6]))
        for i in range(6, n - 2):
            estimate[i] *= math.exp(-rate[i] * h)
        estimate[n - 2] += estimate[n - 1] * h
        kalman.predict_covariance_by_simpson(P, Phi, Phi_half, GQG, h)


class MotionCore:
    """Mean and covariance of the filter, in the form the satellite aids expect of an inertial core.

    ``nav`` (10,): lat, lon [rad], height [m], velocity NED [m/s], a level attitude nobody uses; ``estimate`` (n,): acceleration and clock.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.nav = np.array([0.0] * 6 + [1.0, 0.0, 0.0, 0.0])
        self.estimate = np.zeros(layout.size)
        self.P = layout.initial_covariance()
        self.t_ns = 0

    def start(
        self,
        t_ns: int,
        place: tuple[float, float, float],
        vel_n: np.ndarray,
        cov_pos: np.ndarray | None = None,
        cov_vel: np.ndarray | None = None,
    ) -> None:
        """Begin at a place (rad, rad, m) and velocity; initial covariances and those of the two add up."""
        self.t_ns = int(t_ns)
        self.nav[:3], self.nav[3:6] = place, vel_n
        self.estimate[:] = 0.0
        self.P = self.layout.initial_covariance()
        for rows, covariance in ((POS, cov_pos), (VEL, cov_vel)):
            if covariance is not None:
                self.P[rows, rows] += covariance

    def advance(self, t_ns: int) -> None:
        """Predict to a stamp."""
        predict(self.nav, self.estimate, self.P, self.layout.rate, self.layout.psd, 1e-9 * (t_ns - self.t_ns))
        self.t_ns = int(t_ns)

    def ahead(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance at a later stamp, leaving this state alone."""
        nav, P = self.nav.copy(), self.P.copy()
        if t_ns > self.t_ns:
            predict(nav, self.estimate.copy(), P, self.layout.rate, self.layout.psd, 1e-9 * (t_ns - self.t_ns))
        return nav, P

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (n,)."""
        nav = self.nav
        nav[0], nav[1], nav[2] = displace(nav[0], nav[1], nav[2], dx[POS])
        nav[3:6] += dx[VEL]
        self.estimate[6:] += dx[6:]


@navigator
class GnssOnly(ClockHost, Navigator):
    """Satellites-only navigator; see the module head.

    Modes: ``initialising``, ``gps``, ``coasting`` (too few satellites: nothing fused, solutions held back), ``suspect`` (the receiver's
    clock cannot be right), ``failed``.
    """

    name = "gnss_only"
    Settings = GnssOnlySettings
    colour = "#8c6d31"
    modes = {"suspect": ("#d95f02", "")}
    inputs = {EPOCH: True}

    def __init__(self, settings: GnssOnlySettings) -> None:
        super().__init__(settings, latency_s=settings.latency_s)
        self.layout = Layout(motion_blocks(settings))
        self.core = MotionCore(self.layout)
        self.range_aid, self.rate_aid = RangeAid(settings.gnss), RangeRateAid(settings.gnss)
        self.aids = [self.range_aid, *([self.rate_aid] if settings.gnss.doppler else [])]
        self.lever_b = self.rate_b = np.zeros(3)
        self.integrity = GnssIntegrity(settings.gnss.integrity, inertial=False)
        self._restart()

    @property
    def P(self) -> np.ndarray:
        """Covariance of the whole error state."""
        return self.core.P

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (an aid calls this)."""
        self.core.correct(dx)

    def _restart(self) -> None:
        self._started = False
        self.forget_clock()
        self._fused_ns: int | None = None
        self.integrity.clear()

    def _fuse(self, item: GnssEpoch) -> None:
        if self._started and item.stamp_ns - (self._fused_ns or 0) > 1e9 * self.settings.restart_s:
            self.realign(f"no solution for {self.settings.restart_s:.0f} s")
        if not self._started and not self._start(item):
            return
        self.core.advance(item.stamp_ns)
        if np.count_nonzero(item.range_valid) >= self.settings.minimum_satellites:
            if self.use_aid(self.range_aid, item):  # Dopplers alone would be dead reckoning under another name
                self._fused_ns = item.stamp_ns
            if self.settings.gnss.doppler:
                self.use_aid(self.rate_aid, item)
            self.integrity.watch_drift(item.stamp_ns, self.core.estimate[-1])
            if any(aid.status.rejected.pop(RECOVERED, 0) for aid in self.aids):
                self.realign("most satellites contradicted the state")  # one epoch gives a better state than widening this one
                return
        self._judge(item)
        if self._fused_ns == item.stamp_ns:
            self._out.append(self._solution(item.stamp_ns, self.core.nav, self.P))

    def _start(self, epoch: GnssEpoch) -> bool:
        try:
            fix, velocity = point_solution(epoch, doppler=self.settings.gnss.doppler)
        except GnssError as error:
            self.reason = str(error)
            return False
        self.set_origin(fix.lat, fix.lon, fix.height)
        velocity = velocity or unknown_velocity(fix)
        self.core.start(epoch.stamp_ns, (fix.lat, fix.lon, fix.height), velocity.vel_n, fix.cov_n, velocity.cov_n)
        self._fused_ns, self._started = epoch.stamp_ns, True
        return True

    def _judge(self, epoch: GnssEpoch) -> None:
        since = 1e-9 * (epoch.stamp_ns - self._fused_ns)
        if since == 0.0:
            self.mode, self.reason = "gps", f"{len(self.range_aid.used)} satellites"
            if self.integrity.status.alarm:
                self.mode, self.reason = "suspect", self.integrity.status.alarm
        elif since > self.settings.timeout_s:
            self.mode, self.reason = "coasting", f"{len(epoch)} satellites for {since:.0f} s"

    def _predict(self) -> NavSolution | None:
        if not self._started or self.mode not in ("gps", "suspect"):
            return None
        newest = self.horizon.newest_ns or self.core.t_ns
        return self._solution(max(newest, self.core.t_ns), *self.core.ahead(newest))

    def _solution(self, t_ns: int, nav: np.ndarray, P: np.ndarray) -> NavSolution:
        sigma = np.sqrt(np.maximum(np.diag(P), 0.0))
        return NavSolution(
            stamp_ns=int(t_ns),
            source=self.name,
            lat=float(nav[0]),
            lon=float(nav[1]),
            height=float(nav[2]),
            vel_n=nav[VEL].copy(),
            cov_pos=P[POS, POS].copy(),
            cov_vel=P[VEL, VEL].copy(),
            mode=self.mode,
            integrity=self._integrity(),
            states={self.layout.labels[i]: (float(self.core.estimate[i]), float(sigma[i])) for i in range(6, self.layout.size)},
        )

    def _integrity(self) -> Integrity:
        return self.integrity.report(self.core.t_ns)

    def _sigmas(self) -> dict[str, float]:
        if not self._started:
            return {}
        s = np.sqrt(np.maximum(np.diag(self.P), 0.0))
        return {
            "position_horizontal_m": float(np.hypot(s[0], s[1])),
            "position_down_m": float(s[2]),
            "velocity_horizontal_mps": float(np.hypot(s[3], s[4])),
        }
