"""A contradiction with hysteresis: it begins after seconds of disagreement and ends after seconds of agreement."""

from lowcostnav_ros.base.contradiction import Contradiction


class Latch:
    """One contradiction that may hold.

    Parameters
    ----------
    name, parties, unit
        Of the :class:`Contradiction`.
    begin_s, end_s : float
        How long the parties must disagree for it to begin, and agree for it to end, s.
    """

    def __init__(self, name: str, parties: tuple[str, str], unit: str, begin_s: float = 3.0, end_s: float = 5.0) -> None:
        self.name, self.parties, self.unit = name, parties, unit
        self.begin_ns, self.end_ns = round(1e9 * begin_s), round(1e9 * end_s)
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self.held: Contradiction | None = None
        self._turned_ns: int | None = None  # since when the newest judgements speak against the state held

    def judge(self, stamp_ns: int, disagrees: bool, size: float, suspect: str = "", advice: str = "") -> bool:
        """Take a judgement; return whether the contradiction begins with it."""
        if disagrees == (self.held is not None):
            self._turned_ns = None
        elif self._turned_ns is None:
            self._turned_ns = stamp_ns
        began = False
        if self._turned_ns is not None and stamp_ns - self._turned_ns >= (self.begin_ns if disagrees else self.end_ns):
            began, self.held = disagrees, None
            since_ns, self._turned_ns = self._turned_ns, None
        elif self.held is not None:
            since_ns = self.held.since_ns
        if disagrees and (began or self.held is not None):
            self.held = Contradiction(self.name, self.parties, float(size), self.unit, since_ns, suspect, advice)
        return began
