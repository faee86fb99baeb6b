"""``imu/data_raw``, the inertial samples, and ``imu/data``, the attitude of an AHRS."""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, ImuBlock, NavSolution
from lowcostnav_ros.messages import checks, imu_columns
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.columns import Rows
from lowcostnav_ros.messages.kind import BODY_AXES, BODY_FRAMES, Quantity, TopicSpec, describe
from lowcostnav_ros.messages.layouts import messages_like
from lowcostnav_ros.messages.parts import ABSENT, TYPES, UNKNOWN, Quaternion, flu, header, quaternion
from lowcostnav_ros.messages.rules import DecodeRules
from lowcostnav_ros.messages.samples import FORCE, LEVEL, STEP_S, Instant, TableRow
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.messages.topics import IMU
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_to_dcm

Imu = TYPES[IMU]
_NO_TURN = Quaternion(0.0, 0.0, 0.0, 1.0)
_SAMPLES = 20
_FORCE_ABSENT = "specific force absent, that of unaccelerated flight used"


def _vectors(message: Any, rules: DecodeRules) -> tuple[np.ndarray, np.ndarray]:
    """Return checked (specific force, angular rate), FRD."""
    checks.present(message.angular_velocity_covariance, "angular rate")
    rate, force = checks.xyz(message.angular_velocity), checks.xyz(message.linear_acceleration)
    checks.finite(rate, "angular rate")
    checks.magnitude(rate, rules.max_angular_rate, "angular rate implausible, degrees per second?")
    checks.finite(force, "specific force")
    checks.magnitude(force, rules.max_specific_force, "specific force implausible")
    return conv.swap_body(np.array(force)), conv.swap_body(np.array(rate))


def _decode_raw(message: Any, received: Received) -> ImuBlock:
    received.frame(message.header.frame_id)
    checks.present(message.linear_acceleration_covariance, "specific force")
    force, rate = _vectors(message, received.rules)
    return ImuBlock(*received.head, np.array([received.head[0]]), force[np.newaxis], rate[np.newaxis])


def _vectors_many(rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    rate, force = rows.parts("angular_velocity"), rows.parts("linear_acceleration")
    rows.within(rate, rows.received.rules.max_angular_rate)
    rows.within(force, rows.received.rules.max_specific_force)
    rows.keep(rows["angular_velocity_covariance"][:, 0] != -1.0)
    return conv.swap_body(force), conv.swap_body(rate)


def _raw_many(rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    rows.keep(rows["linear_acceleration_covariance"][:, 0] != -1.0)
    return _vectors_many(rows)


def _attitude_many(rows: Rows) -> tuple[Any, ...]:
    truth = rows.received.kind.name == "truth/imu"
    covariances = rows.covariances(rows["orientation_covariance"], "orientation", conv.swap_world_cov, truth)
    q = rows.parts("orientation", "xyzw")
    rows.unit(q)
    force, rate = _vectors_many(rows)
    q_nb = conv.quats_from_ros(q)
    absent = rows["linear_acceleration_covariance"][:, 0] == -1.0
    if absent.any():
        force = force.copy()
        for k in np.flatnonzero(absent & rows.good):
            force[k] = unaccelerated(q_nb[k])
        rows.note(absent, f"{rows.received.kind.name}: {_FORCE_ABSENT}")
    return q_nb, covariances, rate, force


def orientation(message: Any, received: Received) -> tuple[np.ndarray, np.ndarray]:
    """Return the checked ``q_nb`` (4,) and its covariance (3, 3) of an Imu message object; raises Refusal."""
    received.frame(message.header.frame_id)
    cov = received.covariance(message.orientation_covariance, "orientation", received.kind.name == "truth/imu")
    cov_att = received.known(cov, conv.swap_world_cov)
    q = message.orientation
    checks.quaternion(q.x, q.y, q.z, q.w)
    return conv.quat_from_ros(q.x, q.y, q.z, q.w), cov_att


def unaccelerated(q_nb: np.ndarray) -> np.ndarray:
    """Return the specific force of unaccelerated flight at an attitude, FRD."""
    return quat_to_dcm(q_nb).T @ np.array([0.0, 0.0, -STANDARD_GRAVITY])


def decode_attitude(message: Any, received: Received) -> Attitude:
    """Turn an Imu message object with orientation into an attitude.

    Where the message has no acceleration (its covariance begins with -1) the specific force of unaccelerated flight stands in, and
    ``notes`` records it.

    Raises
    ------
    Refusal
        For anything implausible, by a fixed phrase.
    """
    q_nb, cov_att = orientation(message, received)
    force, rate = _vectors(message, received.rules)
    if message.linear_acceleration_covariance[0] == -1.0:
        received.notes[f"{received.kind.name}: {_FORCE_ABSENT}"] += 1
        force = unaccelerated(q_nb)
    return Attitude(*received.head, q_nb, cov_att, rate, force)


def imu_raw(stamp_ns: int, specific_force_b: np.ndarray, angular_rate_b: np.ndarray, frame_id: str = "imu_link") -> Any:
    """Build an ``imu/data_raw`` message of one sample (m/s^2 and rad/s, FRD): orientation absent, covariances unknown."""
    return Imu(header(stamp_ns, frame_id), _NO_TURN, ABSENT, flu(angular_rate_b), UNKNOWN, flu(specific_force_b), UNKNOWN)


def _encode_raw(block: ImuBlock) -> Any:
    if len(block) != 1:
        raise TypeError(f"A block of {len(block)} samples from {block.source} has no message of its own.")
    return imu_raw(block.stamp_ns, block.specific_force_b[0], block.angular_rate_b[0])


def imu_raw_cdr(block: ImuBlock, frame_id: str = "imu_link") -> list[bytes]:
    """Return the CDR bytes of every sample of a block: what ``to_cdr(imu_raw(...))`` gives, made in columns."""
    first = to_cdr(imu_raw(0, np.zeros(3), np.zeros(3), frame_id))
    rate, force = conv.swap_body(block.angular_rate_b), conv.swap_body(block.specific_force_b)
    return messages_like(first, IMU, block.stamps_ns, {"angular_velocity": rate, "linear_acceleration": force})


def imu_attitude(attitude: Attitude, specific_force_known: bool = True) -> Any:
    """Build an ``imu/data`` message of an attitude; ``specific_force_known=False`` marks the acceleration absent."""
    force_cov = UNKNOWN if specific_force_known else ABSENT
    return imu_message(attitude.stamp_ns, attitude.q_nb, attitude.cov_att, attitude.angular_rate_b, attitude.specific_force_b, force_cov)


def imu_from_solution(solution: NavSolution) -> Any:
    """Build an ``imu/data`` message from a solution that has an attitude: attitude, its covariance, corrected rate and specific force.

    Raises
    ------
    ValueError
        For a solution without attitude or rates.
    """
    if solution.q_nb is None or solution.cov_att is None or solution.angular_rate_b is None:
        raise ValueError(f"Solution of {solution.source} has no attitude and rate, so it cannot become an Imu message.")
    force, force_cov = (np.zeros(3), ABSENT) if solution.specific_force_b is None else (solution.specific_force_b, UNKNOWN)
    return imu_message(solution.stamp_ns, solution.q_nb, solution.cov_att, solution.angular_rate_b, force, force_cov)


def imu_message(stamp_ns: int, q_nb: np.ndarray, cov_att: np.ndarray, rate: np.ndarray, force: np.ndarray, force_cov: np.ndarray) -> Any:
    """Build an Imu message with orientation."""
    cov = np.ravel(conv.swap_world_cov(cov_att))
    return Imu(header(stamp_ns, "base_link"), quaternion(q_nb), cov, flu(rate), UNKNOWN, flu(force), force_cov)


def _attitude_from_row(row: TableRow) -> Any:
    q_nb = row["quaternion"] if "quaternion" in row.values else euler_to_quat(*row["euler"])
    known = "force" in row.values
    attitude = row.of(Attitude, q_nb, row.cov(), row["rate"], row["force"] if known else np.zeros(3))
    return imu_attitude(attitude, specific_force_known=known)


def _attitude_numbers(rows: TableRow) -> dict[str, np.ndarray]:
    values = rows.values
    q_nb = values["quaternion"] if "quaternion" in values else np.array([euler_to_quat(*euler) for euler in values["euler"]])
    found = {"orientation": conv.quats_to_ros(q_nb), "orientation_covariance": conv.swap_world_covs(rows.covs())}
    vectors = {"angular_velocity": "rate", "linear_acceleration": "force"}
    return found | {name: conv.swap_body(values[field]) for name, field in vectors.items() if field in values}


def _raw_sample(at: Instant) -> ImuBlock:
    stamps = at.stamp_ns - round(1e9 * STEP_S / _SAMPLES) * np.arange(_SAMPLES)[::-1]
    return ImuBlock.of(at.source, stamps, np.tile(FORCE, (_SAMPLES, 1)), np.zeros((_SAMPLES, 3)))


def attitude_sample(at: Instant) -> Attitude:
    """Return the attitude of level flight."""
    return at.of(Attitude, LEVEL, 1e-4 * np.eye(3), np.zeros(3), FORCE)


_RATE, _SIGMA = Quantity(3, "angular rate", True, BODY_AXES), Quantity(3, "angle")
describe(
    __name__,
    TopicSpec("imu/data_raw", IMU, "Specific force and angular rate; orientation_covariance[0] = -1.", "imu_link", "m/s^2, rad/s"),
    measurement=ImuBlock,
    decode=_decode_raw,
    encode=_encode_raw,
    frames=BODY_FRAMES,
    fields={"force": Quantity(3, "acceleration", True, BODY_AXES), "rate": _RATE},
    options=("mounting_deg",),
    from_row=lambda rows: ImuBlock.of(rows.head[1], rows.head[0], rows.mounted("force"), rows.mounted("rate")),
    sample=_raw_sample,
    sensed=True,
    fast=imu_columns.one,
    many=_raw_many,
    encode_many=imu_raw_cdr,
)
_ORIENTATION = {"quaternion": Quantity(4, "number", False, ("FRD to NED",)), "euler": Quantity(3, "angle", False)}

ATTITUDE = {
    "measurement": Attitude,
    "decode": decode_attitude,
    "encode": imu_attitude,
    "frames": BODY_FRAMES,
    "variances": (3.0e-4, 3.0e-4, 1.2e-3),  # 1 deg roll and pitch, 2 deg heading
    "fields": {**_ORIENTATION, "rate": _RATE, "force": Quantity(3, "acceleration", False, BODY_AXES), "sigma": _SIGMA},
    "from_row": _attitude_from_row,
    "numbers": _attitude_numbers,
    "sample": attitude_sample,
    "fast": imu_columns.attitude,
    "many": _attitude_many,
}
describe(
    __name__,
    TopicSpec("imu/data", IMU, "The AHRS attitude (true heading) with bias-corrected rates, low latency.", "base_link", "rad/s, m/s^2"),
    TopicSpec("imu/data_fused", IMU, "The AHRS attitude at the fusion horizon: repeatable.", "base_link", "rad/s, m/s^2"),
    **ATTITUDE,
)
describe(
    __name__,
    TopicSpec("hars/attitude", IMU, "A heading and attitude reference: magnetic heading, acceleration absent.", "base_link", "rad/s"),
    **(ATTITUDE | {"encode": lambda sent: imu_attitude(sent, specific_force_known=False), "sensed": True}),
)
