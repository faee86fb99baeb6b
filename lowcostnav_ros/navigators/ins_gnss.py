"""INS/GNSS: the strapdown core aided by satellites one by one (tight) or by a receiver's solution (loose).

The error state is a chosen list: core nine, bias drifts, turn-on biases, scale factors (27 with all of them) and, tightly coupled, the
receiver clock's bias and drift (29); an IMU without drift needs 21 and 23.  Tight coupling uses whatever satellites there are, down to
one; loose coupling coasts where the receiver has no solution (Solimeno 2007, sections 5.2 and 5.3).  Baro, magnetic heading, air data and
VOR radials of the GPS/INS navigator may be switched on beside either.
"""

from dataclasses import dataclass, replace

import numpy as np

from lowcostnav_ros.aids.gnss_integrity import GnssIntegrity
from lowcostnav_ros.aids.ins_gps_aids import AirDataSettings, BaroSettings, MagneticSettings
from lowcostnav_ros.aids.satellites import CLOCK_SIGMA_M, CLOCK_SIGMA_MPS, ClockHost, GnssSettings, RangeAid, RangeRateAid, predicted
from lowcostnav_ros.base.measurements import GnssEpoch, GpsPosition, GpsVelocity, Integrity, Measurement, NavSolution
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.estimation.error_state import Block, Kind, chain, random_walk
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.receiver_clock import CLOCKS
from lowcostnav_ros.navigators.ins_gps import AIR, FIX, IMU, MAG, PRESSURE, VELOCITY, InsGps, InsGpsSettings, chosen_blocks
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.radionav.stations import StationTable
from lowcostnav_ros.starts.point_solution import SlopeVelocity, point_solution

EPOCH = "gnss/raw"
SOLUTION = "gnss_only/odometry_fused"
THESIS_POSITION_PSD = (6.0, 6.0, 90.0)
"""Position random walk, m^2/s north east down, with which the filter follows the range noise as the thesis's published errors do."""
SOURCES = ("epochs", "gnss_only", "receiver")
UNKNOWN_DRIFT_MPS = 1000.0
"""1-sigma of the drift of a clock nobody has measured: three parts in a million, a common crystal."""
ENOUGH = 4
"""Satellites from which position and clock follow from one epoch alone."""


@dataclass(frozen=True)
class NoBaro(BaroSettings):
    """Static pressure, off unless asked for."""

    enabled: bool = setting(False, "Use static pressure for height.")


@dataclass(frozen=True)
class NoMagnetic(MagneticSettings):
    """Magnetometer, off unless asked for."""

    enabled: bool = setting(False, "Use the magnetometer for heading.")


@dataclass(frozen=True)
class NoAirData(AirDataSettings):
    """Air data, off unless asked for."""

    enabled: bool = setting(False, "Use airspeed and sideslip.")


@dataclass(frozen=True)
class LooseSettings:
    """A filtered solution as a measurement: its errors last, and taking them for white would count the same satellites many times."""

    position_tau_s: float = setting(10.0, "Correlation time of its position error.", unit="s", minimum=0.0, maximum=600.0)
    velocity_tau_s: float = setting(0.5, "Correlation time of its velocity error.", unit="s", minimum=0.0, maximum=600.0)
    behind_s: float = setting(0.5, "Its fused solutions are at most this far behind its inputs.", unit="s", minimum=0.0, maximum=10.0)


@dataclass(frozen=True)
class InsGnssSettings(InsGpsSettings):
    """All settings of the INS/GNSS navigator."""

    coupling: str = setting("tight", "Satellites one by one (tight), or a solution of them (loose).", choices=("tight", "loose"))
    loose_source: str = setting(
        "epochs", "Solution used by loose coupling: of each epoch alone, the filtered one of gnss_only, or a receiver's.", choices=SOURCES
    )
    tuning: str = setting("consistent", "Process noise: as the sensors are, or as the thesis's.", choices=("consistent", "thesis"))
    split_turn_on: bool = setting(True, "Estimate turn-on biases beside Gauss-Markov drifts.")
    gnss: GnssSettings = group(GnssSettings)
    loose: LooseSettings = group(LooseSettings)
    baro: NoBaro = group(NoBaro)
    magnetic: NoMagnetic = group(NoMagnetic)
    airdata: NoAirData = group(NoAirData)


def gnss_blocks(settings: InsGnssSettings) -> list[Block]:
    """The list of blocks the settings ask for; sensor errors that the IMU does not have are left out."""
    blocks = [b for b in chosen_blocks(settings) if any(b.sigma0)]
    if settings.tuning == "thesis":
        blocks[0] = replace(blocks[0], psd=THESIS_POSITION_PSD + blocks[0].psd[3:])
    if settings.coupling == "tight":
        blocks.append(clock_block(settings.gnss))
        if settings.gnss.system_offset_m > 0.0:
            blocks.append(random_walk("system_offset", ["galileo_offset_m"], Kind.FREE, settings.gnss.system_offset_m))
    return blocks


def clock_block(settings: GnssSettings) -> Block:
    """Bias, m, and drift, m/s, of the receiver clock with the noise of its oscillator; without Dopplers the drift starts unknown."""
    model = CLOCKS[settings.oscillator]
    labels = ("clock_bias_m", "clock_drift_mps")
    sigmas = CLOCK_SIGMA_M, CLOCK_SIGMA_MPS if settings.doppler else UNKNOWN_DRIFT_MPS
    return chain("clock", labels, sigmas, (model.bias_psd(), model.drift_psd()))


@navigator
class InsGnss(ClockHost, InsGps):
    """INS/GNSS navigator; see the module head.

    Modes: those of the GPS/INS navigator; ``sparse``, aided by one to three satellites; ``suspect``, the satellites contradict the inertial
    sensors or the receiver's clock cannot be right.
    """

    name = "ins_gnss"
    Settings = InsGnssSettings
    colour = "#7a5195"
    modes = {"sparse": ("#b8b042", "with fewer than four satellites"), "suspect": ("#d95f02", "")}

    def __init__(self, settings: InsGnssSettings, stations: StationTable | None = None) -> None:
        self.tight = settings.coupling == "tight"
        self.inputs = {IMU: True, **_fixes(settings), MAG: False, PRESSURE: False, AIR: False}
        self.range_aid, self.rate_aid = RangeAid(settings.gnss), RangeRateAid(settings.gnss)
        self.lever_b = np.array(settings.gps.lever_arm_b_m, dtype=float)
        self.integrity = GnssIntegrity(settings.gnss.integrity, inertial=True)
        self.slope = SlopeVelocity()
        super().__init__(settings, stations, settings.loose.behind_s if SOLUTION in self.inputs else 0.0)
        if self.tight:
            self.aids = [self.range_aid, *([self.rate_aid] if settings.gnss.doppler else []), *self.aids[2:]]

    def blocks(self) -> list[Block]:
        """Those of the GPS/INS navigator with the receiver clock and whatever else the coupling asks for."""
        return gnss_blocks(self.settings)

    def _restart(self) -> None:
        super()._restart()
        self.forget_clock()
        self.slope.clear()
        self._heard_ns = -(10**18)
        self.integrity.clear()

    def _fuse(self, item: Measurement) -> None:
        if isinstance(item, NavSolution) and (item.lat is None or item.vel_n is None):
            self.input_status[item.source].reject("no position or no velocity")
        elif isinstance(item, NavSolution):
            for part in self._fix_of(item):
                super()._fuse(part)
        elif isinstance(item, GnssEpoch) and not self.tight:
            for part in self._solved(item):
                super()._fuse(part)
        else:
            super()._fuse(item)

    def _fix_of(self, solution: NavSolution) -> tuple[GpsPosition, GpsVelocity]:
        """Another navigator's solution as position and velocity of the antenna.

        Errors of sigma s that last tau are worth, every dt, white ones of variance s^2 2 tau/dt: the information then is the same.
        """
        stamp, source, loose = solution.stamp_ns, solution.source, self.settings.loose
        since_s, self._heard_ns = 1e-9 * (stamp - self._heard_ns), stamp
        position = solution.cov_pos * max(1.0, 2.0 * loose.position_tau_s / since_s)
        velocity = solution.cov_vel * max(1.0, 2.0 * loose.velocity_tau_s / since_s)
        place = (solution.lat, solution.lon, solution.height)
        return GpsPosition(stamp, source, *place, position), GpsVelocity(stamp, source, solution.vel_n, velocity)

    def _solved(self, epoch: GnssEpoch) -> tuple[Measurement, ...]:
        """Position and velocity of the antenna from one epoch alone, errors white from epoch to epoch; nothing where there is none."""
        if self._aligned and self.core.t_ns == epoch.stamp_ns:
            used = np.zeros(len(epoch), dtype=bool)
            used[self.range_aid.usable(epoch, epoch.pseudorange_m, epoch.range_valid, predicted(epoch, self)[-1])] = True
            epoch = replace(epoch, range_valid=used, doppler_valid=used & epoch.doppler_valid)
        try:
            return tuple(part for part in self._solve(epoch) if part is not None)
        except GnssError as error:
            self.input_status[epoch.source].reject("no solution of this epoch")
            if not self._aligned:
                self.mode, self.reason = "aligning", str(error)
            return ()

    def _solve(self, epoch: GnssEpoch) -> tuple[GpsPosition, GpsVelocity | None]:
        """Point solution of an epoch; to align without Dopplers, the slope of the positions serves as velocity."""
        fix, velocity = point_solution(epoch, doppler=self.settings.gnss.doppler)
        return fix, velocity or (None if self._aligned else self.slope.add(fix))

    def _aid(self, item: Measurement) -> None:
        if not isinstance(item, GnssEpoch):
            super()._aid(item)
        elif self._due("epoch", item.stamp_ns, self.settings.gps.period_s):
            # Doppler after range: the turn of the lines of sight is then taken at the mended position
            ranged = self.use_aid(self.range_aid, item)
            rated = self.settings.gnss.doppler and self.use_aid(self.rate_aid, item)
            if ranged or rated:
                self._fused_fix_ns = item.stamp_ns
            self.integrity.watch_drift(item.stamp_ns, self.core.estimate[self.layout["clock"].start + 1])

    def _judge(self) -> None:
        super()._judge()
        if not self.tight:
            return
        if self.mode == "coasting":
            self.reason = self.reason.replace("GPS fix", "satellites")
        elif self.mode == "gps":
            ranges, rates = len(self.range_aid.used), len(self.rate_aid.used)
            self.mode = "gps" if ranges >= ENOUGH else "sparse"
            self.reason = f"{ranges} satellites" if ranges or not rates else f"no pseudorange, {rates} Dopplers"
        if self.integrity.status.alarm and self.mode in ("gps", "sparse"):
            self.mode, self.reason = "suspect", self.integrity.status.alarm

    def _integrity(self) -> Integrity | None:
        return self.integrity.report(self.core.t_ns) if self.tight else None

    def _solution(self, *state) -> NavSolution:
        return replace(super()._solution(*state), integrity=self._integrity())

    def _prepare(self, item: Measurement) -> None:
        """Align on the point solution of an epoch, which takes four satellites."""
        if not isinstance(item, GnssEpoch):
            super()._prepare(item)
            return
        try:
            fix, velocity = self._solve(item)
        except GnssError as error:
            self.mode, self.reason = "aligning", str(error)
            return
        super()._prepare(fix)
        if velocity is not None:
            super()._prepare(velocity)
        else:
            self.mode, self.reason = "aligning", "waiting for positions that give a velocity: there are no Dopplers"


def _fixes(settings: InsGnssSettings) -> dict[str, bool]:
    """Sources of satellite data and that they are needed."""
    if settings.coupling == "tight" or settings.loose_source == "epochs":
        return {EPOCH: True}
    return {SOLUTION: True} if settings.loose_source == "gnss_only" else {FIX: True, VELOCITY: True}
