"""Integrity of a navigator that uses satellites one by one: which of them is faulty, how large a position
error can stay undetected, and whether all of them together still agree with the inertial sensors.

Two independent questions, asked before an epoch is fused:

- Do the satellites agree with each other?  Parity of their innovations, of the epoch (snapshot RAIM) and of means over longer times, for
  pseudoranges and Dopplers.  One that does not is excluded until it has agreed again for a while.  The protection level is the error of the
  least-squares position, a bound of the filter's, that one further fault can cause undetected.
- Do they agree with the prediction?  A common ramp (a spoofer, a wrong clock) passes the first question; it shows in the mean innovations.
"""

import math
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.chi_square import exceeded_with, noncentrality
from lowcostnav_ros.base.measurements import GnssEpoch, Integrity
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.estimation.innovation_watch import Disagreement, InnovationWatch
from lowcostnav_ros.estimation.parity_windows import RETURNING_SIGMAS, SLOTS, ParityWindows
from lowcostnav_ros.gnss import parity
from lowcostnav_ros.gnss.raim import EXCLUDED, FAULTY, HEALTHY, NOT_POSSIBLE
from lowcostnav_ros.gnss.signals import GALILEO, SPEED_OF_LIGHT, name

RANGE, RATE = "range", "rate"
EXCLUDED_BY_TEST = "excluded by the integrity test"
MAX_DRIFT_MPS = 3000.0
"""Clock drift beyond which a clock runs away: ten parts in a million, four times a common crystal's limit."""
VALID_NS = 1_500_000_000
"""How long a verdict stands without another epoch."""
NO_FIT = 0, parity.UNTESTED, -1, np.full((1, 3), np.inf), False
"""What is found of satellites without a fit."""
MAX_CLOCK_JUMPS, JUMPS_WITHIN_NS = 5, 10_000_000_000
"""So many clock jumps within such a time are no receiver's habit."""
AXES = ("north", "east", "down", "clock")
UNITS = {RANGE: "m", RATE: "m/s"}


@dataclass(frozen=True)
class IntegritySettings:
    """Integrity tests of the satellites."""

    enabled: bool = setting(True, "Test the satellites against each other and exclude a faulty one.")
    false_alarm_probability: float = setting(1e-8, "Probability that a healthy epoch fails a test.", minimum=1e-12, maximum=0.1)
    missed_detection_probability: float = setting(
        1e-3, "Probability that a fault of the size of the protection level stays undetected.", minimum=1e-9, maximum=0.5
    )
    windows_s: list = setting([10.0, 60.0], "Means over these times are tested, too, for faults that grow slowly.", unit="s", minimum=0.5)
    slow_error_m: float = setting(1.0, "Slow range error of a healthy satellite, 1 sigma.", unit="m", minimum=0.0, maximum=100.0)
    slow_error_mps: float = setting(0.02, "Slow Doppler error of a healthy satellite, 1 sigma.", unit="m/s", minimum=0.0, maximum=10.0)
    readmit_s: float = setting(60.0, "An excluded satellite is used again after agreeing this long.", unit="s", minimum=0.0, maximum=3600.0)
    inertial: bool = setting(True, "Test all satellites together against the inertial sensors (spoofing).")
    inertial_windows_s: list = setting([1.0, 10.0, 60.0], "Windows of that test; 0 is one epoch.", unit="s", minimum=0.0)
    inertial_after_s: float = setting(30.0, "That test begins this long after alignment.", unit="s", minimum=0.0, maximum=3600.0)
    offset_m: float = setting(0.3, "Mean position offset a sound filter may show, 1 sigma.", unit="m", minimum=0.0, maximum=1000.0)
    offset_mps: float = setting(0.02, "Mean velocity offset a sound filter may show, 1 sigma.", unit="m/s", minimum=0.0, maximum=100.0)
    on_alarm: str = setting("warn", "When they disagree: warn and go on, or coast on the inertial sensors.", choices=("warn", "coast"))


@dataclass(frozen=True, slots=True, eq=False)
class Satellites:
    """Some satellites of an epoch: ``rows`` (n,) in it, and their numbers among all, ``slots`` (n,), by :func:`slots_of`.

    ``G`` (n, m) are the columns of what they measure together: three of position or velocity, then clocks; ``R`` (n, n) is the covariance
    of their noise.
    """

    epoch: GnssEpoch
    rows: np.ndarray
    slots: np.ndarray
    G: np.ndarray
    R: np.ndarray

    def name(self, k: int) -> str:
        """Name of one of them."""
        return name_of(self.epoch, self.rows[k])


class GnssIntegrity:
    """The integrity tests of one navigator.

    Parameters
    ----------
    settings : IntegritySettings
    inertial : bool
        Whether the prediction rests on inertial sensors, so that all satellites can be tested against it.

    Attributes
    ----------
    apart : (str, ndarray (3,)) or None
        What the alarm is of, :data:`RANGE` or :data:`RATE`, and by how much satellites and prediction are apart, m or m/s NED.
    """

    def __init__(self, settings: IntegritySettings, *, inertial: bool) -> None:
        self.settings = settings
        limits = np.array([np.inf, *(exceeded_with(settings.false_alarm_probability, dof) for dof in range(1, SLOTS))])
        self.windows = {
            RANGE: ParityWindows(settings.windows_s, settings.slow_error_m, limits),
            RATE: ParityWindows(settings.windows_s, settings.slow_error_mps, limits),
        }
        self.watches: dict[str, InnovationWatch] = {}
        if inertial and settings.inertial:
            for kind, floor in ((RANGE, settings.offset_m), (RATE, settings.offset_mps)):
                self.watches[kind] = InnovationWatch(settings.inertial_windows_s, [floor] * 4, settings.false_alarm_probability)
        self.clear()

    def clear(self) -> None:
        """Forget everything: exclusions, means, the alarm."""
        for windows in self.windows.values():
            windows.clear()
        for watch in self.watches.values():
            watch.clear()
        self.status = Integrity(reason="no epoch yet" if self.settings.enabled else "the tests are switched off")
        self._tested_ns: int | None = None
        self._first_ns: int | None = None
        self._agreeing_since: dict[int, int] = {}
        self._jumps_ns: list[int] = []
        self.apart: tuple[str, np.ndarray] | None = None
        self._excluded = np.zeros(SLOTS, dtype=bool)

    def is_excluded(self, slots: np.ndarray) -> np.ndarray:
        """Which satellites, by :func:`slots_of`, are excluded at present, bool (n,)."""
        return self._excluded[slots]

    @property
    def distrusted(self) -> bool:
        """Whether no satellite is to be fused any more."""
        return bool(self.status.alarm) and self.settings.on_alarm == "coast"

    def report(self, now_ns: int) -> Integrity:
        """Result of the tests at a stamp; a verdict does not outlast the epochs it was made of."""
        out = self.status.snapshot()
        if self._tested_ns is not None and now_ns - self._tested_ns > VALID_NS:
            out.verdict, out.reason = NOT_POSSIBLE, f"no epoch tested for {1e-9 * (now_ns - self._tested_ns):.0f} s"
            out.hpl_m = out.vpl_m = out.lasting_hpl_m = out.lasting_vpl_m = None
        return out

    def compare(self, kind: str, sats: Satellites, y: np.ndarray, passed: np.ndarray) -> np.ndarray:
        """Test the satellites against each other.

        Parameters
        ----------
        kind : str
            :data:`RANGE` or :data:`RATE`.
        sats : Satellites
        y : ndarray, shape (n,)
            Innovations, m or m/s.
        passed : ndarray of bool, shape (n,)
            Those within the gate; the others are judged, too, but not relied on.

        Returns
        -------
        ndarray of bool, shape (n,)
            Those to be fused; none when they contradict each other at once and the faulty one cannot be identified.
        """
        windows, slots, stamp_ns = self.windows[kind], sats.slots, sats.epoch.stamp_ns
        judged = ~self._excluded[slots]
        found = windows.take(stamp_ns, slots, y, sats.G, sats.R, passed, judged)
        good, last = (passed, NO_FIT) if found is None else self._judge(kind, sats, passed, judged, found)
        window, verdict, row, steepness, is_full = last
        self._report(kind, verdict, "" if row < 0 else sats.name(row), good)
        if kind == RANGE:
            self._tested_ns = stamp_ns
            self._protect(verdict, steepness, full=is_full)
        if found is None:
            return passed
        self._readmit(kind, sats, good)
        at_once = window == 0 and verdict in (parity.TOO_FEW, parity.AMBIGUOUS, parity.SEVERAL)
        return np.zeros(len(slots), dtype=bool) if at_once else good

    def _judge(self, kind: str, sats: Satellites, passed: np.ndarray, judged: np.ndarray, found: tuple) -> tuple:
        """Exclude the satellites that the tests identify, one after the other; return those left that passed, and their judgement.

        ``found`` is the judgement of the ``judged`` ones.
        """
        windows, slots = self.windows[kind], sats.slots
        while found[1] == parity.FOUND:
            window, row = found[0], found[2]
            over = f" over {windows.times[window]:.0f} s" if window else ""
            self._exclude(int(slots[row]), sats.name(row), f"its {kind} contradicts the others'{over}")
            judged[row] = False
            found = windows.judge(slots, judged, sats.G, sats.R)
        good = passed & judged
        return good, found if np.count_nonzero(good) == np.count_nonzero(judged) else windows.judge(slots, good, sats.G, sats.R)

    def is_watching(self, kind: str, stamp_ns: int) -> bool:
        """Whether satellites are tested against the prediction now: not right after a start, nor any more once there is an alarm."""
        if self._first_ns is None:
            self._first_ns = stamp_ns
        settled = stamp_ns - self._first_ns >= 1e9 * self.settings.inertial_after_s
        return settled and kind in self.watches and not self.status.alarm

    def check_against_inertial(self, kind: str, stamp_ns: int, y: np.ndarray, G: np.ndarray, S: np.ndarray) -> None:
        """Test all satellites together against the prediction: innovations y (n,), columns G (n, 4), covariance S (n, n)."""
        found = self.watches[kind].observe(stamp_ns, y, G, S)
        if found is not None:
            self.apart = kind, found.offset[:3]
            self._alarm(stamp_ns, sentence(kind, found))

    def contradicted(self, stamp_ns: int, for_s: float) -> None:
        """Note that most satellites were beyond the gate for so long that the filter follows them."""
        if self.watches:
            text = f"Most satellites contradicted the inertial sensors for {for_s:.0f} s: possible spoofing or filter divergence."
            self._alarm(stamp_ns, text)

    def clock_jumped(self, stamp_ns: int) -> None:
        """Note a jump of the clock that the filter follows; a receiver's own resets are minutes apart."""
        self._jumps_ns = [t for t in self._jumps_ns if stamp_ns - t <= JUMPS_WITHIN_NS] + [stamp_ns]
        if len(self._jumps_ns) > MAX_CLOCK_JUMPS:
            within = 1e-9 * (stamp_ns - self._jumps_ns[0])
            self._alarm(stamp_ns, f"The receiver clock jumped {len(self._jumps_ns)} times within {within:.1f} s; check the receiver.")

    def watch_drift(self, stamp_ns: int, drift_mps: float) -> None:
        """Raise the alarm for a receiver clock that runs away, drift in m/s."""
        if abs(drift_mps) > MAX_DRIFT_MPS:
            ppm = drift_mps / SPEED_OF_LIGHT * 1e6
            self._alarm(stamp_ns, f"The receiver clock runs away at {drift_mps:.0f} m/s ({ppm:.1f} ppm); check the receiver.")

    def _alarm(self, stamp_ns: int, text: str) -> None:
        if not self.status.alarm:
            self.status.alarm, self.status.alarm_ns = text, int(stamp_ns)

    def _exclude(self, slot: int, satellite: str, why: str) -> None:
        self._excluded[slot] = True
        self._agreeing_since.pop(slot, None)
        self.status.excluded[satellite] = why

    def _report(self, kind: str, verdict: int, worst: str, good: np.ndarray) -> None:
        """Verdict and reason; Dopplers may only make them worse."""
        status = self.status
        if kind == RATE and (verdict in (parity.HEALTHY, parity.UNTESTED) or status.verdict == FAULTY):
            return
        if verdict == parity.HEALTHY:
            status.verdict, status.reason = HEALTHY, ""
            if status.excluded:
                status.verdict, status.reason = EXCLUDED, "; ".join(f"{s} is excluded: {why}" for s, why in status.excluded.items()) + "."
            return
        what, count = "pseudoranges" if kind == RANGE else "Dopplers", int(np.count_nonzero(good))
        status.verdict = NOT_POSSIBLE if verdict == parity.UNTESTED else FAULTY
        status.reason = {
            parity.UNTESTED: f"{count} satellites are too few for a test; at least 5 are needed.",
            parity.TOO_FEW: f"The {what} contradict each other and {count} satellites do not show which; 6 are needed.",
            parity.AMBIGUOUS: f"A fault of {worst} cannot be distinguished from one of another satellite.",
            parity.SEVERAL: f"More than one of the {what} contradicts the others.",
            parity.FOUND: f"The {what} of {worst} contradict the others'.",
        }[verdict]

    def _protect(self, verdict: int, steepness: np.ndarray, *, full: bool) -> None:
        status, settings = self.status, self.settings
        levels: list[float | None] = [None] * 4
        for k, (horizontal, vertical, redundancy) in ((0, steepness[0].tolist()), (2, steepness[-1].tolist())):
            if math.isfinite(horizontal) and math.isfinite(vertical) and (k == 0 or (full and verdict == parity.HEALTHY)):
                noticed = noncentrality(settings.false_alarm_probability, settings.missed_detection_probability, int(redundancy))
                levels[k : k + 2] = [horizontal * noticed**0.5, vertical * noticed**0.5]
        status.hpl_m, status.vpl_m, status.lasting_hpl_m, status.lasting_vpl_m = levels

    def _readmit(self, kind: str, sats: Satellites, good: np.ndarray) -> None:
        """Use a satellite again that has agreed in both kinds for long enough."""
        slots, stamp_ns = sats.slots, sats.epoch.stamp_ns
        if not self.status.excluded or not self._excluded[slots].any():
            return
        distances = self.windows[kind].strays(slots, good, sats.G, sats.R)
        for k in np.flatnonzero(self._excluded[slots]):
            slot = int(slots[k])
            if distances[k] > RETURNING_SIGMAS:
                self._agreeing_since.pop(slot, None)
            elif stamp_ns - self._agreeing_since.setdefault(slot, stamp_ns) >= 1e9 * self.settings.readmit_s:
                self._excluded[slot] = False
                self.status.excluded.pop(sats.name(int(k)), None)


def sentence(kind: str, found: Disagreement) -> str:
    """By how much satellites and prediction disagree, in words."""
    worst, unit = found.largest(), UNITS[kind]
    over = f" over {found.window_s:.0f} s" if found.window_s >= 1.0 else ""
    return (
        f"The satellites' {kind}s contradict the inertial sensors{over}: {AXES[worst]} {found.offset[worst]:+.2f} {unit} "
        f"({abs(found.offset[worst]) / found.sigma[worst]:.0f} sigma); possible spoofing, clock fault or wrong IMU noise settings."
    )


def slots_of(epoch: GnssEpoch) -> np.ndarray:
    """Number of each satellite of an epoch among all, int (n,)."""
    return epoch.sat_id % (SLOTS // 2) + np.where(epoch.system == GALILEO, SLOTS // 2, 0)


def name_of(epoch: GnssEpoch, row: int) -> str:
    """Name of a satellite, G05."""
    return name(epoch.system[row], epoch.sat_id[row])
