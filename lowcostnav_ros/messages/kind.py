"""What a kind of message is: all there is to know of a topic, described in one file of ``messages.kinds`` or in a plugin.

Topics, frames, default variances, decoding and encoding, what a table must hold to become the topic, the sample a node is warmed up with:
every list of them is derived from the descriptions found here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lowcostnav_ros.base.registry import Registry

if TYPE_CHECKING:  # naming topics loads no numpy
    from lowcostnav_ros.base.measurements import Measurement

_ROOM = "lowcostnav_ros.messages.kinds"
NAVIGATOR = "<navigator>/"
"""Heads the name of a kind that every navigator publishes under its own name."""

BODY_FRAMES = frozenset({"base_link", "imu_link"})
ANTENNA_FRAMES = frozenset({"gps", "gps_link", "gnss", "antenna", "base_link", "map"})
WORLD_FRAMES = frozenset({"map", "odom"})
WORLD_AXES, BODY_AXES = ("NED", "ENU"), ("FRD", "FLU")


@dataclass(frozen=True, slots=True)
class TopicSpec:
    """One topic: ``frame`` is the header's frame_id, ``latched`` asks for transient-local durability."""

    name: str
    msgtype: str
    description: str
    frame: str = ""
    unit: str = ""
    latched: bool = False


@dataclass(frozen=True, slots=True)
class Quantity:
    """What a topic expects of one field of a table: how many columns, of which dimension, in which frames."""

    size: int
    dimension: str
    required: bool = True
    frames: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Kind(TopicSpec):
    """A topic and all that is done with its messages, which must have a header with a stamp to be decoded.

    Attributes
    ----------
    measurement : class of measurement a message becomes
    decode : (message, :class:`~lowcostnav_ros.messages.checks.Received`) to measurement, raises Refusal; None: no navigator reads it
    encode : measurement to message object
    frames : accepted ``frame_id``; a prefix such as ``uav1/`` is ignored; empty accepts any
    variances : assumed where the covariance is all zeros, which means unknown (NED or FRD order, SI); empty: such a message is refused
    fields : fields of a table that can become this topic; empty: none can
    options : what a column profile may give besides: ``mounting_deg``, ``station``
    from_row : :class:`~lowcostnav_ros.messages.samples.TableRow` to measurement or message; to all at once with ``encode_many``
    numbers : :class:`~lowcostnav_ros.messages.samples.TableRow` of all rows to what differs in the messages ``from_row`` leads to beside
        their stamps, by dotted field in columns; None: they are made one by one
    sample : :class:`~lowcostnav_ros.messages.samples.Instant` of the warm-up flight to measurement
    sensed : a sensor publishes it: the player plays it to the navigators
    recorded : the recorder records it unless it is given a list
    by_type : encodes measurements of its class from sources that are no topic of this package, too
    fast : (bytes, kind, rules) to measurement, or to None where ``decode`` has to look
    also : other message types that carry the same, each with what makes the expected one of its message objects
    many : :class:`~lowcostnav_ros.messages.columns.Rows` of messages to the fields of the measurement behind stamp and source, in columns
    encode_many : measurement of several samples, with ``stamps_ns``, to the CDR bytes of each
    """

    measurement: "type[Measurement] | None" = None
    decode: "Callable[[Any, Any], Measurement] | None" = None
    encode: Callable[[Any], Any] | None = None
    frames: frozenset[str] = frozenset()
    variances: tuple[float, ...] = ()
    fields: Mapping[str, Quantity] = field(default_factory=dict)
    options: tuple[str, ...] = ()
    from_row: Callable[[Any], Any] | None = None
    numbers: Callable[[Any], Mapping[str, Any]] | None = None
    sample: "Callable[[Any], Measurement] | None" = None
    sensed: bool = False
    recorded: bool = True
    by_type: bool = True
    fast: "Callable[[Any, Kind, Any], Measurement | None] | None" = None
    many: Callable[[Any], Sequence[Any]] | None = None
    encode_many: Callable[[Any], list[bytes]] | None = None
    also: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)

    def takes(self, msgtype: str) -> bool:
        """Whether messages of a type can be decoded as this kind."""
        return msgtype == self.msgtype or msgtype in self.also


TOPICS: Registry[Kind] = Registry("topic", _ROOM, many=True)
"""Kinds of the topics with a fixed name, by name."""

NAVIGATOR_TOPICS: Registry[Kind] = Registry("navigator topic", _ROOM, many=True)
"""Kinds every navigator publishes under its own name, by the last part of the topic."""


def describe(origin: str, *specs: TopicSpec, **parts: Any) -> None:
    """Enter a kind for each topic, with the attributes of :class:`Kind` as ``parts``; ``origin`` is the describing module, ``__name__``.

    Raises
    ------
    RegistryError
        When another module has described a topic of this name.
    """
    for spec in specs:
        kind = Kind(*(getattr(spec, name) for name in TopicSpec.__dataclass_fields__), **parts)
        registry = NAVIGATOR_TOPICS if kind.name.startswith(NAVIGATOR) else TOPICS
        registry.register(kind.name.removeprefix(NAVIGATOR), kind, origin)


def described(name: str) -> Kind:
    """Return the kind of a canonical topic, ``gps/fix`` or ``<navigator>/fix``; raises RegistryError for any other name."""
    return NAVIGATOR_TOPICS[name.removeprefix(NAVIGATOR)] if name.startswith(NAVIGATOR) else TOPICS[name]


def find(source: str, assigned: Mapping[str, str]) -> Kind | None:
    """Return the kind of any source, None where it has none.

    In this order: the canonical topic it is ``assigned`` to; the topic itself; a further instance of one, numbered in its first word
    (``gps2/fix`` of ``gps/fix``); a navigator's topic, ``<navigator>/<part>``.
    """
    if source in assigned:
        return described(assigned[source])
    if source in TOPICS:
        return TOPICS[source]
    first, _, rest = source.partition("/")
    word = first.rstrip("0123456789")
    if word != first and f"{word}/{rest}" in TOPICS:
        return TOPICS[f"{word}/{rest}"]
    head, _, last = source.rpartition("/")
    if head and last in NAVIGATOR_TOPICS and head.split("/")[-1] not in {name.split("/")[0] for name in TOPICS if "/" in name}:
        return NAVIGATOR_TOPICS[last]
    return None
