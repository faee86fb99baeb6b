"""The recording that a conversion makes: every message checked as a navigator would check it, put in order, and accounted for."""

import heapq
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock, MagneticField, Measurement
from lowcostnav_ros.base.text import counted
from lowcostnav_ros.base.units import STANDARD_GRAVITY
from lowcostnav_ros.formats.log import AUTOPILOT, Series, own_solution
from lowcostnav_ros.formats.parser import Account
from lowcostnav_ros.formats.records import CheckedRecords
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.encode import Record, encode_rows
from lowcostnav_ros.messages.samples import TableRow
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.messages.topics import spec
from lowcostnav_ros.physics.mounting import mounting_dcm

MOUNTING_SAMPLES = 200
"""Inertial samples before their mean says anything of gravity."""
REORDER_NS = 10 * 10**9
"""How far out of order records may come; beyond, they are written where they came."""
WINDOW_NS = 20 * 10**9
"""Time of a log that is turned into messages at once: bounds memory."""


@dataclass(slots=True)
class Found:
    """What was written of a topic: number, first and last stamp, longest time without."""

    messages: int = 0
    first_ns: int = 0
    last_ns: int = 0
    longest_ns: int = 0

    def add(self, stamp_ns: int) -> None:
        """Count a message."""
        if self.messages:
            self.longest_ns = max(self.longest_ns, stamp_ns - self.last_ns)
        else:
            self.first_ns = stamp_ns
        self.messages, self.last_ns = self.messages + 1, stamp_ns

    @property
    def hertz(self) -> float:
        """Mean rate."""
        return (self.messages - 1) / max(1e-9 * (self.last_ns - self.first_ns), 1e-9) if self.messages > 1 else 0.0


LACKING = {
    "No inertial samples and no attitude: gnss_only alone can fly, on raw satellites.": ("imu/data_raw", "imu/data", "imu/data_fused"),
    "No GPS: a navigator has no starting position, and no outage can be studied.": ("gps/fix", "gnss/raw"),
}
"""What is said of a recording that has none of these topics."""


@dataclass(slots=True)
class Summary:
    """What a conversion found and did, printed line by line."""

    format: str
    time_base: str
    found: dict[str, Found]
    account: Account
    rejected: dict[str, int] = field(default_factory=dict)

    @property
    def messages(self) -> dict[str, int]:
        """Number written by topic."""
        return {topic: one.messages for topic, one in self.found.items()}

    @property
    def heading(self) -> str:
        """Format, duration, start and time base."""
        first, last = min(one.first_ns for one in self.found.values()), max(one.last_ns for one in self.found.values())
        when = datetime.fromtimestamp(first // 10**9, tz=UTC)
        return f"{self.format}: {1e-9 * (last - first):.1f} s from {when:%Y-%m-%d %H:%M:%S}, {self.time_base}"

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """What was written: topic, number, rate in Hz, longest gap in s, and of what it was made."""
        origins, rows = self.account.origins, []
        for topic, one in sorted(self.found.items()):
            gap = f"{1e-9 * one.longest_ns:.2f}" if one.messages > 1 else "-"
            origin = origins.get(topic) or origins.get(topic.partition("/")[0]) or origins.get(f"{topic}_fused", "")
            rows.append((topic, f"{one.messages}", f"{one.hertz:.1f}", gap, origin))
        return rows

    def notes(self) -> list[str]:
        """What was refused, what was left out, and what else there is to say."""
        lines = []
        if self.account.refused or self.rejected:
            lines.append(f"refused: {counted({**self.account.refused, **self.rejected})}")
        if self.account.left_out:
            names = sorted(self.account.left_out.items(), key=lambda item: -item[1])
            shown = ", ".join(f"{name} ({count})" for name, count in names[:12])
            lines.append(f"not converted, no topic takes it: {shown}{f' and {len(names) - 12} more' if len(names) > 12 else ''}")
        lines += [sentence for sentence, topics in LACKING.items() if not any(topic in self.found for topic in topics)]
        return [*lines, *self.account.remarks]

    def __str__(self) -> str:
        """Return lines for a terminal."""
        lines = [self.heading, "messages       Hz  longest gap  topic                from"]
        for topic, count, hertz, gap, origin in self.rows():
            lines.append(f"{count:>8s} {hertz:>8s}  {f'{gap} s' if gap != '-' else gap:>11s}  {topic:19s}  {origin}")
        return "\n".join([*lines, *self.notes()])


class Standard:
    """Writes measurements and columns to a recording, in order of stamp within :data:`REORDER_NS`.

    ``mounting_deg`` is the rotation (roll, pitch, yaw) from the axes of the inertial sensor and the magnetometer to those of the body.
    """

    def __init__(self, bag: BagWriter, mounting_deg: tuple[float, float, float] | None = None) -> None:
        self._mounting = () if mounting_deg is None else (mounting_deg,)
        self._turn = mounting_dcm(self._mounting)
        self._force_sum, self._samples = np.zeros(3), 0
        self.found: dict[str, Found] = {}
        self._bag, self._checked = bag, CheckedRecords()
        self._waiting: list[tuple[int, int, Record]] = []
        self._count = self._newest_ns = 0

    def put(self, measurement: Measurement) -> None:
        """Write one measurement, or count why not."""
        if self._turn is not None and isinstance(measurement, MagneticField):
            measurement = replace(measurement, field_b=self._turn @ measurement.field_b)
        if isinstance(measurement, ImuBlock):
            if self._turn is not None:
                force, rate = (vectors @ self._turn.T for vectors in (measurement.specific_force_b, measurement.angular_rate_b))
                measurement = replace(measurement, specific_force_b=force, angular_rate_b=rate)
            self._force_sum += measurement.specific_force_b.sum(axis=0)
            self._samples += len(measurement)
        self._add(self._checked.of(measurement))

    def put_message(self, stamp_ns: int, topic: str, msgtype: str, message: Any) -> None:
        """Write one message object, or count why not."""
        self._add(self._checked.sound([(stamp_ns, topic, msgtype, to_cdr(message))]))

    def put_series(self, series: Iterable[Series]) -> None:
        """Write columns, a window of time after the other."""
        series = list(series)
        if not series:
            return
        begin, end = min(int(one.stamps_ns[0]) for one in series), max(int(one.stamps_ns[-1]) for one in series)
        for start in range(begin, end + 1, WINDOW_NS):
            for one in series:
                first, last = np.searchsorted(one.stamps_ns, (start, start + WINDOW_NS))
                if last > first:
                    self._put_rows(one, slice(first, last))

    def close(self) -> None:
        """Write what still waits for its turn."""
        while self._waiting:
            self._write(heapq.heappop(self._waiting)[2])

    def mounting_remark(self) -> str:
        """One sentence where gravity does not lie where a body's axes have it, which a turned sensor or other axes explain; else empty."""
        mean = self._force_sum / max(self._samples, 1)
        if self._samples < MOUNTING_SAMPLES or not 0.7 < np.linalg.norm(mean) / STANDARD_GRAVITY < 1.3 or -mean[2] > 0.7 * STANDARD_GRAVITY:
            return ""
        roll, pitch = np.arctan2(-mean[1], -mean[2]), np.arctan2(mean[0], np.hypot(mean[1], mean[2]))
        turn = ",".join(f"{45 * round(np.degrees(angle) / 45) % 360}" for angle in (roll, pitch))
        seen = ", ".join(f"{value:.1f}" for value in mean)
        return (
            f"The mean specific force is ({seen}) m/s^2 forward right down, not (0, 0, -9.8) as in level flight: the sensor is turned "
            f"or has other axes; --mounting={turn},0 makes it level (give its heading as the last angle)."
        )

    def rejected(self) -> dict[str, int]:
        """Messages that the decoder refused, by topic and phrase."""
        return self._checked.refused()

    def _put_rows(self, series: Series, rows: slice) -> None:
        stamps, fields = series.stamps_ns[rows], {name: values[rows] for name, values in series.fields.items()}
        if series.topic == AUTOPILOT:
            rest = ({name: column[k] for name, column in fields.items()} for k in range(len(stamps)))
            self._add(self._checked.of(*map(own_solution, stamps.tolist(), rest)))
            return
        if spec(series.topic).measurement is ImuBlock:
            self.put(ImuBlock.of(series.topic, stamps, fields["force"], fields["rate"]))
            return
        self._add(self._checked.sound(encode_rows(TableRow((stamps, series.topic), fields, self._mounting))))

    def _add(self, records: list[Record]) -> None:
        for record in records:
            self._count += 1
            heapq.heappush(self._waiting, (record[0], self._count, record))
            self._newest_ns = max(self._newest_ns, record[0])
        while self._waiting and self._waiting[0][0] < self._newest_ns - REORDER_NS - WINDOW_NS:
            self._write(heapq.heappop(self._waiting)[2])

    def _write(self, record: Record) -> None:
        stamp_ns, topic, msgtype, cdr = record
        self._bag.write(topic, msgtype, stamp_ns, cdr)
        self.found.setdefault(topic, Found()).add(stamp_ns)

