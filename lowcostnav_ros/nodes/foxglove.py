"""Pass the topics of this ROS domain on to Foxglove, or to anything that speaks its websocket protocol, with no ROS on that side."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.graph.executables import executable
from lowcostnav_ros.graph.page.server import is_loopback, parse_listen
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.store import STORE
from lowcostnav_ros.ros import polling, qos
from lowcostnav_ros.ros.input_monitor import OK, Status
from lowcostnav_ros.ros.node_base import NodeBase
from lowcostnav_ros.ros.publishing import message_class

LOOK_S, MOST_CHANNELS, DEPTH, BACKLOG = 1.0, 1000, 50, 256
USUAL = "127.0.0.1:8765"
INSTALL = "foxglove: foxglove-sdk is not installed; install this package with its extra 'foxglove'"


@dataclass(frozen=True)
class FoxgloveSettings:
    """Settings of the bridge to Foxglove."""

    listen: str = setting(USUAL, "Loopback address and port of the websocket; it has no password, so no other machine is served.")

    def __post_init__(self) -> None:
        address, port = parse_listen(self.listen)
        if not is_loopback(address) or not port:
            raise SettingsError(f"listen: '{self.listen}' must be a port of this machine, such as {USUAL}; tunnel it (ssh -L) to another.")


@executable("foxglove", kind="monitor", Settings=FoxgloveSettings, compiled=False)
class Foxglove(NodeBase):
    """Offer every topic whose type is known; subscribe, best effort, to those that a viewer has asked for.

    Nothing can be published or called through it.  A viewer that does not keep up loses messages, the graph none.
    """

    poll_period_s = 0.01

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("foxglove", [FoxgloveSettings()], **kwargs)
        try:
            import foxglove
        except ImportError:
            self.destroy_node()
            raise SettingsError(f"{INSTALL}.") from None
        self._sdk = foxglove
        self._channels: dict[str, tuple[Any, str]] = {}
        self._listening: dict[str, Subscription] = {}
        self._wanted: SimpleQueue[tuple[str, int]] = SimpleQueue()
        self._viewers: dict[str, int] = {}
        host, port = parse_listen(self.parameters.settings[0].listen)
        listener = _Listener(self._wanted)
        try:
            self._server = foxglove.start_server(
                name="lowcostnav_ros", host=host, port=port, server_listener=listener, message_backlog_size=BACKLOG
            )
        except Exception as error:  # of the SDK's own
            self.destroy_node()
            raise SettingsError(f"foxglove: {host}:{port} cannot be listened on ({error}); give another 'listen'.") from error
        self._count = 0
        self.create_timer(LOOK_S, self._offer_new)
        print(f"Foxglove: open connection ws://{host}:{self._server.port}", flush=True)

    def rows(self) -> Iterable[Status]:
        """One row: where it is, what is asked for."""
        if hasattr(self, "_count"):
            values = {"topics": str(len(self._channels)), "listening": str(len(self._listening)), "count": str(self._count)}
            yield Status(f"{self.get_name()}: bridge", OK, f"ws port {self._server.port}, {len(self._listening)} topics asked for", values)

    def poll(self) -> int:
        """Subscribe to what has been asked for, then pass on."""
        while True:
            try:
                topic, change = self._wanted.get_nowait()
            except Empty:
                return super().poll()
            self._viewers[topic] = max(self._viewers.get(topic, 0) + change, 0)
            self._follow(topic)

    def spin(self) -> None:
        """Poll from the beginning, though nothing is subscribed to yet."""
        polling.spin(self, self.poll, self.poll_period_s)

    def destroy_node(self) -> None:
        """Stop the server, then the node."""
        server = getattr(self, "_server", None)
        if server is not None:
            server.stop()
        super().destroy_node()

    def _offer_new(self) -> None:
        """Make a channel of every topic that is new and published."""
        for topic, types in self.get_topic_names_and_types():
            msgtype = types[0]
            is_known = topic in self._channels or msgtype not in STORE.types
            if is_known or len(self._channels) >= MOST_CHANNELS or not self.count_publishers(topic):
                continue
            definition = STORE.generate_msgdef(msgtype)[0].encode()
            schema = self._sdk.Schema(name=msgtype, encoding="ros2msg", data=definition)
            self._channels[topic] = self._sdk.Channel(topic, schema=schema, message_encoding="cdr"), msgtype

    def _follow(self, topic: str) -> None:
        """Listen to a topic while somebody looks at it."""
        if topic not in self._channels:
            return
        channel, msgtype = self._channels[topic]
        if self._viewers[topic] and topic not in self._listening:
            kind = topics.kind_of(topic)
            newest = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
            profile = qos.latched() if kind is not None and kind.latched else newest
            subscription = self.subscribe(message_class(msgtype), topic, partial(self._pass_on, channel), profile)
            self._listening[topic] = subscription
        elif not self._viewers[topic] and topic in self._listening:
            subscription = self._listening.pop(topic)
            self._poller.drop(subscription)
            self.destroy_subscription(subscription)

    def _pass_on(self, channel: Any, raw: bytes) -> None:
        self._count += 1
        channel.log(bytes(raw))


class _Listener:
    """Hears, in a thread of the server, what viewers ask for."""

    def __init__(self, wanted: "SimpleQueue[tuple[str, int]]") -> None:
        self._wanted = wanted

    def on_subscribe(self, client: Any, channel: Any) -> None:
        self._wanted.put((channel.topic, 1))

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        self._wanted.put((channel.topic, -1))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("on_"):
            return lambda *_: None  # nothing else is offered
        raise AttributeError(name)
