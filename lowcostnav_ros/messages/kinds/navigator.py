"""What every navigator publishes under its own name: odometry in its map frame, fix, wind and the origin of the frame."""

import math
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, NavSolution
from lowcostnav_ros.messages import checks, parts
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.columns import Rows
from lowcostnav_ros.messages.kind import ANTENNA_FRAMES, NAVIGATOR, WORLD_FRAMES, TopicSpec, describe
from lowcostnav_ros.messages.parts import Point, Pose, PoseWithCovariance, Twist, TwistWithCovariance, Vector3, flu, nav_sat_fix
from lowcostnav_ros.messages.rules import Refusal
from lowcostnav_ros.messages.samples import FORCE, LEVEL, VELOCITY, Instant
from lowcostnav_ros.messages.topics import NAV_SAT_FIX, ODOMETRY, TWIST
from lowcostnav_ros.physics.earth import LocalFrame

_TRUTH = "truth/"
LARGEST_M, LARGEST_MPS, LARGEST_RADPS, LARGEST_WIND_MPS = 2.0e7, 600.0, 35.0, 150.0
_NOT_ESTIMATED, _UNKNOWN_RATE = np.eye(3) * conv.NOT_ESTIMATED, np.eye(3) * UNKNOWN_VARIANCE


def _decode_origin(message: Any, received: Received) -> NavSolution:
    """Turn the origin of a map frame into a solution with nothing but a position."""
    return NavSolution(*received.head, *checks.geodetic(message))


def _decode_fix(message: Any, received: Received) -> NavSolution:
    """Turn a navigator's NavSatFix into a solution with position and covariance only."""
    received.frame(message.header.frame_id)
    place = checks.geodetic(message)
    cov = received.covariance(message.position_covariance, "position")
    return NavSolution(*received.head, *place, cov_pos=None if cov is None else conv.swap_world_cov(cov))


def _decode_wind(message: Any, received: Received) -> NavSolution:
    """Turn a wind message (velocity of the air mass, east north up) into a solution with wind only.

    A vertical component with a variance below :data:`UNKNOWN_VARIANCE`, as the truth has it, becomes the state ``wind_down_mps``.
    """
    received.frame(message.header.frame_id)
    (east, north, up), cov = checks.twist(message, received, "wind", LARGEST_WIND_MPS, received.kind.name.startswith(_TRUTH))
    cov = received.known(cov, conv.swap_world_cov)
    states = {"wind_down_mps": (-float(up), math.sqrt(cov[2, 2]))} if cov[2, 2] < UNKNOWN_VARIANCE else None
    return NavSolution(*received.head, wind_n=np.array([north, east]), cov_wind=cov[:2, :2].copy(), states=states)


def _decode_odometry(message: Any, received: Received) -> NavSolution:
    """Turn an Odometry message object into a solution; the map origin comes from ``rules.origins`` (see :class:`DecodeRules`).

    A datum whose variance reaches ``NOT_ESTIMATED`` is None in the solution.  The twist's angular part is the bias-corrected rate
    relative to inertial space.

    Raises
    ------
    Refusal
        For a wrong frame, an unknown origin, or a value that is not plausible.
    """
    received.frame(message.header.frame_id)
    if message.child_frame_id.rpartition("/")[2] != "base_link":
        raise Refusal("wrong child frame id", f"'{message.child_frame_id}', expected base_link")
    room = received.kind.name.rpartition("/")[0]
    origin, frame = received.rules.origins.get(room), received.rules.map_frames.get(room)
    if origin is None:
        raise Refusal("map origin is not known yet")
    truth = received.kind.name.startswith(_TRUTH)
    pose, twist = message.pose, message.twist
    position, attitude = pose.pose.position, pose.pose.orientation
    cov_position, cov_rotation = _blocks(received, pose.covariance, "position", "orientation", truth)
    cov_velocity, cov_rate = _blocks(received, twist.covariance, "velocity", "angular rate", truth)
    position_enu = np.array([position.x, position.y, position.z])
    velocity, rate = twist.twist.linear, twist.twist.angular
    vel_flu, rate_flu = np.array([velocity.x, velocity.y, velocity.z]), np.array([rate.x, rate.y, rate.z])
    _check_numbers(position_enu, vel_flu, rate_flu)
    checks.quaternion(attitude.x, attitude.y, attitude.z, attitude.w)
    q_map = conv.quat_from_ros(attitude.x, attitude.y, attitude.z, attitude.w)
    in_map = position_enu, q_map, cov_position, cov_rotation
    place, q_nb, cov_pos, cov_att = conv.local_from_map(*in_map, origin.origin_e, origin.C_le)
    if frame is not None and frame.other is not None and _known(cov_position):
        elsewhere = conv.local_from_map(*in_map, frame.other.origin_e, frame.other.C_le)
        if frame.prefers_other(received.head[0], place, elsewhere[0]):
            received.rules.origins[room] = frame.swap()
            place, q_nb, cov_pos, cov_att = elsewhere
    vel_n, cov_vel = conv.local_velocity(vel_flu, cov_velocity, q_nb)
    has_pos, has_att, has_vel = _known(cov_position), _known(cov_rotation), _known(cov_velocity)
    lat, lon, height = place if has_pos else (None, None, None)
    if has_pos and frame is not None:
        frame.last = (received.head[0], place, vel_n)
    return NavSolution(
        *received.head,
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


def _blocks(received: Received, flat: np.ndarray, first: str, second: str, truth: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the two checked (3, 3) diagonal blocks of a pose or twist covariance, as large as unknown where they are all zeros."""
    matrix = np.reshape(flat, (6, 6))
    blocks = (received.covariance(matrix[k : k + 3, k : k + 3].ravel(), what, truth) for k, what in ((0, first), (3, second)))
    upper, lower = (_NOT_ESTIMATED if block is None else block for block in blocks)
    return upper, lower


def _odometry_many(rows: Rows) -> tuple[Any, ...]:
    """Odometries in the one map frame that is known, with the same data known in all of them."""
    received = rows.received
    room, truth = received.kind.name.rpartition("/")[0], received.kind.name.startswith(_TRUTH)
    origin, frame = received.rules.origins.get(room), received.rules.map_frames.get(room)
    rows.text("child_frame_id", lambda text: text.rpartition("/")[2] == "base_link")
    if origin is None or (frame is not None and frame.other is not None):
        rows.keep(np.zeros(len(rows), bool))
        return ()
    named = ("pose", 0, "position"), ("pose", 3, "orientation"), ("twist", 0, "velocity"), ("twist", 3, "angular rate")
    cov_position, cov_rotation, cov_velocity, cov_rate = (_blocks_many(rows, *names, truth) for names in named)
    known = np.stack([cov[:, 0, 0] < conv.NOT_ESTIMATED for cov in (cov_position, cov_rotation, cov_velocity, cov_rate)], axis=1)
    rows.keep((known == known[0]).all(axis=1))
    has_pos, has_att, has_vel, has_rate = known[0].tolist()
    position, velocity, rate = rows.parts("pose.pose.position"), rows.parts("twist.twist.linear"), rows.parts("twist.twist.angular")
    for values, limit in ((position, LARGEST_M), (velocity, LARGEST_MPS), (rate, LARGEST_RADPS)):
        rows.within(values, limit)
    q = rows.parts("pose.pose.orientation", "xyzw")
    rows.unit(q)
    in_map = position, conv.quats_from_ros(q), cov_position, cov_rotation, velocity, cov_velocity
    for values in in_map:
        values[~rows.good] = 0.0
    places, q_nb, vel_n, (cov_pos, cov_vel, cov_att) = conv.locals_from_map(*in_map, origin.origin_e, origin.C_le)
    if has_pos and frame is not None and rows.good.any():
        last = int(np.flatnonzero(rows.good)[-1])
        lat, lon, height = places[last].tolist()
        frame.last = int(rows.stamps_ns[last]), (lat, lon, height), vel_n[last]
    return (
        *(places.T if has_pos else (None, None, None)),
        vel_n if has_vel else None,
        q_nb if has_att else None,
        conv.swap_body(rate) if has_rate else None,
        None,
        cov_pos if has_pos else None,
        cov_vel if has_vel else None,
        cov_att if has_att else None,
    )


def _blocks_many(rows: Rows, name: str, first: int, what: str, truth: bool) -> np.ndarray:
    blocks = rows.each(rows.block(f"{name}.covariance", first), lambda flat: rows.received.covariance(flat, what, truth))
    return np.array([_NOT_ESTIMATED if block is None else block for block in blocks])


def _wind_many(rows: Rows) -> tuple[Any, ...]:
    truth = rows.received.kind.name.startswith(_TRUTH)
    wind = rows.parts("twist.twist.linear")
    rows.within(wind, LARGEST_WIND_MPS)
    covs = rows.covariances(rows.block("twist.covariance", 0), "wind", conv.swap_world_cov, truth)
    down = [None if cov is None or cov[2, 2] >= UNKNOWN_VARIANCE else math.sqrt(cov[2, 2]) for cov in covs]
    states = [None if sigma is None else {"wind_down_mps": (-up, sigma)} for up, sigma in zip(wind[:, 2].tolist(), down, strict=True)]
    level = [None if cov is None else cov[:2, :2].copy() for cov in covs]
    return *[None] * 10, np.stack([wind[:, 1], wind[:, 0]], axis=1), level, [""] * len(rows), states


def _known(cov: np.ndarray) -> bool:
    return cov[0, 0] < conv.NOT_ESTIMATED


def _check_numbers(position: np.ndarray, velocity: np.ndarray, rate: np.ndarray) -> None:
    checks.finite(position, "position")
    checks.magnitude(position, LARGEST_M, "position implausible")
    checks.finite(velocity, "velocity")
    checks.magnitude(velocity, LARGEST_MPS, "velocity implausible")
    checks.finite(rate, "angular rate")
    checks.magnitude(rate, LARGEST_RADPS, "angular rate implausible, degrees per second?")


def origin_fix(stamp_ns: int, origin: LocalFrame) -> Any:
    """Build the ``<navigator>/origin`` message of a map frame."""
    return nav_sat_fix(stamp_ns, origin.lat, origin.lon, origin.height, None, "map")


def fix_from_solution(solution: NavSolution) -> Any:
    """Build a navigator's NavSatFix; status -1 with zeros where the solution has no position."""
    if solution.lat is None or solution.lon is None or solution.height is None:
        return nav_sat_fix(solution.stamp_ns, 0.0, 0.0, 0.0, None, "base_link", status=-1)
    return nav_sat_fix(solution.stamp_ns, solution.lat, solution.lon, solution.height, solution.cov_pos, "base_link")


def wind_message(stamp_ns: int, wind_n: np.ndarray, cov_wind: np.ndarray | None) -> Any:
    """Build a wind message, ENU, from (2,) or (3,) NED components; the vertical variance is unknown where it has two."""
    wind, cov = np.zeros(3), np.diag([0.0, 0.0, UNKNOWN_VARIANCE])
    n = len(wind_n)
    wind[:n] = wind_n
    cov[:n, :n] = 0.0 if cov_wind is None else cov_wind
    return parts.twist_stamped(stamp_ns, "map", conv.swap_world(wind), conv.swap_world_cov(cov))


def odometry_from_solution(solution: NavSolution, origin: LocalFrame) -> Any:
    """Build an Odometry message of a solution in the map frame of ``origin``.

    Pose in ENU of the origin's tangent plane (attitude and covariances turned into it), twist in base_link FLU.  What the solution does
    not have gets a variance of ``conversions.NOT_ESTIMATED`` and zeros; without attitude the twist is forward = north, left = west.
    """
    has_pos, has_att, has_vel = solution.lat is not None, solution.q_nb is not None, solution.vel_n is not None
    q_nb = solution.q_nb if has_att else LEVEL
    place = (solution.lat, solution.lon, solution.height) if has_pos else (origin.lat, origin.lon, origin.height)
    cov_pos, cov_att = solution.cov_pos if has_pos else _NOT_ESTIMATED, solution.cov_att if has_att else _NOT_ESTIMATED
    position, q_map, cov_pos, cov_att = conv.map_from_local(*place, q_nb, cov_pos, cov_att, origin.origin_e, origin.C_le)
    vel_n, cov_vel = (solution.vel_n, solution.cov_vel) if has_vel else (np.zeros(3), _NOT_ESTIMATED)
    velocity, cov_vel = conv.body_velocity(vel_n, cov_vel, q_nb)
    rate_b = solution.angular_rate_b
    rate = Vector3(0.0, 0.0, 0.0) if rate_b is None else flu(rate_b)
    cov_twist = parts.two_blocks(cov_vel, _NOT_ESTIMATED if rate_b is None else _UNKNOWN_RATE)
    pose = Pose(Point(*position.tolist()), parts.quaternion(q_map))
    return parts.TYPES[ODOMETRY](
        parts.header(solution.stamp_ns, "map"),
        "base_link",
        PoseWithCovariance(pose, parts.two_blocks(cov_pos, cov_att)),
        TwistWithCovariance(Twist(Vector3(*velocity.tolist()), rate), cov_twist),
    )


def wind_from_solution(solution: NavSolution) -> Any:
    """Build a navigator's wind message, None where it has no wind."""
    return None if solution.wind_n is None else wind_message(solution.stamp_ns, solution.wind_n, solution.cov_wind)


def _sample(at: Instant) -> NavSolution:
    eye, still = np.eye(3), np.zeros(3)
    state = *at.place, VELOCITY, LEVEL, still, FORCE
    return at.of(NavSolution, *state, cov_pos=eye, cov_vel=eye, cov_att=1e-4 * eye, mode="gps")


def _wind_sample(at: Instant) -> NavSolution:
    return at.of(NavSolution, wind_n=np.array([3.0, -7.0]), cov_wind=np.eye(2))


OF_ODOMETRY = {"measurement": NavSolution, "decode": _decode_odometry, "frames": WORLD_FRAMES, "sample": _sample, "many": _odometry_many}
OF_WIND = {"measurement": NavSolution, "decode": _decode_wind, "encode": wind_from_solution, "frames": WORLD_FRAMES, "sample": _wind_sample}
OF_WIND |= {"many": _wind_many}
OF_ORIGIN = {"measurement": NavSolution, "decode": _decode_origin, "sample": lambda at: at.of(NavSolution, *at.place)}
"""What the kinds of the navigators and those of the truth have in common."""

describe(
    __name__,
    TopicSpec(f"{NAVIGATOR}odometry", ODOMETRY, "Pose in the map frame of <navigator>/origin, twist in base_link.", "map", "m, m/s, rad/s"),
    TopicSpec(f"{NAVIGATOR}odometry_fused", ODOMETRY, "The same at the fusion horizon: what replay reproduces.", "map", "m, m/s, rad/s"),
    **OF_ODOMETRY,
)
describe(
    __name__,
    TopicSpec(f"{NAVIGATOR}wind", TWIST, "Velocity of the air mass, east north at the aircraft, low latency.", "map", "m/s"),
    TopicSpec(f"{NAVIGATOR}wind_fused", TWIST, "The same at the fusion horizon.", "map", "m/s"),
    **OF_WIND,
)
_ORIGIN = "Geodetic origin of this navigator's map frame."
describe(__name__, TopicSpec(f"{NAVIGATOR}origin", NAV_SAT_FIX, _ORIGIN, "map", "deg, m", True), **OF_ORIGIN)
describe(
    __name__,
    TopicSpec(f"{NAVIGATOR}fix", NAV_SAT_FIX, "Position, height above the ellipsoid, covariance ENU.", "base_link", "deg, m, m^2"),
    measurement=NavSolution,
    decode=_decode_fix,
    encode=fix_from_solution,
    frames=ANTENNA_FRAMES,
    sample=lambda at: at.of(NavSolution, *at.place, cov_pos=4.0 * np.eye(3)),
)
