"""The fingerprint of a fused solution, and the comparison of a replay with what the aircraft recorded.

A digest runs over the packed numbers of the messages (stamp as int64, the rest as float64, little endian), not over their bytes:
the padding of serialised messages is not defined, their numbers are.
"""

import hashlib
import struct
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, NavSolution
from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.columns import whole_table
from lowcostnav_ros.messages.samples import LEVEL
from lowcostnav_ros.messages.store import from_cdr
from lowcostnav_ros.messages.windows import Window
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.replay.columns import NavColumns
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


def _records(stamps_ns: np.ndarray, *numbers: np.ndarray) -> np.ndarray:
    """Records of n stamps as rows of 8-byte numbers, shape (n, m)."""
    return np.hstack([np.asarray(stamps_ns, "<i8").view("<f8")[:, np.newaxis], *numbers])


_FIELDS = {  # what the two functions above pack, in their order: vectors with their components, covariances with their diagonals
    topics.ODOMETRY: (
        *(("pose.pose.position", "xyz"), ("pose.pose.orientation", "xyzw"), ("twist.twist.linear", "xyz")),
        *(("pose.covariance", _DIAGONAL_6), ("twist.covariance", _DIAGONAL_6)),
    ),
    topics.IMU: (
        *(("orientation", "xyzw"), ("angular_velocity", "xyz"), ("linear_acceleration", "xyz"), ("orientation_covariance", _DIAGONAL_3)),
        *(("angular_velocity_covariance", _DIAGONAL_3), ("linear_acceleration_covariance", _DIAGONAL_3)),
    ),
}


def records_of_messages(window: Window, rows: np.ndarray, msgtype: str) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) and records (n, m) of fused messages in a window; those without a stamp, or malformed, are left out."""
    table = whole_table(window, rows, msgtype)
    if table is not None:
        stamps = table["header.stamp.sec"].astype(np.int64) * 1_000_000_000 + table["header.stamp.nanosec"]
        columns = [
            table[name][:, parts] if isinstance(parts, slice) else np.stack([table[f"{name}.{part}"] for part in parts], axis=1)
            for name, parts in _FIELDS[msgtype]
        ]
        records = _records(stamps, *columns)
    else:
        pack, found = imu_record if msgtype == topics.IMU else odometry_record, []
        for row in rows.tolist():
            with suppress(Exception):  # whatever a malformed buffer makes the parser raise
                found.append(pack(from_cdr(window.raw(row), msgtype)))
        records = np.frombuffer(b"".join(found), "<f8").reshape(len(found), -1 if found else 1)
        stamps = np.ascontiguousarray(records[:, 0]).view("<i8")
    return stamps[stamps > 0], records[stamps > 0]


def records_of_solutions(solutions: Sequence[NavSolution], columns: NavColumns, origin: LocalFrame | None) -> np.ndarray:
    """Records (n, m) of the fused messages of solutions, to the bit, without the messages: Odometry by an origin, Imu where it is None."""
    return _imu_records(solutions, columns) if origin is None else _odometry_records(solutions, columns, origin)


def _imu_records(solutions: Sequence[NavSolution], columns: NavColumns) -> np.ndarray:
    force = np.array([np.zeros(3) if s.specific_force_b is None else s.specific_force_b for s in solutions])
    absent = np.array([-1.0 if s.specific_force_b is None else 0.0 for s in solutions])
    variances = np.zeros((len(solutions), 9))
    variances[:, :3], variances[:, 6] = np.diagonal(columns.cov_att, axis1=1, axis2=2)[:, [1, 0, 2]], absent
    rates = np.array([s.angular_rate_b for s in solutions], float)
    return _records(columns.stamps_ns, conv.quats_to_ros(columns.q_nb), conv.swap_body(rates), conv.swap_body(force), variances)


def _odometry_records(solutions: Sequence[NavSolution], columns: NavColumns, origin: LocalFrame) -> np.ndarray:
    has_pos, has_att, has_vel = (np.isfinite(getattr(columns, name)[:, :1]) for name in ("position", "q_nb", "vel_n"))
    unknown = np.eye(3) * conv.NOT_ESTIMATED
    pairs = (has_pos, columns.cov_pos), (has_att, columns.cov_att), (has_vel, columns.cov_vel)
    cov_pos, cov_att, cov_vel = (np.where(known[:, :, np.newaxis], cov, unknown) for known, cov in pairs)
    places = np.where(has_pos, columns.position, (origin.lat, origin.lon, origin.height))
    q_nb, vel_n = np.where(has_att, columns.q_nb, LEVEL), np.where(has_vel, columns.vel_n, 0.0)
    in_map = places, q_nb, cov_pos, cov_att, vel_n, cov_vel, origin.origin_e, origin.C_le
    positions, q_map, velocities, variances = conv.maps_from_local(*in_map)
    rates = np.array([conv.NOT_ESTIMATED if s.angular_rate_b is None else UNKNOWN_VARIANCE for s in solutions])
    return _records(columns.stamps_ns, positions, conv.quats_to_ros(q_map), velocities, variances, np.tile(rates[:, np.newaxis], 3))


class Digest:
    """SHA-256 over records in order, with their count."""

    def __init__(self) -> None:
        self.count = 0
        self._sha = hashlib.sha256()

    def add(self, records: np.ndarray) -> None:
        """Add packed records (n, m)."""
        self.count += len(records)
        self._sha.update(records.tobytes())

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

    def add_replayed(self, stamps_ns: np.ndarray, records: np.ndarray) -> None:
        """Take replayed records (n, m) in, stamps not decreasing."""
        self.replayed.add(records)
        if self.expected:
            self._replayed.extend(zip(stamps_ns.tolist(), _short(records), strict=True))

    def add_recorded(self, stamps_ns: np.ndarray, records: np.ndarray) -> None:
        """Take recorded records (n, m) in, stamps not decreasing, and compare what can be compared."""
        self.recorded.add(records)
        self._recorded.extend(zip(stamps_ns.tolist(), _short(records), strict=True))
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


def _short(records: np.ndarray) -> list[bytes]:
    return [hashlib.blake2b(record, digest_size=16).digest() for record in np.ascontiguousarray(records)]
