"""``gps/velocity_aiding``: a velocity over ground for a receiver that carries its position from fix to fix with one."""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.messages import checks, topics
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.kind import WORLD_FRAMES, TopicSpec, describe
from lowcostnav_ros.messages.parts import twist_stamped
from lowcostnav_ros.messages.samples import VELOCITY


def _decode(message: Any, received: checks.Received) -> NavSolution:
    received.frame(message.header.frame_id)
    velocity, cov = checks.twist(message, received, "velocity", 600.0)
    return NavSolution(*received.head, vel_n=conv.swap_world(velocity), cov_vel=received.known(cov, conv.swap_world_cov))


def _encode(sent: NavSolution) -> Any:
    assert sent.vel_n is not None and sent.cov_vel is not None, "only a solution with a velocity aids a receiver"
    return twist_stamped(sent.stamp_ns, "map", conv.swap_world(sent.vel_n), conv.swap_world_cov(sent.cov_vel))


describe(
    __name__,
    TopicSpec("gps/velocity_aiding", topics.TWIST, "Velocity over ground for the receiver, ENU, low latency.", "map", "m/s"),
    measurement=NavSolution,
    decode=_decode,
    encode=_encode,
    frames=WORLD_FRAMES,
    variances=(1.0, 1.0, 1.0),
    by_type=False,
    sample=lambda at: at.of(NavSolution, vel_n=VELOCITY, cov_vel=np.eye(3)),
)
