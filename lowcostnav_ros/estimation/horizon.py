"""The fusion horizon: hands measurements over in stamp order, a fixed lag behind the newest, whatever order they came in.

The fused solution thereby depends on the set of measurements alone.  Inertial samples may arrive one by one or in blocks of any
cut; an aid that falls inside a sample's interval gets that sample split at its stamp, so it is fused at its own time.  An aid in a
hole of the inertial data gets nothing: the navigator sees that its state has not reached the aid's stamp.
"""

import heapq
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.estimation.clocks import LATE, TIME_JUMPED, Clocks

__all__ = ["HOLE_NS", "TIME_JUMPED", "TIME_JUMP_NS", "FusionHorizon"]

TIME_JUMP_NS = 10_000_000_000
"""A stamp this far from the time base is not lateness: it is a bad stamp, or a restarted clock when all inputs agree (default)."""

HOLE_NS = 500_000_000
"""Longest interval one inertial sample may stand for; a longer one is a hole in the data."""

WAIT_NS = 1_000_000_000
"""Inertial samples are waited for this long beyond the lag; then the horizon goes on, and the navigator bridges the hole."""

CORRECTING = "stamps of this source are being corrected"

MAX_WAITING = 20_000
"""Aids, and inertial samples, held at once; beyond it the oldest aid is dropped, a sample refused, and counted."""


class FusionHorizon:
    """Order measurements by stamp, inertial samples first at equal stamps, then by source name.

    Parameters
    ----------
    lag_ns : int
        How far the horizon stays behind the time base; covers transport delays and declared sensor latencies.
    inertial : str or None
        Source of the :class:`ImuBlock` stream that carries the state; it is waited for.
    jump_ns : int
        A stamp this far from the time base is implausible; a base that moves so far is a fresh start.
    anchor : str or None
        Input that is believed about the time when it is one against one: the inertial one, or where there is none this.

    Attributes
    ----------
    clocks : Clocks
        The time base and the clocks of all inputs.
    passed_ns : int or None
        Up to where measurements were handed over.
    late_ns : mapping
        By how much the stamps of a source are late, from which stamp on, oldest first (:meth:`correct_stamps`).
    """

    def __init__(self, lag_ns: int, inertial: str | None = None, jump_ns: int = TIME_JUMP_NS, anchor: str | None = None) -> None:
        self.lag_ns, self.jump_ns = int(lag_ns), int(jump_ns)
        self.inertial = inertial
        self.clocks = Clocks(self.lag_ns, self.jump_ns, inertial or anchor)
        self.late_ns: dict[str, list[tuple[int, int | None]]] = {}
        self.clear()

    def clear(self) -> None:
        """Forget everything held and every stamp seen."""
        self.clocks.clear()
        self.passed_ns: int | None = None
        self._waiting: list = []
        self._keys: set = set()
        self._imu: ImuBlock | None = None
        self._imu_newest_ns: int | None = None
        self._carried_ns: int | None = None  # up to where inertial samples were handed over

    @property
    def newest_ns(self) -> int | None:
        """The time base: newest stamp of the inputs that agree."""
        return self.clocks.time_ns

    def push(self, measurement: Measurement) -> str:
        """Take one measurement in, or a block of samples as :meth:`.Clocks.pieces` cuts them.

        Returns
        -------
        str
            Empty when accepted; :data:`.HELD` when it is not decided yet; else the reason: ``late``, ``stamp ahead of the other inputs``,
            ``stamp implausible``, ``duplicate stamp``, ``no inertial data``, or :data:`.TIME_JUMPED` when the time base moved for good and
            the caller must reset and push again.
        """
        verdict = self.clocks.judge(measurement, self.passed_ns)
        if verdict:
            return verdict
        for earlier in self.clocks.released():
            reason = self._insert(earlier)
            if reason:
                self.clocks.refused.append((earlier.source, reason))
        return self._insert(measurement)

    def _insert(self, measurement: Measurement) -> str:
        if isinstance(measurement, ImuBlock):
            return self._push_imu(measurement)
        stamp = self._valid_ns(measurement)
        if stamp is None:
            return CORRECTING
        if self.passed_ns is not None and stamp <= self.passed_ns:
            return LATE
        key = (measurement.source, measurement.part, measurement.stamp_ns)
        if key in self._keys:
            return "duplicate stamp"
        self._keys.add(key)
        heapq.heappush(self._waiting, (stamp, *key, measurement))
        if len(self._waiting) > MAX_WAITING:
            self._pop()
            return "no inertial data"
        return ""

    def take(self) -> Iterator[Measurement]:
        """Yield what the horizon has passed since the last call, in order."""
        limit = self._limit_ns()
        if limit is None:
            return
        while self._waiting and self._waiting[0][0] <= limit:
            stamp = self._waiting[0][0]
            if self.inertial is not None:
                yield from self._inertial_until(stamp, split=True)
            yield self._pop()
        if self.inertial is not None:
            yield from self._inertial_until(limit, split=False)
        if self.passed_ns is None or limit > self.passed_ns:
            self.passed_ns = limit

    def ahead(self) -> tuple[ImuBlock | None, list[Measurement]]:
        """What is held beyond the horizon: inertial samples and the other measurements in order, for the output predictor."""
        return self._imu, [_at(entry[0], entry[-1]) for entry in sorted(self._waiting)]

    def correct_stamps(self, source: str, from_ns: int, late_ns: int, lag_ns: int) -> None:
        """Hand what ``source`` stamps after ``from_ns`` over ``late_ns`` before its stamp, and stay ``lag_ns`` behind at least.

        A change that is decided at the horizon must begin so far ahead of it that nothing of it has been handed over: then the fused
        solution still depends on the set of measurements alone.  What would come between the first that are corrected is dropped.
        """
        changes = self.late_ns.setdefault(source, [])
        before = changes[-1][1] or 0 if changes else 0
        changes += [(from_ns - max(late_ns - before, 0), None), (from_ns, late_ns)]
        del changes[:-4]
        self.lag_ns = max(self.lag_ns, lag_ns)
        held = ((self._valid_ns(entry[-1]), *entry[1:]) for entry in self._waiting)
        self._waiting = [entry for entry in held if entry[0] is not None]
        heapq.heapify(self._waiting)

    def _valid_ns(self, measurement: Measurement) -> int | None:
        """When a measurement was valid: its stamp, less what the stamps of its source are late; None while that changes."""
        stamp = measurement.stamp_ns
        if not self.late_ns:
            return stamp
        late_ns = next((late for from_ns, late in reversed(self.late_ns.get(measurement.source, ())) if stamp > from_ns), 0)
        return None if late_ns is None else stamp - late_ns

    def _limit_ns(self) -> int | None:
        newest = self.newest_ns
        if newest is None:
            return None
        limit = newest - self.lag_ns
        if self.inertial is None:
            return limit
        return None if self._imu_newest_ns is None else min(limit, max(self._imu_newest_ns, limit - WAIT_NS))

    def _pop(self) -> Measurement:
        stamp, *key, measurement = heapq.heappop(self._waiting)
        self._keys.discard(tuple(key))
        return _at(stamp, measurement)

    def _push_imu(self, block: ImuBlock) -> str:
        held, floor = self._imu, self.passed_ns
        if floor is not None and block.stamps_ns[0] <= floor:
            keep = block.stamps_ns > floor
            if not keep.any():
                return LATE
            block = block[keep]
        if held is None:
            self._imu = block
        elif len(held) + len(block) > MAX_WAITING:
            return "too many samples at once"
        elif block.stamps_ns[0] > held.stamp_ns:
            self._imu = _joined(held, block)
        else:
            merged = _joined(held, block)
            stamps, first = np.unique(merged.stamps_ns, return_index=True)
            self._imu = merged[first]
            if len(stamps) == len(held):
                return "duplicate stamp"
        self._imu_newest_ns = max(self._imu.stamp_ns, self._imu_newest_ns or 0)
        return ""

    def _inertial_until(self, stamp: int, *, split: bool) -> Iterator[ImuBlock]:
        held = self._imu
        if held is None:
            return
        stamps = held.stamps_ns
        n = int(np.searchsorted(stamps, stamp, side="right"))
        if n:
            self._carried_ns = int(stamps[n - 1])
            yield from unbroken(held[:n])
        carried = self._carried_ns
        if split and n < len(stamps) and (carried is None or (carried < stamp and stamps[n] - carried <= HOLE_NS)):
            self._carried_ns = stamp
            yield ImuBlock.of(held.source, np.array([stamp]), held.specific_force_b[n : n + 1], held.angular_rate_b[n : n + 1])
        if n == len(stamps):
            self._imu = None
        elif n:
            self._imu = held[n:]


def _at(stamp_ns: int, measurement: Measurement) -> Measurement:
    return measurement if stamp_ns == measurement.stamp_ns else replace(measurement, stamp_ns=stamp_ns)


def unbroken(block: ImuBlock) -> list[ImuBlock]:
    """The block cut before every sample that comes after a hole in the data."""
    if block.stamps_ns[-1] - block.stamps_ns[0] <= HOLE_NS:
        return [block]
    cuts = np.flatnonzero(np.diff(block.stamps_ns) > HOLE_NS) + 1
    return [block[a:b] for a, b in pairwise([0, *cuts.tolist(), len(block)])]


def _joined(a: ImuBlock, b: ImuBlock) -> ImuBlock:
    return ImuBlock.of(
        b.source,
        np.concatenate((a.stamps_ns, b.stamps_ns)),
        np.concatenate((a.specific_force_b, b.specific_force_b)),
        np.concatenate((a.angular_rate_b, b.angular_rate_b)),
    )
