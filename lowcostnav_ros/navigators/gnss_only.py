"""Satellites alone: an extended Kalman filter on pseudoranges and Dopplers without inertial sensors.

    PV  (8):  dp/dt = v,  dv/dt = w                       velocity a random walk of density q_v, m^2/s^3
    PVA (11): dp/dt = v,  dv/dt = a,  da/dt = -a/T + w    acceleration Gauss-Markov of driving density q_a, m^2/s^5

and the receiver clock's bias and drift in both (Solimeno 2007, section 5.2.1).  Errors are metres north, east, down, true minus
estimated, at the current place, where p' = v holds; the mean turns with n.  The printed -diag(T) of the acceleration is -diag(1/T).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.aids.gnss import ENOUGH, EPOCH, GNSS, THESIS_POSITION_PSD, RangeAid, SatelliteAid, clock_block
from lowcostnav_ros.base.measurements import GnssEpoch, Integrity, Measurement, NavSolution
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.motion import MotionCore
from lowcostnav_ros.estimation.aiding import Decision, unique
from lowcostnav_ros.estimation.error_state import Block, Kind, Layout
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.navigators.against_satellites import AgainstSatellites
from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.navigators.solutions import position_sigmas
from lowcostnav_ros.starts.point_solution import point_solution, unknown_velocity


@dataclass(frozen=True)
class GnssOnlyOwnSettings:
    """Settings of the satellites-only navigator that are no sensor's."""

    horizon: HorizonSettings = group(HorizonSettings, jump_s=130.0)  # with one source, no data is an outage, not a clock that jumped
    model: str = setting("pva", "Motion model: velocity (pv) or acceleration (pva) as the driven state.", choices=("pv", "pva"))
    velocity_psd: float = setting(3.0, "Driving density of the velocity (pv).", unit="m^2/s^3", minimum=0.0, maximum=1e4)
    acceleration_psd: float = setting(1.0, "Driving density of the acceleration (pva).", unit="m^2/s^5", minimum=0.0, maximum=1e4)
    acceleration_tau_s: float = setting(10.0, "Correlation time of the acceleration (pva).", unit="s", minimum=0.1)
    tuning: str = setting("consistent", "Position noise: none, or the thesis's.", choices=("consistent", "thesis"))
    minimum_satellites: int = setting(ENOUGH, "With fewer the solution is held back and the state only predicted.", minimum=1, maximum=12)
    latency_s: float = setting(0.2, "Longest delay between validity and arrival of an epoch.", unit="s", minimum=0.0, maximum=5.0)
    timeout_s: float = setting(2.5, "No solution for this long is an outage.", unit="s", minimum=0.1, maximum=600.0)
    restart_s: float = setting(120.0, "An outage beyond this restarts the filter.", unit="s", minimum=1.0, maximum=3600.0)


def motion_blocks(settings: Any) -> list[Block]:
    """Position, velocity, acceleration where modelled, clock."""

    def block(name: str, unit: str, sigma: float, psd: tuple[float, ...], tau_s: float = np.inf) -> Block:
        return Block(name, tuple(f"{name}_{axis}_{unit}" for axis in ("north", "east", "down")), Kind.FREE, (sigma,) * 3, tau_s, psd)

    jitter = THESIS_POSITION_PSD if settings.tuning == "thesis" else (0.0, 0.0, 0.0)
    accelerated = settings.model == "pva"
    blocks = [block("position", "m", 30.0, jitter), block("velocity", "mps", 3.0, (0.0 if accelerated else settings.velocity_psd,) * 3)]
    if accelerated:
        blocks.append(block("acceleration", "mps2", 3.0, (settings.acceleration_psd,) * 3, settings.acceleration_tau_s))
    return [*blocks, clock_block(settings.gnss)]


@navigator
class GnssOnly(Navigator):
    """Satellites-only navigator; see the module head.

    Modes: ``initialising``, ``gps``, ``coasting`` (too few satellites: nothing fused, solutions held back), ``suspect`` (the receiver's
    clock cannot be right), ``failed``.
    """

    name = "gnss_only"
    smooths = True
    colour = "#8c6d31"
    modes = {"suspect": ("#d95f02", "")}
    OwnSettings = GnssOnlyOwnSettings
    sensors = (GNSS,)
    needs = ("gnss",)
    required = (EPOCH,)

    def __init__(self, settings: Any, stations: Any = None) -> None:
        super().__init__(settings, stations, settings.latency_s)
        layout = Layout(unique([*motion_blocks(settings), *self.aid_blocks()]))
        self._attach(layout, MotionCore(layout))
        self.range_aid = self.aids_of(RangeAid)[0]
        self.receiver, self.against = self.range_aid.receiver, AgainstSatellites()
        self._satellite_aids = self.aids_of(SatelliteAid)
        self._restart()

    def gps_good(self, stamp_ns: int) -> bool:
        """Whether satellites hold the solution."""
        return self.mode == Mode.GPS

    def _restart(self) -> None:
        self._started = False
        self.receiver.restart()
        self.against.clear()
        self._fused_ns = 0

    def _fuse(self, item: Measurement) -> None:
        if not isinstance(item, GnssEpoch):
            if self._started:
                self.core.advance(item.stamp_ns)
                self.use(item)
            return
        if self._started and item.stamp_ns - self._fused_ns > 1e9 * self.settings.restart_s:
            self.realign(f"no solution for {self.settings.restart_s:.0f} s")
        if not self._started and not self._start(item):
            return
        self.core.advance(item.stamp_ns)
        if np.count_nonzero(item.range_valid) >= self.settings.minimum_satellites:
            used = self.use(item)
            self.against.take(item.stamp_ns, self._satellite_aids, self.P)
            if self.range_aid in used:  # Dopplers alone would be dead reckoning
                self._fused_ns = item.stamp_ns
            if any(aid.decision is Decision.RECOVER for aid in used):
                self.realign("most satellites contradicted the state")  # one epoch gives a better state than widening this one
                return
        self._judge(item)
        if self._fused_ns == item.stamp_ns:
            self.publish(self._solution(item.stamp_ns, self.core.nav, self.P))

    def doubt(self, stamp_ns: int) -> np.ndarray:
        """As every navigator; of satellites that contradict the state what they show."""
        doubt, shown = super().doubt(stamp_ns), self.against.doubt(self.P)
        return doubt if shown is None else doubt + shown

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
            words = self.against.words()
            self.mode, self.reason = Mode.GPS, f"{len(self.range_aid.used)} satellites{'; ' if words else ''}{words}"
            if self.receiver.integrity.status.alarm:
                self.mode, self.reason = Mode.SUSPECT, self.receiver.integrity.status.alarm
        elif since > self.settings.timeout_s:
            self.mode, self.reason = Mode.COASTING, f"{len(epoch)} satellites for {since:.0f} s"

    def _predict(self) -> NavSolution | None:
        if not self._started or self.mode not in (Mode.GPS, Mode.SUSPECT):
            return None
        newest = self.horizon.newest_ns or self.core.t_ns
        nav, P = self.core.ahead(newest)
        return self._solution(max(newest, self.core.t_ns), nav, P)

    def _solution(self, t_ns: int, nav: np.ndarray, P: np.ndarray) -> NavSolution:
        """The solution of a state ``nav`` (6,) with its covariance."""
        lat, lon, height = nav[:3].tolist()
        covariance = P[:6, :6] + self.doubt(t_ns)[:6, :6]
        return NavSolution(
            *(int(t_ns), self.name, lat, lon, height, nav[3:6].copy()),
            cov_pos=covariance[:3, :3].copy(),
            cov_vel=covariance[3:, 3:].copy(),
            mode=self.mode,
            states=self._states(P, 6),
            integrity=self._integrity(),
        )

    def _integrity(self) -> Integrity:
        return self.receiver.integrity.report(self.core.t_ns)

    def _sigmas(self) -> dict[str, float]:
        return position_sigmas(self.P) if self._started else {}


GnssOnlySettings = GnssOnly.Settings
