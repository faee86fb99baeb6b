"""The true states as a flight publishes them: the origin of their map frame first, then pose and wind at 20 Hz."""

from collections.abc import Iterator
from typing import Any

from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.messages import encode
from lowcostnav_ros.physics.earth import LocalFrame

PERIOD_NS = 50_000_000


class TruthStates:
    """Makes the messages of the true states of one flight, row by row."""

    def __init__(self) -> None:
        self._origin: LocalFrame | None = None
        self._due_ns = 0

    def begin(self, truth: TruthBlock) -> Iterator[tuple[str, Any]]:
        """Yield ``truth/origin`` with its message when ``truth`` is the first block, nothing after that."""
        if self._origin is None:
            self._due_ns = int(truth.stamps_ns[0])
            self._origin = LocalFrame(float(truth.lat[0]), float(truth.lon[0]), float(truth.height[0]))
            yield "truth/origin", encode.origin_fix(self._due_ns, self._origin)

    def at(self, truth: TruthBlock, row: int) -> Iterator[tuple[str, Any]]:
        """Yield topics and messages of a row, none where no state is due."""
        stamp_ns = int(truth.stamps_ns[row])
        if self._origin is None or stamp_ns < self._due_ns:
            return
        self._due_ns += PERIOD_NS * (1 + (stamp_ns - self._due_ns) // PERIOD_NS)
        yield "truth/odometry", encode.truth_odometry(truth, row, self._origin)
        yield "truth/wind", encode.truth_wind(truth, row)
