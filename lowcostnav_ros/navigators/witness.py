"""A witness: the state of some while ago, flown on by the sensors that carry it, without GPS.

What a slow spoofer does to a filter is done before the first of its measurements is refused, so the state of that moment is no witness.
While GPS and the state have agreed for long, copies of the core are kept, and what has moved it since; when GPS comes under suspicion, a
copy from before is flown on to the present and from then on beside the navigator's own core, at the cost of a second propagation.
"""

from collections import deque
from typing import Any

from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.estimation.horizon import HOLE_NS
from lowcostnav_ros.estimation.inertial_spikes import Jolt

SPACING_NS = 5_000_000_000
KEPT = 6
BEFORE_NS = 12_000_000_000
"""A copy that was made so long before the suspicion began is sound."""


class Witness:
    """Copies of a core and what moved it since; one of them flown on.

    Parameters
    ----------
    output_ns : int
        Output period of its navigator.

    Attributes
    ----------
    core : InertialCore or ReckoningCore or None
        The one flown on; None while nobody is under suspicion.
    """

    def __init__(self, output_ns: int) -> None:
        self._output_ns = output_ns
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.core: Any = None
        self._copies: deque[Any] = deque(maxlen=KEPT)
        self._moves: deque[tuple[int, Measurement | Jolt]] = deque()  # with the last stamp that a core has not been moved by it

    def take(self, move: Measurement) -> None:
        """Take what moves the core, in order, before the core is moved by it."""
        if self.core is None and not self._copies:
            self._moves.clear()
        self._moves.append((move.stamp_ns, move))

    def disturb(self, jolt: Jolt, t_ns: int) -> None:
        """Take what disturbs the core at a time that it has come to."""
        self._moves.append((t_ns + 1, jolt))

    def keep(self, core: Any) -> None:
        """Copy a core that is sound, now and then."""
        if core.t_ns < self.due_ns:
            return
        self._copies.append(core.branch())
        self._drop(self._copies[0].t_ns)

    @property
    def due_ns(self) -> int:
        """When the next copy of a core that is sound is to be made."""
        return self._copies[-1].t_ns + SPACING_NS if self._copies else 0

    def call(self, since_ns: int, now_ns: int) -> bool:
        """Fly the newest copy on that is from well before a suspicion; return whether there is one."""
        self.core = next((core for core in reversed(self._copies) if core.t_ns <= since_ns - BEFORE_NS), None)
        self._copies.clear()
        if self.core is not None:
            self._drop(self.core.t_ns)
            self.follow(now_ns)
        return self.core is not None

    def _drop(self, t_ns: int) -> None:
        """Drop what has moved a core that stands at a time."""
        while self._moves and self._moves[0][0] <= t_ns:
            self._moves.popleft()

    def follow(self, now_ns: int) -> None:
        """Fly on to a time; a hole in the inertial data ends it."""
        while self._moves and self.core is not None:
            move = self._moves[0][1]
            if isinstance(move, Jolt):
                self.core.disturb(move.kick, move.variance)
            elif isinstance(move, ImuBlock) and move.stamps_ns[0] - self.core.t_ns > HOLE_NS:
                self.clear()
                return
            elif not self.core.fly(move, now_ns, self._output_ns):
                break
            self._moves.popleft()
        if self.core is not None:
            self.core.arrive(now_ns)
