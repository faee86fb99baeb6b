"""The fast way through single Imu messages: the fixed CDR layout read by offset.

Little-endian CDR of sensor_msgs/Imu: 4 bytes of encapsulation, then sec (int32), nanosec (uint32), length of frame_id with its zero
(uint32), the text, padding to 8, and 37 doubles: orientation 4, covariance 9, angular rate 3, covariance 9, acceleration 3,
covariance 9.  Only messages that are clean at first sight pass; all others go through the careful decoder, which names what is wrong.
Of the last two covariances, which no filter uses, only the mark of an absent datum is looked at.
"""

import struct

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, ImuBlock
from lowcostnav_ros.base.small_matrices import at_least
from lowcostnav_ros.messages.checks import LEAST_SIGMA, covariance
from lowcostnav_ros.messages.conversions import quat_from_ros, swap_world_cov
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.messages.rules import DecodeRules, Refusal

_HEAD = struct.Struct("<iII")
_TO_RATE = struct.Struct("<13d")
_RATE_TO_END = struct.Struct("<24d")
_DOUBLES = 37
_RATE = 13
_ABSENT = -1.0


def one(raw: bytes | memoryview, kind: Kind, rules: DecodeRules) -> ImuBlock | None:
    """Return a block of one sample, or None where the message needs the careful decoder."""
    head = _head(raw, kind)
    if head is None:
        return None
    stamp, start = head
    v = _RATE_TO_END.unpack_from(raw, start + 8 * _RATE)
    if not _sound_vectors(v, rules):
        return None
    f, w = np.array(((v[12], -v[13], -v[14]),)), np.array(((v[0], -v[1], -v[2]),))
    return ImuBlock(stamp, kind.name, np.array((stamp,)), f, w)


def attitude(raw: bytes | memoryview, kind: Kind, rules: DecodeRules) -> Attitude | None:
    """Return the attitude of an ``imu/data`` message, or None where it needs the careful decoder."""
    head = _head(raw, kind)
    if head is None:
        return None
    stamp, start = head
    x, y, z, w, *cov = _TO_RATE.unpack_from(raw, start)
    v = _RATE_TO_END.unpack_from(raw, start + 8 * _RATE)
    norm2 = x * x + y * y + z * z + w * w
    if not _sound_vectors(v, rules) or not 0.981 < norm2 < 1.019:
        return None
    try:
        matrix = covariance(cov, "orientation")
    except Refusal:
        return None  # the careful decoder finds the same and names it
    if matrix is None or at_least(matrix, LEAST_SIGMA["orientation"]) is not matrix:
        return None
    force, rate = np.array((v[12], -v[13], -v[14])), np.array((v[0], -v[1], -v[2]))
    return Attitude(stamp, kind.name, quat_from_ros(x, y, z, w), swap_world_cov(matrix), rate, force)


def _head(raw: bytes | memoryview, kind: Kind) -> tuple[int, int] | None:
    """Return (stamp ns, offset of the doubles) of a message that looks right so far."""
    size = len(raw)
    if size < 16 or raw[0] != 0 or raw[1] != 1:
        return None
    sec, nanosec, frame_size = _HEAD.unpack_from(raw, 4)
    start = _doubles_start(frame_size)
    if not 0 <= size - start - 8 * _DOUBLES <= 3 or not _frame_is_known(raw, frame_size, kind):
        return None
    if sec < 0 or nanosec >= 1_000_000_000 or sec == nanosec == 0:
        return None
    return sec * 1_000_000_000 + nanosec, start


def _sound_vectors(v: tuple[float, ...], rules: DecodeRules) -> bool:
    """Say whether rate and force, of 24 numbers with their covariances, are there and plausible; NaN fails every comparison."""
    rate, force = rules.max_angular_rate, rules.max_specific_force
    small = -rate <= v[0] <= rate and -rate <= v[1] <= rate and -rate <= v[2] <= rate
    light = -force <= v[12] <= force and -force <= v[13] <= force and -force <= v[14] <= force
    return small and light and v[3] != _ABSENT and v[15] != _ABSENT


def _doubles_start(frame_size: int) -> int:
    return 4 + ((12 + frame_size + 7) & -8)  # alignment counts from behind the encapsulation


def _frame_is_known(raw: bytes | memoryview, frame_size: int, kind: Kind) -> bool:
    if not 1 < frame_size < 200:
        return False
    name = bytes(raw[16 : 15 + frame_size])
    if raw[15 + frame_size] != 0 or not name.isascii():
        return False
    return not kind.frames or name.decode().rpartition("/")[2] in kind.frames
