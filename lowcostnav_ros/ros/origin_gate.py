"""The odometry of a navigator means nothing without the origin of its map frame."""

from collections import deque
from collections.abc import Callable

from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.decode import Decoder, Rejected
from lowcostnav_ros.ros import qos
from lowcostnav_ros.ros.input_monitor import InputMonitor
from lowcostnav_ros.ros.publishing import message_class


class OriginGate:
    """Hold the odometry of one navigator until the origin of its map frame has come: two topics keep no order between them."""

    HELD = 1000

    def __init__(self, navigator: str, decoder: Decoder, subscribe: Callable[..., object]) -> None:
        self._origin, self._decoder = f"{navigator}/origin", decoder
        self._held: deque[tuple[Callable, InputMonitor, bytes]] = deque(maxlen=self.HELD)
        self._open = False
        spec = topics.spec(self._origin)
        subscribe(message_class(spec.msgtype), spec.name, self._arrived, qos.latched())

    def pass_on(self, take: Callable[[InputMonitor, bytes], None], monitor: InputMonitor, raw: bytes) -> None:
        """Hand a message on, or hold it."""
        if self._open:
            take(monitor, raw)
        else:
            self._held.append((take, monitor, raw))

    def _arrived(self, raw: bytes) -> None:
        if isinstance(self._decoder.decode(self._origin, topics.NAV_SAT_FIX, raw), Rejected):
            return
        self._open = True
        while self._held:
            take, monitor, held = self._held.popleft()
            take(monitor, held)
