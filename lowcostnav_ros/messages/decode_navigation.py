"""Messages of navigators and of the truth, back to :class:`NavSolution`: odometry in a map frame, fixes, wind, map origins."""

import math
from collections import Counter

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, NavSolution
from lowcostnav_ros.messages import checks
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.rules import DecodeRules, Refusal
from lowcostnav_ros.physics.earth import LocalFrame

_TRUTH = "truth/"


def origin_from_fix(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Counter) -> NavSolution:
    """Turn a ``<navigator>/origin`` message into a solution with nothing but a position."""
    lat, lon, height = checks.geodetic(message)
    return NavSolution(stamp_ns, source, lat, lon, height)


def solution_from_fix(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Counter) -> NavSolution:
    """Turn a navigator's NavSatFix into a solution with position and covariance only."""
    checks.frame(source, message.header.frame_id, rules, "fix")
    lat, lon, height = checks.geodetic(message)
    cov = checks.covariance(message.position_covariance, "position")
    return NavSolution(stamp_ns, source, lat, lon, height, cov_pos=None if cov is None else conv.swap_world_cov(cov))


def solution_from_wind(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Counter) -> NavSolution:
    """Turn a wind message (velocity of the air mass, east north up) into a solution with wind only.

    A vertical component with a variance below :data:`UNKNOWN_VARIANCE`, as the truth has it, becomes the state ``wind_down_mps``.
    """
    checks.frame(source, message.header.frame_id, rules, "wind")
    linear = message.twist.twist.linear
    checks.finite((linear.x, linear.y, linear.z), "wind")
    checks.magnitude((linear.x, linear.y, linear.z), 150.0, "wind implausible")
    cov = checks.covariance(np.reshape(message.twist.covariance, (6, 6))[:3, :3].ravel(), "wind", source.startswith(_TRUTH))
    if cov is None:
        raise Refusal("covariance is unknown and no default is set")
    cov = conv.swap_world_cov(cov)
    states = {"wind_down_mps": (-linear.z, math.sqrt(cov[2, 2]))} if cov[2, 2] < UNKNOWN_VARIANCE else None
    return NavSolution(stamp_ns, source, wind_n=np.array([linear.y, linear.x]), cov_wind=cov[:2, :2].copy(), states=states)


def odometry(message, stamp_ns: int, source: str, rules: DecodeRules, notes: Counter) -> NavSolution:
    """Turn an Odometry message object into a solution; the map origin comes from ``rules.origins`` (see :class:`DecodeRules`).

    A datum whose variance reaches ``NOT_ESTIMATED`` is None in the solution.  The twist's angular part is the bias-corrected rate
    relative to inertial space.

    Raises
    ------
    Refusal
        For a wrong frame, an unknown origin, or a value that is not plausible.
    """
    checks.frame(source, message.header.frame_id, rules, "odometry")
    if message.child_frame_id.rpartition("/")[2] != "base_link":
        raise Refusal("wrong child frame id", f"'{message.child_frame_id}', expected base_link")
    origin = rules.origins.get(source.rpartition("/")[0])
    if origin is None:
        raise Refusal("map origin is not known yet")
    return solution_from_odometry(message, origin, source)


def solution_from_odometry(message, origin: LocalFrame, source: str) -> NavSolution:
    """Turn an Odometry message object in the map frame of ``origin`` into a solution; raises Refusal for what is not plausible."""
    truth = source.startswith(_TRUTH)
    pose, twist = message.pose, message.twist
    position, attitude = pose.pose.position, pose.pose.orientation
    cov_position, cov_rotation = _blocks(pose.covariance, "position", "orientation", truth)
    cov_velocity, cov_rate = _blocks(twist.covariance, "velocity", "angular rate", truth)
    position_enu = np.array([position.x, position.y, position.z])
    velocity, rate = twist.twist.linear, twist.twist.angular
    vel_flu, rate_flu = np.array([velocity.x, velocity.y, velocity.z]), np.array([rate.x, rate.y, rate.z])
    _check_numbers(position_enu, vel_flu, rate_flu)
    checks.quaternion(attitude.x, attitude.y, attitude.z, attitude.w)
    q_map = conv.quat_from_ros(attitude.x, attitude.y, attitude.z, attitude.w)
    place, q_nb, cov_pos, cov_att = conv.local_from_map(position_enu, q_map, cov_position, cov_rotation, origin.origin_e, origin.C_le)
    vel_n, cov_vel = conv.local_velocity(vel_flu, cov_velocity, q_nb)
    has_pos, has_att, has_vel = _known(cov_position), _known(cov_rotation), _known(cov_velocity)
    lat, lon, height = place if has_pos else (None, None, None)
    return NavSolution(
        checks.stamp_ns(message.header),
        source,
        lat,
        lon,
        height,
        vel_n if has_vel else None,
        q_nb if has_att else None,
        conv.swap_body(rate_flu) if _known(cov_rate) else None,
        None,
        cov_pos if has_pos else None,
        cov_vel if has_vel else None,
        cov_att if has_att else None,
    )


def _blocks(flat: np.ndarray, first: str, second: str, truth: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the two checked (3, 3) diagonal blocks of a pose or twist covariance, as large as unknown where they are all zeros."""
    matrix = np.reshape(flat, (6, 6))
    blocks = (checks.covariance(matrix[k : k + 3, k : k + 3].ravel(), what, truth) for k, what in ((0, first), (3, second)))
    upper, lower = (np.eye(3) * conv.NOT_ESTIMATED if block is None else block for block in blocks)
    return upper, lower


def _known(cov: np.ndarray) -> bool:
    return cov[0, 0] < conv.NOT_ESTIMATED


def _check_numbers(position: np.ndarray, velocity: np.ndarray, rate: np.ndarray) -> None:
    checks.finite(position, "position")
    checks.magnitude(position, 2.0e7, "position implausible")
    checks.finite(velocity, "velocity")
    checks.magnitude(velocity, 600.0, "velocity implausible")
    checks.finite(rate, "angular rate")
    checks.magnitude(rate, 35.0, "angular rate implausible, degrees per second?")
