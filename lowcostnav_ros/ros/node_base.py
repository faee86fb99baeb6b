"""What every node of this package is made of: settings, raw subscriptions, counted publishers, diagnostics, reset."""

import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.settings import from_mapping, group, nearest, setting
from lowcostnav_ros.graph.wiring import PACED
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.checks import WRONG_FRAME
from lowcostnav_ros.messages.decode import Decoder, DecodeRules, Rejected
from lowcostnav_ros.messages.foreign import offers
from lowcostnav_ros.messages.inputs import Inputs, is_of_input, parse_inputs, remedy
from lowcostnav_ros.ros import polling, qos
from lowcostnav_ros.ros.diagnostics import DiagnosticsPublisher
from lowcostnav_ros.ros.flow import ProgressReport, header_stamp_ns
from lowcostnav_ros.ros.input_monitor import InputMonitor, Status
from lowcostnav_ros.ros.origin_gate import OriginGate
from lowcostnav_ros.ros.pacing import parse_expected
from lowcostnav_ros.ros.parameters import Parameters, given_parameters
from lowcostnav_ros.ros.publishing import Output, message_class

NO_SUBSCRIPTION_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)
ABSOLUTE = ("clock", "diagnostics")  # these two are outside all namespaces
Bases = Sequence[Any] | Callable[[dict[str, Any]], Sequence[Any]]


@dataclass(frozen=True)
class QosSettings:
    """How messages are carried."""

    lossless: bool = setting(False, "Reliable and keep-all on both sides: nothing is lost, publishing waits for the slowest listener.")
    listeners: list[str] = setting([], "Lossless: listeners to be matched before the first message of a topic, as 'topic:count'.")

    def __post_init__(self) -> None:
        parse_expected(self.listeners)


@dataclass(frozen=True)
class InputSettings:
    """How inputs are judged."""

    silent_after_s: float = setting(
        1.0,
        "An input without data for longer is reported as timed out; slow inputs get five of their intervals.",
        unit="s",
        minimum=0.2,
        maximum=60.0,
        live=True,
    )
    frames: list[str] = setting([], "Frame ids accepted of every input beside the usual ones; 'any' accepts all.")


@dataclass(frozen=True)
class NodeSettings:
    """Settings of every node, whatever it does."""

    qos: QosSettings = group(QosSettings)
    input: InputSettings = group(InputSettings)


class ResetRefusedError(Exception):
    """Why a reset is not done, in one sentence."""


class NodeBase(Node):
    """Base of all nodes.

    Parameters
    ----------
    name : str
        Default node name.
    settings : sequence of settings objects, or callable
        Their values are the defaults of the ROS parameters; :class:`NodeSettings` is added.  A callable gets the values given from outside
        and returns the sequence (defaults that depend on a parameter: the scenario).
    **kwargs
        ``context``, ``parameter_overrides``, ``namespace`` ... for :class:`rclpy.node.Node`.

    Raises
    ------
    SettingsError
        When a parameter is unknown or cannot be used.
    """

    poll_period_s = 0.005
    exit_status = Exit.OK  # what the process ends with
    build_settings = staticmethod(from_mapping)

    def __init__(self, name: str, settings: Bases = (), **kwargs: Any) -> None:
        self._given_empty: list[str] = []
        super().__init__(name, automatically_declare_parameters_from_overrides=True, **kwargs)
        try:
            given = given_parameters(self) | {name: [] for name in self._given_empty}
            self.sources = self._take_inputs(given)
            given = {name: value for name, value in given.items() if not is_of_input(name)}
            bases = settings(given) if callable(settings) else settings
            self.parameters = Parameters(self, [*bases, NodeSettings()], given, self._changed, self.build_settings)
        except Exception:
            self.destroy_node()
            raise
        self._poller = polling.Poller()
        self._progress: ProgressReport | None = None
        self.decoder = Decoder(DecodeRules(everywhere=tuple(self.node_settings.input.frames)))
        self.decoder.rules.allow(self.sources.frames)
        self.msgtypes: dict[str, str] = {}
        self._subscribed: dict[str, tuple[Subscription, Callable[[bytes], None]]] = {}
        self._gates: dict[str, OriginGate] = {}
        self.inputs: dict[str, InputMonitor] = {}
        self.outputs: dict[str, Output] = {}
        self.create_service(Trigger, "~/reset", self._reset)
        self.diagnostics = DiagnosticsPublisher(self, self.rows)

    def _take_inputs(self, given: dict[str, Any]) -> Inputs:
        """Where its sources come from, of parameters that are there to be read from now on."""
        inputs = parse_inputs(given, self.get_name())
        for name in filter(is_of_input, given):
            if self.has_parameter(name):
                self.undeclare_parameter(name)
                descriptor = ParameterDescriptor(description="Where a source comes from.", read_only=True, dynamic_typing=True)
                self.declare_parameter(name, given[name], descriptor, ignore_override=True)
        return inputs

    def declare_parameters(self, namespace: str, parameters: list, ignore_override: bool = False) -> list:
        """Declare parameters; an empty list from a file, which ROS takes for 'not set' and cannot declare, is remembered instead."""
        self._given_empty += [entry[0] for entry in parameters if len(entry) > 1 and entry[1] is None]
        settable = [entry for entry in parameters if len(entry) < 2 or entry[1] is not None]
        return super().declare_parameters(namespace, settable, ignore_override)

    @property
    def node_settings(self) -> NodeSettings:
        """The settings every node has."""
        return self.parameters.settings[-1]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters; a name that there is none of is refused with the nearest that there is."""
        unknown = [parameter.name for parameter in parameter_list if not self.has_parameter(parameter.name)]
        if unknown and hasattr(self, "parameters"):
            known = self.parameters.names
            return SetParametersResult(successful=False, reason=f"there is no parameter '{unknown[0]}'{nearest(unknown[0], known)}")
        return super().set_parameters_atomically(parameter_list)

    def listen(self, source: str, handler: Callable[[Measurement], None], *, required: bool = False) -> InputMonitor:
        """Subscribe to a topic, decode what comes and hand good measurements to ``handler``.

        Bad messages are counted under their reason and go no further.  Odometry that arrives before the origin of its map frame is
        held until the origin is known.
        """
        msgtype = topics.spec(source, self.decoder.rules).msgtype

        def take(monitor: InputMonitor, raw: bytes) -> None:
            result = self.decoder.decode(source, self.msgtypes[source], raw)
            if isinstance(result, Rejected):
                self._refuse(monitor, result)
                return
            monitor.stamped(result.stamp_ns)
            handler(result)

        if msgtype != topics.ODOMETRY:
            return self.listen_raw(source, take, required=required)
        return self.listen_raw(source, partial(self.gate_of(source.rpartition("/")[0]).pass_on, take), required=required)

    def gate_of(self, navigator: str) -> OriginGate:
        """The gate before a navigator's odometry, which listens for its origin from the first call on."""
        if navigator not in self._gates:
            self._gates[navigator] = OriginGate(navigator, self.decoder, self.subscribe)
        return self._gates[navigator]

    def listen_raw(self, source: str, handler: Callable[[InputMonitor, bytes], None], *, required: bool = False) -> InputMonitor:
        """Subscribe to the serialised bytes of a topic; a message that breaks the handler is counted, never raised."""
        spec = topics.spec(source, self.decoder.rules)
        monitor = InputMonitor(source, required, self.node_settings.input.silent_after_s, sheds=not self.node_settings.qos.lossless)
        progress = self._progress_on(source)

        def arrived(raw: bytes) -> None:
            if not monitor.arrived():
                return
            try:
                handler(monitor, raw)
                if progress is not None:
                    progress.passed(source, header_stamp_ns(raw))
            except Exception as error:  # bad data in flight never ends a node
                if not self.context.ok():
                    raise
                self._defect(monitor, error)

        self.inputs[source] = monitor
        self._subscribe_to(source, spec.msgtype, arrived)
        return monitor

    def _subscribe_to(self, source: str, msgtype: str, handler: Callable[[bytes], None]) -> None:
        """Subscribe to the topic that carries a source, as messages of a type; in place of what was subscribed to for it."""
        if source in self._subscribed:
            self._poller.drop(self._subscribed[source][0])
            self.destroy_subscription(self._subscribed[source][0])
        profile = qos.for_subscription(topics.spec(source, self.decoder.rules), self.node_settings.qos.lossless)
        self.msgtypes[source] = msgtype
        self._subscribed[source] = self.subscribe(message_class(msgtype), self._topic_of(source), handler, profile), handler

    def _topic_of(self, source: str) -> str:
        """Topic to subscribe to for a source."""
        name = self.sources.topics.get(source, source if source in ABSOLUTE else "")
        return f"/{name}" if name else source

    def _refuse(self, monitor: InputMonitor, refused: Rejected) -> None:
        """Count a message that cannot be used; the first of a reason goes to the log in full, with what to do."""
        if refused.reason not in monitor.rejected:
            frames = f"input.{monitor.topic}.frames"
            advice = f"; accept it by {frames}: any, if its axes are right" if refused.reason == WRONG_FRAME else ""
            self.get_logger().warning(f"{monitor.topic}: {refused.reason} {refused.detail}".rstrip() + advice)
        monitor.reject(refused.reason, refused.detail)

    def _defect(self, monitor: InputMonitor, error: Exception) -> None:
        """Count what a handler raised, by its kind: its text, which may hold numbers and names, goes to the log, once."""
        reason = f"error in handling: {type(error).__name__}"
        if reason not in monitor.rejected:
            where = traceback.extract_tb(error.__traceback__)[-1]
            self.get_logger().error(f"{monitor.topic}: {type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})")
        monitor.reject(reason)

    def _progress_on(self, source: str) -> ProgressReport | None:
        """The report of progress to a lossless source, if this is an input that never pauses."""
        if not self.node_settings.qos.lossless or source not in PACED:
            return None
        self._progress = self._progress or ProgressReport(self)
        return self._progress

    def subscribe(self, kind: type, name: str, handler: Callable[[bytes], None], profile: QoSProfile) -> Subscription:
        """Subscribe to the bytes of a topic; :meth:`poll` hands them to ``handler``."""
        subscription = self.create_subscription(
            kind, name, handler, profile, callback_group=self._poller.group, event_callbacks=NO_SUBSCRIPTION_EVENTS, raw=True
        )
        self._poller.add(subscription, handler)
        return subscription

    def poll(self) -> int:
        """Handle what has come on the inputs; return how many messages.  An executor that spins this node must call it, too."""
        return self._poller.take()

    def spin(self) -> None:
        """Run until the context is shut down."""
        polling.spin(self, self.poll if self._poller else None, self.poll_period_s)

    def output(self, source: str, topic: str | None = None) -> Output:
        """Return the publisher of a topic, made on first use."""
        if source not in self.outputs:
            settings = self.node_settings.qos
            listeners = parse_expected(settings.listeners).get(source, 0)
            self.outputs[source] = Output(self, topics.spec(source, self.decoder.rules), topic or source, settings.lossless, listeners)
        return self.outputs[source]

    def rows(self) -> Iterable[Status]:
        """Diagnostics rows; a subclass adds its own."""
        prefix = self.get_name()
        self._check_publishers()
        yield from (monitor.status(prefix) for monitor in self.inputs.values())
        yield from (output.status(prefix) for output in self.outputs.values())

    def reset(self, reason: str) -> str:
        """Reset the node's state; return one sentence on what was done.  A subclass overrides it, and may raise ResetRefusedError."""
        return f"{self.get_name()} keeps no state: nothing to reset."

    def on_settings(self, settings: list) -> None:
        """Take over settings that were changed live; a subclass that has live settings overrides it."""

    def destroy_node(self) -> None:
        """Publish the final counts and shut down."""
        if self.context.ok() and hasattr(self, "diagnostics"):
            self.diagnostics.publish()
        super().destroy_node()

    def _reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = self.reset("reset by service"), True
        except ResetRefusedError as refusal:
            response.message, response.success = str(refusal), False
        self.get_logger().info(response.message)
        return response

    def _changed(self, settings: list) -> None:
        for monitor in self.inputs.values():
            monitor.silent_after_s = settings[-1].input.silent_after_s
        self.on_settings(settings)

    def _check_publishers(self) -> None:
        """Find the reason of inputs without data, another type or quality of service of their publishers; take over a type that serves."""
        silent = [source for source, monitor in self.inputs.items() if monitor.is_silent()]
        offered = self._offered() if silent else {}  # asked for once: a recorder has 80 topics, most of them silent
        for source, monitor in self.inputs.items():
            monitor.trouble = self._trouble_of(source, offered) if source in silent else ""

    def _trouble_of(self, source: str, offered: dict[str, str]) -> str:
        is_lossless = self.node_settings.qos.lossless
        spec, msgtype = topics.spec(source, self.decoder.rules), self.msgtypes[source]
        if not self.count_publishers(self._topic_of(source)):
            return _offer(source, offered)
        publishers = self.get_publishers_info_by_topic(self._topic_of(source))
        others = [p.topic_type for p in publishers if p.topic_type != msgtype]
        if others and len(others) == len(publishers) and spec.takes(others[0]):
            self._subscribe_to(source, others[0], self._subscribed[source][1])
            return ""
        if others:
            return f"is published as {others[0]}, expected {spec.msgtype}"
        own = qos.for_subscription(spec, is_lossless)
        verdicts = [qos_check_compatible(p.qos_profile, own) for p in publishers]
        reasons = [why for verdict, why in verdicts if verdict == QoSCompatibility.ERROR]
        return f"is published with a QoS incompatible with qos.lossless={is_lossless} ({reasons[0].strip()})" if reasons else ""

    def _offered(self) -> dict[str, str]:
        """What else is published that may be an input of this node: published topic to the input it is like, or namespace to ''."""
        own = {topic.lstrip("/") for topic in (*self.outputs, *map(self._topic_of, self.inputs))}
        names = ((name.lstrip("/"), types[0]) for name, types in self.get_topic_names_and_types() if self.count_publishers(name))
        there = {name: msgtype for name, msgtype in names if name not in own}
        found = offers(there)
        spaced = {space + source: source for space, ours in found.items() if not ours for source in self.inputs if space + source in there}
        return spaced | {theirs: ours for theirs, ours in found.items() if ours}


def _offer(source: str, offered: dict[str, str]) -> str:
    """What may be done about an input that nobody publishes."""
    topic = next((theirs for theirs, ours in offered.items() if ours == source), "")
    return f"is not published; /{topic} may be it: {remedy(source, topic)}" if topic else ""
