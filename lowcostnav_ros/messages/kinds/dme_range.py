"""``dme/range`` and ``ranging/range``: the replies of DME stations and of ranging beacons."""

from typing import Any

from lowcostnav_ros.base.measurements import SlantRange
from lowcostnav_ros.messages import checks, parts, topics
from lowcostnav_ros.messages.kind import Quantity, TopicSpec, describe
from lowcostnav_ros.messages.rules import Refusal

SERVICE_M = 400.0e3
"""Service range that a message states."""


def _decode(message: Any, received: checks.Received) -> SlantRange:
    station = checks.station(message.header)
    checks.finite((message.range,), "range")
    if message.range < 0.0:
        raise Refusal("range is negative", f"{message.range:g} m")
    if message.range > received.rules.max_range_m or 0.0 < message.max_range < message.range:
        raise Refusal("range is beyond the station's maximum", f"{message.range:g} m")
    return SlantRange(*received.head, station, message.range, received.variance(message.variance, "range"))


def _encode(sent: SlantRange) -> Any:
    header = parts.header(sent.stamp_ns, sent.station)
    return parts.TYPES[topics.RANGE](header, 0, 0.0, 0.0, SERVICE_M, float(sent.range_m), float(sent.variance))


for _name, _what, _variance in (
    ("dme/range", "One reply: slant range; frame_id is the station ident.", 1.0e5),  # 0.17 NM
    ("ranging/range", "Two-way range to a beacon on the ground; frame_id is its ident.", 4.0),
):
    describe(
        __name__,
        TopicSpec(_name, topics.RANGE, _what, "", "m"),
        measurement=SlantRange,
        decode=_decode,
        encode=_encode,
        variances=(_variance,),
        fields={"range": Quantity(1, "length"), "sigma": Quantity(1, "length")},
        options=("station",),
        from_row=lambda row: row.of(SlantRange, row.station, row["range"], row.variance()),
        sample=lambda at: at.of(SlantRange, "OAK", 40_000.0, 1.0e5),
        sensed=True,
    )
