"""Single inertial samples that cannot be: recognised, replaced, counted; sensors at their limit, and axes that say nothing.

A sample that differs from the one before by more than an aircraft can do is held back: the last value stands in for it.  The next sample
decides.  If it is nearer to the value held back, the step was real (a landing shock, an engine that starts), and what was held back, a
velocity and a rotation, is given to the state then, one sample late.  If it is nearer to the value before, the sample was a spike: it is
dropped, and the covariance grows by what may have been lost.

Nothing but the samples before is looked at, so the result does not depend on the order of arrival or the cut of blocks.  A sample may
come in pieces (the horizon splits it at the stamps of aids); pieces have the same bits and are judged as one.  What counts as a step adapts
to the differences that are usual (vibration), and to the interval of the samples.

An axis that repeats its value to the bit for longer than chance lets it, by how often it has repeated values so far, says nothing: it is
stuck, dead, or at its limit.  A unit of coarse steps, or one that is read faster than it measures, repeats values all the time.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.estimation.horizon import HOLE_NS

SPIKE = "single sample unlike those before and after, replaced"
SATURATED = "sensor at its limit"

GAIN = np.array([0.25, 0.25, 0.25, 0.016, 0.016, 0.016])
"""Samples that differ by less than this velocity or angle over their interval, m/s and rad, show vibration: a wheel over a stone."""
STEP = np.array([15.0, 15.0, 15.0, 1.0, 1.0, 1.0])
"""And so do two that differ by less than this, m/s^2 and rad/s, however long the interval."""
JERK = np.array([150.0, 150.0, 150.0, 20.0, 20.0, 20.0])
"""A difference that comes about at this rate is a motion, m/s^3 (15 g a second) and rad/s^2 (a snap roll begins with 10)."""
USUAL, USUAL_S = 6.0, 1.0
"""Differences of so many times their root mean square over so long are usual."""
LOST = 0.25
"""1-sigma of what a dropped sample would have said, as a share of the step it could have been."""
PIECES = 1.5
"""Equal bits last no longer than this many intervals as pieces of one sample."""
RUN, HIGH = 5, np.array([15.0, 15.0, 15.0, 1.0, 1.0, 1.0])
"""So many samples of one value, as large as it ever was and larger than at rest, are a sensor's limit."""

OFTEN, LEARNT, RARE, SILENT_NS = 0.1, 0.005, 1e-9, 100_000_000
"""Share of repeated values that is usual at least; what a sample counts for it; the chance of a run, and its length, that say nothing."""

LAST, GOOD, LEVEL, HELD, SUSPECT, PEAK, REPEATED, SHARE, CHANCE, CHANGED, SILENT = range(11)
NOW, BEGUN, INTERVAL = range(3)


@kernel
def judge(axes, times, stamp, x, out, kick, variance):
    """Judge one sample ``x`` (6,) into ``out`` (6,); return 1 for a spike dropped before it, 2 for a sensor at its limit, 4 for axes that
    fall silent or speak again, their sum, or 0.

    ``kick``, ``variance`` (6,): velocity and rotation in b, m/s and rad, that the state gains before this sample, and variances.
    """
    out[:] = x
    for a in range(6):
        if not np.isfinite(x[a]):
            times[NOW] = stamp
            return 0
    dt_ns = stamp - times[NOW]
    dt = 1e-9 * dt_ns
    if times[NOW] == 0 or dt_ns <= 0 or dt_ns > HOLE_NS:
        times[BEGUN], times[INTERVAL] = stamp, 0
        axes[LAST], axes[GOOD], axes[SUSPECT], axes[REPEATED] = x, x, 0.0, 0.0
        axes[CHANCE], axes[CHANGED] = 1.0, stamp
        times[NOW] = stamp
        return 0
    same = True
    for a in range(6):
        same = same and x[a] == axes[LAST, a]
    if same and stamp - times[BEGUN] <= PIECES * times[INTERVAL]:  # a further piece of the sample before
        for a in range(6):
            if axes[SUSPECT, a] > 0.0:
                out[a] = axes[GOOD, a]
                axes[HELD, a] += (x[a] - axes[GOOD, a]) * dt
        times[NOW] = stamp
        return 0
    times[INTERVAL], times[BEGUN] = times[NOW] - times[BEGUN], times[NOW]
    interval, found = 1e-9 * max(times[INTERVAL], dt_ns), 0
    for a in range(6):
        limit = max(max(STEP[a], GAIN[a] / interval) + JERK[a] * interval, USUAL * np.sqrt(axes[LEVEL, a]))
        if axes[SUSPECT, a] > 0.0:
            axes[SUSPECT, a] = 0.0
            if abs(x[a] - axes[LAST, a]) < abs(x[a] - axes[GOOD, a]):
                kick[a] = axes[HELD, a]
                axes[GOOD, a] = axes[LAST, a]
            else:
                variance[a] = (LOST * limit * 1e-9 * times[INTERVAL]) ** 2
                found |= 1
        step = x[a] - axes[GOOD, a]
        axes[LEVEL, a] += (min(step * step, limit * limit) - axes[LEVEL, a]) * min(interval / USUAL_S, 1.0)
        if abs(step) > limit:
            axes[SUSPECT, a], axes[HELD, a], out[a] = 1.0, step * dt, axes[GOOD, a]
        else:
            axes[GOOD, a] = x[a]
        size = abs(x[a])
        if x[a] == axes[LAST, a]:
            axes[REPEATED, a] += 1.0
            axes[CHANCE, a] *= max(axes[SHARE, a], OFTEN)
        else:
            axes[REPEATED, a], axes[CHANCE, a], axes[CHANGED, a] = 0.0, 1.0, stamp
        if axes[SILENT, a] == 0.0:
            axes[SHARE, a] += LEARNT * (min(axes[REPEATED, a], 1.0) - axes[SHARE, a])
        silent = 1.0 if axes[CHANCE, a] < RARE and stamp - axes[CHANGED, a] >= SILENT_NS else 0.0
        if silent != axes[SILENT, a]:
            axes[SILENT, a] = silent
            found |= 4
        if axes[REPEATED, a] >= RUN and not same and size >= HIGH[a] and size >= axes[PEAK, a]:
            variance[a] += (limit * interval) ** 2
            found |= 2
        if axes[SUSPECT, a] == 0.0:
            axes[PEAK, a] = max(axes[PEAK, a], size)
        axes[LAST, a] = x[a]
    times[NOW] = stamp
    return found


@kernel
def run(axes, times, stamps, force, rate, start, out, kick, variance):
    """Judge samples from ``start`` on; return the next index and what was found: stops after the first that is not as it came."""
    x = np.empty(6)
    for k in range(start, stamps.shape[0]):
        x[:3], x[3:] = force[k], rate[k]
        found = judge(axes, times, stamps[k], x, out, kick, variance)
        if found:
            return k + 1, found
        for a in range(6):
            if out[a] != x[a] or kick[a] != 0.0:
                return k + 1, 0
    return stamps.shape[0], -1


@dataclass(frozen=True, slots=True)
class Jolt:
    """What the state gains at once, in b: velocity and rotation (6,), m/s and rad, and their variances (6,).

    ``silent`` (6,): which axes say nothing from now on, where that changes; else None.
    """

    kick: np.ndarray
    variance: np.ndarray
    silent: np.ndarray | None = None


class InertialSpikes:
    """Screen of one stream of inertial samples; ``counts`` pairs phrases with what was found by the last call of :meth:`screen`."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget the samples seen."""
        self._axes, self._times = np.zeros((11, 6)), np.zeros(3, dtype=np.int64)
        self._axes[SHARE] = 1.0

    def screen(self, block: ImuBlock) -> Iterator[tuple[Jolt | None, ImuBlock, str]]:
        """Pieces of a block with spikes replaced, each after what the state gains before it; and the phrase to count, or an empty text."""
        begun = done = 0
        while done < len(block):
            out, kick, variance = np.empty(6), np.zeros(6), np.zeros(6)
            args = block.stamps_ns, block.specific_force_b, block.angular_rate_b, done, out, kick, variance
            done, found = run(self._axes, self._times, *args)
            if found < 0:
                break
            if done - 1 > begun:
                yield None, block[begun : done - 1], ""
            silent = self._axes[SILENT] > 0.0 if found & 4 else None
            jolt = Jolt(kick, variance, silent) if found & 4 or kick.any() or variance.any() else None
            sample = ImuBlock.of(block.source, block.stamps_ns[done - 1 : done], out[None, :3].copy(), out[None, 3:].copy())
            yield jolt, sample, (SATURATED if found & 2 else SPIKE if found & 1 else "")
            begun = done
        if begun < len(block):
            yield None, block[begun:] if begun else block, ""

    def preview(self, block: ImuBlock) -> ImuBlock:
        """Samples beyond the horizon with spikes replaced, as far as they show yet; the state of the screen stays."""
        kept = self._axes.copy(), self._times.copy()
        parts = [part for _, part, _ in self.screen(block)]
        self._axes, self._times = kept
        if len(parts) == 1:
            return parts[0]
        columns = (np.concatenate([getattr(part, name) for part in parts]) for name in ("specific_force_b", "angular_rate_b"))
        return ImuBlock.of(block.source, block.stamps_ns, *columns)
