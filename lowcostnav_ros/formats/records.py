"""Measurements to messages that a navigator would accept: each is encoded and decoded again, so that its checks stand in one place."""

import numpy as np

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.messages.decode import Decoder, Rejected
from lowcostnav_ros.messages.encode import Record, encode_cdr, odometry_from_solution, origin_fix
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.messages.topics import NAV_SAT_FIX, ODOMETRY
from lowcostnav_ros.messages.windows import Window
from lowcostnav_ros.physics.earth import LocalFrame

LATEST_NS = 2**31 * 10**9
"""A message holds seconds in 31 bits."""


class CheckedRecords:
    """Turns measurements into records; what the decoder refuses, by its ranges and units, is counted and goes no further."""

    def __init__(self) -> None:
        self.decoder = Decoder()
        self._origins: dict[str, LocalFrame] = {}

    def of(self, *measurements: Measurement) -> list[Record]:
        """Return the records of measurements; of a recorder's own solution its odometry, with the origin of its map first."""
        records = list[Record]()
        for one in measurements:
            if not 0 < one.stamp_ns < LATEST_NS:
                self.decoder.count(Rejected(one.source, "stamp out of range", f"{one.stamp_ns} ns"), one.source)
            else:
                records += self._odometry(one) if isinstance(one, NavSolution) else encode_cdr(one)
        return self.sound(records)

    def sound(self, records: list[Record]) -> list[Record]:
        """Return those records that the decoder accepts."""
        window, good = Window.of_messages([(topic, stamp_ns, cdr) for stamp_ns, topic, _, cdr in records]), np.zeros(len(records), bool)
        for _, rows in window.by_source():
            found, rest = self.decoder.decode_many(window, rows, records[rows[0]][2])
            good[np.concatenate([*(columns.rows for columns in found), np.array([row for row, _ in rest], int)])] = True
        return [records[row] for row in np.flatnonzero(good)]

    def refused(self) -> dict[str, int]:
        """Messages that the decoder refused, by topic and phrase."""
        return {f"{source}: {reason}": count for (source, reason), count in self.decoder.rejected.items()}

    def _odometry(self, solution: NavSolution) -> list[Record]:
        name, records = solution.source, list[Record]()
        if name not in self._origins:
            self._origins[name] = LocalFrame(*solution.place)
            origin = origin_fix(solution.stamp_ns, self._origins[name])
            records.append((solution.stamp_ns, f"{name}/origin", NAV_SAT_FIX, to_cdr(origin)))
        odometry = odometry_from_solution(solution, self._origins[name])
        return [*records, (solution.stamp_ns, f"{name}/odometry", ODOMETRY, to_cdr(odometry))]
