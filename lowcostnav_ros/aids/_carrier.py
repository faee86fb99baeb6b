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
from lowcostnav_ros.base.kernels import plain
from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.base.settings import SettingsError, group, setting
from lowcostnav_ros.cores.views import Attitude, Place
from lowcostnav_ros.estimation import aiding, kalman
from lowcostnav_ros.estimation.aiding import SLACK_NS, Aid, Decision, GateSettings, Host, Innovation, Reason, SensorSettings
from lowcostnav_ros.estimation.carrier_model import fused, predicted_codes, ranked, row_variances, rows_of
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
NO_LEVER, NO_CHANNEL = np.zeros(3), np.zeros(0, dtype=np.int64)


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
class Heard:
    """Transmitters that can be used: an epoch of them alone (m), their channels (m,), places (m, 3) ECEF, and air (m, 6)."""

    epoch: CarrierEpoch
    channel: np.ndarray
    pos_e: np.ndarray
    air: np.ndarray

    def part(self, rows: np.ndarray) -> "Heard":
        """Some of them."""
        return Heard(self.epoch.rows(rows), self.channel[rows], self.pos_e[rows], self.air[rows])


@dataclass(slots=True, eq=False)
class Seen:
    """Those at a state: straight ranges (m,) m, predicted codes (m,) m, their Jacobian (m, n), modelled delays (m,) m."""

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
        self._scale: int = getattr(layout.get(f"{prefix}_troposphere"), "start", -1)
        self._to_slow = 0 if self._slow is None else self._slow.start - self._rows.start
        self._attitude = host.core.attitude_rows.start if isinstance(host.core, Attitude) else -1
        self.lever_b = np.array(self.settings.lever_arm_b_m, dtype=float)
        self._has_arm = bool(self.lever_b.any()) or self._lever is not None
        self._noise = self.settings.code_sigma_m**2, self.settings.carrier_sigma_m**2
        super().attach(host)

    def restart(self) -> None:
        """Forget what was received; the counters stay."""
        super().restart()
        self.ambiguities = Ambiguities(self._rows, AMBIGUITY_SIGMA)
        self.channels = Channels(self.settings.slip_cycles, self.settings.gap_s)
        self.watch.clear()
        self.scale.clear()
        self._number: dict[str, int] = {}
        self._heard, self._channel = (0, b""), NO_CHANNEL
        self._state = np.full(MOST, -1)
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
        heard = Heard(measurement.rows(rows), NO_CHANNEL, pos_e, self.air_of(measurement, rows))
        seen = self._predicted(heard, host)
        y = heard.epoch.code_m - seen.predicted
        return Innovation(y, seen.H, np.eye(len(y)) * self.settings.code_sigma_m**2, heard.epoch.code_m)

    def process(self, measurement: CarrierEpoch, host: Host) -> bool:
        """Look for slips, use what there is, begin ambiguities anew; return whether anything was used."""
        status, self.applied, self.decision, self.used = self.status, None, None, 0
        status.stamp_ns = measurement.stamp_ns
        rows, pos_e, others = self.located(measurement)
        for _, reason in others:
            status.rejected[Reason.phrase_of(reason)] += 1
        if not rows.size:
            return self.refuse(others[-1][1] if others else "no usable transmitter")
        air = self.air_of(measurement, rows)
        epoch = measurement if len(rows) == len(measurement) else measurement.rows(rows)
        heard = Heard(epoch, self._channels_of(epoch.ident), pos_e, air)
        slips = self._look(heard, host)
        self._drop_absent(measurement.stamp_ns, host)
        if measurement.stamp_ns - self._used_ns < 1e9 * self.settings.period_s - SLACK_NS:
            status.accepted = False
            return False
        self._used_ns = measurement.stamp_ns
        return self._fuse_epoch(heard, slips, host)

    def located(self, epoch: CarrierEpoch) -> tuple[np.ndarray, np.ndarray, list[tuple[int, str]]]:
        """Rows of an epoch that can be used (m,), where their transmitters are (m, 3) ECEF, and the other rows with the reason."""
        rows, pos_e, others = self.place_of(epoch)
        good = epoch.code_valid[rows] | epoch.carrier_valid[rows]
        if np.count_nonzero(good) == len(good):
            return rows, pos_e, others
        return rows[good], pos_e[good], others + [(int(row), "not valid") for row in rows[~good]]

    def _channels_of(self, idents: np.ndarray) -> np.ndarray:
        """Numbers of transmitters; when there are too many, the one unheard for longest gives up its number."""
        heard = len(idents), idents.tobytes()
        if heard == self._heard:  # they hardly ever change
            return self._channel
        out = np.empty(len(idents), dtype=np.int64)
        for i, ident in enumerate(idents.tolist()):
            number = self._number.get(ident)
            if number is None:
                number = len(self._number)
                if number == MOST:
                    number = int(np.argmin(self._seen_ns))
                    self._number = {name: k for name, k in self._number.items() if k != number}
                self._number[ident] = number
                self._lost[number], self._begun[number], self._state[number] = True, False, self.ambiguities.index(ident)
            out[i] = number
        self._heard, self._channel = heard, out
        return out

    def _look(self, heard: Heard, host: Host) -> list[tuple[str, str, float]]:
        """Find slips; the carriers that have slipped are lost.  A clock step moves the clock and nothing else."""
        epoch, counted = heard.epoch, np.flatnonzero(heard.epoch.carrier_valid)
        number, found = heard.channel[counted], []
        slips = self.channels.look(epoch, counted, number)
        self.scale.take(epoch, counted, number)
        self._seen_ns[heard.channel] = epoch.stamp_ns
        for row, kind in sorted(slips.kinds.items()):
            self._lost[heard.channel[row]] = True
            found.append((str(epoch.ident[row]), kind, float(slips.size[np.searchsorted(counted, row)])))
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
                    self._lost[self._number[ident]], self._state[self._number[ident]] = True, -1

    def _predicted(self, heard: Heard, host: Host) -> Seen:
        """Ranges with troposphere and clock, and what the states do to them."""
        core, x = host.core, host.core.estimate
        lever_n, attitude = NO_LEVER, -1
        if self._has_arm:
            lever_n, attitude = core.lever_n(self.lever_b if self._lever is None else self.lever_b + x[self._lever]), self._attitude
        states = self._clock, self._scale, attitude
        seen = Seen(*predicted_codes(core.nav, lever_n, heard.pos_e, x, self.model, heard.air, *states))
        if self._lever is not None:
            seen.H[:, self._lever] = seen.H[:, 0:3] @ core.C_nb()
        return seen

    def _fuse_epoch(self, heard: Heard, slips: list, host: Host) -> bool:
        own, status, epoch = self.settings, self.status, heard.epoch
        seen = self._predicted(heard, host)
        if seen.ranges.min() < NEAREST_M:
            near = seen.ranges < NEAREST_M
            status.rejected["transmitter at the aircraft"] += int(np.count_nonzero(near))
            if near.all():
                return self.refuse("transmitter at the aircraft")
            return self._fuse_epoch(heard.part(~near), slips, host)
        self._seed_clock(epoch, seen, host)
        signals = tuple(map(plain, (epoch.code_m, epoch.carrier_cycles, epoch.wavelength_m, epoch.code_valid, epoch.carrier_valid)))
        known = self.watch.excluded, self._lost, self._begun, self._budget
        y_code, y_carrier, with_code, counting, y, H, r, codes, is_finite = rows_of(
            *(seen.predicted, seen.H, host.core.estimate, signals, heard.channel, self._state[heard.channel], self._to_slow),
            *(known, self.scale.trusted, own.reset.code_updates != 0, self._noise),
        )
        in_step = ~self.watch.excluded[heard.channel]
        self._watch_codes(heard, y_code, seen, host)
        record = EpochRecord(epoch.stamp_ns, epoch.ident, y_code, y_carrier, with_code, counting, seen.delays)
        self.record, record.slips = record, slips
        if not is_finite:
            return self.refuse(aiding.NOT_FINITE)
        used = self._update(epoch, y, H, r, codes, host) if len(y) else np.zeros(0, dtype=bool)
        if used is None:
            return False
        self._settle(record, heard.channel, used)
        self._renew(heard, in_step, host)
        self.used = int(np.count_nonzero(record.code_used | record.carrier_used))
        status.accepted, status.reason = self.used > 0, "" if self.used else "nothing to use yet"
        if self.used:
            status.accepted_ns = epoch.stamp_ns
            status.fused += 1
        return self.used > 0

    def _seed_clock(self, epoch: CarrierEpoch, seen: Seen, host: Host) -> None:
        """Move a clock that is not known to where most codes put it."""
        valid = epoch.code_valid
        if self._clock_known or not valid.any():
            return
        common = float(np.median(epoch.code_m[valid] - seen.predicted[valid]))
        host.core.estimate[self._clock] += common
        seen.predicted += common
        kalman.reset_block(host.P, slice(self._clock, self._clock + 1), np.array([[CLOCK_SIGMA_M**2]]), host.core.history)
        self._clock_known = True

    def _watch_codes(self, heard: Heard, y: np.ndarray, seen: Seen, host: Host) -> None:
        epoch = heard.epoch
        fell = self.watch.take(epoch.stamp_ns, host.P, seen.H, y, plain(epoch.code_valid), heard.channel, self.settings.code_sigma_m)
        self._lost[fell] = True

    def _update(self, epoch: CarrierEpoch, y: np.ndarray, H: np.ndarray, r: np.ndarray, codes: int, host: Host) -> np.ndarray | None:
        """Fuse the rows that pass; None where the epoch as a whole is not believed."""
        order, shown = ranked(host.P, y, H, r, self.threshold)
        status, middle = self.status, float(shown[3])
        status.observation, status.innovation, status.innovation_variance = shown[0:1], shown[1:2], shown[2:3]
        status.nis, status.test_ratio = middle * self.threshold, middle
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
        dx, used, is_finite = fused(host.P, y, H, r, order, threshold, self.settings.update == "ud")
        if not is_finite:
            self.refuse(aiding.NO_CORRECTION)
            return None
        host.correct(dx)
        if decision is Decision.RECOVER:
            used[codes:] = False
        return used

    def _settle(self, record: EpochRecord, channel: np.ndarray, used: np.ndarray) -> None:
        """Note what was used of the codes, which come first, and of the carriers; a carrier that was refused is lost."""
        if np.count_nonzero(used) < len(used):
            codes = np.count_nonzero(record.code_used)
            bad_code, bad_carrier = np.flatnonzero(record.code_used)[~used[:codes]], np.flatnonzero(record.carrier_used)[~used[codes:]]
            record.code_used[bad_code], record.carrier_used[bad_carrier] = False, False
            self._lost[channel[bad_carrier]] = True
            for reason, bad in ((aiding.BEYOND_GATE, bad_code), (REFUSED, bad_carrier)):
                if len(bad):
                    self.status.rejected[reason] += len(bad)
        spent = channel[record.code_used]
        self._budget[spent] -= self._budget[spent] > 0

    def _renew(self, heard: Heard, in_step: np.ndarray, host: Host) -> None:
        """Begin ambiguities of carriers that are lost anew, from the state after the update."""
        lost = self._lost[heard.channel]
        if not (self.scale.trusted and np.count_nonzero(lost)):
            return
        due = np.flatnonzero(heard.epoch.carrier_valid & lost & in_step)
        if not due.size:
            return
        reset, core, these = self.settings.reset, host.core, heard.part(due)
        epoch, seen = these.epoch, self._predicted(these, host)
        for i, number in enumerate(these.channel.tolist()):
            ident, wave = str(epoch.ident[i]), float(epoch.wavelength_m[i])
            h, cycles = seen.H[i] / wave, epoch.carrier_cycles[i] - seen.predicted[i] / wave
            variance = (self.settings.carrier_sigma_m / wave) ** 2
            if reset.source == "code" and epoch.code_valid[i]:
                cycles, h = epoch.carrier_cycles[i] - epoch.code_m[i] / wave, np.zeros(len(h))
                variance += (self.settings.code_sigma_m / wave) ** 2
            elif reset.covariance == "zeroed":
                stated = reset.again_sigma_cycles if self._begun[number] else reset.first_sigma_cycles
                variance = stated**2 if stated else float(row_variances(host.P, h[None, :], np.array([variance]))[0])
                h = np.zeros(len(h))
            if not self.ambiguities.renew(ident, float(cycles), -h, variance, host.P, core.estimate, core.history):
                self.status.rejected["no ambiguity state free"] += 1
                continue
            self._lost[number], self._begun[number], self._budget[number] = False, True, reset.code_updates
            self._state[number] = self.ambiguities.index(ident)
            if self.record is not None:
                self.record.renewed.append(ident)

    def words(self, now_ns: int) -> str:
        """How many transmitters are used."""
        return f"{self.used} transmitters" if self.used and self.is_fresh(now_ns) else ""
