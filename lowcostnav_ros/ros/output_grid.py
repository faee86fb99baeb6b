"""When the next low-latency solution is due: on multiples of its period, by stamps."""


class OutputGrid:
    """Decimate by stamps, so that neither jitter nor a late measurement changes the spacing.

    Attributes
    ----------
    period_ns : int
    """

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.clear()

    def clear(self) -> None:
        """Begin anew: the next stamp is due."""
        self._next_ns = 0

    def is_due(self, stamp_ns: int, base_ns: int) -> bool:
        """Whether a solution is due with a stamp, where the inputs agree that it is ``base_ns``.

        A stamp ahead of that moves nothing.  One period is the most that the next solution can be ahead of it; further, the inputs have
        stepped back (a recording that is played in a loop, a clock that was set).
        """
        if self._next_ns - base_ns > self.period_ns:
            self.clear()
        stamp_ns = min(stamp_ns, base_ns)
        if stamp_ns < self._next_ns:
            return False
        self._next_ns = (stamp_ns // self.period_ns + 1) * self.period_ns
        return True
