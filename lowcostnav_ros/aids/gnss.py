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
from lowcostnav_ros.base.kernels import plain
from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.tally import Tally
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.inertial import CORE, POS, VEL
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
    JUMP_SIGMAS,
    UNUSABLE,
    Observations,
    believed,
    learnt,
    observed,
    scalar_variances,
    screened,
    summary,
)
from lowcostnav_ros.gnss.receiver_clock import CLOCKS
from lowcostnav_ros.gnss.signals import GALILEO, name
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
NOTHING, NO_LEVER = np.zeros(0, dtype=np.int64), np.zeros(3)


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
        self.carry(np.zeros(3))
        self.clock_known = [False, False]
        self._epoch: GnssEpoch | None = None
        self._names = b""

    def carry(self, lever_b: np.ndarray) -> None:
        """Take the antenna to be at ``lever_b`` (3,), m."""
        self.lever_b, self.has_lever = lever_b, bool(lever_b.any())

    def satellites(self, epoch: GnssEpoch) -> tuple[tuple, np.ndarray]:
        """Columns of an epoch as :func:`.observed` takes them, and the numbers of its satellites (:func:`.slots_of`)."""
        if self._epoch is not epoch:
            names = epoch.system.tobytes() + epoch.sat_id.tobytes()
            if names != self._names:  # they hardly ever change
                wanted = np.array([system in self._settings.systems for system in epoch.system.tolist()], dtype=bool)
                self._names, self._systems, self._slots = names, (wanted, epoch.system == GALILEO), slots_of(epoch)
            self._epoch, self._columns = epoch, tuple(map(plain, (epoch.sat_pos_e, epoch.sat_vel_e, epoch.cn0)))
        return self._columns + self._systems, self._slots

    def attach(self, host: Host) -> None:
        """Take the antenna of a host and test against its inertial sensors, if it has any."""
        if self._host is not host:
            self._host = host
            self.carry(np.array(getattr(host, "lever_b", np.zeros(3))))
            self.integrity = GnssIntegrity(self._settings.integrity, inertial=hasattr(host.core, "force_b"))

    def restart(self) -> None:
        """Seed both anew at the next epoch, and test from the beginning."""
        self.clock_known = [False, False]
        self.integrity.clear()

    def antenna(self, host: Host) -> tuple[np.ndarray, np.ndarray]:
        """The antenna relative to the IMU, m, and its velocity, m/s, in n; (3,) each."""
        if not self.has_lever:
            return NO_LEVER, NO_LEVER
        C = quat_to_dcm(host.core.nav[6:10])
        return C @ self.lever_b, C @ np.cross(host.core.rate_b, self.lever_b)


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
    sigma_scale: float

    def __init__(self, settings: GnssSettings, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self._least = math.sin(settings.mask_deg * DEGREE), float(settings.minimum_cn0)
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
        offset = host.layout.get(self.own("system_offset"))
        self._offset = -1 if offset is None or self.kind == RATE else offset.start
        self.seeds = (POS, host.core.velocity_rows)

    def columns(self, epoch: GnssEpoch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What is measured of each satellite, its sigma and whether it means anything, (n,) each."""
        raise NotImplementedError

    def _look(self, epoch: GnssEpoch, host: Host, estimate: np.ndarray, states: tuple[int, int]) -> tuple:
        """Output of :func:`.observed`, with the satellites that cannot be used, each with its reason, in place of all that were found."""
        satellites, _ = self.receiver.satellites(epoch)
        measured, stated, valid = self.columns(epoch)
        found, rows, *further = observed(
            *(host.core.nav, *self.receiver.antenna(host), estimate, satellites, plain(measured), plain(stated)),
            *(plain(valid), self.kind == RATE, states, self._least),
            *(self.sigma_scale, self._usual, self.settings.common_error and self.kind == RANGE),
        )
        if len(rows) == len(found):
            return [], rows, *further
        return [(row, UNUSABLE[found[row]]) for row in np.argsort(found, kind="stable").tolist() if found[row] >= 0], rows, *further

    def observations(self, epoch: GnssEpoch, host: Host) -> Observations:
        """Innovations of the usable satellites, and why the others are not usable; a jump of the whole clock is taken off.

        Changes nothing.
        """
        states = self._clock + self.clock_state, self._offset
        others, rows, y, H, r, common, stated, usual, is_finite, is_steady = self._look(epoch, host, host.core.estimate, states)
        obs = Observations(rows, y, H, r, common, others, None, stated, usual=usual, is_finite=is_finite)
        if self.receiver.has_lever:
            self._swing(obs, host)
        if not (is_steady and self.receiver.clock_known[self.clock_state]):
            obs.clock_step = self._clock_step(y, H, r, host)
            if obs.clock_step is not None:
                obs.y = y - obs.clock_step
        return obs

    def _swing(self, obs: Observations, host: Host) -> None:
        """Add what a lever arm does beyond position, velocity and attitude."""

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
        self._usual = obs.usual
        self.count(measurement, obs.excluded)
        if not obs.rows.size:
            return self.refuse("no usable satellite")
        if not obs.is_finite:
            return self.refuse(aiding.NOT_FINITE)
        slots = self.receiver.satellites(measurement)[1][obs.rows]
        excluded = integrity.is_excluded(slots)
        if integrity.distrusted or np.count_nonzero(excluded) == len(excluded):
            return self.refuse("satellites not used since the alarm" if integrity.distrusted else EXCLUDED_BY_TEST)
        self._seed(obs, host)
        threshold = self.threshold if self.settings.screening else math.inf
        S, _, shown, passed, R, is_finite = screened(host.P, obs.y, obs.H, obs.r, obs.common, excluded, threshold)
        if not is_finite:
            return self.refuse(aiding.NOT_FINITE)
        if host.offsets is not None and shown[0] > 1.0:
            late = host.offsets.uncertainty(self, obs, host).diagonal()
            widened = obs.y**2 / ((S + late) * self.threshold)
            if middle(widened) <= 1.0 and host.offsets.is_likely(self.source):
                obs.late, passed = late, (widened <= 1.0) & ~excluded
                shown = summary(host.P, obs.y, obs.H, obs.r, obs.common, excluded, widened)
        # the lower median: with most satellites beyond the gate it is the prediction that is wrong, not they
        middle_ratio = self._report(shown)
        self.scatter, self.observed = middle_ratio * self.threshold, obs
        decision, reason = self.control(measurement.stamp_ns, middle_ratio, host)
        self.decision = decision
        if decision is Decision.REJECT:
            return self.refuse(reason)
        status.reason = ""
        if decision is Decision.RECOVER:
            obs.r = obs.r + obs.y**2
            status.rejected[aiding.RECOVERED] += 1
            integrity.contradicted(measurement.stamp_ns, self.gate.recovery_s)
            self._apply(measurement, obs, ~excluded, obs.R, host)
        else:
            good = self._tested(measurement, obs, slots, passed, R)
            number = np.count_nonzero(good)
            if not number:
                return self.refuse("satellites contradict each other")
            if number < len(good):
                self.count(measurement, [(row, aiding.BEYOND_GATE) for row in obs.rows[~passed & ~excluded]])
                self.count(measurement, [(row, EXCLUDED_BY_TEST) for row in obs.rows[excluded | (passed & ~good)]])
            self._apply(measurement, obs, good, R, host)
        status.accepted, status.accepted_ns = True, measurement.stamp_ns
        status.fused += 1
        return True

    def _tested(self, epoch: GnssEpoch, obs: Observations, slots: np.ndarray, passed: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Those of the satellites that passed which the integrity tests leave."""
        integrity = self.receiver.integrity
        if not integrity.settings.enabled:
            return passed
        return integrity.compare(self.kind, Satellites(epoch, obs.rows, slots, self.shared(obs), R), obs.y, passed)

    def _apply(self, epoch: GnssEpoch, obs: Observations, good: np.ndarray, R: np.ndarray, host: Host) -> None:
        """Fuse the good ones, with those of the inertial test; ``R`` is the noise of all."""
        integrity, left = self.receiver.integrity, obs.part(good)
        y, H, R = left.y, left.H, R if left is obs else left.R
        self.applied = Innovation(y, H, R, np.array([float(len(y))]), late=None if left.late is None else np.diag(left.late))
        _, S, self.epoch_nis, _ = kalman.tested(host.P, y, H, R)
        self.epoch_dof = len(y)
        if self.decision is Decision.FUSE and integrity.is_watching(self.kind, epoch.stamp_ns):
            integrity.check_against_inertial(self.kind, epoch.stamp_ns, y, self.shared(left)[:, :4], S)
        self.fuse(self.applied, host)
        self.used = left.rows

    def _report(self, shown: np.ndarray) -> float:
        """Fill the record in by what :func:`.summary` says; return the lower median of the ratios."""
        status = self.status
        status.observation, status.innovation, status.innovation_variance = shown[1:2], shown[2:3], shown[3:4]
        mean, variance, status.test_ratio, lower = shown[2:].tolist()
        status.nis = mean**2 / variance
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
        self._usual = learnt(plain(stated), self._usual)

    def believed(self, stated: np.ndarray) -> np.ndarray:
        """Sigmas (n,) as far as the stated ones can be."""
        return believed(stated, self._usual)

    def _clock_step(self, y: np.ndarray, H: np.ndarray, r: np.ndarray, host: Host) -> float | None:
        """By how much the clock (or its drift) is to be moved: it was unknown, or it jumped; else None.

        A jump moves all satellites together, so most of them agree on it (two must both); no motion of the receiver does that.
        """
        if not y.size:
            return None
        common = middle(y)
        if not self.receiver.clock_known[self.clock_state]:
            return common
        together = np.abs(y - common) <= JUMP_SIGMAS * np.sqrt(r)
        if len(y) < 2 or 2 * np.count_nonzero(together) <= len(y):
            return None
        if abs(common) < JUMP_SIGMAS * math.sqrt(scalar_variances(host.P, H, r).max()):
            return None
        return common

    def count(self, epoch: GnssEpoch, excluded: list[tuple[int, str]]) -> None:
        """Count satellites that are not used under their reasons."""
        for row, reason in excluded:
            satellite = name(epoch.system[row], epoch.sat_id[row])
            self.status.rejected[reason] += 1
            self.satellites[f"{satellite}: {reason}"] += 1
            self.status.reason = f"{satellite}: {reason}"


class RangeAid(SatelliteAid):
    """Pseudoranges, m: y = pseudorange - (range + clock + system offset)."""

    name, labels = "gnss_range", ("mean_range_m",)
    kind, clock_state, clock_sigma = RANGE, 0, CLOCK_SIGMA_M

    def __init__(self, settings: GnssSettings, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self.sigma_scale = float(settings.range_sigma_scale)

    def columns(self, epoch: GnssEpoch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pseudoranges."""
        return epoch.pseudorange_m, epoch.sigma_m, epoch.range_valid

    def usable_at(self, epoch: GnssEpoch, host: Host) -> np.ndarray:
        """Rows of an epoch whose pseudoranges can be used at the state of a navigator, which may have no receiver clock."""
        others, rows, *_ = self._look(epoch, host, np.zeros(CORE), (0, -1))
        self.count(epoch, others)
        return rows

    def after(self, measurement: GnssEpoch, host: Host) -> None:
        """Watch the clock's drift."""
        self.receiver.integrity.watch_drift(measurement.stamp_ns, host.core.estimate[self._clock + 1])

    def shared(self, obs: Observations) -> np.ndarray:
        """Position, clock, and the clock between systems where satellites of both are seen."""
        columns = [0, 1, 2, self._clock]
        if self._offset >= 0:
            columns += [self._offset] if 0.0 < obs.H[:, self._offset].mean() < 1.0 else []
        return obs.H.take(columns, axis=1)


class RangeRateAid(SatelliteAid):
    """Dopplers as range rates, m/s: y = rate - (predicted rate + clock drift)."""

    name, labels = "gnss_range_rate", ("mean_rate_mps",)
    kind, clock_state, clock_sigma = RATE, 1, CLOCK_SIGMA_MPS
    measures_velocity = True

    def __init__(self, settings: GnssSettings, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self.sigma_scale = float(settings.doppler_sigma_scale)

    def columns(self, epoch: GnssEpoch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Dopplers."""
        return epoch.doppler_mps, epoch.sigma_mps, epoch.doppler_valid

    def _swing(self, obs: Observations, host: Host) -> None:
        """The velocity of the lever arm also depends on the gyro bias."""
        host.layout.fill(obs.H, Kind.GYRO_BIAS, obs.H[:, VEL] @ quat_to_dcm(host.core.nav[6:10]) @ skew(self.receiver.lever_b))

    def shared(self, obs: Observations) -> np.ndarray:
        """Velocity and clock drift."""
        return obs.H.take([3, 4, 5, self._clock + 1], axis=1)


def receiver_aids(settings: GnssSettings, key: str, stations: Any) -> list[Aid]:
    """The two aids of a receiver, or the first alone without Dopplers; they share antenna, clock and integrity tests."""
    ranges, rates = RangeAid(settings, key), RangeRateAid(settings, key)
    rates.receiver = ranges.receiver
    return [ranges, rates] if settings.doppler else [ranges]


GNSS = AIDS.register("gnss", Sensor("gnss", GnssSettings, receiver_aids), __name__)
