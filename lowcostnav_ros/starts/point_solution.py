"""First state of a navigator that has satellites alone: a checked point solution, and a velocity even without Dopplers."""

import numpy as np

from lowcostnav_ros.base.measurements import GnssEpoch, GpsPosition, GpsVelocity
from lowcostnav_ros.estimation.satellite_integrity import name_of
from lowcostnav_ros.gnss import GnssError, raim
from lowcostnav_ros.gnss.positioning import FAILED, solve_velocity
from lowcostnav_ros.physics.earth import difference_n

SPAN_NS = 10_000_000_000
"""Without Dopplers the velocity is the slope of the positions over this time."""
ENOUGH_FIXES, ENOUGH_NS = 5, 4_000_000_000
"""A slope takes so many positions over so long."""
UNKNOWN_MPS = 100.0
"""1-sigma of each component of a velocity that was not measured."""


def point_solution(epoch: GnssEpoch, *, doppler: bool = True) -> tuple[GpsPosition, GpsVelocity | None]:
    """Least-squares position and velocity of one epoch, checked: a satellite that contradicts the others is excluded from both.

    Parameters
    ----------
    epoch : GnssEpoch
    doppler : bool
        Whether there are Dopplers to use; without them the velocity is None.

    Raises
    ------
    GnssError
        When there is no position, or the satellites contradict each other and the faulty one cannot be identified.
    """
    checked = raim.check(epoch)
    if checked.verdict == raim.FAULTY:
        raise GnssError(checked.reason)
    fix = checked.fix
    position = GpsPosition(epoch.stamp_ns, epoch.source, fix.lat, fix.lon, fix.height, fix.cov_n)
    if not doppler:
        return position, None
    rows = np.flatnonzero(epoch.doppler_valid)
    rows = np.array([row for row in rows if name_of(epoch, int(row)) != checked.excluded], dtype=np.int64)
    velocity = solve_velocity(epoch, fix.position_e, rows=rows, probability=1.0 - raim.RaimSettings().false_alarm_probability)
    if velocity.test.verdict == FAILED:
        raise GnssError("The Dopplers contradict each other; wait for an epoch in which they agree.")
    return position, GpsVelocity(epoch.stamp_ns, epoch.source, velocity.vel_n, velocity.cov_n)


def unknown_velocity(position: GpsPosition) -> GpsVelocity:
    """Zero, with a sigma to match."""
    return GpsVelocity(position.stamp_ns, position.source, np.zeros(3), np.eye(3) * UNKNOWN_MPS**2)


class SlopeVelocity:
    """Velocity from the positions of the last ten seconds, for a receiver without Dopplers; as good as the flight is straight."""

    def __init__(self) -> None:
        self._fixes: list[GpsPosition] = []

    def clear(self) -> None:
        """Forget all positions."""
        self._fixes = []

    def add(self, fix: GpsPosition) -> GpsVelocity | None:
        """Take a position; return the slope through those kept, None while they are too few.

        The covariance is that of white position errors: sigma^2 / sum (t - mean t)^2.
        """
        self._fixes = [f for f in self._fixes if 0 < fix.stamp_ns - f.stamp_ns <= SPAN_NS] + [fix]
        if len(self._fixes) < ENOUGH_FIXES or fix.stamp_ns - self._fixes[0].stamp_ns < ENOUGH_NS:
            return None
        t_s = np.array([1e-9 * (f.stamp_ns - fix.stamp_ns) for f in self._fixes])
        t_s -= t_s.mean()
        places = np.array([difference_n(f.lat, f.lon, f.height, fix.lat, fix.lon, fix.height) for f in self._fixes])
        spread = float(t_s @ t_s)
        return GpsVelocity(fix.stamp_ns, fix.source, t_s @ places / spread, np.mean([f.cov_n for f in self._fixes], axis=0) / spread)
