"""The way of one topic's measurements to the aids of a navigator."""

from lowcostnav_ros.estimation.aiding import SLACK_NS, Aid


class Channel:
    """One topic of one sensor: the aids that its measurements go to, thinned to a period together."""

    def __init__(self, aids: list[Aid]) -> None:
        self.aids = aids
        self.period_s: float = 0.0 if aids[0].thins_itself else aids[0].period_s
        self._used_ns = -(10**18)

    def begin(self, stamp_ns: int = -(10**18)) -> None:
        """Count the period from here; without a stamp, take the next measurement whenever it comes."""
        self._used_ns = stamp_ns

    def is_due(self, stamp_ns: int) -> bool:
        """Whether a period has passed since the last one: errors are slow, so that more would not add information."""
        return stamp_ns - self._used_ns >= 1e9 * self.period_s - SLACK_NS

    def due(self, stamp_ns: int) -> bool:
        """Take one, if it is due."""
        if not self.is_due(stamp_ns):
            return False
        self._used_ns = stamp_ns
        return True
