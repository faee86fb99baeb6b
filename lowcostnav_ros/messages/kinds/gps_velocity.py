"""``gps/vel``: the velocity over ground of a GPS receiver."""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import GpsVelocity
from lowcostnav_ros.messages import checks, topics
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.columns import Rows
from lowcostnav_ros.messages.kind import ANTENNA_FRAMES, WORLD_AXES, Quantity, TopicSpec, describe
from lowcostnav_ros.messages.parts import twist_stamped, without_covariance
from lowcostnav_ros.messages.samples import VELOCITY


def _decode(message: Any, received: checks.Received) -> GpsVelocity:
    received.frame(message.header.frame_id)
    velocity, cov = checks.twist(message, received, "velocity", 600.0)
    return GpsVelocity(*received.head, conv.swap_world(velocity), received.known(cov, conv.swap_world_cov))


def _many(rows: Rows) -> tuple[Any, ...]:
    return rows.twist("velocity", 600.0, conv.swap_world, conv.swap_world_cov)


_SPEED = Quantity(3, "speed", True, WORLD_AXES)
describe(
    __name__,
    TopicSpec("gps/vel", topics.TWIST, "Velocity over ground, east north up at the antenna.", "gps", "m/s"),
    measurement=GpsVelocity,
    decode=_decode,
    encode=lambda sent: twist_stamped(sent.stamp_ns, "gps", conv.swap_world(sent.vel_n), conv.swap_world_cov(sent.cov_n)),
    frames=ANTENNA_FRAMES - {"base_link"},  # which would mean body axes
    variances=(0.04, 0.04, 0.09),
    fields={"velocity": _SPEED, "sigma": _SPEED},
    from_row=lambda row: row.of(GpsVelocity, row["velocity"], row.cov()),
    sample=lambda at: at.of(GpsVelocity, VELOCITY, 0.01 * np.eye(3)),
    sensed=True,
    many=_many,
    also={topics.TWIST_ALONE: without_covariance},
)
