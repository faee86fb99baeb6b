"""Parts that several kinds of messages are built of; axes are converted on the way."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.store import STORE

TYPES = STORE.types
Header, Time = TYPES["std_msgs/msg/Header"], TYPES["builtin_interfaces/msg/Time"]
Vector3, Quaternion, Point = (TYPES[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Quaternion", "Point"))
Pose, PoseWithCovariance = TYPES["geometry_msgs/msg/Pose"], TYPES["geometry_msgs/msg/PoseWithCovariance"]
Twist, TwistWithCovariance = TYPES["geometry_msgs/msg/Twist"], TYPES["geometry_msgs/msg/TwistWithCovariance"]
TwistStamped, NavSatFix, NavSatStatus = TYPES[topics.TWIST], TYPES[topics.NAV_SAT_FIX], TYPES["sensor_msgs/msg/NavSatStatus"]

ABSENT = np.array([-1.0] + [0.0] * 8)
UNKNOWN = np.zeros(9)


def time_of(stamp_ns: int) -> Any:
    """Return a builtin_interfaces/Time of integer nanoseconds."""
    return Time(int(stamp_ns) // 1_000_000_000, int(stamp_ns) % 1_000_000_000)


def header(stamp_ns: int, frame_id: str) -> Any:
    """Return a std_msgs/Header."""
    return Header(time_of(stamp_ns), frame_id)


def flu(vector_b: np.ndarray) -> Any:
    """Return a Vector3, FLU, of FRD components."""
    return Vector3(float(vector_b[0]), -float(vector_b[1]), -float(vector_b[2]))


def quaternion(q_nb: np.ndarray) -> Any:
    """Return the ROS orientation of ``q_nb``."""
    return Quaternion(*conv.quat_to_ros(q_nb))


def nav_sat_fix(stamp_ns: int, lat: float, lon: float, height: float, cov_n: np.ndarray | None, frame_id: str, status: int = 0) -> Any:
    """Build a NavSatFix of a position (rad, rad, m above the ellipsoid) with its NED covariance, or None for unknown.

    ``status`` is -1 for no fix, 0 for a fix, 1 and 2 for satellite- and ground-based augmentation.
    """
    cov = UNKNOWN if cov_n is None else np.ravel(conv.swap_world_cov(cov_n))
    kind = 0 if cov_n is None else 3
    state = NavSatStatus(status, 1)
    return NavSatFix(header(stamp_ns, frame_id), state, math.degrees(lat), math.degrees(lon), float(height), cov, kind)


def without_covariance(message: Any) -> Any:
    """Return the TwistWithCovarianceStamped of a TwistStamped: its covariance is unknown."""
    return TwistStamped(message.header, TwistWithCovariance(message.twist, np.zeros(36)))


def twist_stamped(stamp_ns: int, frame_id: str, linear: np.ndarray, cov: np.ndarray) -> Any:
    """Build a TwistWithCovarianceStamped of a linear velocity and its (3, 3) covariance, both already in the message's axes."""
    full = two_blocks(cov, np.eye(3) * UNKNOWN_VARIANCE)
    twist = Twist(Vector3(*map(float, linear)), Vector3(0.0, 0.0, 0.0))
    return TwistStamped(header(stamp_ns, frame_id), TwistWithCovariance(twist, full))


def two_blocks(upper: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """Return a flat (36,) covariance of two (3, 3) blocks on the diagonal."""
    full = np.zeros((6, 6))
    full[:3, :3] = upper
    full[3:, 3:] = lower
    return full.ravel()
