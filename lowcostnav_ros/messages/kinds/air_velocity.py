"""``air/velocity``: the air-relative velocity."""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity
from lowcostnav_ros.messages import checks, topics
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.columns import Rows
from lowcostnav_ros.messages.kind import Quantity, TopicSpec, describe
from lowcostnav_ros.messages.parts import twist_stamped, two_blocks, without_covariance
from lowcostnav_ros.messages.rules import Refusal
from lowcostnav_ros.messages.samples import VELOCITY, TableRow

SLOWEST = -20.0
"""Nothing that flies reads less than this, m/s: a sensor that does is plumbed the wrong way round."""


def _decode(message: Any, received: checks.Received) -> AirVelocity:
    received.frame(message.header.frame_id)
    velocity, cov = checks.twist(message, received, "airspeed", 400.0)
    if velocity[0] < SLOWEST:
        raise Refusal("airspeed is negative", f"{velocity[0]:g} m/s")
    return AirVelocity(*received.head, conv.swap_body(velocity), received.known(cov, conv.swap_body_cov))


def _many(rows: Rows) -> tuple[Any, ...]:
    velocity, cov = rows.twist("airspeed", 400.0, conv.swap_body, conv.swap_body_cov)
    rows.keep(velocity[:, 0] >= SLOWEST)
    return velocity, cov


def _cov(variance: float) -> np.ndarray:
    """Return the covariance of a measured airspeed without vanes."""
    return np.diag([variance, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])


def _numbers(rows: TableRow) -> dict[str, np.ndarray]:
    level = np.array([two_blocks(conv.swap_body_cov(_cov(0.0)), np.eye(3) * UNKNOWN_VARIANCE)])
    cov = np.repeat(level, len(rows["tas"]), axis=0)
    cov[:, 0] = rows.variance()
    return {"twist.twist.linear.x": rows["tas"], "twist.covariance": cov}


describe(
    __name__,
    TopicSpec("air/velocity", topics.TWIST, "Air-relative velocity: TAS on x, sideslip on y, incidence on z.", "base_link", "m/s"),
    measurement=AirVelocity,
    decode=_decode,
    encode=lambda sent: twist_stamped(sent.stamp_ns, "base_link", conv.swap_body(sent.vel_b), conv.swap_body_cov(sent.cov_b)),
    frames=frozenset({"base_link"}),
    variances=(4.0, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE),
    fields={"tas": Quantity(1, "speed"), "sigma": Quantity(1, "speed")},
    numbers=_numbers,
    from_row=lambda row: row.of(AirVelocity, np.array([row["tas"], 0.0, 0.0]), _cov(row.variance())),
    sample=lambda at: at.of(AirVelocity, VELOCITY, _cov(4.0)),
    sensed=True,
    many=_many,
    also={topics.TWIST_ALONE: without_covariance},
)
