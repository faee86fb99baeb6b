"""Code and carrier of several transmitters, tightly coupled: what ground transmitters and differenced satellites share.

An epoch is taken in one update, row by row (:mod:`lowcostnav_ros.estimation.carrier_model`).  A carrier is used once it has an ambiguity;
where it is new, has slipped or is refused, its ambiguity begins anew after the update; the carrier of that epoch, which then defines the
state, is no measurement.  With the cross-covariances *kept* the new state knows that it is made of the position and the clock; *zeroed*, as
the thesis has it, position and clock are counted as independent of it, and the filter becomes too sure.
"""

import math
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from lowcostnav_ros.aids._ambiguities import Ambiguities
from lowcostnav_ros.aids._carrier_channels import MOST, NEW, Channels
from lowcostnav_ros.aids._carrier_watch import CodeWatch, ScaleWatch
from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.cores.views import Attitude, Place
from lowcostnav_ros.estimation import aiding, kalman
from lowcostnav_ros.estimation.aiding import SLACK_NS, Aid, Decision, GateSettings, Host, Innovation, Reason, SensorSettings
from lowcostnav_ros.estimation.carrier_model import row_variances, screened_update, screened_update_ud, transmitter_model
from lowcostnav_ros.estimation.error_state import Block, Kind, chain, gauss_markov, random_walk
from lowcostnav_ros.gnss.receiver_clock import CLOCKS
from lowcostnav_ros.radionav.troposphere import path_delays

NEAREST_M = 2.0
"""A transmitter so close is at the aircraft: its table is wrong."""
ENOUGH = 4
"""Transmitters that hold position and clock."""
CLOCK_SIGMA_M, CLOCK_SIGMA_MPS = 100.0, 30.0
AMBIGUITY_SIGMA = 1e4
"""Of a state that holds none, cycles."""
STEP_SIGMA_M = 0.1
"""What a clock step leaves uncertain."""
LOOK_NS = 1_000_000_000
REFUSED = "carrier beyond gate"


@dataclass(frozen=True)
class ResetSettings:
    """How an ambiguity begins anew."""

    source: str = setting("position", "From the filter's own range, or from the code.", choices=("position", "code"))
    covariance: str = setting(
        "kept", "Cross-covariances with position and clock: kept (consistent) or zeroed (the thesis).", choices=("kept", "zeroed")
    )
    first_sigma_cycles: float = setting(0.0, "Sigma of a first one, zeroed; 0: as the filter knows its range.", unit="cycles", minimum=0.0)
    again_sigma_cycles: float = setting(0.0, "Sigma of a later one, zeroed; 0: as the filter knows its range.", unit="cycles", minimum=0.0)
    code_updates: int = setting(2, "Codes used after it; -1: all.", minimum=-1, maximum=1000000)


@dataclass(frozen=True)
class CarrierSettings(SensorSettings):
    """Code and carrier of a receiver."""

    enabled: bool = setting(True, "Use it.")
    lever_arm_b_m: list = setting([0.0, 0.0, 0.0], "Antenna relative to the IMU, forward, right, down.", unit="m", minimum=-100.0)
    lever_sigma_m: float = setting(0.0, "Sigma of the lever arm; 0: exact, no states.", unit="m", minimum=0.0, maximum=10.0)
    code_sigma_m: float = setting(4.0, "Noise of a code.", unit="m", minimum=0.01, maximum=1000.0)
    code_slow_m: float = setting(1.5, "Slow part of a code's error, which is no sign of a fault.", unit="m", minimum=0.0, maximum=100.0)
    carrier_sigma_m: float = setting(0.02, "Noise of a carrier.", unit="m", minimum=0.0001, maximum=10.0)
    slow_m: float = setting(0.04, "Slow error of each carrier, Gauss-Markov sigma; 0: no states.", unit="m", minimum=0.0, maximum=10.0)
    slow_tau_s: float = setting(20.0, "Correlation time of the slow error.", unit="s", minimum=0.1)
    walk_cycles_rts: float = setting(1e-3, "Growth of an ambiguity's sigma.", unit="cycles/sqrt(s)", minimum=0.0, maximum=10.0)
    slip_cycles: float = setting(0.7, "Threshold of a cycle slip.", unit="cycles", minimum=0.1, maximum=1000.0)
    gap_s: float = setting(0.25, "A carrier away for longer has slipped.", unit="s", minimum=0.01, maximum=60.0)
    drop_s: float = setting(30.0, "A transmitter away for longer loses its ambiguity state.", unit="s", minimum=0.1, maximum=3600.0)
    slots: int = setting(0, "Ambiguity states; 0: one for each transmitter of the table.", minimum=0, maximum=MOST)
    oscillator: str = setting("ovenized_crystal", "Receiver oscillator.", choices=tuple(CLOCKS))
    clock_psd: list = setting([], "Noise of bias and drift in place of the oscillator's, m^2/s and m^2/s^3; empty: its own.", minimum=0.0)
    period_s: float = setting(0.0, "Use at most one epoch in this time; slips are looked for in all.", unit="s", minimum=0.0, maximum=60.0)
    timeout_s: float = setting(2.5, "No accepted epoch for this long is an outage.", unit="s", minimum=0.1, maximum=600.0)
    update: str = setting("covariance", "Algebra of the update: covariance or U-D factors.", choices=("covariance", "ud"))
    reset: ResetSettings = group(ResetSettings)
    gate: GateSettings = group(GateSettings, probability=0.99999)

    def __post_init__(self) -> None:
        if len(self.lever_arm_b_m) != 3:
            raise SettingsError(f"'lever_arm_b_m' needs three numbers, forward, right, down, got {len(self.lever_arm_b_m)}.")
        if len(self.clock_psd) not in (0, 2):
            raise SettingsError(f"'clock_psd' needs two numbers, bias and drift, or none; got {len(self.clock_psd)}.")


@dataclass(slots=True, eq=False)
class Seen:
    """Rows of an epoch at a state: straight ranges (m,) m, predicted codes (m,) m, their Jacobian (m, n), modelled delays (m,) m."""

    ranges: np.ndarray
    predicted: np.ndarray
    H: np.ndarray
    delays: np.ndarray


@dataclass(slots=True, eq=False)
class EpochRecord:
    """What became of an epoch, for studies: idents (m,), residuals of code and carrier (m,) m (NaN: none) and which were used.

    ``slips`` holds ident, kind and size of every slip; ``renewed`` the idents whose ambiguity began anew.
    """

    stamp_ns: int
    ident: np.ndarray
    code_m: np.ndarray
    carrier_m: np.ndarray
    code_used: np.ndarray
    carrier_used: np.ndarray
    delays_m: np.ndarray
    slips: list[tuple[str, str, float]] = field(default_factory=list)
    renewed: list[str] = field(default_factory=list)


class CarrierAid(Aid):
    """Code and carrier of one receiver; see the module head.

    Attributes
    ----------
    record : EpochRecord or None
        Of the last epoch.
    used : int
        Transmitters of which the last epoch used anything.
    """

    labels = ("mean_range_m",)
    measurement, views, is_fix, thins_itself = CarrierEpoch, (Place,), True, True
    few_slots: ClassVar[int] = 12
    updates_alone, keeps_slots = True, True

    def __init__(self, settings: Any, key: str = "", stations: Any = None) -> None:
        super().__init__(settings, key, stations)
        self.watch = CodeWatch(MOST, settings.code_slow_m)
        self.scale = ScaleWatch(self.own(self.name))
        self.latches = [self.scale.latch]
        self.record: EpochRecord | None = None
        self.used = 0

    # what it is made of ------------------------------------------------------------------------------------------------------

    @property
    def model(self) -> int:
        """Index of the troposphere's model."""
        return 0

    @property
    def slots(self) -> int:
        """Number of ambiguity states."""
        return self.settings.slots or self.few_slots

    def blocks(self) -> list[Block]:
        """Receiver clock, ambiguities, and slow errors, lever arm where they are states."""
        own, prefix, n = self.settings, self.own(self.name), self.slots
        clock = CLOCKS[own.oscillator]
        psd = own.clock_psd or (clock.bias_psd(), clock.drift_psd())
        labels = f"{prefix}_clock_bias_m", f"{prefix}_clock_drift_mps"
        blocks = [chain(f"{prefix}_clock", labels, (CLOCK_SIGMA_M, CLOCK_SIGMA_MPS), psd)]
        numbered = [f"{prefix}_ambiguity_{i + 1}_cycles" for i in range(n)]
        blocks.append(random_walk(f"{prefix}_ambiguity", numbered, Kind.FREE, AMBIGUITY_SIGMA, own.walk_cycles_rts))
        if own.slow_m > 0.0:
            slow = [f"{prefix}_slow_{i + 1}_m" for i in range(n)]
            blocks.append(gauss_markov(f"{prefix}_slow", slow, Kind.FREE, own.slow_m, own.slow_tau_s))
        if own.lever_sigma_m > 0.0:
            arm = [f"{prefix}_lever_{axis}_m" for axis in ("forward", "right", "down")]
            blocks.append(random_walk(f"{prefix}_lever", arm, Kind.FREE, own.lever_sigma_m))
        return blocks

    def attach(self, host: Host) -> None:
        """Find its states in the layout of its host."""
        prefix, layout = self.own(self.name), host.layout
        self._clock, self._rows = layout[f"{prefix}_clock"].start, layout[f"{prefix}_ambiguity"]
        self._slow, self._lever = layout.get(f"{prefix}_slow"), layout.get(f"{prefix}_lever")
        self._scale: int | None = getattr(layout.get(f"{prefix}_troposphere"), "start", None)
        self._attitude = host.core.attitude_rows.start if isinstance(host.core, Attitude) else -1
        self.lever_b = np.array(self.settings.lever_arm_b_m, dtype=float)
        super().attach(host)

    def restart(self) -> None:
        """Forget what was received; the counters stay."""
        super().restart()
        self.ambiguities = Ambiguities(self._rows, AMBIGUITY_SIGMA)
        self.channels = Channels(self.settings.slip_cycles, self.settings.gap_s)
        self.watch.clear()
        self.scale.clear()
        self._number: dict[str, int] = {}
        self._seen_ns, self._budget = np.zeros(MOST, np.int64), np.zeros(MOST, np.int64)
        self._lost = np.ones(MOST, dtype=bool)
        self._begun = np.zeros(MOST, dtype=bool)
        self._clock_known = False
        self._used_ns = self._looked_ns = -(10**18)

    def place_of(self, epoch: CarrierEpoch) -> tuple[np.ndarray, np.ndarray, list[tuple[int, str]]]:
        """Rows of an epoch whose transmitters' places are known (m,), these places (m, 3) ECEF, and the other rows with the reason."""
        raise NotImplementedError

    def air_of(self, epoch: CarrierEpoch, rows: np.ndarray) -> np.ndarray:
        """What the model of the troposphere needs of each row's transmitter, (m, 6)."""
        return np.zeros((len(rows), 6))

    def delays(self, epoch: CarrierEpoch, rows: np.ndarray, height: float, ranges: np.ndarray) -> np.ndarray:
        """Modelled delays (m,), m, of rows at a height of the antenna and at ranges (m,), m."""
        return path_delays(self.model, self.air_of(epoch, rows), height, ranges)

    # an epoch ----------------------------------------------------------------------------------------------------------------

    def innovation(self, measurement: CarrierEpoch, host: Host) -> Innovation | str:
        """Codes of an epoch against the prediction."""
        rows, pos_e, _ = self.located(measurement)
        if not rows.size:
            return "no usable transmitter"
        seen = self._predicted(measurement, rows, pos_e, host)
        y = measurement.code_m[rows] - seen.predicted
        return Innovation(y, seen.H, np.eye(len(y)) * self.settings.code_sigma_m**2, measurement.code_m[rows])

    def process(self, measurement: CarrierEpoch, host: Host) -> bool:
        """Look for slips, use what there is, begin ambiguities anew; return whether anything was used."""
        status, self.applied, self.decision, self.used = self.status, None, None, 0
        status.stamp_ns = measurement.stamp_ns
        rows, pos_e, others = self.located(measurement)
        for _, reason in others:
            status.rejected[Reason.phrase_of(reason)] += 1
        if not rows.size:
            return self.refuse(others[-1][1] if others else "no usable transmitter")
        channel = self._channels_of(measurement.ident[rows])
        slips = self._look(measurement, rows, channel, host)
        self._drop_absent(measurement.stamp_ns, host)
        if measurement.stamp_ns - self._used_ns < 1e9 * self.settings.period_s - SLACK_NS:
            status.accepted = False
            return False
        self._used_ns = measurement.stamp_ns
        return self._fuse_epoch(measurement, rows, channel, pos_e, slips, host)

    def located(self, epoch: CarrierEpoch) -> tuple[np.ndarray, np.ndarray, list[tuple[int, str]]]:
        """Rows of an epoch that can be used (m,), where their transmitters are (m, 3) ECEF, and the other rows with the reason."""
        rows, pos_e, others = self.place_of(epoch)
        good = epoch.code_valid[rows] | epoch.carrier_valid[rows]
        if not good.all():
            others = others + [(int(row), "not valid") for row in rows[~good]]
        return rows[good], pos_e[good], others

    def _channels_of(self, idents: np.ndarray) -> np.ndarray:
        """Numbers of transmitters; when there are too many, the one unheard for longest gives up its number."""
        out = np.empty(len(idents), dtype=np.int64)
        for i, ident in enumerate(idents.tolist()):
            number = self._number.get(ident)
            if number is None:
                number = len(self._number)
                if number == MOST:
                    number = int(np.argmin(self._seen_ns))
                    self._number = {name: k for name, k in self._number.items() if k != number}
                self._number[ident] = number
                self._lost[number], self._begun[number] = True, False
            out[i] = number
        return out

    def _look(self, epoch: CarrierEpoch, rows: np.ndarray, channel: np.ndarray, host: Host) -> list[tuple[str, str, float]]:
        """Find slips; the carriers that have slipped are lost.  A clock step moves the clock and nothing else."""
        with_carrier = epoch.carrier_valid[rows]
        counted, number = rows[with_carrier], channel[with_carrier]
        slips = self.channels.look(epoch, counted, number)
        self.scale.take(epoch, counted, number)
        self._seen_ns[channel] = epoch.stamp_ns
        found = []
        for i, row in enumerate(counted.tolist()):
            kind = slips.kinds.get(row)
            if kind is not None:
                self._lost[number[i]] = True
                found.append((str(epoch.ident[row]), kind, float(slips.size[i])))
                if kind != NEW:
                    self.status.rejected[kind] += 1
        if slips.step_m and self._clock_known and self.scale.trusted:
            self.status.rejected["clock step followed"] += 1
            self._move_clock(slips.step_m, STEP_SIGMA_M, host)
        return found

    def _move_clock(self, step_m: float, sigma_m: float, host: Host) -> None:
        k = self._clock
        host.core.estimate[k] += step_m
        kalman.add_variance(host.P, slice(k, k + 1), sigma_m**2, host.core.history)

    def _drop_absent(self, now_ns: int, host: Host) -> None:
        if now_ns - self._looked_ns < LOOK_NS:
            return
        self._looked_ns = now_ns
        for ident in self.ambiguities:
            if now_ns - self._seen_ns[self._number.get(ident, 0)] > 1e9 * self.settings.drop_s or ident not in self._number:
                self.ambiguities.drop(ident, host.P, host.core.estimate, host.core.history)
                if ident in self._number:
                    self._lost[self._number[ident]] = True

    def _predicted(self, epoch: CarrierEpoch, rows: np.ndarray, pos_e: np.ndarray, host: Host) -> Seen:
        """Ranges with troposphere and clock, and what the states do to them."""
        core, x = host.core, host.core.estimate
        lever_b = self.lever_b if self._lever is None else self.lever_b + x[self._lever]
        arm = lever_b.any() or self._lever is not None
        lever_n = core.lever_n(lever_b) if arm else np.zeros(3)
        ranges, H = transmitter_model(core.nav[0], core.nav[1], core.nav[2], lever_n, pos_e, len(x), self._attitude if arm else -1)
        delays = self.delays(epoch, rows, core.nav[2] - lever_n[2], ranges)
        H[:, self._clock] = 1.0
        factor = 1.0
        if self._scale is not None:
            H[:, self._scale] = delays
            factor += x[self._scale]
        if self._lever is not None:
            H[:, self._lever] = H[:, 0:3] @ core.C_nb()
        return Seen(ranges, ranges + factor * delays + x[self._clock], H, delays)

    def _states_of(self, idents: np.ndarray) -> np.ndarray:
        return np.array([self.ambiguities.index(ident) for ident in idents.tolist()], dtype=np.int64)

    def _fuse_epoch(self, epoch: CarrierEpoch, rows: np.ndarray, channel: np.ndarray, pos_e: np.ndarray, slips: list, host: Host) -> bool:
        own, status = self.settings, self.status
        seen = self._predicted(epoch, rows, pos_e, host)
        near = seen.ranges < NEAREST_M
        if near.any():
            status.rejected["transmitter at the aircraft"] += int(np.count_nonzero(near))
            if near.all():
                return self.refuse("transmitter at the aircraft")
            return self._fuse_epoch(epoch, rows[~near], channel[~near], pos_e[~near], slips, host)
        self._seed_clock(epoch, rows, seen, host)
        y_code = epoch.code_m[rows] - seen.predicted
        state, wave = self._states_of(epoch.ident[rows]), epoch.wavelength_m[rows]
        y_carrier = wave * (epoch.carrier_cycles[rows] - host.core.estimate[state]) - seen.predicted
        H_carrier = seen.H.copy()
        each = np.arange(len(rows))
        H_carrier[each, state] = wave
        slow = state - self._rows.start + (self._slow.start if self._slow is not None else 0)
        if self._slow is not None:
            H_carrier[each, slow] = 1.0
            y_carrier = y_carrier - host.core.estimate[slow]
        in_step = ~self.watch.excluded[channel]
        counting = epoch.carrier_valid[rows] & ~self._lost[channel] & (state >= 0) & in_step & self.scale.trusted
        with_code = epoch.code_valid[rows] & in_step & ((self._budget[channel] != 0) | ~epoch.carrier_valid[rows] | ~self._begun[channel])
        with_code &= (own.reset.code_updates != 0) | ~epoch.carrier_valid[rows]
        code_rows, carrier_rows = np.flatnonzero(with_code), np.flatnonzero(counting)
        self._watch_codes(epoch, rows, channel, y_code, seen, host)
        record = EpochRecord(
            epoch.stamp_ns, epoch.ident[rows], y_code, np.where(counting, y_carrier, np.nan), with_code, counting, seen.delays
        )
        self.record, record.slips = record, slips
        y = np.concatenate([y_code[code_rows], y_carrier[carrier_rows]])
        H = np.vstack([seen.H[code_rows], H_carrier[carrier_rows]])
        r = np.concatenate([np.full(len(code_rows), own.code_sigma_m**2), np.full(len(carrier_rows), own.carrier_sigma_m**2)])
        if not np.isfinite(y).all():
            return self.refuse(aiding.NOT_FINITE)
        used = self._update(epoch, y, H, r, len(code_rows), host) if len(y) else np.zeros(0, dtype=bool)
        if used is None:
            return False
        self._settle(record, channel, code_rows, carrier_rows, used)
        self._renew(epoch, rows, channel, pos_e, in_step, host)
        self.used = int(np.count_nonzero(record.code_used | record.carrier_used))
        status.accepted, status.reason = self.used > 0, "" if self.used else "nothing to use yet"
        if self.used:
            status.accepted_ns = epoch.stamp_ns
            status.fused += 1
        return self.used > 0

    def _seed_clock(self, epoch: CarrierEpoch, rows: np.ndarray, seen: Seen, host: Host) -> None:
        """Move a clock that is not known to where most codes put it."""
        valid = epoch.code_valid[rows]
        if self._clock_known or not valid.any():
            return
        common = float(np.median(epoch.code_m[rows][valid] - seen.predicted[valid]))
        host.core.estimate[self._clock] += common
        seen.predicted += common
        kalman.reset_block(host.P, slice(self._clock, self._clock + 1), np.array([[CLOCK_SIGMA_M**2]]), host.core.history)
        self._clock_known = True

    def _watch_codes(self, epoch: CarrierEpoch, rows: np.ndarray, channel: np.ndarray, y: np.ndarray, seen: Seen, host: Host) -> None:
        valid = epoch.code_valid[rows]
        if valid.any():
            S = row_variances(host.P, seen.H[valid], np.full(int(np.count_nonzero(valid)), self.settings.code_sigma_m**2))
            fell = self.watch.take(epoch.stamp_ns, channel[valid], y[valid], S, self.settings.code_sigma_m)
            self._lost[fell] = True

    def _update(self, epoch: CarrierEpoch, y: np.ndarray, H: np.ndarray, r: np.ndarray, codes: int, host: Host) -> np.ndarray | None:
        """Fuse the rows that pass; None where the epoch as a whole is not believed."""
        S = row_variances(host.P, H, r)
        ratios = y * y / (S * self.threshold)
        order = np.argsort(ratios, kind="stable")
        middle = float(ratios[order[(len(order) - 1) // 2]])
        status = self.status
        status.observation, status.innovation = np.array([float(len(y))]), np.array([float(y.mean())])
        status.innovation_variance, status.nis, status.test_ratio = np.array([float(S.mean())]), middle * self.threshold, middle
        decision, reason = self.control(epoch.stamp_ns, middle, host)
        self.decision = decision
        threshold = self.threshold
        if decision is Decision.REJECT:
            self.refuse(reason)
            return None
        if decision is Decision.RECOVER:  # the codes lead back; every carrier begins anew
            status.rejected[reason] += 1
            r, threshold = r + y * y, math.inf
            r[codes:] = 1e12
        P = host.P.copy()
        update = screened_update_ud if self.settings.update == "ud" else screened_update
        dx, used = update(P, y, H, r, order, threshold)
        if not (np.isfinite(dx).all() and np.isfinite(P).all()):
            self.refuse(aiding.NO_CORRECTION)
            return None
        host.P[:] = P
        host.correct(dx)
        if decision is Decision.RECOVER:
            used[codes:] = False
        return used

    def _settle(self, record: EpochRecord, channel: np.ndarray, code_rows: np.ndarray, carrier_rows: np.ndarray, used: np.ndarray) -> None:
        """Note what was used; a carrier that was refused is lost."""
        codes = len(code_rows)
        bad_code, bad_carrier = code_rows[~used[:codes]], carrier_rows[~used[codes:]]
        record.code_used[bad_code], record.carrier_used[bad_carrier] = False, False
        good = channel[code_rows[used[:codes]]]
        self._budget[good] = np.where(self._budget[good] > 0, self._budget[good] - 1, self._budget[good])
        if len(bad_code):
            self.status.rejected[aiding.BEYOND_GATE] += len(bad_code)
        if len(bad_carrier):
            self.status.rejected[REFUSED] += len(bad_carrier)
            self._lost[channel[bad_carrier]] = True

    def _renew(
        self, epoch: CarrierEpoch, rows: np.ndarray, channel: np.ndarray, pos_e: np.ndarray, in_step: np.ndarray, host: Host
    ) -> None:
        """Begin ambiguities of carriers that are lost anew, from the state after the update."""
        due = np.flatnonzero(epoch.carrier_valid[rows] & self._lost[channel] & in_step & self.scale.trusted)
        if not due.size:
            return
        reset, core = self.settings.reset, host.core
        seen = self._predicted(epoch, rows[due], pos_e[due], host)
        for i, at in enumerate(due.tolist()):
            row, number = int(rows[at]), int(channel[at])
            ident, wave = str(epoch.ident[row]), float(epoch.wavelength_m[row])
            h, cycles = seen.H[i] / wave, epoch.carrier_cycles[row] - seen.predicted[i] / wave
            variance = (self.settings.carrier_sigma_m / wave) ** 2
            if reset.source == "code" and epoch.code_valid[row]:
                cycles, h = epoch.carrier_cycles[row] - epoch.code_m[row] / wave, np.zeros(len(h))
                variance += (self.settings.code_sigma_m / wave) ** 2
            elif reset.covariance == "zeroed":
                stated = reset.again_sigma_cycles if self._begun[number] else reset.first_sigma_cycles
                variance = stated**2 if stated else float(row_variances(host.P, h[None, :], np.array([variance]))[0])
                h = np.zeros(len(h))
            if not self.ambiguities.renew(ident, float(cycles), -h, variance, host.P, core.estimate, core.history):
                self.status.rejected["no ambiguity state free"] += 1
                continue
            self._lost[number], self._begun[number], self._budget[number] = False, True, reset.code_updates
            if self.record is not None:
                self.record.renewed.append(ident)

    def words(self, now_ns: int) -> str:
        """How many transmitters are used."""
        return f"{self.used} transmitters" if self.used and self.is_fresh(now_ns) else ""
