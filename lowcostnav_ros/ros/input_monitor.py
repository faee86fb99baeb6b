"""What became of one input: rate, age, gaps, rejections by reason, and whether it has timed out.

Independent of ROS.  Ages and rates are judged by a steady clock at arrival, because a sensor that stopped sends no stamps to judge by;
gaps are judged by stamps, because arrival jitters.
"""

import time
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.base.tally import Tally

OK, WARN, ERROR = Level
TIMEOUT_INTERVALS = 5.0  # a slow sensor times out after this many of its own intervals
SHORTEST_NS = 100_000  # no sensor is faster: stamps closer than this do not tell its interval
RECENT_S = 5.0  # a rejection colours the status this long
MOST_HZ, BURST = 3000.0, 1000.0  # of one input in real time: what a process can take beside its other inputs
FLOOD_RATIO, FLOOD_HZ, USUAL_S = 5.0, 50.0, 10.0
FLOOD = "flood"


class Status(NamedTuple):
    """One row of the diagnostics: name, level (0 ok, 1 warning, 2 error), a sentence, and values as text."""

    name: str
    level: int
    message: str
    values: dict[str, str]


class InputMonitor:
    """Follow one input.

    Parameters
    ----------
    topic : str
        Its name.
    required : bool
        Whether a timeout is an error (True) or a warning.
    silent_after_s : float
        Time without data that is reported as a timeout; a slow input is given five of its own intervals.
    clock : callable
        Steady time in seconds.
    sheds : bool
        Whether messages beyond :data:`MOST_HZ` are dropped: a flood on one topic must not keep the others waiting.
    """

    def __init__(
        self,
        topic: str,
        required: bool = False,
        silent_after_s: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        sheds: bool = False,
    ) -> None:
        self.topic, self.required, self.silent_after_s, self._clock, self._sheds = topic, required, silent_after_s, clock, sheds
        self._room = BURST
        self._looked, self._usual_hz, self._flood = (clock(), 0), 0.0, ""
        self.count = self.gaps = self.backward = 0
        self.rejected: Counter[str] = Tally()
        self.last_reject = self._detail = ""
        self.trouble = ""  # set when the transport itself reports one: another type, an incompatible QoS
        self._taken = (0, 0)
        self._refusal = ""
        self._started = self._learning_since = clock()
        self._last_arrival: float | None = None
        self._last_reject_at: float | None = None
        self._interval_s = 0.0
        self._last_stamp_ns = 0
        self._stamp_interval_ns = 0.0
        self._steps = 0

    def arrived(self) -> bool:
        """Note that a message came, good or bad; return whether it is to be handled, not shed."""
        now = self._clock()
        if self._last_arrival is not None:
            gap = now - self._last_arrival
            self._interval_s = gap if not self._interval_s else self._interval_s + 0.05 * (gap - self._interval_s)
            self._room = min(BURST, self._room + gap * MOST_HZ)
        self._last_arrival = now
        self.count += 1
        if self._sheds and self._room < 1.0:
            self.reject(FLOOD)
            return False
        self._room -= 1.0
        return True

    def _look(self, now: float) -> None:
        """Compare the rate since the last look with the usual one."""
        since, count = self._looked
        if now - since < 0.3:
            return
        rate, self._looked = (self.count - count) / (now - since), (now, self.count)
        if not self._usual_hz:
            self._learning_since = now  # nothing is usual before it has come for a while: the first seconds hold one message, or few
        is_known = now - self._learning_since > USUAL_S
        is_flood = rate > (max(FLOOD_RATIO * self._usual_hz, FLOOD_HZ) if is_known else MOST_HZ)
        self._flood = f"flood: {rate:.0f} Hz, usually {self._usual_hz:.0f} Hz" if is_flood else ""
        if not is_flood:
            self._usual_hz += (rate - self._usual_hz) * (min(1.0, (now - since) / USUAL_S) if is_known else 1.0)

    def stamped(self, stamp_ns: int) -> None:
        """Note the stamp of a good message: count what is missing between stamps and stamps that step back."""
        step, self._last_stamp_ns = stamp_ns - self._last_stamp_ns, stamp_ns
        if step == stamp_ns:
            return
        if step <= 0:
            self.backward += 1
        elif self._stamp_interval_ns and step > 1.5 * max(self._stamp_interval_ns, SHORTEST_NS):
            self.gaps += round(step / max(self._stamp_interval_ns, SHORTEST_NS)) - 1
        else:
            self._steps += 1  # a plain mean at first: one jittering step must not stand for the interval
            self._stamp_interval_ns += (step - self._stamp_interval_ns) * max(0.05, 1.0 / self._steps)

    def reject(self, reason: str, detail: str = "") -> None:
        """Count one rejection under its reason; ``detail`` is the message's own."""
        self.rejected[reason] += 1
        self.last_reject, self._detail = reason, f" {detail[:120]}" if detail else ""
        self._last_reject_at = self._clock()

    def refused(self, received: int, refused: int, reason: str) -> None:
        """Note what became of its messages after decoding: all received there and refused since the start, and the last reason."""
        new, bad = received - self._taken[0], refused - self._taken[1]
        if new > 0:
            self._taken = received, refused
            self._refusal = f"{bad} of the last {new} refused: {reason}" if 2 * bad > new else ""

    def is_silent(self) -> bool:
        """Whether nothing has come yet, or nothing for longer than it may be silent."""
        return self._last_arrival is None or self._clock() - self._last_arrival > self._longest_s()

    def _longest_s(self) -> float:
        return max(self.silent_after_s, TIMEOUT_INTERVALS * self._interval_s)

    def status(self, prefix: str) -> Status:
        """Return the diagnostics row; ``prefix`` is the node's name."""
        self._look(self._clock())
        level, message = self._verdict(self._clock())
        return Status(f"{prefix}: input {self.topic}", level, message, self._values())

    def _verdict(self, now: float) -> tuple[int, str]:
        timed_out = ERROR if self.required else WARN
        if self._last_arrival is None:
            waited = now - self._started
            why = f" {self.trouble}; nothing received" if self.trouble else ": nothing received yet"
            return (timed_out if waited > 2.0 else OK), f"{self.topic}{why} after {waited:.1f} s"
        age = now - self._last_arrival
        if age > self._longest_s():
            return timed_out, f"{self.topic} timed out: no data for {age:.1f} s{f'; it {self.trouble}' if self.trouble else ''}"
        if self._flood:
            return WARN, f"{self.topic}: {self._flood} ({self.rejected[FLOOD]} shed)"
        if self._refusal:
            return timed_out, f"{self.topic}: {self._refusal}"
        if self._last_reject_at is not None and now - self._last_reject_at < RECENT_S:
            return WARN, f"{self.topic}: {self.last_reject}{self._detail} ({sum(self.rejected.values())} rejected of {self.count})"
        return OK, f"{self.topic}: {self.rate_hz:.1f} Hz"

    @property
    def rate_hz(self) -> float:
        """Smoothed rate of arrival, Hz; 0 before the second message."""
        return 1.0 / self._interval_s if self._interval_s else 0.0

    def _values(self) -> dict[str, str]:
        age = "" if self._last_arrival is None else f"{self._clock() - self._last_arrival:.2f}"
        values = {"rate_hz": f"{self.rate_hz:.1f}", "age_s": age, "count": str(self.count), "gaps": str(self.gaps)}
        values |= {"backward_stamps": str(self.backward), "rejected": str(sum(self.rejected.values())), "last_reject": self.last_reject}
        return values | {f"rejected[{reason}]": str(n) for reason, n in self.rejected.most_common()}
