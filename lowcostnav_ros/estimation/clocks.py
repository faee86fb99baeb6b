"""What time is it?  The time base of a navigator, agreed upon by its inputs.

Nothing here reads a clock: there are the stamps and the order in which messages arrive.  The time base is the newest stamp of the inputs
that agree.  A message agrees when it is no further ahead of the base than transport and the pace of the fastest input explain, and no
further behind than the horizon waits.  One that does not agree moves nothing: far ahead it is held until it is decided who is right, and
dropped as soon as another message speaks for the base.

Who is right is put to the vote, one vote for each device (the first word of a topic, so that the two topics of a GPS receiver are one):
those that left the base together against those that have spoken for it since.  Inputs that all step, or all resume after a pause, move the
base; one that steps alone does not, however many messages it sends, and a message alone never does.  When it is one against one, the
input that carries the state is believed.  What only lies behind is late, not wrong about the time, unless by more than any transport takes.

An input that is off by whole seconds for good (a wrong second, leap seconds, a zone) is corrected by them, which no delay imitates; one
that is off by anything else is not used: read off the order of arrival, an offset is uncertain by the delay.
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.estimation.aiding import Reason

TIME_JUMPED = "time jumped"
HELD = "held"
AHEAD, LATE, IMPLAUSIBLE = "stamp ahead of the other inputs", "late", "stamp implausible"
CLOCK_OFFSET = "clock offset"

TRANSPORT_NS = 100_000_000
"""Inputs of one instant may arrive this much apart, however short the lag of the horizon."""
NEARLY = 0.8
"""Up to this share of the lag ahead a stamp moves the base: what comes without delay must not be late by it."""
QUEUE_NS = 500_000_000
"""A busy machine lets one input wait this long beside the others: a message of an input that has kept time is used none the less."""
LATENCY_NS = 2_000_000_000
"""Transport takes less; inputs that all lie further behind one other are not late, the other is ahead."""
PACES = 3.0
"""An input may pause for so many of its usual intervals."""
BEAT = 1.5
"""The base rests no longer than this many intervals of the fastest input."""
LONE_MESSAGES = 5
"""So many messages of one device, while the others are silent, mean that these have stopped."""
PROGRESS_NS = 100_000_000
"""Nobody is believed for less than this long."""
LIVE_NS = 5_000_000_000
"""An input that has been silent longer, and longer than five of its intervals, has no voice."""
STEADY_NS = 500_000_000
"""Leads that scatter less than this are an offset of a clock; transport scatters or passes."""
NAMED_MESSAGES, NAMED_NS = 3, 1_000_000_000
"""So many messages over so long a time make an offset certain."""
MAX_HELD = 2_000
SECOND_NS = 1_000_000_000
EARLY_NS, DELAY_NS = 150_000_000, 350_000_000
"""A lead is one of whole seconds if it is no more than this above them (by the pace of the others), or below (by its transport)."""


class Clock:
    """What is known of one input's stamps.

    Attributes
    ----------
    last_ns : int or None
        Newest stamp that agreed.
    pace_ns : float
        Usual interval of its stamps; 0 before there is one.
    kept : int
        Messages that agreed.
    spoke, left : int
        Number, in the order of arrival of all, of the last message that agreed, and of the first of those since that did not.
    out : int
        Messages in a row that did not agree; their newest stamp is ``stamp_ns``, the first ``first_ns``.
    shift_ns : int
        Whole seconds by which its stamps are taken back.
    steady : int
        How many of them, from the stamp ``steady_ns`` on, lead the base by the same, ``low_ns`` to ``high_ns``; it was ``since_ns`` then.
    """

    def __init__(self, source: str) -> None:
        self.source, self.device = source, source.partition("/")[0]
        self.last_ns: int | None = None
        self.pace_ns = 0.0
        self.kept = self.spoke = self.left = self.out = self.steady = 0
        self.stamp_ns = self.first_ns = self.steady_ns = self.since_ns = self.low_ns = self.high_ns = self.shift_ns = 0

    def agreed(self, first_ns: int, last_ns: int, count: int, serial: int) -> None:
        """Note stamps that agree with the base."""
        span, steps = last_ns - first_ns, count - 1
        if self.last_ns is not None and first_ns > self.last_ns:
            span, steps = last_ns - self.last_ns, count
        if steps and span > 0:
            pace = span / steps
            self.pace_ns += (min(pace, 4.0 * self.pace_ns) - self.pace_ns) / 8.0 if self.pace_ns else pace
        self.last_ns = last_ns if self.last_ns is None else max(last_ns, self.last_ns)
        self.kept, self.spoke, self.out, self.steady = self.kept + 1, serial, 0, 0

    def left_at(self, first_ns: int, stamp_ns: int, count: int, base_ns: int, serial: int, usual_ns: float) -> None:
        """Note stamps that do not agree; what is no continuation of those before begins anew."""
        lead_ns = first_ns - base_ns
        if not self.out or not 0 <= first_ns - self.stamp_ns <= max(usual_ns, PACES * self.pace_ns or np.inf):
            self.out, self.steady, self.left, self.first_ns = 0, 0, serial, first_ns
        if not self.steady or max(self.high_ns, lead_ns) - min(self.low_ns, lead_ns) > STEADY_NS:
            self.steady, self.steady_ns, self.since_ns, self.low_ns, self.high_ns = 0, stamp_ns, base_ns, lead_ns, lead_ns
        self.low_ns, self.high_ns = min(self.low_ns, lead_ns), max(self.high_ns, lead_ns)
        self.out, self.steady, self.stamp_ns = self.out + count, self.steady + 1, stamp_ns

    def take_back(self) -> None:
        """Correct an offset of whole seconds: a wrong second, leap seconds, a zone, a week.  What lies a little behind may be late."""
        whole_ns = round((self.high_ns + EARLY_NS // 2) / SECOND_NS) * SECOND_NS
        is_whole = whole_ns != 0 and -DELAY_NS <= self.high_ns - whole_ns <= EARLY_NS
        if is_whole and (whole_ns == -self.shift_ns or not -LATENCY_NS <= whole_ns <= 0):
            self.shift_ns += whole_ns
            self.out = self.steady = 0

    @property
    def is_off(self) -> bool:
        """Whether its offset is certain."""
        return self.steady >= NAMED_MESSAGES and self.stamp_ns - self.steady_ns >= NAMED_NS

    def lives(self, base_ns: int) -> bool:
        """Whether it kept time not long ago."""
        return self.last_ns is not None and base_ns - self.last_ns <= max(LIVE_NS, 5.0 * self.pace_ns)


@kernel
def goes_on(stamps_ns, longest_ns):
    """Whether every stamp comes after the one before, and no later than ``longest_ns``."""
    usual = True
    for k in range(1, stamps_ns.shape[0]):
        usual = usual and 0 < stamps_ns[k] - stamps_ns[k - 1] <= longest_ns
    return usual


class Clocks:
    """The time base and the clocks of all inputs.

    Parameters
    ----------
    lag_ns : int
        How long the horizon waits for what is under way.
    jump_ns : int
        A new base further ahead than this, or any behind, is a fresh start; a stamp this far off is implausible.
    anchor : str or None
        Input that is believed when it is one against one.

    Attributes
    ----------
    time_ns : int or None
        The time base: newest stamp that agreed.
    refused : list of (str, str)
        Source and reason of held messages that were dropped; the caller empties it.
    is_quiet : bool
        Whether all inputs keep time: nothing is held, and nothing is known against any clock.
    """

    def __init__(self, lag_ns: int, jump_ns: int, anchor: str | None = None) -> None:
        self.lag_ns, self.jump_ns, self.anchor = lag_ns, jump_ns, anchor
        self.refused: list[tuple[str, str]] = []
        self._near_ns = max(NEARLY * lag_ns, TRANSPORT_NS)
        self.clear()

    def clear(self) -> None:
        """Forget every stamp."""
        self.time_ns: int | None = None
        self._clocks: dict[str, Clock] = {}
        self._held: list[Measurement] = []
        self._released: list[Measurement] = []
        self._serial = 0
        self.is_quiet = True

    def pieces(self, measurement: Measurement) -> list[Measurement]:
        """A measurement as it is judged: at the time that its stamp is taken for.

        A block is cut where its stamps do not go on as usual, so that no other cut of blocks matters.
        """
        clock = self._clocks.get(measurement.source)
        if clock is not None and clock.shift_ns:
            measurement = replace(measurement, stamp_ns=measurement.stamp_ns - clock.shift_ns)
        if not isinstance(measurement, ImuBlock) or len(measurement) < 2 or goes_on(measurement.stamps_ns, self._near_ns):
            return [measurement]
        steps = np.diff(measurement.stamps_ns)
        cuts = [0, *(np.flatnonzero((steps <= 0) | (steps > self._near_ns)) + 1).tolist(), len(measurement)]
        return [measurement[a:b] for a, b in pairwise(cuts)]

    def judge(self, measurement: Measurement, passed_ns: int | None) -> str:
        """Whether a message agrees with the base; ``passed_ns`` is where fusion is.

        Returns
        -------
        str
            Empty when it is to be used, after those that :meth:`released` gives; :data:`HELD`; :data:`TIME_JUMPED`; or the reason.
        """
        stamp = measurement.stamp_ns
        first, count = (int(measurement.stamps_ns[0]), len(measurement)) if isinstance(measurement, ImuBlock) else (stamp, 1)
        clock = self._clocks.get(measurement.source)
        if clock is None:
            clock = self._clocks[measurement.source] = Clock(measurement.source)
        self._serial += 1
        base = stamp if self.time_ns is None else self.time_ns
        ahead = first - base > self._near_ns and first - base > self._near_ns + self._pause_ns(base, clock)
        passed = passed_ns is not None and stamp <= passed_ns
        if not ahead and not passed and stamp >= base - self.lag_ns - QUEUE_NS:
            clock.agreed(first, stamp, count, self._serial)
            self.time_ns = max(base, stamp)
            if not self.is_quiet:
                self._drop()
                self.is_quiet = not any(c.out or c.steady or c.shift_ns for c in self._clocks.values())
            return ""
        self.is_quiet = False
        clock.left_at(first, stamp, count, base, self._serial, self._near_ns)
        self._serial += count - 1
        if self._outvotes(clock, stamp, ahead, base):
            return self._move(clock, first, stamp, count, base)
        prompt = first - base <= self.lag_ns + QUEUE_NS * (clock.kept >= NAMED_MESSAGES)
        if (prompt if ahead else base - stamp <= self.jump_ns) and not passed and not clock.is_off:
            return ""  # it has kept time until now, and the others may be late; the base does not move
        if ahead and not clock.is_off and len(self._held) < MAX_HELD:
            self._held.append(measurement)
            return HELD
        reason = self._reason(clock, ahead)
        if clock.is_off and clock.source != self.anchor and not isinstance(measurement, ImuBlock):
            clock.take_back()
        return reason

    def released(self) -> list[Measurement]:
        """Messages that were held and turn out to be right, in the order of arrival; once."""
        if not self._released:
            return self._released
        out, self._released = self._released, []
        return out

    def contradictions(self) -> tuple[Contradiction, ...]:
        """Inputs whose clocks are off, each with the input it is compared with, and by how much."""
        if self.is_quiet:
            return ()
        off = [c for c in self._clocks.values() if (c.steady and c.is_off) or c.shift_ns]
        return tuple([self._contradiction(c) for c in off]) if off else ()

    def _contradiction(self, c: Clock) -> Contradiction:
        parties, size = (c.source, self._reference(c)), abs(self._offset_s(c))
        return Contradiction(CLOCK_OFFSET, parties, size, "s", c.since_ns, c.source, self._sentence(c))

    def sentences(self) -> list[str]:
        """What is wrong with which clock, for people."""
        return [self._sentence(clock) for clock in self._clocks.values() if clock.is_off or clock.shift_ns]

    def _sentence(self, clock: Clock) -> str:
        if not clock.is_off and clock.shift_ns:
            return f"{self.words(clock)}: corrected"
        return f"{self.words(clock)}{self._remedy(clock)}: not used"

    def _remedy(self, clock: Clock) -> str:
        """What to set for one that lies behind by what may be delay: nobody can tell which of the two it is."""
        behind_s = -self._offset_s(clock)
        if not 0.0 < behind_s <= 1e-9 * LATENCY_NS:
            return ""
        wait_s = math.ceil(10.0 * behind_s + 2.0) / 10.0
        return f" (latency_s: {wait_s:.1f} waits for what comes late, late_s: {-behind_s:.1f} as well sets a slow clock right)"

    def words(self, clock: Clock) -> str:
        """Size of an offset, for people: ``gps/fix is 1.0 s ahead of imu/data_raw``."""
        lead_s = self._offset_s(clock)
        return f"{clock.source} is {abs(lead_s):.1f} s {'ahead of' if lead_s > 0.0 else 'behind'} {self._reference(clock)}"

    def _offset_s(self, clock: Clock) -> float:
        """The least delayed message is the best measure, or the one that comes right after a slower reference's."""
        if clock.shift_ns and not clock.is_off:
            return 1e-9 * clock.shift_ns
        reference = self._clocks.get(self._reference(clock))
        slower = reference is not None and reference.pace_ns > PACES * clock.pace_ns > 0.0
        return 1e-9 * (clock.shift_ns + (clock.low_ns if slower else clock.high_ns))

    def _reason(self, clock: Clock, ahead: bool) -> str:
        phrase = IMPLAUSIBLE if max(abs(clock.low_ns), abs(clock.high_ns)) > self.jump_ns else AHEAD if ahead else LATE
        return Reason(phrase, self.words(clock) if clock.is_off else "")

    def _reference(self, clock: Clock) -> str:
        """The input to compare with: the one that carries the state, or the fastest that keeps time."""
        base = self.time_ns or 0
        keeping = [c for c in self._clocks.values() if c is not clock and not c.out and c.lives(base)]
        if any(c.source == self.anchor for c in keeping):
            return str(self.anchor)
        return min(keeping, key=lambda c: (c.pace_ns or LIVE_NS, c.source)).source if keeping else "the other inputs"

    def _pause_ns(self, base: int, clock: Clock) -> float:
        """How long the base may rest: by the pace of the fastest input, one alone may miss a message or two; at first, anything."""
        if not any(c.pace_ns for c in self._clocks.values()):
            return float(self.jump_ns)
        others = self._pace_ns(base, but=clock)
        return min(PACES * clock.pace_ns or np.inf, BEAT * others) if others else PACES * clock.pace_ns

    def _pace_ns(self, base: int, but: Clock) -> float:
        """Interval of the fastest other input; 0 where there is none."""
        return min((c.pace_ns for c in self._clocks.values() if c is not but and c.pace_ns and c.lives(base)), default=0.0)

    def _outvotes(self, clock: Clock, stamp: int, ahead: bool, base: int) -> bool:
        """Whether those that left the base together with a clock outvote those that have spoken for it since."""
        near = self._near_ns + LIVE_NS // 5
        together = [c for c in self._clocks.values() if c.out and abs(c.stamp_ns - stamp) <= near + PACES * c.pace_ns]
        left = max(c.left for c in together)
        others = [c for c in self._clocks.values() if c not in together]
        ours = {c.device for c in together}
        theirs = {c.device for c in others if not c.out and c.spoke > left}
        progress = stamp - clock.first_ns
        if not theirs:
            if len(ours) > 1:
                return self._serial - left >= 2
            if any(c.lives(base) for c in others):
                return clock.out >= LONE_MESSAGES and progress >= max(PROGRESS_NS, min(PACES * self._pace_ns(base, clock), NAMED_NS))
            return clock.out >= (2 if ahead else 3) and progress >= PROGRESS_NS
        anchored = any(c.source == self.anchor and c in others and not c.out and c.spoke > left for c in self._clocks.values())
        if not ahead and base - stamp <= LATENCY_NS and (anchored or not clock.is_off):
            return False  # they may all be late
        if len(ours) > len(theirs):
            return progress >= PROGRESS_NS
        return len(ours) == len(theirs) and clock.source == self.anchor and progress >= NAMED_NS

    def _move(self, clock: Clock, first: int, stamp: int, count: int, base: int) -> str:
        """Take over the time of a clock and of those that left with it."""
        if not 0 < first - base <= self.jump_ns:
            return TIME_JUMPED
        mine = [m for m in self._held if abs(m.stamp_ns - stamp) <= self.jump_ns]
        self._held = [m for m in self._held if abs(m.stamp_ns - stamp) > self.jump_ns]
        self._drop()
        self._released = sorted(mine, key=lambda m: m.stamp_ns)
        for held in self._released:
            other = self._clocks[held.source]
            begin = int(held.stamps_ns[0]) if isinstance(held, ImuBlock) else held.stamp_ns
            other.agreed(begin, held.stamp_ns, len(held) if isinstance(held, ImuBlock) else 1, self._serial)
        clock.agreed(first, stamp, count, self._serial)
        self.time_ns = max([stamp, *(m.stamp_ns for m in mine)])
        return ""

    def _drop(self) -> None:
        """Refuse what is held: others speak for the base."""
        self.refused += [(m.source, self._reason(self._clocks[m.source], ahead=True)) for m in self._held]
        self._held = []
