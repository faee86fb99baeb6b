"""``vor/bearing``: the radials of VOR stations."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, VorBearing
from lowcostnav_ros.messages import checks, parts, topics
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.kind import Quantity, TopicSpec, describe
from lowcostnav_ros.messages.rules import Refusal
from lowcostnav_ros.physics.rotation import wrap_2pi

TILTED = 1.0e-3
"""Sine of half a tilt beyond which an orientation is that of a body, not a bearing."""
WIDEST = 0.25
"""Variance of a bearing, rad^2 (29 deg), beyond which it was stated in square degrees."""


def _decode(message: Any, received: Received) -> VorBearing:
    """Turn a message object, a rotation about up by 90 degrees minus the radial, into a measurement."""
    station = checks.station(message.header)
    q, position = message.pose.pose.orientation, checks.xyz(message.pose.pose.position)
    checks.quaternion(q.x, q.y, q.z, q.w)
    if math.hypot(q.x, q.y) > TILTED:
        raise Refusal("roll or pitch is not zero, not a bearing?", f"x {q.x:g}, y {q.y:g}")
    checks.finite(position, "position")
    if any(position):
        raise Refusal("position is not zero, not a bearing?", f"{position}")
    flat = message.pose.covariance
    variance = float(flat[35])
    if variance == 0.0 and np.any(flat):
        raise Refusal("bearing covariance has a zero variance")
    variance = received.variance(variance, "bearing")
    if variance > WIDEST:
        raise Refusal("bearing variance implausible, square degrees instead of square radians?", f"{variance:g}")
    radial = float(conv.heading_of_yaw(2.0 * math.atan2(q.z, q.w)))
    return VorBearing(*received.head, station, radial, variance)


def _encode(sent: VorBearing) -> Any:
    """Build a message: the station ident is the frame id, yaw (0 east, left positive) 90 degrees minus the radial."""
    half = 0.5 * float(conv.yaw_of_heading(sent.bearing_rad))
    pose = parts.Pose(parts.Point(0.0, 0.0, 0.0), parts.Quaternion(0.0, 0.0, math.sin(half), math.cos(half)))
    cov = np.diag([UNKNOWN_VARIANCE] * 5 + [float(sent.variance)]).ravel()
    return parts.TYPES[topics.POSE](parts.header(sent.stamp_ns, sent.station), parts.PoseWithCovariance(pose, cov))


_MEANING = "One radial: yaw = 90 deg - radial, roll, pitch and position zero; frame_id is the station ident."
describe(
    __name__,
    TopicSpec("vor/bearing", topics.POSE, _MEANING, "", "rad"),
    measurement=VorBearing,
    decode=_decode,
    encode=_encode,
    variances=(3.0e-4,),  # 1 deg
    fields={"radial": Quantity(1, "angle"), "sigma": Quantity(1, "angle")},
    options=("station",),
    from_row=lambda row: row.of(VorBearing, row.station, float(wrap_2pi(row["radial"])), row.variance()),
    sample=lambda at: at.of(VorBearing, "OAK", 1.0, 3.0e-4),
    sensed=True,
)
