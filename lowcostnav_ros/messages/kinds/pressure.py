"""``air/static_pressure`` and ``air/dynamic_pressure``."""

from collections.abc import Callable
from typing import Any

from lowcostnav_ros.base.measurements import Pressure
from lowcostnav_ros.messages import checks, parts, topics
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.columns import Rows
from lowcostnav_ros.messages.kind import Quantity, TopicSpec, describe
from lowcostnav_ros.messages.rules import Refusal

STATIC_PA, DYNAMIC_PA = (5.0e3, 1.2e5), (-500.0, 5.0e4)
"""At rest a differential sensor scatters around zero; refusing half of that would bias the rest."""


def _refuse_static(value: float) -> None:
    if value < 0.0:
        raise Refusal("pressure is negative", f"{value:g} Pa")
    if 120.0 < value < 1200.0:  # Pa would be above 30 km
        raise Refusal("pressure implausible, hectopascal instead of pascal?", f"{value:g}")
    if 10.0 < value <= 120.0:
        raise Refusal("pressure implausible, kilopascal or inches of mercury instead of pascal?", f"{value:g}")
    if not STATIC_PA[0] <= value <= STATIC_PA[1]:
        raise Refusal("pressure implausible", f"{value:g} Pa")


def _refuse_dynamic(value: float) -> None:
    if value < DYNAMIC_PA[0]:
        raise Refusal("pressure is negative", f"{value:g} Pa")
    if value > DYNAMIC_PA[1]:
        raise Refusal("pressure implausible", f"{value:g} Pa")


def _encode(sent: Pressure) -> Any:
    return parts.TYPES[topics.FLUID_PRESSURE](parts.header(sent.stamp_ns, "base_link"), float(sent.pressure_pa), float(sent.variance))


def _describe(name: str, description: str, refuse: Callable[[float], None], usual: tuple[float, float], *own: float) -> None:
    variance, typical = own

    def decode(message: Any, received: Received) -> Pressure:
        received.frame(message.header.frame_id)
        value = message.fluid_pressure
        checks.finite((value,), "pressure")
        refuse(value)
        return Pressure(*received.head, value, received.variance(message.variance, "pressure"))

    def many(rows: Rows) -> tuple[Any, ...]:
        value = rows["fluid_pressure"]
        rows.keep((usual[0] <= value) & (value <= usual[1]))
        return value, rows.variances(rows["variance"], "pressure")

    describe(
        __name__,
        TopicSpec(name, topics.FLUID_PRESSURE, description, "base_link", "Pa"),
        measurement=Pressure,
        decode=decode,
        encode=_encode,
        frames=frozenset(),  # a scalar has no orientation
        variances=(variance,),
        fields={"value": Quantity(1, "pressure"), "sigma": Quantity(1, "pressure")},
        numbers=lambda rows: {"fluid_pressure": rows["value"], "variance": rows.variance()},
        from_row=lambda row: row.of(Pressure, row["value"], row.variance()),
        sample=lambda at: at.of(Pressure, typical, 100.0),
        sensed=True,
        many=many,
    )


_describe("air/static_pressure", "Static pressure.", _refuse_static, STATIC_PA, 400.0, 95_460.0)
_describe("air/dynamic_pressure", "Impact pressure, total minus static.", _refuse_dynamic, DYNAMIC_PA, 100.0, 1_450.0)
