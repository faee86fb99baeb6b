"""A table as data: built once, drawn on a terminal or on a page by :mod:`lowcostnav_ros.report`."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any


@dataclass(frozen=True, slots=True)
class Column:
    """One column.

    Attributes
    ----------
    head : str
    cell : callable
        Text of the cell from what the row is about.
    unit : str
    short : str
        Head where space is short, a terminal; lines are stacked.  Empty: the same.
    left : bool
        Aligned left, as words are; numbers are aligned right.
    page_only : bool
        Not drawn where space is short.
    """

    head: str
    cell: Callable[[Any], str]
    unit: str = ""
    short: str = ""
    left: bool = False
    page_only: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A title, columns, rows of texts, a colour for each row (none: empty) and sentences to stand below."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    colours: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, title: str, columns: Iterable[Column], items: Iterable[Any], **more: Any) -> "Table":
        """Build a table with a row for each item."""
        columns = tuple(columns)
        return cls(title, columns, tuple(tuple(c.cell(item) for c in columns) for item in items), **more)

    @classmethod
    def plain(cls, title: str, heads: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> "Table":
        """Build a table from texts; the first ``left`` columns are words."""
        columns = (Column(head, itemgetter(k), left=k < left) for k, head in enumerate(heads))
        return cls.of(title, columns, rows)


def number(value: float | None, digits: int = 3) -> str:
    """A number with ``digits`` significant digits, never in exponents; a dash for none."""
    if value is None:
        return "-"
    whole = len(str(int(abs(value)))) if abs(value) >= 1.0 else 1
    return f"{value:.{max(0, digits - whole)}f}"


def percent(share: float) -> str:
    """A share in per cent; 100 and 0 only where it is all and nothing."""
    if 0.0 < share < 1.0:
        return f"{min(99.9, max(0.1, 100.0 * share)):.3g}"
    return f"{100.0 * share:.0f}"
