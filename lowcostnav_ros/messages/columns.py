"""Messages of one topic decoded together, in columns: what is clean at first sight; the careful decoder names what is wrong with the rest.

A kind that has ``many`` works on :class:`Rows` with the checks it works with on one message.  What it cannot tell at a glance, as whether a
covariance is positive, is asked once for all messages that state the same, by the very function that checks a single message.
"""

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.messages.checks import Received
from lowcostnav_ros.messages.kind import Kind
from lowcostnav_ros.messages.layouts import SIZE, layout_of
from lowcostnav_ros.messages.rules import DecodeRules, Refusal
from lowcostnav_ros.messages.windows import Window

Swap = Callable[[np.ndarray], np.ndarray]
FEW = 3
"""So few messages are decoded one by one."""


class Rows:
    """Messages of one topic and layout as a table, and which of them have passed all checks so far.

    Attributes
    ----------
    received : Received
        What is known of all of them; its stamp means nothing.
    good : ndarray of bool, shape (n,)
    stamps_ns : ndarray of int64, shape (n,)
    """

    def __init__(self, table: np.ndarray, kind: Kind, rules: DecodeRules) -> None:
        self._table, self._noted = table, list[tuple[np.ndarray, Counter[str]]]()
        self.received = Received((0, kind.name), kind, rules, Counter())
        self.good = np.ones(len(table), bool)
        for name in table.dtype.names or ():
            if name.endswith(SIZE):
                self.keep(table[name] == table[name][0])
        sec, nanosec = (table[f"header.stamp.{part}"].astype(np.int64) for part in ("sec", "nanosec"))
        self.keep((sec >= 0) & (nanosec < 1_000_000_000) & (sec + nanosec > 0))
        self.stamps_ns = sec * 1_000_000_000 + nanosec
        self.each(table["header.frame_id"], lambda text: self.received.frame(_text(text)))

    def __len__(self) -> int:
        return len(self._table)

    def __getitem__(self, name: str) -> np.ndarray:
        """One field of all messages, contiguous, shape (n,) or (n, elements)."""
        return np.ascontiguousarray(self._table[name])

    def parts(self, name: str, parts: str = "xyz") -> np.ndarray:
        """Components of a vector or a quaternion, shape (n, len(parts))."""
        return np.stack([self._table[f"{name}.{part}"] for part in parts], axis=1)

    def text(self, name: str, expected: Callable[[str], bool]) -> None:
        """Pass messages with a string that is as expected."""
        self.keep(np.array(self.each(self._table[name], lambda raw: expected(_text(raw))), bool))

    def keep(self, passed: np.ndarray) -> None:
        """Pass some messages, by a mask (n,), and fail the others."""
        self.good &= passed

    def within(self, values: np.ndarray, limit: float) -> None:
        """Pass messages whose values (n, k) are all numbers no larger than a limit."""
        self.keep((np.abs(values) <= limit).all(axis=1))

    def unit(self, quaternions: np.ndarray) -> None:
        """Pass messages whose quaternions (n, 4) are of unit norm."""
        norm = np.sqrt((quaternions * quaternions).sum(axis=1))
        self.keep(np.abs(norm - 1.0) <= 0.0099)  # nearer to the limit than round-off, the careful decoder decides

    def each(self, values: np.ndarray, check: Callable[[Any], Any]) -> list[Any]:
        """Check each of ``values`` (n, ...), the same one but once; return what the check makes of it, None for what it refuses."""
        flat = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
        if (flat == flat[0]).all():
            keys: Sequence[Any] = [b""] * len(flat)
        else:
            keys = np.ascontiguousarray(flat).view(f"V{flat.shape[1]}").ravel().tolist()
        known: dict[Any, Any] = {}
        out = []
        for k, key in enumerate(keys):
            if key not in known:
                known[key] = self._checked(values[k], check)
            out.append(known[key])
        if any(bad for bad, _, _ in known.values()):
            self.keep(np.array([not one[0] for one in out], bool))
        for one in known.values():
            if one[1]:
                self._noted.append((np.array([other is one for other in out], bool), one[1]))
        return [one[2] for one in out]

    def covariances(self, flat: np.ndarray, what: str, swap: Swap, may_be_zero: bool = False) -> list[Any]:
        """Checked covariances (3, 3) in our axes of ``flat`` (n, 9), as :meth:`.Received.covariance` and ``known`` give them."""
        return self.each(flat, lambda one: self.received.known(self.received.covariance(one, what, may_be_zero), swap))

    def twist(self, what: str, limit: float, swap: Swap, swap_cov: Swap) -> tuple[np.ndarray, list[Any]]:
        """Checked linear velocities (n, 3) of TwistWithCovarianceStamped messages and their covariances, in our axes."""
        velocity = self.parts("twist.twist.linear")
        self.within(velocity, limit)
        return swap(velocity), self.covariances(self.block("twist.covariance", 0), what, swap_cov)

    def block(self, name: str, first: int) -> np.ndarray:
        """Diagonal block (n, 9) of covariances (n, 36), from row ``first`` on."""
        return self._table[name].reshape(-1, 6, 6)[:, first : first + 3, first : first + 3].reshape(-1, 9)

    def variances(self, values: np.ndarray, what: str) -> list[float]:
        """Checked variances of ``values`` (n,)."""
        return self.each(values, lambda one: self.received.variance(float(one), what))

    def note(self, assumed: np.ndarray, phrase: str) -> None:
        """Note what is assumed of some messages, by a mask (n,)."""
        self._noted.append((assumed, Counter([phrase])))

    def notes(self) -> Counter[str]:
        """What was assumed of the messages that have passed."""
        total: Counter[str] = Counter()
        for rows, noted in self._noted:
            count = int(np.count_nonzero(rows & self.good))
            total.update({phrase: n * count for phrase, n in noted.items() if count})
        return total

    def _checked(self, value: Any, check: Callable[[Any], Any]) -> tuple[bool, Counter[str], Any]:
        self.received.notes = noted = Counter[str]()
        try:
            return False, noted, check(value)
        except (Refusal, ArithmeticError, ValueError):
            return True, noted, None


def _text(raw: Any) -> str:
    """The characters of a string; raises ValueError where it does not end in its only zero, or is no plain text."""
    text = bytes(raw)
    if text[-1:] != b"\0" or b"\0" in text[:-1] or not text.isascii():
        raise ValueError
    return text[:-1].decode()


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Decoded messages of one topic: ``rows`` of the window they are of, their stamps (ns), and fields of the measurement by column."""

    kind: Kind
    rows: np.ndarray
    stamps_ns: np.ndarray
    fields: Sequence[Any]

    def __len__(self) -> int:
        return len(self.rows)

    def measurements(self) -> list[Measurement]:
        """One measurement a message."""
        assert self.kind.measurement is not None
        fields = (repeat(None) if f is None else f.tolist() if isinstance(f, np.ndarray) and f.ndim == 1 else f for f in self.fields)
        return list(map(self.kind.measurement, self.stamps_ns.tolist(), repeat(self.kind.name), *fields))


def decoded(window: Window, rows: np.ndarray, kind: Kind, rules: DecodeRules, notes: Counter[str]) -> list[Columns]:
    """Decode what is clean of the messages of one topic.

    Parameters
    ----------
    window : Window
    rows : ndarray of int64
        Where it has messages of the topic; all of the type that the kind expects.
    kind : Kind
        With ``many``.
    rules : DecodeRules
    notes : Counter
        Counts what was assumed.

    Returns
    -------
    list of Columns
        One for every layout; messages that are in none of them need the careful decoder.
    """
    found = []
    for same in _of_one_size(window.sizes[rows]):
        at = rows[same]
        dtype = layout_of(kind.msgtype, window.raw(int(at[0])))
        if dtype is None or kind.many is None or len(at) <= FEW:
            continue
        table = window.table(at, dtype)
        passed = Rows(table, kind, rules)
        passed.keep(window.little_endian(at))
        with np.errstate(all="ignore"):  # rows that fail hold anything
            fields = kind.many(passed)
        good = passed.good
        if good.any():
            notes.update(passed.notes())
            found.append(Columns(kind, at[good], passed.stamps_ns[good], fields if good.all() else [_some(f, good) for f in fields]))
    return found


def whole_table(window: Window, rows: np.ndarray, msgtype: str) -> np.ndarray | None:
    """All messages of one topic as one table; None where their layouts differ or they have to be parsed one by one."""
    dtype = layout_of(msgtype, window.raw(int(rows[0])))
    if dtype is None or (window.sizes[rows] != window.sizes[rows[0]]).any():
        return None
    table = window.table(rows, dtype)
    same = [(table[name] == table[name][0]).all() for name in table.dtype.names or () if name.endswith(SIZE)]
    return table if all(same) and window.little_endian(rows).all() else None


def _of_one_size(sizes: np.ndarray) -> Collection[np.ndarray]:
    if (sizes == sizes[0]).all():
        return [np.arange(len(sizes))]
    return [np.flatnonzero(sizes == size) for size in np.unique(sizes)]


def _some(field: Any, good: np.ndarray) -> Any:
    if field is None:
        return None
    return field[good] if isinstance(field, np.ndarray) else [one for one, passed in zip(field, good.tolist(), strict=True) if passed]
