"""The checks of a navigator's sources among each other, fed with everything but inertial samples, before it is used."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.measurements import AirVelocity, GnssEpoch, GpsPosition, GpsVelocity, Measurement, Pressure
from lowcostnav_ros.estimation.cross_checks.air import AirspeedCheck
from lowcostnav_ros.estimation.cross_checks.height import ClimbCheck
from lowcostnav_ros.estimation.cross_checks.receiver import FROZEN, REPEATS_WORDS, ReceiverCheck, Repetition, Trusted, frozen_latch
from lowcostnav_ros.physics.atmosphere import pressure_altitude
from lowcostnav_ros.physics.earth import difference_n

FRESH_NS = 2_500_000_000


class SourceChecks:
    """All checks among the sources of one navigator.

    Parameters
    ----------
    receivers : sequence of ReceiverCheck
    air, pressure, epochs : str
        Topics of air velocity, static pressure and satellite observations; empty where it takes none.
    """

    def __init__(self, receivers: Sequence[ReceiverCheck], air: str = "", pressure: str = "", epochs: str = "") -> None:
        self.receivers, self.sky = list(receivers), frozen_latch(epochs, "satellites that move")
        first = self.receivers[0] if self.receivers else None
        self.airspeed = AirspeedCheck(air, first.velocity) if air and first else None
        self.climb = ClimbCheck(pressure, first.fix) if pressure and first else None
        own = (latch for latch in (self.sky, self.airspeed, self.climb) if latch is not None)
        self._latches = [*(latch for receiver in self.receivers for latch in receiver.latches), *own]
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._epochs = Repetition()
        for check in (*self.receivers, self.airspeed, self.climb, self.sky):
            if check is not None:
                check.clear()
        self.speed_mps, self._speed_ns = 0.0, -FRESH_NS
        self._altitude: tuple[int, float] | None = None
        self._fix: GpsPosition | None = None

    def take(self, item: Measurement, trusted: Callable[[], Trusted]) -> str:
        """Take a measurement; return why it is none.  ``trusted``: whether the state agrees with each kind of measurement."""
        if isinstance(item, GpsPosition | GpsVelocity):
            for receiver in self.receivers:
                if item.source in receiver.sources:
                    receiver.take(item, trusted())
                    self._keep(item, receiver)
        elif isinstance(item, AirVelocity) and self.airspeed is not None and item.source == self.airspeed.parties[0]:
            if self.ground_speed(item.stamp_ns) is not None:
                self.airspeed.compare(item.stamp_ns, float(np.linalg.norm(item.vel_b)), self.speed_mps)
        elif isinstance(item, Pressure) and self.climb is not None and item.source == self.climb.parties[0]:
            self._altitude = item.stamp_ns, float(pressure_altitude(item.pressure_pa))
        elif isinstance(item, GnssEpoch):
            self._epochs.take(item.stamp_ns, tuple(item.pseudorange_m.tolist()))
            frozen = bool(len(item)) and self._epochs.lasts(item.stamp_ns)
            self.sky.judge(item.stamp_ns, frozen, 1e-9 * (item.stamp_ns - self._epochs.first_ns), item.source, REPEATS_WORDS)
            return FROZEN if frozen else ""
        return ""

    def ground_speed(self, stamp_ns: int) -> float | None:
        """Speed over ground by GPS, m/s, None where there is none that is fresh and sound."""
        return self.speed_mps if stamp_ns - self._speed_ns <= FRESH_NS else None

    def _keep(self, item: GpsPosition | GpsVelocity, receiver: ReceiverCheck) -> None:
        if receiver is not self.receivers[0] or receiver.excluded(type(item)):
            return
        if isinstance(item, GpsVelocity):
            self._fix, self.speed_mps, self._speed_ns = None, receiver.speed_mps, item.stamp_ns
            return
        if self.ground_speed(item.stamp_ns) is None or self._fix is not None:
            self._speed_of_fixes(item)
        if self.climb is not None and self._altitude is not None and item.stamp_ns - self._altitude[0] <= FRESH_NS:
            self.climb.compare(item.stamp_ns, self._altitude[1], item.height, float(np.sqrt(max(item.cov_n[2, 2], 0.0))))

    def _speed_of_fixes(self, item: GpsPosition) -> None:
        """Without velocities, the displacement of fixes over a second or more is the speed."""
        last = self._fix
        if last is not None and item.stamp_ns - last.stamp_ns >= 1_000_000_000:
            north, east, _ = difference_n(item.lat, item.lon, item.height, last.lat, last.lon, last.height)
            self.speed_mps, self._speed_ns = math.hypot(north, east) / (1e-9 * (item.stamp_ns - last.stamp_ns)), item.stamp_ns
            last = None
        self._fix = last or item

    def held(self) -> list[Contradiction]:
        """Contradictions that last, of GPS first."""
        return [latch.held for latch in self._latches if latch.held is not None]
