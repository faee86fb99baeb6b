"""``clock`` and ``diagnostics``: what no navigator reads."""

from collections.abc import Sequence
from typing import Any

from lowcostnav_ros.messages.kind import TopicSpec, describe
from lowcostnav_ros.messages.parts import TYPES, header, time_of
from lowcostnav_ros.messages.topics import CLOCK, DIAGNOSTICS

DiagnosticStatus, KeyValue = TYPES["diagnostic_msgs/msg/DiagnosticStatus"], TYPES["diagnostic_msgs/msg/KeyValue"]


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
