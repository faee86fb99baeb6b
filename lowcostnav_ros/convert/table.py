"""Reading one recorded table: named columns as arrays, malformed rows counted by line and skipped."""

import gzip
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from lowcostnav_ros.base.documents import cells_of, delimiter_of, foreign_text
from lowcostnav_ros.base.settings import nearest, shown
from lowcostnav_ros.convert.profile import ConvertError, TableProfile

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(slots=True)
class Table:
    """Columns of the usable rows.

    Attributes
    ----------
    numbers : dict of column name to ndarray
    written_ns : list of int
        Time of each row, ns since 1970, where the profile reads it as text.
    row_end : ndarray of int
        Byte count of the file up to and including each row, as it was when recorded.
    lines : list of int
        Line of each row.
    malformed : list of (line number, reason)
    total : int
        Data rows seen.
    """

    numbers: dict[str, np.ndarray]
    written_ns: list[int]
    row_end: np.ndarray
    lines: list[int] = field(default_factory=list)
    malformed: list[tuple[int, str]] = field(default_factory=list)
    total: int = 0


def read_table(path: Path, profile: TableProfile) -> Table:
    """Read the columns a profile needs.

    Raises
    ------
    ConvertError
        For a file without rows, a column that is not there, or a file in which every row is malformed.
    """
    lines = _lines(path, profile.time.line_end_bytes)
    names, delimiter = _header(lines, profile, path) if not profile.columns else (profile.columns, profile.delimiter)
    wanted = sorted(profile.needed())
    where = _places(wanted, names, path)
    text_places = _places(profile.time.columns, names, path) if profile.time.text_format else []
    time_places = [] if profile.time.text_format else [wanted.index(name) for name in profile.time.columns]
    rows: list[list[float]] = []
    table = Table({}, [], np.zeros(0, int))
    ends: list[int] = []
    for number, end, line in lines:
        if not line.strip() or line.lstrip()[0] in profile.comment:
            continue
        table.total += 1
        delimiter = delimiter or delimiter_of(line)
        cells = cells_of(line, delimiter)
        if delimiter == ";":
            cells = [cell.replace(",", ".") for cell in cells]  # such tables come with a decimal comma
        if len(cells) < len(names):
            table.malformed.append((number, f"{len(cells)} columns instead of {len(names)}"))
            continue
        values, reason = numbers_of(cells, where, wanted)
        is_timed = all(math.isfinite(values[k]) for k in time_places)
        if text_places and is_timed:
            written, bad = written_ns(" ".join(cells[k] for k in text_places), profile.time.text_format)
            reason, is_timed = bad or reason, not bad
        if reason or not is_timed:
            table.malformed.append((number, reason or "no time"))
        if not is_timed:
            continue
        rows.append(values)
        ends.append(end)
        table.lines.append(number)
        if text_places:
            table.written_ns.append(written)
    if not rows:
        first = f"; the first is line {table.malformed[0][0]}: {table.malformed[0][1]}" if table.malformed else ""
        raise ConvertError(f"{path} has no usable row{first}; check delimiter and columns of the profile.")
    columns = np.array(rows).reshape(len(rows), len(wanted))
    table.numbers = {name: np.ascontiguousarray(columns[:, k]) for k, name in enumerate(wanted)}
    table.row_end = np.array(ends)
    return table


def _lines(path: Path, line_end_bytes: int) -> Iterator[tuple[int, int, str]]:
    """Yield (line number, bytes so far, text)."""
    opener = gzip.open if path.suffix == ".gz" else open
    end = 0
    try:
        with opener(path, "rb") as file:
            for number, raw in enumerate(file, 1):
                if number == 1 and raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
                    raise ConvertError(f"{path} is UTF-16 text; save it as UTF-8.")
                body = raw.rstrip(b"\r\n")
                end += len(body) + line_end_bytes
                yield number, end, foreign_text(body)
    except (OSError, EOFError, zlib.error) as error:
        raise ConvertError(f"{path} cannot be read to its end: {error}.") from error


def _header(lines: Iterator[tuple[int, int, str]], profile: TableProfile, path: Path) -> tuple[tuple[str, ...], str]:
    """Names of the columns and the delimiter."""
    for _number, _end, line in lines:
        if line.strip() and line.lstrip()[0] not in profile.comment:
            delimiter = profile.delimiter or delimiter_of(line)
            return tuple(cells_of(line, delimiter)), delimiter
    raise ConvertError(f"{path} is empty; check that it was recorded.")


def _places(wanted: list[str] | tuple[str, ...], names: tuple[str, ...], path: Path) -> list[int]:
    for name in wanted:
        if name not in names:
            raise ConvertError(f"{path} has no column '{name}'{nearest(name, names)}.")
    return [names.index(name) for name in wanted]


def numbers_of(cells: list[str], where: list[int], wanted: list[str]) -> tuple[list[float], str]:
    """The numbers of a row, NaN where a cell is empty or no number, and what is wrong with the first that is neither empty nor one."""
    values, reason = [], ""
    for name, k in zip(wanted, where, strict=True):
        cell = cells[k]
        try:
            value = float(cell) if cell else math.nan
        except ValueError:
            value = math.nan
            reason = reason or f"'{name}' is not a number"
        if cell and not math.isfinite(value):
            reason, value = reason or "a value is not finite", math.nan
        values.append(value)
    return values, reason


def written_ns(text: str, text_format: str) -> tuple[int, str]:
    try:
        read = datetime.strptime(text, text_format)
        since = (read if read.tzinfo else read.replace(tzinfo=UTC)) - _EPOCH  # a stated zone is part of the time
    except (ValueError, OverflowError):
        return 0, f"'{shown(text, str)}' is not a time of the form '{text_format}'"
    return (since.days * 86400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000, ""


def is_number(text: str) -> bool:
    """Whether ``text`` reads as a number, NaN and infinity among them."""
    try:
        float(text)
    except ValueError:
        return False
    return True
