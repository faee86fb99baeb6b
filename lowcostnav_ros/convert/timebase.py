"""Stamps of recorded rows: a column, a written date, or a counter fitted to the arrival times in a byte tag file."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from lowcostnav_ros.convert.profile import ConvertError, TimeBase
from lowcostnav_ros.convert.table import Table

_TAG_HEADER = 76
_WINDOW_S = 10.0
_DAY_NS = 86_400 * 1_000_000_000


def stamps_ns(table: Table, base: TimeBase, folder: Path) -> np.ndarray:
    """Return the stamp of every row, integer nanoseconds of UTC (or of the profile's own epoch), shape (n,).

    Raises
    ------
    ConvertError
        For a damaged tag file, or one that ends before the table.
    """
    shift = base.epoch_s + base.offset_s - base.leap_seconds
    if base.text_format:
        written = np.array(table.written_ns, np.int64)
        if not any(part in base.text_format for part in ("%d", "%j", "%x", "%c")):
            written = _since_midnight(written)
        return _dated(written * 1e-9 + shift, table, lambda: written + round(shift * 1e9))
    seconds = table.numbers[base.columns[0]] * base.factor
    if base.tag_file:
        seconds, start = _fitted(seconds, table.row_end, folder / base.tag_file)
        shift += start
    return _dated(seconds + shift, table, lambda: _nanoseconds(seconds, shift))


def _nanoseconds(seconds: np.ndarray, shift: float) -> np.ndarray:
    whole = np.floor(seconds)  # whole seconds apart, or a double of today's epoch would cost a quarter of a microsecond
    return (whole.astype(np.int64) + int(np.floor(shift))) * 1_000_000_000 + np.rint((seconds - whole + shift % 1.0) * 1e9).astype(np.int64)


def _since_midnight(written_ns: np.ndarray) -> np.ndarray:
    """Times of day, ns, counted from the first midnight: where they fall by half a day, the next day has begun."""
    time = written_ns % _DAY_NS
    return time + _DAY_NS * np.cumsum(np.diff(time, prepend=time[:1]) < -_DAY_NS // 2)


def _dated(seconds: np.ndarray, table: Table, stamps: Callable[[], np.ndarray]) -> np.ndarray:
    """Return the stamps, once it is clear that a message can carry every time, s since 1970."""
    wrong = np.flatnonzero(~((seconds >= 0.0) & (seconds < 2.0**31)))
    if len(wrong):
        which = "before 1970" if seconds[wrong[0]] < 0.0 else "after 2038"
        raise ConvertError(f"The time of line {table.lines[wrong[0]]} is {which}; correct the unit, or add 'epoch_s', the time at zero.")
    return stamps()


def read_tags(path: Path) -> tuple[float, np.ndarray, np.ndarray]:
    """Read a byte tag file.

    Layout: 60 bytes of text, uint32 tick, uint32 seconds and float64 fraction of the start time, then pairs of uint32: milliseconds
    since the start, bytes of the table received by then.

    Returns
    -------
    start_s : float
    elapsed_s, position : ndarray
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ConvertError(f"The tag file {path} cannot be read: {error.strerror}.") from error
    if len(raw) < _TAG_HEADER + 8 or not raw.startswith(b"TIMETAG"):
        raise ConvertError(f"{path} is not a time tag file; it must begin with TIMETAG and hold at least one tag.")
    start_s = float(np.frombuffer(raw, "<u4", 1, 64)[0]) + float(np.frombuffer(raw, "<f8", 1, 68)[0])
    pairs = np.frombuffer(raw, "<u4", (len(raw) - _TAG_HEADER) // 8 * 2, _TAG_HEADER).reshape(-1, 2)
    return start_s, pairs[:, 0] * 1e-3, pairs[:, 1].astype(np.int64)


def _fitted(counter_s: np.ndarray, row_end: np.ndarray, path: Path) -> tuple[np.ndarray, float]:
    """Return the counter carried to the clock of the tags, s since the returned start."""
    start_s, elapsed_s, position = read_tags(path)
    place = np.searchsorted(position, row_end)
    if place[-1] >= len(position):
        raise ConvertError(
            f"{path} ends at byte {position[-1]}, before the last row at {row_end[-1]}; check 'line_end_bytes' of the profile."
        )
    late = elapsed_s[place] - counter_s
    return counter_s + straight_line(counter_s, late), start_s


def straight_line(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a straight line through noisy ``y`` at ``x``, fitted to medians over 10 s: rows arrive in bursts, a mean would follow them."""
    window = ((x - x[0]) // _WINDOW_S).astype(int)
    starts = np.flatnonzero(np.diff(window, prepend=-1))
    parts = zip(np.split(x, starts[1:]), np.split(y, starts[1:]), strict=True)
    middle = np.array([(part_x.mean(), np.median(part_y), len(part_x)) for part_x, part_y in parts])
    if len(middle) < 2:
        return np.full_like(x, np.median(y))
    slope, level = np.polyfit(middle[:, 0] - x[0], middle[:, 1], 1, w=np.sqrt(middle[:, 2]))
    return level + slope * (x - x[0])
