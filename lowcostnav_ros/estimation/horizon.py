"""The fusion horizon: hands measurements over in stamp order, a fixed lag behind the newest, whatever order they came in.

The fused solution thereby depends on the set of measurements alone.  Inertial samples may arrive one by one or in blocks of any
cut; an aid that falls inside a sample's interval gets that sample split at its stamp, so it is fused at its own time.  An aid in a
hole of the inertial data gets nothing: the navigator sees that its state has not reached the aid's stamp.

No run of inertial samples is cut where nothing comes of it: a measurement that moves nothing (thinned out) is handed over before the
samples up to its stamp, and samples are held until one falls due for an output.
"""

import heapq
from collections.abc import Callable, Iterator
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
    output_ns : int
        Inertial samples that no measurement asks for are handed over once one of them passes a multiple of this.

    Attributes
    ----------
    clocks : Clocks
        The time base and the clocks of all inputs.
    passed_ns : int or None
        Up to where measurements are handed over, or will be when :meth:`take` is called next: what is not later than this is late.
    is_idle : bool
        Whether the measurement handed over last moves nothing, so that the state need not have come to its stamp.
    """

    def __init__(
        self, lag_ns: int, inertial: str | None = None, jump_ns: int = TIME_JUMP_NS, anchor: str | None = None, output_ns: int = 1
    ) -> None:
        self.lag_ns, self.jump_ns, self.output_ns = int(lag_ns), int(jump_ns), int(output_ns)
        self.inertial = inertial
        self.clocks = Clocks(self.lag_ns, self.jump_ns, inertial or anchor)
        self.clear()

    def clear(self) -> None:
        """Forget everything held and every stamp seen."""
        self.clocks.clear()
        self.passed_ns: int | None = None
        self._waiting: list = []
        self._keys: set = set()
        self._sequence = 0
        self._parts: list[ImuBlock] = []  # inertial samples, in order; :meth:`_held` joins them
        self._count = 0  # of them
        self._imu_newest_ns: int | None = None
        self._carried_ns: int | None = None  # up to where inertial samples were handed over
        self.is_idle = False

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
        stamp = measurement.stamp_ns
        if self.passed_ns is not None and stamp <= self.passed_ns:
            return LATE
        key = (stamp, measurement.source, measurement.part)
        if key in self._keys:
            return "duplicate stamp"
        self._keys.add(key)
        self._sequence += 1
        heapq.heappush(self._waiting, (stamp, measurement.source, key[2], self._sequence, measurement))
        if len(self._waiting) > MAX_WAITING:
            self._pop()
            return "no inertial data"
        return ""

    def take(self, moves: Callable[[Measurement], bool] | None = None) -> Iterator[Measurement]:
        """Yield what the horizon has passed since the last call, in order.

        ``moves`` tells of a measurement whether anything may come of it.  So that the answer does not depend on how much has arrived, no
        run of inertial samples that has no hole may change it from no to yes, or back.
        """
        self.move_on()
        limit = self.passed_ns
        if limit is None:
            return
        while self._waiting and self._waiting[0][0] <= limit:
            if self.inertial is not None:
                yield from self._inertial_before(self._waiting[0][0], self._waiting[0][-1], moves)
            yield self._pop()
        if self.inertial is not None and self._is_due(limit):
            yield from self._inertial_until(limit, split=False)

    def move_on(self) -> None:
        """Pass what is old enough, once a measurement has been taken in: from then on it is too late for others, handed over or not."""
        newest, imu = self.clocks.time_ns, self._imu_newest_ns
        if newest is None or (self.inertial is not None and imu is None):
            return
        limit = newest - self.lag_ns
        if imu is not None and self.inertial is not None and imu < limit:
            limit = max(imu, limit - WAIT_NS)
        if self.passed_ns is None or limit > self.passed_ns:
            self.passed_ns = limit

    def _inertial_before(self, stamp: int, item: Measurement, moves: Callable[[Measurement], bool] | None) -> Iterator[ImuBlock]:
        """Inertial samples to be run before a measurement: none where it moves nothing, and no hole lies before it."""
        self.is_idle = moves is not None and not moves(item)
        if moves is not None and self.is_idle and self._has_hole(stamp):
            yield from self._inertial_until(stamp, split=False)  # all up to the hole, or beyond it
            self.is_idle = not self._has_hole(stamp) and not moves(item)
        if not self.is_idle:
            yield from self._inertial_until(stamp, split=True)

    def _has_hole(self, stamp: int) -> bool:
        """Whether the samples held may leave a hole between the last one handed over and the first at ``stamp`` or later."""
        held, carried = self._held(), self._carried_ns
        if carried == stamp:
            return False
        if held is None or carried is None or held.stamp_ns < stamp:
            return True
        return int(held.stamps_ns[held.stamps_ns.searchsorted(stamp)]) - carried > HOLE_NS

    def _is_due(self, limit: int) -> bool:
        """Whether a sample held, up to ``limit``, is beyond a multiple of the output period that the ones before it were not."""
        held, carried = self._held(), self._carried_ns
        if held is None or carried is None or limit - carried > HOLE_NS:
            return True
        n = int(held.stamps_ns.searchsorted(limit, side="right"))
        return n > 0 and int(held.stamps_ns[n - 1]) // self.output_ns != carried // self.output_ns

    def ahead(self) -> tuple[ImuBlock | None, list[Measurement]]:
        """What is held beyond the horizon: inertial samples and the other measurements in order, for the output predictor."""
        return self._held(), [entry[-1] for entry in sorted(self._waiting, key=lambda e: e[:4])]

    def _pop(self) -> Measurement:
        stamp, source, part, _, measurement = heapq.heappop(self._waiting)
        self._keys.discard((stamp, source, part))
        return measurement

    def _push_imu(self, block: ImuBlock) -> str:
        floor, parts = self.passed_ns, self._parts
        if floor is not None and block.stamps_ns[0] <= floor:
            keep = block.stamps_ns > floor
            if not keep.any():
                return LATE
            block = block[keep]
        count = self._count
        if count and count + len(block) > MAX_WAITING:
            return "too many samples at once"
        parts.append(block)
        self._count += len(block)
        if count and block.stamps_ns[0] <= parts[-2].stamp_ns:
            merged = ImuBlock.joined(parts)
            stamps, first = np.unique(merged.stamps_ns, return_index=True)
            self._parts, self._count = [merged[first]], len(stamps)
            if len(stamps) == count:
                return "duplicate stamp"
        self._imu_newest_ns = max(self._parts[-1].stamp_ns, self._imu_newest_ns or 0)
        return ""

    def _held(self) -> ImuBlock | None:
        """The inertial samples held."""
        if len(self._parts) > 1:
            self._parts = [ImuBlock.joined(self._parts)]
        return self._parts[0] if self._parts else None

    def _inertial_until(self, stamp: int, *, split: bool) -> Iterator[ImuBlock]:
        held = self._held()
        if held is None:
            return
        stamps = held.stamps_ns
        n = int(stamps.searchsorted(stamp, side="right"))
        if n:
            self._carried_ns = int(stamps[n - 1])
        carried = self._carried_ns
        if split and n < len(stamps) and (carried is None or (carried < stamp and stamps[n] - carried <= HOLE_NS)):
            self._carried_ns = stamp
            passed = np.append(stamps[:n], stamp)  # the interval of the next sample is cut there, and both parts have its values
            yield from unbroken(ImuBlock.of(held.source, passed, held.specific_force_b[: n + 1], held.angular_rate_b[: n + 1]))
        elif n:
            yield from unbroken(held[:n])
        if n:
            self._parts, self._count = [] if n == len(stamps) else [held[n:]], len(stamps) - n


def unbroken(block: ImuBlock) -> list[ImuBlock]:
    """The block cut before every sample that comes after a hole in the data."""
    if block.stamps_ns[-1] - block.stamps_ns[0] <= HOLE_NS:
        return [block]
    cuts = np.flatnonzero(np.diff(block.stamps_ns) > HOLE_NS) + 1
    return [block[a:b] for a, b in pairwise([0, *cuts.tolist(), len(block)])]
