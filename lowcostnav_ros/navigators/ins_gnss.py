"""INS/GNSS: the strapdown core aided by satellites one by one (tight) or by a receiver's solution (loose).

The error state is a chosen list: core nine, bias drifts, turn-on biases, scale factors (27 with all of them) and, tightly coupled, the
receiver clock's bias and drift (29); an IMU without drift needs 21 and 23.  Tight coupling uses whatever satellites there are, down to
one; loose coupling coasts where the receiver has no solution (Solimeno 2007, sections 5.2 and 5.3).  Baro, magnetic heading, air data and
VOR radials may be switched on beside either.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lowcostnav_ros.aids.baro import BARO
from lowcostnav_ros.aids.gnss import ENOUGH, EPOCH, GNSS, THESIS_POSITION_PSD, RangeAid, RangeRateAid, Receiver
from lowcostnav_ros.aids.gps import GPS
from lowcostnav_ros.aids.magnetic import MAGNETIC
from lowcostnav_ros.aids.vor import VOR
from lowcostnav_ros.aids.wheels import WHEELS
from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.measurements import GnssEpoch, GpsPosition, GpsVelocity, Integrity, Measurement, NavSolution
from lowcostnav_ros.base.modes import Mode
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.cores.inertial import POS, VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision
from lowcostnav_ros.estimation.error_state import Block
from lowcostnav_ros.estimation.satellite_integrity import RATE
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.navigators.against_air import FOLLOWED
from lowcostnav_ros.navigators.inertial import IMU, InertialNavigator, InertialSettings
from lowcostnav_ros.navigators.ins_gps import AIR
from lowcostnav_ros.navigators.registry import navigator
from lowcostnav_ros.navigators.trust import LASTS_NS, covering, lasting_s
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.starts.gps_start import Start
from lowcostnav_ros.starts.point_solution import point_solution

SOLUTION = "gnss_only/odometry_fused"
SAME_WAY = 0.5
"""Cosine between velocities that one epoch and the next find a state to be off by, which is lost and not the Dopplers noisy."""
SOURCES = {"epochs": EPOCH, "gnss_only": SOLUTION, "receiver": ""}


@dataclass(frozen=True)
class LooseSettings:
    """A filtered solution as a measurement: its errors last, and taking them for white would count the same satellites many times."""

    position_tau_s: float = setting(10.0, "Correlation time of its position error.", unit="s", minimum=0.0, maximum=600.0)
    velocity_tau_s: float = setting(0.5, "Correlation time of its velocity error.", unit="s", minimum=0.0, maximum=600.0)
    behind_s: float = setting(0.5, "Its fused solutions are at most this far behind its inputs.", unit="s", minimum=0.0, maximum=10.0)


@dataclass(frozen=True)
class InsGnssOwnSettings(InertialSettings):
    """Settings of the INS/GNSS navigator that are no sensor's."""

    coupling: str = setting("tight", "Satellites one by one (tight), or a solution of them (loose).", choices=("tight", "loose"))
    loose_source: str = setting(
        "epochs", "Solution used by loose coupling: of each epoch alone, the filtered one of gnss_only, or a receiver's.",
        choices=tuple(SOURCES),
    )  # fmt: skip
    tuning: str = setting("consistent", "Process noise: as the sensors are, or as the thesis's.", choices=("consistent", "thesis"))
    split_turn_on: bool = setting(True, "Estimate turn-on biases beside Gauss-Markov drifts.")
    loose: LooseSettings = group(LooseSettings)


@navigator
class InsGnss(InertialNavigator):
    """INS/GNSS navigator; see the module head.

    Modes: those of the GPS/INS navigator; ``sparse``, aided by one to three satellites; ``suspect``, the satellites contradict the inertial
    sensors or the receiver's clock cannot be right.

    Attributes
    ----------
    tight : bool
    receiver : Receiver or None
        Clock and integrity tests of the satellite receiver, tightly coupled.
    """

    name = "ins_gnss"
    colour = "#7a5195"
    modes = {"sparse": ("#b8b042", "with fewer than four satellites or transmitters"), "suspect": ("#d95f02", "")}
    OwnSettings = InsGnssOwnSettings
    sensors = (GPS, BARO.but(enabled=False), MAGNETIC.but(enabled=False), AIR.but(enabled=False), WHEELS, VOR, GNSS)
    needs = ("gps", "gnss")

    def __init__(self, settings: Any, stations: Any = None) -> None:
        self.tight = settings.coupling == "tight"
        self.solution_source = "" if self.tight else SOURCES[settings.loose_source]
        self.fix_word = "satellites" if self.tight else "GPS fix"
        self.receiver: Receiver | None = None
        super().__init__(settings, stations, settings.loose.behind_s if self.solution_source == SOLUTION else 0.0)
        self._lost_limit = chi_square.threshold(settings.gnss.gate.probability, 3) if self.tight else 0.0
        self._screen, self._doppler = RangeAid(settings.gnss), RangeRateAid(settings.gnss)
        self._screen.receiver.carry(self.lever_b)
        if self.solution_source == EPOCH:
            self.aids.append(self._screen)  # for its record of the satellites that no solution was made of
        for channel in self.channels.get(EPOCH, ()):
            channel.period_s = settings.gps.period_s

    # its list: tight coupling has no use for the receiver's solution, loose none for the satellites -----------------------------

    def wants(self, key: str) -> bool:
        """Satellites when tightly coupled, else the receiver's solution."""
        return key.rstrip("0123456789") != ("gps" if self.tight else "gnss")

    def source_of(self, aid: Aid) -> str:
        """Loosely coupled, position and velocity come out of the source of solutions."""
        is_solution = aid.measurement in (GpsPosition, GpsVelocity)
        return self.solution_source if is_solution and self.solution_source else aid.source

    def required_sources(self) -> tuple[str, ...]:
        """The IMU and what the coupling lives on."""
        return (IMU, EPOCH) if self.tight else (IMU, self.solution_source or "gps/fix", self.solution_source or "gps/vel")

    def blocks(self) -> list[Block]:
        """Sensor errors that the IMU does not have are no states; the thesis's tuning lets the position wander."""
        core, *others = (block for block in super().blocks() if any(block.sigma0))
        if self.settings.tuning == "thesis":
            core = replace(core, psd=THESIS_POSITION_PSD + core.psd[3:])
        return [core, *others]

    def _restart(self) -> None:
        super()._restart()
        self._ranges, self._rates = self.aids_of(RangeAid), self.aids_of(RangeRateAid)
        for aid in self._ranges if self.tight else ():
            aid.receiver.restart()
        self.receiver = self._ranges[0].receiver if self.tight else None
        self._away_since_ns: int | None = None
        self._solved_ns = -(10**18)

    # loose coupling is an adapter: epochs or solutions in, position and velocity of the antenna out ------------------------------

    def _fuse(self, item: Measurement) -> None:
        if not self.tight and item.source == self.solution_source:
            for part in self._adapted(item):
                self.trust.take(part)
                super()._fuse(part)
        else:
            super()._fuse(item)

    def _adapted(self, item: Measurement) -> Iterator[Measurement]:
        if isinstance(item, GnssEpoch):
            yield from self._solved(item)
        elif isinstance(item, NavSolution):
            yield from self._fix_of(item)

    def _fix_of(self, solution: NavSolution) -> tuple[Measurement, ...]:
        """Another navigator's solution as position and velocity of the antenna; nothing where it lacks one.

        Errors of sigma s that last tau are worth, every dt, white ones of variance s^2 2 tau/dt: the information then is the same.
        """
        stamp, source, loose, vel_n, cov_vel = solution.stamp_ns, solution.source, self.settings.loose, solution.vel_n, solution.cov_vel
        if not solution.has_position or vel_n is None or cov_vel is None:
            self.input_status[source].reject("no position or no velocity")
            return ()
        since_s, self._solved_ns = 1e-9 * (stamp - self._solved_ns), stamp
        position = solution.place_cov * max(1.0, 2.0 * loose.position_tau_s / since_s)
        velocity = cov_vel * max(1.0, 2.0 * loose.velocity_tau_s / since_s)
        return GpsPosition(stamp, source, *solution.place, position), GpsVelocity(stamp, source, vel_n, velocity)

    def _solved(self, epoch: GnssEpoch) -> tuple[Measurement, ...]:
        """Position and velocity of the antenna from one epoch alone, errors white from epoch to epoch; nothing where there is none."""
        if self._aligned and self.core.t_ns == epoch.stamp_ns:
            used = np.zeros(len(epoch), dtype=bool)
            used[self._screen.usable_at(epoch, self)] = True
            epoch = replace(epoch, range_valid=used, doppler_valid=used & epoch.doppler_valid)
        try:
            return tuple(part for part in self._solve(epoch) if part is not None)
        except GnssError as error:
            self.input_status[epoch.source].reject("no solution of this epoch")
            if not self._aligned:
                self.mode, self.reason = Mode.ALIGNING, str(error)
            return ()

    def _solve(self, epoch: GnssEpoch) -> tuple[GpsPosition, GpsVelocity | None]:
        """Point solution of an epoch; to align without Dopplers, the slope of the positions serves as velocity."""
        ranges, rates = (*self._ranges, self._screen)[0], (*self._rates, self._doppler)[0]
        if not self.tight:
            ranges.learn(epoch.sigma_m)
            rates.learn(epoch.sigma_mps)
        epoch = replace(epoch, sigma_m=ranges.believed(epoch.sigma_m), sigma_mps=rates.believed(epoch.sigma_mps))
        fix, velocity = point_solution(epoch, doppler=self.settings.gnss.doppler)
        return fix, velocity or (None if self._aligned else self.slope.add(fix))

    # tight coupling ----------------------------------------------------------------------------------------------------------

    def _prepare(self, item: Measurement) -> None:
        """Align on the point solution of an epoch, which takes four satellites."""
        if not isinstance(item, GnssEpoch):
            super()._prepare(item)
            return
        try:
            fix, velocity = self._solve(item)
        except GnssError as error:
            self.mode, self.reason = Mode.ALIGNING, str(error)
            return
        super()._prepare(fix)
        if velocity is not None:
            super()._prepare(velocity)
        else:
            self.mode, self.reason = Mode.ALIGNING, "waiting for positions that give a velocity: there are no Dopplers"

    def _recover(self, item: Measurement) -> None:
        super()._recover(item)
        if self.receiver is not None and isinstance(item, GnssEpoch) and not self.receiver.integrity.distrusted:
            self._look_for_loss(item)

    def _look_for_loss(self, epoch: GnssEpoch) -> None:
        """Where satellites are refused: do they agree among themselves and not with the state, it is the state that is lost."""
        found = None if self._is_sound(epoch) else self._apart(epoch)
        if found is None:
            self.trust.away, self._away_since_ns = None, None
            nis, dof = max(((aid.epoch_nis, aid.epoch_dof) for aid in self._rates), default=(0.0, 0))
            self.recovery.note(epoch.stamp_ns, Decision.FUSE, np.zeros(dof) if dof else None, nis)
            self.inertial_is_suspect = self.recovery.is_widened
            return
        (fix, velocity), apart, drift = found
        stamp_ns, first, before = epoch.stamp_ns, self._ranges[0], self.trust.away
        if before is not None and drift @ before[2] < SAME_WAY * np.linalg.norm(drift) * np.linalg.norm(before[2]):
            self._away_since_ns = None  # noise points anywhere
        self.trust.away, self._away_since_ns = (stamp_ns, apart, drift), self._away_since_ns or stamp_ns
        self.recovery.note(stamp_ns, Decision.REJECT, None if velocity is None else drift)
        starts = [self._gather(part) for part in (fix, velocity) if part is not None]
        if stamp_ns - self._away_since_ns >= 1e9 * self.recovery.patience_s(stamp_ns, first.gate.recovery_s) and starts[-1] is not None:
            first.receiver.integrity.contradicted(stamp_ns, 1e-9 * (stamp_ns - self._away_since_ns))
            self.recovery.note(stamp_ns, Decision.RECOVER)
            self._begin_anew(starts[-1])

    def _apart(self, epoch: GnssEpoch) -> tuple[tuple[GpsPosition, GpsVelocity | None], np.ndarray, np.ndarray] | None:
        """Point solution of an epoch, and by what the state is off it, m (3,) and m/s (3,); None: it is not, or there is none."""
        try:
            fix, velocity = self._solve(epoch)
        except GnssError:
            return None
        P, nav, seen = self.core.P, self.core.nav, self.core.velocity_at(self.lever_b)
        apart = difference_n(fix.lat, fix.lon, fix.height, nav[0], nav[1], nav[2]) - self.core.lever_n(self.lever_b)
        drift = np.zeros(3) if velocity is None else velocity.vel_n - seen.vel_n - seen.swing_n
        off = [kalman.normalised_innovation_squared(apart, P[POS, POS] + fix.cov_n)]
        off += [] if velocity is None else [kalman.normalised_innovation_squared(drift, P[VEL, VEL] + velocity.cov_n)]
        return ((fix, velocity), apart, drift) if max(off) > self._lost_limit else None

    def _is_sound(self, epoch: GnssEpoch) -> bool:
        """Whether most satellites were used, and nothing speaks against the state."""
        if self.receiver is None or self.receiver.integrity.status.alarm:
            return False
        for aids, valid in ((self._ranges, epoch.range_valid), (self._rates, epoch.doppler_valid)):
            seen = np.count_nonzero(valid)
            if seen and any(aid.decision is not Decision.FUSE or 2 * len(aid.used) < seen for aid in aids):
                return False
        return True

    def _begin_anew(self, start: Start) -> None:
        super()._begin_anew(start)
        if self.receiver is not None:  # its clock is sought anew; the alarm stays
            alarm = self.receiver.integrity.status
            self.receiver.restart()
            self.receiver.integrity.status.alarm, self.receiver.integrity.status.alarm_ns = alarm.alarm, alarm.alarm_ns
            self.trust.away, self._away_since_ns = None, None
            for aid in (*self._ranges, *self._rates):
                aid.rejecting_since_ns = None

    def doubt(self, t_ns: int) -> np.ndarray:
        """As every inertial navigator; while an alarm is young, what satellites and inertial sensors are apart by."""
        doubt, integrity = super().doubt(t_ns), None if self.receiver is None else self.receiver.integrity
        since_ns = None if integrity is None else integrity.status.alarm_ns
        if integrity is None or integrity.apart is None or since_ns is None or t_ns - since_ns > LASTS_NS:
            return doubt
        kind, offset = integrity.apart
        doubt = doubt.copy()
        if kind == RATE:
            doubt[VEL, VEL] += covering(FOLLOWED * offset)
            offset = offset * lasting_s(t_ns - since_ns)
        doubt[POS, POS] += covering(FOLLOWED * offset)
        return doubt

    def gps_alarm(self) -> bool:
        """Whether the satellites' integrity tests say so."""
        return self.receiver is not None and bool(self.receiver.integrity.status.alarm)

    def _judge(self, *, speaks: bool = True) -> None:
        super()._judge(speaks=speaks)
        if self.receiver is None:
            return
        if self.mode == Mode.GPS:
            ranges, rates = sum(len(aid.used) for aid in self._ranges), sum(len(aid.used) for aid in self._rates)
            self.mode = Mode.GPS if ranges >= ENOUGH else Mode.SPARSE
            self.reason = f"{ranges} satellites" if ranges or not rates else f"no pseudorange, {rates} Dopplers"
        alarm = self.receiver.integrity.status.alarm
        if alarm and self.mode in (Mode.GPS, Mode.SPARSE):
            self.mode, self.reason = Mode.SUSPECT, alarm

    def _integrity(self) -> Integrity | None:
        return None if self.receiver is None else self.receiver.integrity.report(self.core.t_ns)


InsGnssSettings = InsGnss.Settings
