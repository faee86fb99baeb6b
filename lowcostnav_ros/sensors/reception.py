"""What a simulated receiver hands over and when: nothing during an outage, everything else after its latency."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Generic, Protocol, TypeVar

from lowcostnav_ros.base.settings import SettingsError, setting
from lowcostnav_ros.sensors.registry import SimulatorSettings


class Stamped(Protocol):
    """What is valid at a time."""

    @property
    def stamp_ns(self) -> int: ...


M = TypeVar("M", bound=Stamped)


def outage_windows(outages_s: Sequence[float]) -> list[tuple[float, float]]:
    """Return the flat list ``[start, end, start, end, ...]`` as pairs."""
    return list(zip(outages_s[0::2], outages_s[1::2], strict=True))


@dataclass(frozen=True)
class ReceiverSettings(SimulatorSettings):
    """What the settings of a receiver begin with, whose name sentences about them bear."""

    receiver: ClassVar[str]
    outages_s: list = setting([], "Outages as start, end, start, end, ... from the first truth stamp.", unit="s", minimum=0.0)

    def __post_init__(self) -> None:
        """Refuse outages that are not pairs of a start and a later end."""
        if len(self.outages_s) % 2:
            raise SettingsError(f"{self.receiver}: 'outages_s' needs pairs of start and end; add the missing end.")
        for start, end in outage_windows(self.outages_s):
            if end <= start:
                sentence = f"an outage ends at {end:g} s, not after its start at {start:g} s; swap or correct them."
                raise SettingsError(f"{self.receiver}: {sentence}")


class Reception(Generic[M]):
    """Outages and latency of one receiver; keeps what is still on its way.

    Parameters
    ----------
    latency_s : float
        Time from validity to availability, s.
    outages_s : sequence of float
        Start, end, start, end, ... in s from the first truth stamp.
    """

    def __init__(self, latency_s: float, outages_s: Sequence[float]) -> None:
        self._latency_ns = round(latency_s * 1e9)
        self._outages = outage_windows(outages_s)
        self._start_ns = 0
        self._begun = False
        self._pending: list[M] = []

    def begin(self, stamp_ns: int) -> None:
        """Count outages from ``stamp_ns``; only the first call does."""
        if not self._begun:
            self._start_ns, self._begun = stamp_ns, True

    def in_outage(self, stamp_ns: int) -> bool:
        """Whether nothing is received at ``stamp_ns``; after :meth:`begin`."""
        elapsed_s = (stamp_ns - self._start_ns) * 1e-9
        return any(start <= elapsed_s < end for start, end in self._outages)

    def send(self, *measurements: M) -> None:
        """Put measurements, in stamp order, on their way."""
        self._pending.extend(measurements)

    def arrived(self, now_ns: int) -> list[M]:
        """Take what is available at ``now_ns``, in stamp order."""
        ready = [m for m in self._pending if m.stamp_ns + self._latency_ns <= now_ns]
        self._pending = self._pending[len(ready) :]  # pending is in stamp order, so the ready ones are its head
        return ready
