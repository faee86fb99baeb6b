"""``gps/attitude``: the attitude from several GPS antennas."""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Attitude
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages import parts, topics
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.kind import TopicSpec, describe
from lowcostnav_ros.messages.kinds.imu import Imu, attitude_sample, orientation, unaccelerated


def _decode(message: Any, received: Received) -> Attitude:
    """Turn an Imu message object with nothing but an orientation into an attitude at no rate, unaccelerated."""
    q_nb, cov_att = orientation(message, received)
    return Attitude(*received.head, q_nb, cov_att, np.zeros(3), unaccelerated(q_nb))


def _encode(attitude: Attitude) -> Any:
    """Build a message: orientation and its covariance, angular velocity and acceleration marked absent."""
    header, q, none = parts.header(attitude.stamp_ns, "base_link"), parts.quaternion(attitude.q_nb), parts.flu(np.zeros(3))
    return Imu(header, q, np.ravel(conv.swap_world_cov(attitude.cov_att)), none, parts.ABSENT, none, parts.ABSENT)


describe(
    __name__,
    TopicSpec("gps/attitude", topics.IMU, "Attitude from several GPS antennas; rate and acceleration absent (-1).", "base_link", "rad"),
    measurement=Attitude,
    decode=_decode,
    encode=_encode,
    frames=frozenset({"base_link"}),
    variances=(7.6e-5, 7.6e-5, 7.6e-5),  # 0.5 deg
    sample=attitude_sample,
    sensed=True,
    by_type=False,
)
