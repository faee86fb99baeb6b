"""Counts by phrase that cannot grow without bound, whatever comes from outside."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

Key = TypeVar("Key")

MOST = 100
OTHERS = "others"


class Tally(Counter[Key]):
    """A counter of at most :data:`MOST` keys; what comes under further ones is counted as :data:`OTHERS`.

    Parameters
    ----------
    counts : mapping or iterable, optional
        As for :class:`collections.Counter`.
    others : hashable
        The key that stands for all further ones.
    """

    def __init__(self, counts: Mapping[Key, int] | Iterable[Key] = (), others: Any = OTHERS) -> None:
        self._others = others
        super().__init__(counts)

    def __setitem__(self, key: Key, count: int) -> None:
        """Set a count; one of a further key, which read as 0, is added to the others."""
        if key not in self and len(self) >= MOST:
            key, count = self._others, self.get(self._others, 0) + count
        super().__setitem__(key, count)

    def copy(self) -> "Tally[Key]":
        """A tally of the same counts."""
        return Tally(self, self._others)

    def __reduce__(self) -> Any:
        """As a pickle: another process counts on."""
        return Tally, (dict(self), self._others)
