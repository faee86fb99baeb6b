"""Rows of a table as they come off a port: a column profile read line by line, by the code that converts the recorded table."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from lowcostnav_ros.base.documents import cells_of, delimiter_of, foreign_text
from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.convert.convert import table_rows, topic_columns
from lowcostnav_ros.convert.profile import ConvertError, Profile, TableProfile
from lowcostnav_ros.convert.table import Table, numbers_of, written_ns
from lowcostnav_ros.convert.timebase import stamps_ns
from lowcostnav_ros.formats.framing import LineFramer
from lowcostnav_ros.formats.parser import BOOT, Parser
from lowcostnav_ros.messages.topics import spec


class TableParser(Parser):
    """Lines of one table, whose profile names the columns, or whose stream begins with a line of their names.

    Raises
    ------
    ConvertError
        For a profile of several tables, or one that needs a file of its own for the time.
    """

    clock: ClassVar[str] = BOOT

    def __init__(self, profile: Profile) -> None:
        super().__init__()
        if len(profile.tables) != 1 or profile.tables[0].time.tag_file:
            raise ConvertError("A stream is one table with its time in a column; give a profile of that.")
        self._profile: TableProfile = profile.tables[0]
        self._wanted = sorted(self._profile.needed())
        time = self._profile.time
        self.utc_offset_ns = 0 if time.text_format or time.epoch_s else None
        self._names, self._delimiter, self._rows = tuple(self._profile.columns), self._profile.delimiter, 0
        self.framer = LineFramer("table", self._is_sound)

    def _cells(self, line: bytes) -> list[str]:
        text = foreign_text(line)
        cells = cells_of(text, self._delimiter or delimiter_of(text))
        return [cell.replace(",", ".") for cell in cells] if (self._delimiter or delimiter_of(text)) == ";" else cells

    def _is_sound(self, line: bytes) -> bool:
        """Whether a line is a row, or the line of names; a comment is passed over."""
        if chr(line[0]) in self._profile.comment:
            return True
        cells = self._cells(line)
        if not self._names or self._is_header(cells):
            return self._is_header(cells)
        return len(cells) == len(self._names) and not self._row(cells)[1]

    def _is_header(self, cells: list[str]) -> bool:
        return {*self._wanted, *self._profile.time.columns} <= set(cells)

    def _row(self, cells: list[str]) -> tuple[list[float], str]:
        return numbers_of(cells, [self._names.index(name) for name in self._wanted], self._wanted)

    def take(self, protocol: str, frame: bytes) -> Iterator[Measurement]:
        """Turn a row into the measurements of its topics."""
        cells, profile = self._cells(frame), self._profile
        if chr(frame[0]) in profile.comment:
            return
        if self._is_header(cells):
            self._names = tuple(cells)
            return
        numbers = {name: np.array([value]) for name, value in zip(self._wanted, self._row(cells)[0], strict=True)}
        table = Table(numbers, [], np.zeros(1, int), [sum(self.framer.frames.values())])
        if profile.time.text_format:
            written, bad = written_ns(" ".join(cells[self._names.index(name)] for name in profile.time.columns), profile.time.text_format)
            if bad:
                self.account.refused["row without a time"] += 1
                return
            table.written_ns.append(written)
        elif not np.isfinite(numbers[profile.time.columns[0]][0]):
            self.account.refused["row without a time"] += 1
            return
        if not all(low <= numbers[name][0] <= high for name, (low, high) in profile.keep.items()):
            self.account.left_out["row beyond what the profile keeps"] += 1
            return
        self._rows += 1
        if (self._rows - 1) % profile.every == 0:
            yield from self._measured(table)

    def _measured(self, table: Table) -> Iterator[Measurement]:
        try:
            stamps = stamps_ns(table, self._profile.time, Path())
        except (ConvertError, OverflowError):
            self.account.refused["time before 1970 or after 2038"] += 1
            return
        for topic in self._profile.topics:
            there, columns = topic_columns(topic, table, np.ones(1, bool))
            places = [np.abs(columns[name]) <= limit for name, limit in (("lat", np.pi / 2), ("lon", np.pi)) if name in columns]
            if not there.any() or not np.all(places):
                self.account.refused[f"{topic.topic}: a number is missing, or latitude or longitude is none"] += 1
            elif self.is_new(f"{topic.topic} {topic.station}".rstrip(), int(stamps[0])):
                rows, kind = table_rows(topic, stamps, columns), spec(topic.topic)
                assert kind.from_row is not None  # the profile refuses a topic that has none
                one = kind.from_row(rows if kind.encode_many else rows.row(0))
                if isinstance(one, Measurement):
                    yield one
