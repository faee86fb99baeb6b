"""``air/temperature``: the static air temperature, degrees Celsius in the message as its type says."""

from typing import Any

from lowcostnav_ros.base.measurements import AirTemperature
from lowcostnav_ros.base.units import ZERO_CELSIUS, celsius, kelvin
from lowcostnav_ros.messages import checks, parts, topics
from lowcostnav_ros.messages.columns import Rows
from lowcostnav_ros.messages.kind import Quantity, TopicSpec, describe
from lowcostnav_ros.messages.rules import Refusal


def _decode(message: Any, received: checks.Received) -> AirTemperature:
    received.frame(message.header.frame_id)
    value = message.temperature
    checks.finite((value,), "temperature")
    if 150.0 <= value <= 350.0:
        raise Refusal("temperature implausible, kelvin instead of degrees Celsius?", f"{value:g}")
    if not -120.0 <= value <= 80.0:
        raise Refusal("temperature implausible", f"{value:g} deg C")
    return AirTemperature(*received.head, kelvin(value), received.variance(message.variance, "temperature"))


def _many(rows: Rows) -> tuple[Any, ...]:
    value = rows["temperature"]
    rows.keep((value >= -120.0) & (value <= 80.0))
    return value + ZERO_CELSIUS, rows.variances(rows["variance"], "temperature")


def _encode(sent: AirTemperature) -> Any:
    header = parts.header(sent.stamp_ns, "base_link")
    return parts.TYPES[topics.TEMPERATURE](header, celsius(float(sent.temperature_k)), float(sent.variance))


describe(
    __name__,
    TopicSpec("air/temperature", topics.TEMPERATURE, "Static air temperature.", "base_link", "deg C"),
    measurement=AirTemperature,
    decode=_decode,
    encode=_encode,
    frames=frozenset(),  # a scalar has no orientation
    variances=(4.0,),
    fields={"value": Quantity(1, "temperature"), "sigma": Quantity(1, "temperature")},
    from_row=lambda row: row.of(AirTemperature, row["value"], row.variance()),
    sample=lambda at: at.of(AirTemperature, 285.0, 1.0),
    sensed=True,
    many=_many,
)
