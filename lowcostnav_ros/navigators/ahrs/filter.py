"""What the attitude reference asks of a filter: its list of aids, and the rules of when to apply them."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.estimation.aiding import Aid
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.settings import kind_of, listed

IMU = "imu/data_raw"
LEVEL_TIMEOUT_S = 5.0


class Filter(ABC):
    """A filter of the attitude reference.

    Attributes
    ----------
    needs : tuple of str
        Sensors it cannot do without.
    used_ns : dict of str to int
        When each kind of sensor was used last.
    unused : tuple of str
        Sensors it has no use for: their topics are not subscribed to.
    is_full : bool
        Whether GPS velocity is weighed by a full covariance, so that what it does to the attitude can be watched.
    """

    needs: ClassVar[tuple[str, ...]] = ("level",)
    unused: ClassVar[tuple[str, ...]] = ()
    is_full: ClassVar[bool] = False

    def __init__(self, host: Navigator) -> None:
        self.host, self.used_ns = host, dict[str, int]()
        self._timeouts = {kind_of(key): getattr(own, "timeout_s", 0.0) for key, own in listed(host.settings)}

    def fresh(self, sensor: str, now_ns: int, seconds: float | None = None) -> bool:
        """Whether a sensor, or another of its kind, was used within its time-out, or within ``seconds``."""
        if sensor not in self.used_ns:
            return False
        return now_ns - self.used_ns[sensor] <= 1e9 * (self._timeouts[sensor] if seconds is None else seconds)

    @classmethod
    def forms(cls, aid: Aid, settings: Any) -> list[Aid]:
        """What it uses in place of an aid of the list, with the navigator's settings."""
        return [aid]

    @abstractmethod
    def begin(self, t_ns: int) -> None:
        """Called when an attitude was found."""

    @abstractmethod
    def follow(self, block: ImuBlock, start: int, stop: int) -> None:
        """Called when samples ``start`` to ``stop`` have moved the core."""

    @abstractmethod
    def keep(self, now_ns: int) -> None:
        """Called at every output: what is to be done without measurements."""

    def applies(self, aid: Aid, measurement: Measurement) -> bool:
        """Whether an aid is to be used now."""
        return True

    def before(self, aid: Aid, measurement: Measurement) -> None:  # noqa: B027 - most filters have nothing to do then
        """Called before an aid is run on a measurement."""

    @abstractmethod
    def gps_good(self, stamp_ns: int) -> bool:
        """Whether GPS holds the solution."""

    @abstractmethod
    def mode(self, now_ns: int, heading: str) -> tuple[str, str]:
        """Mode and reason; ``heading`` is what to add when there is no magnetic heading, else empty."""
