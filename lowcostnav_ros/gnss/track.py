"""All epochs of a recording, one after the other: position with its integrity verdict, what was excluded, what the clock did."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.gnss import GnssError, raim
from lowcostnav_ros.gnss.clock_watch import ClockWatch
from lowcostnav_ros.gnss.correction import CorrectionSettings, corrected
from lowcostnav_ros.gnss.gps_time import SECOND
from lowcostnav_ros.gnss.locate import locate
from lowcostnav_ros.gnss.positioning import VelocityFix, solve_velocity
from lowcostnav_ros.gnss.raw_epoch import RawEpoch
from lowcostnav_ros.gnss.rinex_nav import Navigation

HOLD_S = 60.0
"""An epoch that gives no position is corrected at the last good one up to this much later: at 250 m/s 15 km away, worth 0.1 m."""
TRUSTED = (raim.HEALTHY, raim.EXCLUDED)
"""Verdicts whose position the next epoch may start from."""


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """One epoch.

    Attributes
    ----------
    gps_ns : int
        Time of reception by the receiver's clock.
    satellites : int
        In the raw epoch.
    epoch : GnssEpoch or None
        Corrected at the position found, or at the last good one; None where there is neither.
    result : RaimResult or None
        None where the epoch gives no position.
    velocity : VelocityFix or None
        None without four Dopplers.
    refusal : str
        Why there is no position, one sentence.
    """

    gps_ns: int
    satellites: int
    epoch: GnssEpoch | None
    result: raim.RaimResult | None
    velocity: VelocityFix | None = None
    refusal: str = ""

    @property
    def verdict(self) -> str:
        """Word of the integrity test, or ``no position``."""
        return self.result.verdict if self.result else "no position"

    @property
    def usable(self) -> bool:
        """Whether there is a position with no fault against it (unchecked with four satellites, which is not healthy)."""
        return self.result is not None and self.result.verdict != raim.FAULTY


@dataclass(slots=True)
class Track:
    """What became of a recording: epochs in order, satellites excluded by reason, and remarks on the clock with their GPS times, ns.

    ``runaway_epochs`` counts the fixes at which the receiver's clock ran away; only the first of a stretch is a remark.
    """

    located: list[Located] = field(default_factory=list)
    rejected: Counter = field(default_factory=Counter)
    remarks: list[tuple[int, str]] = field(default_factory=list)
    resets: int = 0
    runaway_epochs: int = 0

    def verdicts(self) -> Counter:
        """Epochs by verdict."""
        return Counter(one.verdict for one in self.located)


def track(
    epochs: Iterable[RawEpoch],
    navigation: Navigation,
    settings: CorrectionSettings | None = None,
    raim_settings: raim.RaimSettings | None = None,
    advance: Callable[[int], None] | None = None,
) -> Track:
    """Locate every epoch.

    Satellites whose pseudorange jumps alone by whole milliseconds are excluded from their epoch.

    Parameters
    ----------
    epochs : iterable of RawEpoch
        In order of time.
    navigation : Navigation
    settings : CorrectionSettings, optional
    raim_settings : RaimSettings, optional
    advance : callable, optional
        Called with the number of epochs done.
    """
    follower = Follower(navigation, settings or CorrectionSettings(), raim_settings)
    for done, raw in enumerate(epochs, 1):
        follower.out.located.append(follower.take(raw))
        if advance is not None:
            advance(done)
    return follower.out


class Follower:
    """Carries the last good position and the watch over the clock from epoch to epoch, in a recording or as they come."""

    def __init__(self, navigation: Navigation, settings: CorrectionSettings, raim_settings: raim.RaimSettings | None = None) -> None:
        self.out = Track()
        self._navigation, self._settings, self._raim = navigation, settings, raim_settings
        self._watch = ClockWatch()
        self._runs_away = False
        self._good: tuple[int, np.ndarray, float] | None = None

    def take(self, raw: RawEpoch) -> Located:
        """Locate the next epoch; ``out`` gets everything but what is returned."""
        satellites = len(raw)
        raw = self._without_jumps(raw)
        try:
            used, result = self._located(raw, self._good[1] if self._good else None)
        except GnssError as error:
            return Located(raw.gps_ns, satellites, self._held(raw), None, None, str(error))
        clock_m = next(iter(result.fix.clocks_m.values()))
        if result.verdict in TRUSTED:
            self._good = raw.gps_ns, result.fix.position_e, clock_m
        epoch: GnssEpoch | None = used
        if result.verdict == raim.FAULTY:
            epoch = self._held(raw)  # a wrong position takes off the wrong delays and the wrong satellites
        else:
            self._watch_clock(raw.gps_ns, clock_m)
        velocity = _velocity(used, result) if result.verdict != raim.FAULTY else None
        return Located(raw.gps_ns, satellites, epoch, result, velocity)

    def _without_jumps(self, raw: RawEpoch) -> RawEpoch:
        report = self._watch.observe(raw)
        self.out.remarks += [(raw.gps_ns, sentence) for sentence in report.sentences]
        self.out.resets += report.reset_ms != 0
        if not report.jumped:
            return raw
        self.out.rejected["pseudorange jumped alone"] += len(report.jumped)
        return raw.rows(np.flatnonzero([satellite not in report.jumped for satellite in raw.satellites()]))

    def _located(self, raw: RawEpoch, start_e: np.ndarray | None) -> tuple[GnssEpoch, raim.RaimResult]:
        """Start from the last good position; where that gives nothing, which a long gap may be the cause of, from nowhere."""
        rejected: Counter[str] = Counter()
        try:
            return locate(raw, self._navigation, rejected, settings=self._settings, raim_settings=self._raim, position_e=start_e)
        except GnssError:
            if start_e is None:
                raise
            rejected.clear()
            return self._located(raw, None)
        finally:
            self.out.rejected.update(rejected)

    def _watch_clock(self, gps_ns: int, clock_m: float) -> None:
        sentence = self._watch.solved(gps_ns, clock_m)
        self.out.runaway_epochs += bool(sentence)
        if sentence and not self._runs_away:
            self.out.remarks.append((gps_ns, sentence))
        self._runs_away = bool(sentence)

    def _held(self, raw: RawEpoch) -> GnssEpoch | None:
        """The epoch corrected at the last good position, None without one, without a satellite or when it is too old."""
        if self._good is None or raw.gps_ns - self._good[0] > HOLD_S * SECOND:
            return None
        epoch = corrected(raw, self._navigation, self._good[1], self._settings, Counter(), self._good[2])
        return epoch if len(epoch) else None


def _velocity(epoch: GnssEpoch, result: raim.RaimResult) -> VelocityFix | None:
    """Velocity from the Dopplers of the satellites the position was made of."""
    used = np.zeros(len(epoch), dtype=bool)
    used[result.fix.rows] = True
    try:
        return solve_velocity(replace(epoch, doppler_valid=epoch.doppler_valid & used), result.fix.position_e)
    except GnssError:
        return None
