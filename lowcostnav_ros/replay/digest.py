"""The fingerprint of a fused solution, and the comparison of a replay with what the aircraft recorded.

A digest runs over the packed numbers of the messages (stamp as int64, the rest as float64, little endian), not over their bytes:
the padding of serialised messages is not defined, their numbers are.
"""

import hashlib
import struct
from collections import deque
from typing import Any

import numpy as np

from lowcostnav_ros.replay.result import Fused

_DIAGONAL_6 = slice(None, None, 7)
_DIAGONAL_3 = slice(None, None, 4)


def odometry_record(msg: Any) -> bytes:
    """Pack a ``nav_msgs/Odometry``: stamp, position, orientation, linear velocity, diagonals of both covariances."""
    pose, twist = msg.pose.pose, msg.twist.twist
    position, q, v = pose.position, pose.orientation, twist.linear
    numbers = (position.x, position.y, position.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z)
    return _packed(msg, numbers, (msg.pose.covariance, _DIAGONAL_6), (msg.twist.covariance, _DIAGONAL_6))


def imu_record(msg: Any) -> bytes:
    """Pack a ``sensor_msgs/Imu``: stamp, orientation, rates, specific force, diagonals of the three covariances."""
    q, w, f = msg.orientation, msg.angular_velocity, msg.linear_acceleration
    numbers = (q.x, q.y, q.z, q.w, w.x, w.y, w.z, f.x, f.y, f.z)
    covariances = (msg.orientation_covariance, msg.angular_velocity_covariance, msg.linear_acceleration_covariance)
    return _packed(msg, numbers, *((c, _DIAGONAL_3) for c in covariances))


def _packed(msg: Any, numbers: tuple, *covariances: tuple) -> bytes:
    stamp_ns = msg.header.stamp.sec * 1_000_000_000 + msg.header.stamp.nanosec
    diagonals = [np.asarray(c, dtype="<f8")[diagonal].tobytes() for c, diagonal in covariances]
    return struct.pack(f"<q{len(numbers)}d", stamp_ns, *numbers) + b"".join(diagonals)


class Digest:
    """SHA-256 over records in order, with their count."""

    def __init__(self) -> None:
        self.count = 0
        self._sha = hashlib.sha256()

    def add(self, record: bytes) -> None:
        """Add one packed record."""
        self.count += 1
        self._sha.update(record)

    def __deepcopy__(self, _memo: dict) -> "Digest":
        copied = Digest()
        copied.count, copied._sha = self.count, self._sha.copy()
        return copied

    @property
    def hexdigest(self) -> str:
        """The digest so far, 64 hex digits."""
        return self._sha.hexdigest()


class Comparison:
    """Replayed against recorded records, both in stamp order, paired by stamp as they come.

    Equal means: over the span the recording covers, both hold the same stamps and at each stamp the same bits.  What the replay has
    before the first recorded stamp or after the last one (a recorder starts late and stops early) is counted, not held against it.

    Parameters
    ----------
    expected : bool
        False when there is no recording to compare with: only the replay's own digest is kept.
    """

    def __init__(self, expected: bool = True) -> None:
        self.expected = expected
        self.replayed = Digest()
        self.recorded = Digest()
        self.equal_count = 0
        self.differing_count = 0
        self.missing_count = 0
        self.outside_count = 0
        self.first_difference_ns: int | None = None
        self._replayed: deque[tuple[int, bytes]] = deque()
        self._recorded: deque[tuple[int, bytes]] = deque()

    def add_replayed(self, stamp_ns: int, record: bytes) -> None:
        """Take one replayed record in, stamps not decreasing."""
        self.replayed.add(record)
        if self.expected:
            self._replayed.append((stamp_ns, _short(record)))

    def add_recorded(self, stamp_ns: int, record: bytes) -> None:
        """Take one recorded record in, stamps not decreasing, and compare what can be compared."""
        self.recorded.add(record)
        self._recorded.append((stamp_ns, _short(record)))
        self._pair()

    def finish(self) -> None:
        """Compare the rest; call once, after the last record."""
        self._pair()
        for stamp_ns, _ in self._recorded:
            self.missing_count += 1
            self._differs(stamp_ns)
        self.outside_count += len(self._replayed)
        self._recorded.clear()
        self._replayed.clear()

    @property
    def equals_recorded(self) -> bool | None:
        """True, False, or None when nothing was recorded to compare with."""
        return None if self.recorded.count == 0 else self.differing_count + self.missing_count == 0

    def result(self) -> Fused:
        """Fingerprints and counts."""
        recorded, first = self.recorded.count > 0, self.first_difference_ns
        return Fused(
            self.replayed.hexdigest if self.replayed.count else None,
            self.recorded.hexdigest if recorded else None,
            self.equals_recorded,
            None if first is None else first / 1e9,
            self.replayed.count,
            self.recorded.count,
            self.equal_count,
            self.differing_count,
            self.missing_count,
            self.outside_count if recorded else 0,
        )

    def _pair(self) -> None:
        while self._replayed and self._recorded:
            (ours_ns, ours), (theirs_ns, theirs) = self._replayed[0], self._recorded[0]
            if ours_ns <= theirs_ns:
                self._replayed.popleft()
            if theirs_ns <= ours_ns:
                self._recorded.popleft()
            if ours_ns == theirs_ns and ours == theirs:
                self.equal_count += 1
            elif ours_ns == theirs_ns:
                self.differing_count += 1
                self._differs(ours_ns)
            elif ours_ns > theirs_ns:
                self.missing_count += 1
                self._differs(theirs_ns)
            elif self.equal_count + self.differing_count + self.missing_count == 0:
                self.outside_count += 1
            else:
                self.differing_count += 1
                self._differs(ours_ns)

    def _differs(self, stamp_ns: int) -> None:
        if self.first_difference_ns is None:
            self.first_difference_ns = stamp_ns


def _short(record: bytes) -> bytes:
    return hashlib.blake2b(record, digest_size=16).digest()
