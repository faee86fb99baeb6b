"""Satellite receiver: pseudoranges and Dopplers of an epoch, each satellite judged by its own innovation.

The model is in :mod:`lowcostnav_ros.estimation.satellite_model`, the integrity tests in
:mod:`lowcostnav_ros.estimation.satellite_integrity`.
"""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from lowcostnav_ros.aids import AIDS
from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.tally import Tally
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import POS, VEL
from lowcostnav_ros.cores.views import Place, Velocity
from lowcostnav_ros.estimation import aiding, kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision, GateSettings, Host, Innovation, Sensor, SensorSettings
from lowcostnav_ros.estimation.cross_checks.receiver import middle
from lowcostnav_ros.estimation.error_state import Block, Kind, chain, random_walk
from lowcostnav_ros.estimation.satellite_integrity import (
    EXCLUDED_BY_TEST,
    RANGE,
    RATE,
    GnssIntegrity,
    IntegritySettings,
    Satellites,
    slots_of,
)
from lowcostnav_ros.estimation.satellite_model import (
    ABSURD,
    UNUSABLE,
    Observations,
    believed,
    common_part,
    failed,
    gathered,
    lower_middle,
    satellite_model,
    scalar_variances,
    screened,
    summary,
)
from lowcostnav_ros.gnss.receiver_clock import CLOCKS
from lowcostnav_ros.gnss.signals import name
from lowcostnav_ros.physics.rotation import quat_to_dcm, skew

EPOCH = "gnss/raw"
ENOUGH = 4
"""Satellites from which position and clock follow from one epoch alone."""
THESIS_POSITION_PSD = (6.0, 6.0, 90.0)
"""Position random walk, m^2/s north east down, with which a filter follows the range noise as the published errors of the thesis do."""
CLOCK_SIGMA_M, CLOCK_SIGMA_MPS = 100.0, 10.0
"""Sigmas of a clock just seeded from the median innovation of an epoch."""
UNKNOWN_DRIFT_MPS = 1000.0
"""1-sigma of the drift of a clock not yet measured: three parts in a million, a common crystal."""
NOTHING = np.zeros(0, dtype=np.int64)
USUAL_EPOCHS = 10.0
"""A stated sigma is usual that was stated over so many epochs."""
JUMP_SIGMAS = 8.0
"""A clock jump moves most satellites together by more than this many sigmas, and apart by less."""


@dataclass(frozen=True)
class GnssSettings(SensorSettings):
    """Satellite observations."""

    systems: str = setting("GE", "Letters of the systems used: G GPS, E Galileo.")
    oscillator: str = setting("compensated_crystal", "Receiver oscillator.", choices=tuple(CLOCKS))
    mask_deg: float = setting(5.0, "Lowest elevation used.", unit="deg", minimum=0.0, maximum=60.0)
    minimum_cn0: float = setting(0.0, "Weakest signal used where the receiver reports it.", unit="dB-Hz", minimum=0.0, maximum=60.0)
    doppler: bool = setting(True, "Use Dopplers.")
    range_sigma_scale: float = setting(1.0, "Factor on the stated sigma of a pseudorange.", minimum=0.1, maximum=100.0)
    doppler_sigma_scale: float = setting(1.0, "Factor on the stated sigma of a Doppler.", minimum=0.1, maximum=100.0)
    common_error: bool = setting(False, "Part of the range noise is common to all satellites and grows towards the horizon.")
    system_offset_m: float = setting(0.0, "Sigma of Galileo's clock against that of GPS; 0 takes them as one.", unit="m", minimum=0.0)
    screening: bool = setting(True, "Exclude satellites whose innovation is beyond the gate.")
    gate: GateSettings = group(GateSettings)
    integrity: IntegritySettings = group(IntegritySettings)


def clock_block(settings: GnssSettings, label: str = "clock") -> Block:
    """Bias, m, and drift, m/s, of the receiver clock with the noise of its oscillator; without Dopplers the drift starts unknown."""
    model = CLOCKS[settings.oscillator]
    labels = (f"{label}_bias_m", f"{label}_drift_mps")
    sigmas = CLOCK_SIGMA_M, CLOCK_SIGMA_MPS if settings.doppler else UNKNOWN_DRIFT_MPS
    return chain(label, labels, sigmas, (model.bias_psd(), model.drift_psd()))


class Receiver:
    """What the two aids of a receiver share: the antenna, the clock, the integrity tests.

    ``clock_known`` holds whether bias and drift of the clock were seeded; ``lever_b`` (3,), m, is that of the host's GPS antenna.
    """

    def __init__(self, settings: GnssSettings) -> None:
        self._settings = settings
        self._host: Host | None = None
        self.lever_b = np.zeros(3)
        self.clock_known = [False, False]
        self._numbered: tuple[GnssEpoch | None, np.ndarray, np.ndarray] = (None, NOTHING, NOTHING)

    def numbers(self, epoch: GnssEpoch) -> tuple[np.ndarray, np.ndarray]:
        """Of all satellites of an epoch whether their system is used, bool (n,), and their numbers (:func:`.slots_of`)."""
        if self._numbered[0] is not epoch:
            wanted = np.array([system in self._settings.systems for system in epoch.system.tolist()], dtype=bool)
            self._numbered = epoch, wanted, slots_of(epoch)
        return self._numbered[1:]

    def attach(self, host: Host) -> None:
        """Take the antenna of a host and test against its inertial sensors, if it has any."""
        if self._host is not host:
            self._host = host
            self.lever_b = np.array(getattr(host, "lever_b", np.zeros(3)))
            self.integrity = GnssIntegrity(self._settings.integrity, inertial=hasattr(host.core, "force_b"))

    def restart(self) -> None:
        """Seed both anew at the next epoch, and test from the beginning."""
        self.clock_known = [False, False]
        self.integrity.clear()

    def predicted(self, epoch: GnssEpoch, host: Host) -> tuple:
        """Output of :func:`satellite_model` for an epoch at the state of the navigator."""
        lever_n, swing_n = np.zeros(3), np.zeros(3)
        nav = host.core.nav
        if self.lever_b.any():
            C = quat_to_dcm(nav[6:10])
            lever_n, swing_n = C @ self.lever_b, C @ np.cross(host.core.rate_b, self.lever_b)
        return satellite_model(nav, lever_n, swing_n, epoch.sat_pos_e, epoch.sat_vel_e, host.layout.size)


class SatelliteAid(Aid):
    """Base of the two: screening satellite by satellite, the integrity tests, fusing what passes in one update, recovery when most do not.

    ``used`` holds the rows of the last epoch that were fused; ``epoch_nis`` and ``epoch_dof`` hold the normalised innovation
    squared of all of them together.  The status shows their mean innovation with its own variance, and the worst test ratio.
    ``observed`` are the innovations of the last epoch, whether they were used or not, None where there was none, and ``scatter`` is the
    lower median of their squares in their sigmas.
    """

    measurement, topic, views, is_fix = GnssEpoch, EPOCH, (Place, Velocity), True
    kind: str
    clock_state: int
    clock_sigma: float

    def __init__(self, settings: GnssSettings, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self.receiver = Receiver(settings)
        self.used = NOTHING
        self.satellites: Counter[str] = Tally()
        self.epoch_nis, self.epoch_dof = 0.0, 0
        self._usual = self.scatter = 0.0
        self.observed: Observations | None = None

    def blocks(self) -> list[Block]:
        """Receiver clock, and the clock between systems where it is a state."""
        blocks = [clock_block(self.settings, self.own("clock"))]
        if self.settings.system_offset_m > 0.0:
            label = self.own("galileo_offset_m")
            blocks.append(random_walk(self.own("system_offset"), [label], Kind.FREE, self.settings.system_offset_m))
        return blocks

    def attach(self, host: Host) -> None:
        """Find the clock."""
        self.receiver.attach(host)
        super().attach(host)
        self._clock = host.layout[self.own("clock")].start
        self._offset = host.layout.get(self.own("system_offset"))
        self.seeds = (POS, host.core.velocity_rows)

    def observations(self, epoch: GnssEpoch, host: Host) -> Observations:
        """Innovations of the usable satellites, and why the others are not usable.  Changes nothing."""
        raise NotImplementedError

    def shared(self, obs: Observations) -> np.ndarray:
        """Columns (n, m) of what all satellites measure together: position or velocity, and clocks."""
        raise NotImplementedError

    def innovation(self, measurement: GnssEpoch, host: Host) -> Innovation | str:
        """All usable satellites of an epoch together."""
        obs = self.observations(measurement, host)
        if not obs.rows.size:
            return "no usable satellite"
        return Innovation(obs.y, obs.H, obs.R, np.array([float(len(obs.rows))]))

    def seen_by(self, host: Host, measurement: GnssEpoch) -> Innovation | str:
        """Those satellites that were used; a clock that was sought, or has jumped, is moved alike."""
        obs = self.observations(measurement, host)
        if obs.clock_step is not None:
            self._move_clock(obs.clock_step, host)
        rows = np.searchsorted(obs.rows, self.used)
        return Innovation(obs.y[rows], obs.H[rows], obs.covariance(rows), np.array([float(len(rows))]))

    def process(self, measurement: GnssEpoch, host: Host) -> bool:
        """Judge and fuse one epoch; return whether anything of it was used."""
        status, self.used, self.applied, self.decision, self.observed = self.status, NOTHING, None, None, None
        integrity = self.receiver.integrity
        status.stamp_ns = measurement.stamp_ns
        obs = self.observations(measurement, host)
        if host.offsets is not None:
            host.offsets.take_back(self, obs, host)
        self.learn(obs.stated)
        self.count(measurement, obs.excluded)
        if not obs.rows.size:
            return self.refuse("no usable satellite")
        if not math.isfinite(sum(obs.y.tolist())):
            return self.refuse(aiding.NOT_FINITE)
        slots = self.receiver.numbers(measurement)[1][obs.rows]
        excluded = integrity.is_excluded(slots)
        if integrity.distrusted or excluded.all():
            return self.refuse("satellites not used since the alarm" if integrity.distrusted else EXCLUDED_BY_TEST)
        self._seed(obs, host)
        S, ratios, is_finite = screened(host.P, obs.y, obs.H, obs.r, self.threshold)
        if not is_finite:
            return self.refuse(aiding.NOT_FINITE)
        if not self.settings.screening:
            ratios = np.zeros(len(S))
        if host.offsets is not None and middle(ratios) > 1.0:
            late = host.offsets.uncertainty(self, obs, host).diagonal()
            widened = obs.y**2 / ((S + late) * self.threshold)
            if middle(widened) <= 1.0 and host.offsets.is_likely(self.source):
                obs.late, ratios = late, widened
        # the lower median: with most satellites beyond the gate it is the prediction that is wrong, not they
        middle_ratio = self._report(obs, ratios, excluded, host)
        self.scatter, self.observed = middle_ratio * self.threshold, obs
        decision, reason = self.control(measurement.stamp_ns, middle_ratio, host)
        self.decision = decision
        if decision is Decision.REJECT:
            return self.refuse(reason)
        status.reason = ""
        if decision is Decision.RECOVER:
            good = ~excluded
            obs.r = obs.r + obs.y**2
            status.rejected[aiding.RECOVERED] += 1
            integrity.contradicted(measurement.stamp_ns, self.gate.recovery_s)
        else:
            passed = (ratios <= 1.0) & ~excluded
            good = self._tested(measurement, obs, slots, passed, host)
            if not good.any():
                return self.refuse("satellites contradict each other")
            if not good.all():
                self.count(measurement, [(row, aiding.BEYOND_GATE) for row in obs.rows[~passed & ~excluded]])
                self.count(measurement, [(row, EXCLUDED_BY_TEST) for row in obs.rows[excluded | (passed & ~good)]])
        self._apply(obs, good, host)
        self.used = obs.rows[good]
        status.accepted, status.accepted_ns = True, measurement.stamp_ns
        status.fused += 1
        return True

    def _tested(self, epoch: GnssEpoch, obs: Observations, slots: np.ndarray, passed: np.ndarray, host: Host) -> np.ndarray:
        """Those of the satellites that passed which the integrity tests leave."""
        integrity = self.receiver.integrity
        if not integrity.settings.enabled:
            return passed
        shared = self.shared(obs)
        sats = Satellites(epoch, obs.rows, slots)
        good = integrity.compare(self.kind, sats, obs.y, shared, obs.R, passed)
        if good.any() and integrity.is_watching(self.kind, epoch.stamp_ns):
            left = obs.part(good)
            S = kalman.innovation_covariance(host.P, left.H, left.R)
            integrity.check_against_inertial(self.kind, epoch.stamp_ns, left.y, shared[good, :4], S)
        return good

    def _apply(self, obs: Observations, good: np.ndarray, host: Host) -> None:
        left = obs.part(good)
        y, H, R = left.y, left.H, left.R
        self.applied = Innovation(y, H, R, np.array([float(len(y))]), late=None if left.late is None else np.diag(left.late))
        _, _, self.epoch_nis, _ = kalman.tested(host.P, y, H, R)
        self.epoch_dof = len(y)
        self.fuse(self.applied, host)

    def _report(self, obs: Observations, ratios: np.ndarray, excluded: np.ndarray, host: Host) -> float:
        """Fill the record in; return the lower median of the ratios."""
        count, mean, variance, worst, lower = summary(host.P, obs.y, obs.H, obs.r, obs.common, excluded, ratios)
        status = self.status
        status.observation, status.innovation, status.innovation_variance = np.array([count]), np.array([mean]), np.array([variance])
        status.nis, status.test_ratio = mean**2 / variance, worst
        return lower

    def _seed(self, obs: Observations, host: Host) -> None:
        """Move the clock (or its drift) where it was unknown or has jumped, and forget how well it was known."""
        if obs.clock_step is None:
            return
        if self.receiver.clock_known[self.clock_state]:
            self.status.rejected["clock jump followed"] += 1
            self.receiver.integrity.clock_jumped(self.status.stamp_ns)
        self._move_clock(obs.clock_step, host)
        self.receiver.clock_known[self.clock_state] = True

    def _move_clock(self, step: float, host: Host) -> None:
        row = self._clock + self.clock_state
        host.core.estimate[row] += step
        kalman.reset_block(host.P, slice(row, row + 1), np.array([[self.clock_sigma**2]]), host.core.history)

    def learn(self, stated: np.ndarray) -> None:
        """Learn from the stated sigmas (n,) of an epoch what is usual."""
        if stated.size and (size := middle(stated)) > ABSURD * self._usual:
            self._usual += (1.0 / USUAL_EPOCHS if self._usual else 1.0) * (size - self._usual)

    def believed(self, stated: np.ndarray) -> np.ndarray:
        """Sigmas (n,) as far as the stated ones can be."""
        return believed(stated, self._usual)

    def _stepped(self, obs: Observations, host: Host) -> Observations:
        """Observations with the step of the clock they ask for."""
        obs.clock_step = self._clock_step(obs.y, obs.H, obs.r, host)
        if obs.clock_step is not None:
            obs.y = obs.y - obs.clock_step
        return obs

    def _clock_step(self, y: np.ndarray, H: np.ndarray, r: np.ndarray, host: Host) -> float | None:
        """By how much the clock (or its drift) is to be moved: it was unknown, or it jumped; else None.

        A jump moves all satellites together, so most of them agree on it (two must both); no motion of the receiver does that.
        """
        if not y.size:
            return None
        known = self.receiver.clock_known[self.clock_state]
        if known and abs(lower_middle(y)) < JUMP_SIGMAS * math.sqrt(r.min()):
            return None  # nearly always; the tests below cost time
        common = middle(y)
        if not known:
            return common
        together = np.abs(y - common) <= JUMP_SIGMAS * np.sqrt(r)
        if len(y) < 2 or 2 * np.count_nonzero(together) <= len(y):
            return None
        if abs(common) < JUMP_SIGMAS * math.sqrt(scalar_variances(host.P, H, r).max()):
            return None
        return common

    def usable(
        self, epoch: GnssEpoch, observed: np.ndarray, valid: np.ndarray, sin_elevation: np.ndarray
    ) -> tuple[np.ndarray, list[tuple[int, str]]]:
        """Rows that are valid and finite (``observed`` (n,) is what was measured), of a wanted system, high and strong enough.

        The other rows come second, each with its reason.
        """
        settings, found = self.settings, np.empty(len(epoch), dtype=np.int64)
        wanted, _ = self.receiver.numbers(epoch)
        least = math.sin(settings.mask_deg * DEGREE), settings.minimum_cn0
        if failed(np.ascontiguousarray(valid, dtype=bool), plain(observed), wanted, sin_elevation, plain(epoch.cn0), *least, found):
            return np.arange(len(epoch)), []
        others = [(row, UNUSABLE[found[row]]) for row in np.argsort(found, kind="stable").tolist() if found[row] >= 0]
        return np.flatnonzero(found < 0), others

    def count(self, epoch: GnssEpoch, excluded: list[tuple[int, str]]) -> None:
        """Count satellites that are not used under their reasons."""
        for row, reason in excluded:
            satellite = name(epoch.system[row], epoch.sat_id[row])
            self.status.rejected[reason] += 1
            self.satellites[f"{satellite}: {reason}"] += 1
            self.status.reason = f"{satellite}: {reason}"


class RangeAid(SatelliteAid):
    """Pseudoranges, m."""

    name, labels = "gnss_range", ("mean_range_m",)
    kind, clock_state, clock_sigma = RANGE, 0, CLOCK_SIGMA_M

    def observations(self, epoch: GnssEpoch, host: Host) -> Observations:
        """y = pseudorange - (range + clock + system offset); a jump of the whole clock is followed first."""
        ranges, _, H, _, sin_elevation = self.receiver.predicted(epoch, host)
        rows, others = self.usable(epoch, epoch.pseudorange_m, epoch.range_valid, sin_elevation)
        clock, scale = self._clock, self.settings.range_sigma_scale
        y, H, r, stated = gathered(
            *(ranges, H, plain(epoch.pseudorange_m), plain(epoch.sigma_m)),
            *(rows, host.core.estimate[clock], clock, scale, self._usual),
        )
        if self._offset is not None:
            offset = self._offset.start
            H[:, offset] = epoch.system[rows] == "E"
            y -= H[:, offset] * host.core.estimate[offset]
        common = common_part(r, sin_elevation[rows]) if self.settings.common_error else np.zeros(len(rows))
        return self._stepped(Observations(rows, y, H, r, common, others, stated=stated), host)

    def usable_at(self, epoch: GnssEpoch, host: Host) -> np.ndarray:
        """Rows of an epoch whose pseudoranges can be used at the state of a navigator, which may have no receiver clock."""
        rows, others = self.usable(epoch, epoch.pseudorange_m, epoch.range_valid, self.receiver.predicted(epoch, host)[-1])
        self.count(epoch, others)
        return rows

    def after(self, measurement: GnssEpoch, host: Host) -> None:
        """Watch the clock's drift."""
        self.receiver.integrity.watch_drift(measurement.stamp_ns, host.core.estimate[self._clock + 1])

    def shared(self, obs: Observations) -> np.ndarray:
        """Position, clock, and the clock between systems where satellites of both are seen."""
        columns = [0, 1, 2, self._clock]
        if self._offset is not None:
            columns += [self._offset.start] if 0.0 < obs.H[:, self._offset.start].mean() < 1.0 else []
        return obs.H[:, columns]


class RangeRateAid(SatelliteAid):
    """Dopplers as range rates, m/s."""

    name, labels = "gnss_range_rate", ("mean_rate_mps",)
    kind, clock_state, clock_sigma = RATE, 1, CLOCK_SIGMA_MPS
    measures_velocity = True

    def observations(self, epoch: GnssEpoch, host: Host) -> Observations:
        """y = rate - (predicted rate + clock drift); the velocity of the lever arm also depends on the gyro bias."""
        _, rates, _, H, sin_elevation = self.receiver.predicted(epoch, host)
        rows, others = self.usable(epoch, epoch.doppler_mps, epoch.doppler_valid, sin_elevation)
        drift, lever_b = self._clock + 1, self.receiver.lever_b
        scale = self.settings.doppler_sigma_scale
        y, H, r, stated = gathered(
            *(rates, H, plain(epoch.doppler_mps), plain(epoch.sigma_mps)),
            *(rows, host.core.estimate[drift], drift, scale, self._usual),
        )
        if lever_b.any():
            host.layout.fill(H, Kind.GYRO_BIAS, H[:, VEL] @ quat_to_dcm(host.core.nav[6:10]) @ skew(lever_b))
        return self._stepped(Observations(rows, y, H, r, np.zeros(len(rows)), others, stated=stated), host)

    def shared(self, obs: Observations) -> np.ndarray:
        """Velocity and clock drift."""
        return obs.H[:, [3, 4, 5, self._clock + 1]]


def plain(column: np.ndarray) -> np.ndarray:
    """A column of an epoch as compiled code takes it."""
    return np.ascontiguousarray(column, dtype=float)


def receiver_aids(settings: GnssSettings, key: str, stations: Any) -> list[Aid]:
    """The two aids of a receiver, or the first alone without Dopplers; they share antenna, clock and integrity tests."""
    ranges, rates = RangeAid(settings, key), RangeRateAid(settings, key)
    rates.receiver = ranges.receiver
    return [ranges, rates] if settings.doppler else [ranges]


GNSS = AIDS.register("gnss", Sensor("gnss", GnssSettings, receiver_aids), __name__)
