"""Time offsets of the aids' stamps: estimated from the innovations, beside the filter, and corrected once they are sure.

A measurement that is stamped r seconds after it was valid sees the state of before: ``y = H dx - h' r + noise`` with h' the rate at which
the measured quantity changes.  The filter follows it, so its own error depends on r, too: ``dx = dx_0 + V r``.  V is carried through every
transition and every gain beside the covariance (Friedland's separated bias estimation, :func:`.kalman.update_with_parameters`); with it the
offset of every source is the solution of one regression on all innovations, as exact as a state, and the filter keeps its bits.  In
straight flight ``H V - h'`` goes to zero: a fix that lags behind cannot be told from one that is off; turns and accelerations tell.

The sigma is the larger of that of white innovations and of their scatter over spans of :data:`SPAN_S` (a sandwich estimate, White,
Econometrica 48, 1980): errors of a receiver that last, jitter of the stamps and what the model lacks widen it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lowcostnav_ros.estimation import kalman

SPAN_S = 5.0
"""Innovations of one span are judged together."""
MEMORY_S = 300.0
"""What was learned fades over this time: an offset may change."""
SETTLING_NS = 20_000_000_000
"""Nothing is learned for so long after a start."""
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
AHEAD_NS = 3_000_000_000
"""A correction begins with stamps so far ahead of the fusion that none of them has been handed over."""


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
    begins_ns : int or None
        Stamp from which on a correction that is decided holds, while it is still to come; ``change_s`` is its size.
    """

    device: str
    sources: list[str] = field(default_factory=list)
    late_s: float = 0.0
    rest_s: float = 0.0
    sigma_s: float = UNKNOWN_S
    prior_s: float = UNKNOWN_S
    spans: float = 0.0
    begins_ns: int | None = None
    change_s: float = 0.0
    squares: float = field(default=0.0, repr=False)

    @property
    def is_observed(self) -> bool:
        """Whether the estimate means anything."""
        return self.spans >= SPANS and self.sigma_s <= SHARP_S

    def words(self) -> str:
        """For people: ``0.35 s late, sigma 0.004 s, corrected``."""
        total = self.late_s + self.rest_s
        if not self.is_observed:
            return f"corrected by {self.late_s:.3f} s" if self.late_s else "not observable yet: no turn or acceleration"
        corrected = f", corrected by {self.late_s:.3f} s" if self.late_s else ""
        return f"{abs(total):.3f} s {'late' if total >= 0.0 else 'early'}, sigma {self.sigma_s:.3f} s{corrected}"

    def judge(self) -> float:
        """By how much to correct it further, s; 0 for not at all."""
        if self.begins_ns is not None or self.spans < SPANS or abs(self.late_s + self.rest_s) > LONGEST_S:
            return 0.0
        sure, smallest_s = (SURE_AGAIN, SMALLEST_AGAIN_S) if self.late_s else (SURE, SMALLEST_S)
        return round(self.rest_s, 3) if abs(self.rest_s) > max(sure * self.sigma_s, smallest_s) else 0.0


class TimeOffsets:
    """The offsets of all sources of a navigator, and by what they move its error.

    Offers its core what :class:`.History` does, and hands on to one.

    Parameters
    ----------
    size : int
        Number of error states n.

    Attributes
    ----------
    known : dict of str to TimeOffset
        By device, in the order of the columns.
    V : ndarray (n, k)
        Error of the state by the offset of each, per second.
    history : History or None
    is_changing : bool
        Whether a correction is to come.
    """

    def __init__(self, size: int) -> None:
        self.size, self.known = size, dict[str, TimeOffset]()
        self.history: Any = None
        self._learned, self._scatter = np.zeros((0, 1)), np.zeros((0, 0))
        self.is_changing = False
        self.restart()

    def restart(self) -> None:
        """Begin with a state that is new; what is known of the stamps stays."""
        self.V = np.zeros((self.size, len(self.known)))
        self._seeded: set[str] = set()
        self._settled_ns: int | None = None
        self._span: int | None = None
        self._begun = self._learned.copy()

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
        if self.history is not None:
            self.history.correct(dx)

    # what aids report --------------------------------------------------------------------------------------------------------

    def update(self, aid: Any, innovation: Any, free: np.ndarray, host: Any, *, learn: bool) -> np.ndarray:
        """Fuse as :func:`.kalman.update` does, carry V along and learn."""
        D = self._direct(aid, innovation, host)
        learn = learn and aid.status.stamp_ns > (self._settled_ns or 0)
        learned, idle = (self._learned if learn else np.zeros_like(self._learned)), np.zeros_like(self._learned)
        P, y, H, R = host.P, innovation.y, innovation.H, innovation.R
        if innovation.late is None:
            return kalman.update_with_parameters(P, y, H, R, free, D, self.V, learned)
        kalman.update_with_parameters(P.copy(), y, H, R, free, D, self.V.copy(), learned)
        return kalman.update_with_parameters(P, y, H, R + innovation.late, free, D, self.V, idle)

    def uncertainty(self, aid: Any, innovation: Any, host: Any) -> np.ndarray:
        """Covariance (m, m) of an innovation by the offsets as far as they are not known or not corrected yet."""
        U = innovation.H @ self.V + self._direct(aid, innovation, host)
        return (U * [offset.sigma_s**2 + offset.rest_s**2 for offset in self.known.values()]) @ U.T

    def recovered(self, aid: Any, host: Any) -> None:
        """A state was taken from an aid: where it is late, it lies behind by as much."""
        if aid.source:
            self._seed(aid, self._column(aid.source), host.core.motion())

    def _direct(self, aid: Any, innovation: Any, host: Any) -> np.ndarray:
        """D (m, k): what the offsets do to a measurement directly."""
        column = self._column(aid.source) if aid.source else None
        D, motion = np.zeros((len(innovation.y), len(self.known))), host.core.motion()
        if column is None:
            return D
        D[:, column] = -(innovation.H @ motion if innovation.rate is None else innovation.rate)
        if aid.status.name not in self._seeded:
            self._seed(aid, column, motion)
            self._settled_ns = max(self._settled_ns or 0, aid.status.stamp_ns + SETTLING_NS)
        return D

    def _seed(self, aid: Any, column: int, motion: np.ndarray) -> None:
        self._seeded.add(aid.status.name)
        for rows in aid.seeds:
            self.V[rows, column] = motion[rows]

    def _column(self, source: str) -> int:
        device = source.partition("/")[0]
        if device not in self.known:
            k = len(self.known)
            self.known[device] = TimeOffset(device)
            self.V = np.hstack((self.V, np.zeros((self.size, 1))))
            self._learned, self._begun = (_grown(matrix, k) for matrix in (self._learned, self._begun))
            self._scatter = np.pad(self._scatter, (0, 1))
        if source not in self.known[device].sources:
            self.known[device].sources.append(source)
        return list(self.known).index(device)

    def doubt(self, rows: slice | None) -> np.ndarray | float:
        """What the offsets that were corrected or are likely may still do to some states: covariance (m, m)."""
        total: np.ndarray | float = 0.0
        for offset, by in zip(self.known.values(), self.V.T, strict=True):
            if rows is not None and (offset.late_s or abs(offset.rest_s) > SURE_AGAIN * offset.sigma_s):
                total = total + np.outer(by[rows], by[rows]) * (offset.sigma_s**2 + offset.rest_s**2)
        return total

    # what is known -----------------------------------------------------------------------------------------------------------

    def judge(self, stamp_ns: int, *, corrects: bool) -> Iterator[tuple[TimeOffset, int]]:
        """At the end of a span sum up; yield offsets that have become sure, each with the stamp from which on it is to be corrected."""
        span = stamp_ns // round(1e9 * SPAN_S)
        if span == self._span or not self.known:
            return
        if self._span is not None:
            self._sum_up()
        self._span, self._begun = span, self._learned.copy()
        for offset in self.known.values():
            change_s = offset.judge() if corrects else 0.0
            if change_s:
                from_ns = stamp_ns + AHEAD_NS
                offset.change_s, offset.begins_ns = change_s, from_ns - round(1e9 * (offset.late_s + change_s))
                self.is_changing = True
                yield offset, from_ns

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

    def change(self, source: str, stamp_ns: int, host: Any) -> bool:
        """With the first measurement whose stamp is corrected anew: take what the offset has done out of the state, and learn the rest.

        Returns whether it was the first.
        """
        offset = self.known.get(source.partition("/")[0])
        if offset is None or source not in offset.sources or offset.begins_ns is None or stamp_ns <= offset.begins_ns:
            return False
        j = list(self.known).index(offset.device)
        by, sigma = self.V[:, j].copy(), max(offset.sigma_s, COARSE * abs(offset.change_s))
        if by.any():
            self.begin(host.P)
            host.P[:] += np.outer(by, by) * sigma**2
            self.end(host.P)
            host.correct(by * offset.change_s)
        rest_s = offset.rest_s
        offset.late_s, offset.rest_s, offset.begins_ns = offset.late_s + offset.change_s, 0.0, None
        offset.prior_s = offset.sigma_s = sigma
        offset.squares = offset.spans = 0.0
        for matrix in (self._learned, self._begun):
            matrix[:, -1] -= matrix[:, j] * rest_s
        for matrix in (self._learned, self._begun, self._scatter):
            matrix[j] = matrix[:, j] = 0.0
        self.is_changing = any(other.begins_ns is not None for other in self.known.values())
        return True


def _grown(matrix: np.ndarray, k: int) -> np.ndarray:
    """Information and score (k, k + 1) with one source more."""
    return np.insert(np.pad(matrix, ((0, 1), (0, 0))), k, 0.0, axis=1)
