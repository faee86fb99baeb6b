"""Measurements to messages that a navigator would accept: each is encoded and decoded again, so that its checks stand in one place."""

from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock, Measurement, NavSolution
from lowcostnav_ros.messages.decode import Decoder, Rejected
from lowcostnav_ros.messages.encode import encode_cdr, odometry_from_solution, origin_fix
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.messages.topics import NAV_SAT_FIX, ODOMETRY, spec
from lowcostnav_ros.physics.earth import LocalFrame

Record = tuple[int, str, str, bytes]
"""Stamp in ns, topic, message type, CDR bytes."""
LATEST_NS = 2**31 * 10**9
"""A message holds seconds in 31 bits."""


class CheckedRecords:
    """Turns measurements into records; what the decoder refuses, by its ranges and units, is counted and goes no further."""

    def __init__(self) -> None:
        self.decoder = Decoder()
        self._origins: dict[str, LocalFrame] = {}

    def of(self, measurement: Measurement) -> list[Record]:
        """Return the records of a measurement; of a recorder's own solution its odometry, with the origin of its map first."""
        if not 0 < measurement.stamp_ns < LATEST_NS:
            self.decoder.count(Rejected(measurement.source, "stamp out of range", f"{measurement.stamp_ns} ns"), measurement.source)
            return []
        if isinstance(measurement, ImuBlock):
            return self._inertial(measurement)
        encoded = self._odometry(measurement) if isinstance(measurement, NavSolution) else list(encode_cdr(measurement))
        return [record for record in encoded if self._is_sound(record)]

    def of_message(self, stamp_ns: int, topic: str, msgtype: str, message: Any) -> list[Record]:
        """Return the record of a message object."""
        record = stamp_ns, topic, msgtype, to_cdr(message)
        return [record] if self._is_sound(record) else []

    def refused(self) -> dict[str, int]:
        """Messages that the decoder refused, by topic and phrase."""
        return {f"{source}: {reason}": count for (source, reason), count in self.decoder.rejected.items()}

    def _is_sound(self, record: Record) -> bool:
        return not isinstance(self.decoder.decode(*record[1:]), Rejected)

    def _inertial(self, block: ImuBlock) -> list[Record]:
        kind, encoded = spec(block.source), list(encode_cdr(block))
        if len(encoded) == 1:
            return encoded if self._is_sound(encoded[0]) else []
        _, good = self.decoder.decode_imu_block([record[3] for record in encoded], kind.name)
        return [encoded[row] for row in np.flatnonzero(good)]

    def _odometry(self, solution: NavSolution) -> list[Record]:
        name, records = solution.source, list[Record]()
        if name not in self._origins:
            self._origins[name] = LocalFrame(*solution.place)
            origin = origin_fix(solution.stamp_ns, self._origins[name])
            records.append((solution.stamp_ns, f"{name}/origin", NAV_SAT_FIX, to_cdr(origin)))
        odometry = odometry_from_solution(solution, self._origins[name])
        return [*records, (solution.stamp_ns, f"{name}/odometry", ODOMETRY, to_cdr(odometry))]
