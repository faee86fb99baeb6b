"""``clock`` and ``diagnostics``, which no navigator reads, and what a navigator says of itself."""

from collections.abc import Sequence
from typing import Any

from lowcostnav_ros.base.measurements import Health
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.kind import NAVIGATOR, TopicSpec, describe
from lowcostnav_ros.messages.parts import TYPES, header, time_of
from lowcostnav_ros.messages.rules import Refusal
from lowcostnav_ros.messages.topics import CLOCK, DIAGNOSTICS

DiagnosticStatus, KeyValue = TYPES["diagnostic_msgs/msg/DiagnosticStatus"], TYPES["diagnostic_msgs/msg/KeyValue"]
MOST_VALUES, LONGEST, LONGEST_COUNT = 20, 500, 10
"""Of what is taken from one message: values, characters of a text, digits of a count."""


def clock(stamp_ns: int) -> Any:
    """Build a ``/clock`` message."""
    return TYPES[CLOCK](time_of(stamp_ns))


def diagnostics(stamp_ns: int, statuses: Sequence[tuple[str, int, str, dict[str, object]]]) -> Any:
    """Build a DiagnosticArray.

    Parameters
    ----------
    stamp_ns : int
    statuses : sequence of (name, level, message, values)
        ``level`` is 0 ok, 1 warning, 2 error, 3 stale; ``values`` becomes key/value text, floats with six digits.
    """
    array = []
    for name, level, text, values in statuses:
        array.append(DiagnosticStatus(level, name, text, "", [KeyValue(key, _text(value)) for key, value in values.items()]))
    return TYPES[DIAGNOSTICS](header(stamp_ns, ""), array)


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


describe(__name__, TopicSpec("clock", CLOCK, "Simulated time.", "", "s"), recorded=False)
describe(__name__, TopicSpec("diagnostics", DIAGNOSTICS, "Health of inputs, aids and navigators."))


def health_from(health: Health) -> Any:
    """Build the ``<navigator>/health`` message."""
    values = {"reason": health.reason, "restarts": health.restarts, "contradictions": health.contradictions}
    return diagnostics(health.stamp_ns, [(health.source, health.level, health.mode, values)])


def _decode_health(message: Any, received: Received) -> Health:
    """Turn what a navigator says of itself into a value; a mode it does not know counts by its level."""
    if len(message.status) != 1:
        raise Refusal("not the health of one navigator", f"{len(message.status)} statuses")
    status = message.status[0]
    values = {pair.key: pair.value for pair in status.values[:MOST_VALUES]}
    counts = [values.get(name, "") for name in ("restarts", "contradictions")]
    sound = all(count.isascii() and count.isdigit() and len(count) < LONGEST_COUNT for count in counts)
    if status.level not in (0, 1, 2) or not status.message or not sound:
        raise Refusal("not the health of a navigator")
    restarts, contradictions = (int(count) for count in counts)
    return Health(*received.head, status.message[:LONGEST], int(status.level), values.get("reason", "")[:LONGEST], restarts, contradictions)


describe(
    __name__,
    TopicSpec(f"{NAVIGATOR}health", DIAGNOSTICS, "Mode, level and reason of the fused solution, when they change and each second."),
    measurement=Health,
    decode=_decode_health,
    encode=health_from,
    by_type=False,
    sample=lambda at: at.of(Health, "gps", 0, "GPS position accepted", 0, 0),
)
