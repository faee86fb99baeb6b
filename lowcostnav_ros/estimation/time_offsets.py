"""Time offsets of the aids' stamps: estimated from the innovations, beside the filter, and corrected once they are sure.

A measurement that is stamped r seconds after it was valid sees the state of before: ``y = H dx - h' r + noise`` with h' the rate at which
the measured quantity changes.  The filter follows it, so its own error depends on r, too: ``dx = dx_0 + V r``.  V is carried through every
transition and every gain beside the covariance (Friedland's separated bias estimation, :func:`.kalman.update_with_parameters`); with it the
offset of every source is the solution of one regression on all innovations, as exact as a state, and the filter keeps its bits.  In
straight flight ``H V - h'`` goes to zero: a fix that lags behind cannot be told from one that is off; turns and accelerations tell.

An offset that is corrected moves no stamp: the prediction is taken back to when the measurement was valid, along the way that the core has
come since (:class:`Way`), so that nothing is waited for and what this navigator feeds is not delayed.

The sigma is the larger of that of white innovations and of their scatter over spans of :data:`SPAN_S` (a sandwich estimate, White,
Econometrica 48, 1980): errors of a receiver that last, jitter of the stamps and what the model lacks widen it.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.base.small_matrices import matvec
from lowcostnav_ros.estimation import kalman

POS = slice(0, 3)
SPAN_S = 5.0
"""Innovations of one span are judged together."""
MEMORY_S = 300.0
"""What was learned fades over this time: an offset may change."""
SETTLING_NS = 20_000_000_000
"""Nothing is learned for so long after a start."""
BEYOND = 1e6
"""What a second of offset cannot do to any state of an aircraft, in its unit: m, m/s, rad."""
UNKNOWN_S = 0.5
"""Sigma of an offset before anything is known."""
LONGEST_S = 1.0
"""Larger offsets are not corrected: those are clocks, not latency."""
SURE, SMALLEST_S, SPANS = 5.0, 0.04, 2.0
"""An offset is corrected when it is so many sigmas and so large, learned in so many spans."""
SURE_AGAIN, SMALLEST_AGAIN_S = 2.0, 0.01
"""The same for what is left of one that was corrected."""
SHARP_S = 0.03
"""An offset with a larger sigma has not been observed."""
COARSE = 0.2
"""Share of a correction that may be wrong: it was learned from measurements taken at the wrong time."""
SLOPE_S = 0.1
"""An acceleration is the change of velocity over this time on either side: the noise of a sample is no motion."""
STEPS = 8
"""Parts of a way back that are summed."""
ROOM = 64
"""Points of a way that are kept at first."""


@dataclass(slots=True)
class TimeOffset:
    """What is known of the stamps of one device, the first word of its topics.

    Attributes
    ----------
    device : str
    sources : list of str
        Its topics that were fused.
    late_s : float
        By how much its stamps are corrected, s; positive where they are late.
    rest_s, sigma_s : float
        Estimate of what is left, and its sigma.
    spans : float
        In how many spans it was observable.
    """

    device: str
    sources: list[str] = field(default_factory=list)
    late_s: float = 0.0
    rest_s: float = 0.0
    sigma_s: float = UNKNOWN_S
    prior_s: float = UNKNOWN_S
    spans: float = 0.0
    squares: float = field(default=0.0, repr=False)

    @property
    def is_observed(self) -> bool:
        """Whether the estimate means anything."""
        return self.spans >= SPANS and self.sigma_s <= SHARP_S

    @property
    def doubt(self) -> float:
        """Variance of what it may still be off by, s^2; of one not corrected, what of its estimate stands out of chance."""
        return self.rest_s**2 + self.sigma_s**2 * (1.0 if self.late_s else -(SURE_AGAIN**2))

    def words(self) -> str:
        """For people: ``0.35 s late, sigma 0.004 s, corrected``."""
        total = self.late_s + self.rest_s
        if not self.is_observed:
            return f"corrected by {self.late_s:.3f} s" if self.late_s else "not observable yet: no turn or acceleration"
        corrected = f", corrected by {self.late_s:.3f} s" if self.late_s else ""
        return f"{abs(total):.3f} s {'late' if total >= 0.0 else 'early'}, sigma {self.sigma_s:.3f} s{corrected}"

    def judge(self) -> float:
        """By how much to correct it further, s; 0 for not at all."""
        if self.spans < SPANS or abs(self.late_s + self.rest_s) > LONGEST_S:
            return 0.0
        sure, smallest_s = (SURE_AGAIN, SMALLEST_AGAIN_S) if self.late_s else (SURE, SMALLEST_S)
        return round(self.rest_s, 3) if abs(self.rest_s) > max(sure * self.sigma_s, smallest_s) else 0.0


@kernel
def passed(times, values, t_s, out):
    """Into ``out`` (3,) the value at a time, of points ``times`` (n,), ``values`` (n, 3); beyond either end with the slope there."""
    k = times.shape[0] - 2
    if k < 0:
        out[:] = values[0]
        return
    while k > 0 and times[k] > t_s:
        k -= 1
    share = (t_s - times[k]) / (times[k + 1] - times[k])
    for a in range(3):
        out[a] = values[k, a] + (values[k + 1, a] - values[k, a]) * share


@kernel
def slope_about(times, values, t_s, newest_s, out):
    """Slope about a time, over :data:`SLOPE_S` on either side, into ``out`` (3,)."""
    t1, t0, before = min(t_s + SLOPE_S, newest_s), t_s - SLOPE_S, np.empty(3)
    passed(times, values, t1, out)
    passed(times, values, t0, before)
    for a in range(3):
        out[a] = (out[a] - before[a]) / (t1 - t0)


@kernel
def direct(times, values, t_s, newest_s, H, motion, velocity, column, k):
    """What the offset of a source does to its measurement, which shows ``H`` (m, n) of the state: D (m, k), zero but for its column.

    ``motion`` (n,) is how fast the state moves; from ``velocity`` on, where that is a state, the slope about a time is written into it.
    Returns that slope (3,), too.
    """
    D, slope = np.zeros((H.shape[0], k)), np.empty(3)
    slope_about(times, values, t_s, newest_s, slope)
    if velocity >= 0:
        motion[velocity : velocity + 3] = slope
    seen = matvec(H, motion)
    for i in range(H.shape[0]):
        D[i, column] = -seen[i]
    return D, slope


@kernel
def slower_before(times, values, t_s, late_s, mean, last):
    """By how much the value at a time is more than those since ``late_s`` before: on average, and then, into ``mean`` and ``last`` (3,)."""
    now = np.empty(3)
    passed(times, values, t_s, now)
    mean[:] = 0.0
    for k in range(STEPS + 1):
        passed(times, values, t_s - late_s * k / STEPS, last)
        for a in range(3):
            last[a] = now[a] - last[a]
            mean[a] += last[a]
    for a in range(3):
        mean[a] = (mean[a] - 0.5 * last[a]) / STEPS


class Way:
    """Velocity of late, free of the corrections of the filter: by it a state is carried back a little."""

    def __init__(self) -> None:
        self._times, self._values = np.empty(ROOM), np.empty((ROOM, 3))
        self.clear()

    def clear(self) -> None:
        """Forget it."""
        self._first = self._end = 0
        self.newest_s = -math.inf

    def note(self, t_s: float, w: np.ndarray) -> None:
        """Take the velocity (3,) at a time in."""
        if self._end == len(self._times):
            self._make_room()
        self._times[self._end], self._values[self._end] = t_s, w
        self._end, self.newest_s = self._end + 1, t_s
        while self._times[self._first] < t_s - LONGEST_S - 3.0 * SLOPE_S:
            self._first += 1

    def _make_room(self) -> None:
        """Move what is kept to the front, of arrays twice as long where it fills most of them."""
        kept, more = self.points(), 2 if self._end - self._first > len(self._times) // 2 else 1
        self._times, self._values = np.empty(more * len(self._times)), np.empty((more * len(self._times), 3))
        self._first, self._end = 0, len(kept[0])
        self._times[: self._end], self._values[: self._end] = kept

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,), s, and velocities (n, 3) that are kept."""
        return self._times[self._first : self._end], self._values[self._first : self._end]

    def back(self, t_s: float, v: np.ndarray, late_s: float) -> tuple[np.ndarray, np.ndarray]:
        """How far it has come since ``late_s`` before ``t_s``, where the velocity is ``v``, m and m/s (3,) each."""
        mean, last = np.empty((2, 3))
        slower_before(*self.points(), t_s, late_s, mean, last)
        return late_s * (v - mean), last



class TimeOffsets:
    """The offsets of all sources of a navigator, and by what they move its error.

    Offers its core what :class:`.History` does, and hands on to one.

    Parameters
    ----------
    size : int
        Number of error states n.
    rows : slice or None
        The velocity among them, if it is.

    Attributes
    ----------
    known : dict of str to TimeOffset
        By device, in the order of the columns.
    V : ndarray (n, k)
        Error of the state by the offset of each, per second.
    errors : ndarray (k,)
        Sigma of each as far as it is not known or not corrected yet, s.
    history : History or None
    way : Way
    """

    def __init__(self, size: int, rows: slice | None) -> None:
        self.size, self.rows, self.known = size, rows, dict[str, TimeOffset]()
        self.history: Any = None
        self._columns: dict[str, int] = {}  # by source
        self._likely: list[int] = []
        self.errors = np.zeros(0)
        self._learned, self._scatter = np.zeros((0, 1)), np.zeros((0, 0))
        self.way = Way()
        self.restart()

    def declare(self, source: str, late_s: float) -> None:
        """Begin with an offset that is known."""
        self._column(source)
        offset = self.known[source.partition("/")[0]]
        if offset.late_s not in (0.0, late_s):
            raise SettingsError(f"'late_s' is one for all topics of a device; {offset.device} has {offset.late_s:g} and {late_s:g}.")
        offset.late_s = late_s
        self._look()

    def restart(self) -> None:
        """Begin with a state that is new; what is known of the stamps stays."""
        self.V = np.zeros((self.size, len(self.known)))
        self._seeded: set[str] = set()
        self._settled_ns: int | None = None
        self._span: int | None = None
        self._begun = self._learned.copy()
        self._corrected = np.zeros(3)
        self.way.clear()

    def rest(self, t_ns: int) -> None:
        """Learn nothing for a while: the state was none that a linear filter has led to."""
        self.V = np.zeros((self.size, len(self.known)))
        self._settled_ns = max(self._settled_ns or 0, t_ns + SETTLING_NS)

    # what a core reports -----------------------------------------------------------------------------------------------------

    def begin(self, P: np.ndarray) -> np.ndarray:
        """Before a change of the error state: return what is to be multiplied by its transition, from the left."""
        self._track: np.ndarray = self.V if self.history is None else self.history.begin(P)
        return self._track

    def end(self, P: np.ndarray) -> None:
        """After the change."""
        if self.history is not None:
            self.V = self._track @ self.V
            self.history.end(P)

    def correct(self, dx: np.ndarray) -> None:
        """Take a correction in."""
        if self.rows is not None:
            self._corrected = self._corrected + dx[self.rows]
        if self.history is not None:
            self.history.correct(dx)

    def note(self, core: Any) -> None:
        """Remember the velocity of now."""
        t_s = 1e-9 * core.t_ns
        if t_s > self.way.newest_s:
            self.way.note(t_s, core.course_n() - self._corrected)

    def note_rows(self, stamps_ns: list[int], velocities: np.ndarray) -> None:
        """Remember the velocities (k, 3) that the core has had at some stamps."""
        for stamp_ns, velocity in zip(stamps_ns, velocities - self._corrected, strict=True):
            t_s = 1e-9 * stamp_ns
            if t_s > self.way.newest_s:
                self.way.note(t_s, velocity)

    # what aids report --------------------------------------------------------------------------------------------------------

    def take_back(self, aid: Any, innovation: Any, host: Any) -> None:
        """Compare a measurement with the state of when it was valid."""
        late_s = self._late_s(aid)
        if late_s:
            self.note(host.core)
            t_s, motion = 1e-9 * host.core.t_ns, host.core.state_rate()
            moved, faster = self.way.back(t_s, motion[POS], late_s)
            motion *= late_s
            motion[POS] = moved
            if self.rows is not None:
                motion[self.rows] = faster
            innovation.y = innovation.y + (innovation.H @ motion if innovation.turns is None else innovation.turns * faster)
            if aid.status.name not in self._seeded:
                self._start_late(aid, innovation, host, motion)

    def _start_late(self, aid: Any, innovation: Any, host: Any, motion: np.ndarray) -> None:
        """A state that began with what an aid had measured lies behind by the way of its offset."""
        dx = np.zeros(self.size)
        for rows in aid.seeds:
            dx[rows] = motion[rows]
        host.correct(dx)
        innovation.y = innovation.y - innovation.H @ dx

    def _late_s(self, aid: Any) -> float:
        offset = self.known.get(aid.source.partition("/")[0])
        return 0.0 if offset is None else offset.late_s

    def update(self, aid: Any, innovation: Any, free: np.ndarray, host: Any, *, learn: bool) -> np.ndarray:
        """Fuse as :func:`.kalman.update` does, carry V along and learn."""
        D = self._direct(aid, innovation, host)
        learn = learn and aid.status.stamp_ns > (self._settled_ns or 0)
        learned = self._learned if learn else np.zeros_like(self._learned)
        P, y, H, R = host.P, innovation.y, innovation.H, innovation.R
        if innovation.late is None:
            return kalman.update_with_parameters(P, y, H, R, free, D, self.V, learned)
        kalman.update_with_parameters(P.copy(), y, H, R, free, D, self.V.copy(), learned)
        return kalman.update_with_parameters(P, y, H, R + innovation.late, free, D, self.V, np.zeros_like(self._learned))

    def uncertainty(self, aid: Any, innovation: Any, host: Any) -> np.ndarray:
        """Covariance (m, m) of an innovation by the offsets as far as they are not known or not corrected yet."""
        D = self._direct(aid, innovation, host)  # first: it may make a column for a device that is new
        U = innovation.H @ self.V + D
        return (U * [offset.sigma_s**2 + offset.rest_s**2 for offset in self.known.values()]) @ U.T

    def is_likely(self, source: str) -> bool:
        """Whether what was learned speaks for an offset, or one was corrected."""
        offset = self.known.get(source.partition("/")[0])
        return offset is not None and (offset.late_s != 0.0 or abs(offset.rest_s) > SURE_AGAIN * offset.sigma_s)

    def explains(self, aid: Any, innovation: Any, host: Any) -> bool:
        """Whether an innovation beyond the gate, which an offset might explain, is to be used for that; else it teaches alone."""
        offset = self.known.get(aid.source.partition("/")[0])
        likely = self.is_likely(aid.source) or (offset is not None and offset.spans < SPANS)  # nothing speaks against it yet
        if not likely and aid.status.stamp_ns > (self._settled_ns or 0):
            y, H, R, D = innovation.y, innovation.H, innovation.R, self._direct(aid, innovation, host)
            kalman.update_with_parameters(host.P.copy(), y, H, R, np.ones(self.size), D, self.V.copy(), self._learned)
        return likely

    def recovered(self, aid: Any, host: Any) -> None:
        """A state was taken from an aid: where it is late, it lies behind by as much."""
        if aid.source:
            self._seed(aid, self._column(aid.source), host.core.state_rate())

    def _direct(self, aid: Any, innovation: Any, host: Any) -> np.ndarray:
        """D (m, k): what the offsets do to a measurement directly."""
        column = self._column(aid.source) if aid.source else None
        if column is None:
            return np.zeros((len(innovation.y), len(self.known)))
        self.note(host.core)
        t_s, motion = 1e-9 * host.core.t_ns, host.core.state_rate()
        if host.core.climbs_by_aids:  # what moves by the aids alone tells nothing of their time
            motion[2] = 0.0
        velocity = -1 if self.rows is None else self.rows.start
        D, slope = direct(*self.way.points(), t_s - self._late_s(aid), t_s, innovation.H, motion, velocity, column, len(self.known))
        if innovation.turns is not None:
            D[:, column] = -innovation.turns * slope
        if aid.status.name not in self._seeded:
            self._seed(aid, column, motion)
            self._settled_ns = max(self._settled_ns or 0, aid.status.stamp_ns + SETTLING_NS)
        return D

    def _seed(self, aid: Any, column: int, motion: np.ndarray) -> None:
        self._seeded.add(aid.status.name)
        for rows in aid.seeds:
            self.V[rows, column] = motion[rows]

    def _column(self, source: str) -> int:
        column = self._columns.get(source)
        if column is not None:
            return column
        device = source.partition("/")[0]
        if device not in self.known:
            k = len(self.known)
            self.known[device] = TimeOffset(device)
            self.V = np.hstack((self.V, np.zeros((self.size, 1))))
            self._learned, self._begun = (_grown(matrix, k) for matrix in (self._learned, self._begun))
            self._scatter = np.pad(self._scatter, (0, 1))
            self._look()
        if source not in self.known[device].sources:
            self.known[device].sources.append(source)
        self._columns[source] = list(self.known).index(device)
        return self._columns[source]

    def _look(self) -> None:
        """Note sigmas, and the columns of the offsets that are likely; looked at when one may have changed, not at every output."""
        self.errors = np.array([math.hypot(offset.sigma_s, offset.rest_s) for offset in self.known.values()])
        self._likely = [k for k, device in enumerate(self.known) if self.is_likely(device)]

    def doubt(self) -> np.ndarray | None:
        """What the offsets that were corrected or are likely may still do to the state: covariance (n, n); None for nothing."""
        if not self._likely:
            return None
        doubts, by = [offset.doubt for offset in self.known.values()], self.V[:, self._likely]
        return (by * [doubts[k] for k in self._likely]) @ by.T

    # what is known -----------------------------------------------------------------------------------------------------------

    def judge(self, stamp_ns: int, host: Any, *, corrects: bool) -> list[TimeOffset]:
        """At the end of a span sum up, and correct what has become sure; return what was."""
        span = stamp_ns // round(1e9 * SPAN_S)
        if span == self._span or not self.known:
            return []
        if not np.abs(self.V).max() < BEYOND:
            self._forget(stamp_ns)
        elif self._span is not None:
            self._sum_up()
        changed = [offset for offset in self.known.values() if corrects and self._changed(offset, host)]
        self._look()
        self._span, self._begun = span, self._learned.copy()
        return changed

    def _forget(self, stamp_ns: int) -> None:
        """What an offset does to the state has grown beyond anything that flies: the state was none, and nothing was learned of it."""
        for offset in self.known.values():
            offset.squares = offset.spans = 0.0
        self._learned[:] = self._scatter[:] = 0.0
        self.rest(stamp_ns)

    def _sum_up(self) -> None:
        """Solve the regression, with what this span has added to the scatter."""
        k, offsets = len(self.known), list(self.known.values())
        gained = self._learned - self._begun
        rest = np.array([offset.rest_s for offset in offsets])
        excess = gained[:, k] - gained[:, :k] @ rest
        fade = math.exp(-SPAN_S / MEMORY_S)
        self._scatter = fade * self._scatter + np.outer(excess, excess)
        prior = np.array([offset.prior_s**-2 for offset in offsets])
        inverse = np.linalg.inv(self._learned[:, :k] + np.diag(prior))
        rest, white = inverse @ self._learned[:, k], inverse.diagonal()
        seen = (inverse @ (self._scatter + np.diag(prior)) @ inverse).diagonal()
        for j, offset in enumerate(offsets):
            offset.rest_s, offset.sigma_s = float(rest[j]), math.sqrt(max(white[j], seen[j]))
            offset.squares = fade**2 * offset.squares + gained[j, j] ** 2
            offset.prior_s = min(offset.prior_s / math.sqrt(fade), UNKNOWN_S)
            offset.spans = float(self._learned[j, j] ** 2 / offset.squares) if offset.squares > 0.0 else 0.0
        self._learned *= fade

    def _changed(self, offset: TimeOffset, host: Any) -> bool:
        """Correct an offset if it is sure: take what it has done out of the state, and learn what is left."""
        change_s = offset.judge()
        if not change_s or (host.core.climbs_by_aids and not offset.is_observed):  # its own motion is too loose for a rough correction
            return False
        j, sigma = list(self.known).index(offset.device), max(offset.sigma_s, COARSE * abs(change_s))
        by = self.V[:, j].copy()
        self.begin(host.P)
        host.P[:] += np.outer(by, by) * sigma**2
        self.end(host.P)
        host.correct(by * change_s)
        self._learned[:, -1] -= self._learned[:, j] * offset.rest_s
        for matrix in (self._learned, self._scatter):
            matrix[j] = matrix[:, j] = 0.0
        offset.late_s, offset.rest_s = offset.late_s + change_s, 0.0
        offset.prior_s = offset.sigma_s = sigma
        offset.squares = offset.spans = 0.0
        return True


def _grown(matrix: np.ndarray, k: int) -> np.ndarray:
    """Information and score (k, k + 1) with one source more."""
    return np.insert(np.pad(matrix, ((0, 1), (0, 0))), k, 0.0, axis=1)
