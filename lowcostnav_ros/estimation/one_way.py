"""Corrections of attitude and sensor errors that go one way: what a sensor that drifts away does to a filter, unseen by any gate.

The corrections K y of a consistent filter are white, and of covariance K S K', which is what the update takes off the covariance.  So
over some seconds

    c = sum K y  ~  N(0, sum (P- - P+))

An accelerometer that drifts is followed by the tilt, through a gyro bias where that is slow; a gyro that drifts is held by it.  Either
way the tilt is off by no more than c, and half of it covers both.

Late stamps look the same for as long as an aircraft turns.  An offset of sigma s that is not known yet moves the sum by s sum K U, U being
what it does to an innovation (:mod:`.time_offsets`): that much of it is no fault of the sensors.
"""

import math

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.error_state import Kind, Layout
from lowcostnav_ros.estimation.time_offsets import TimeOffsets
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

WINDOWS_S = np.array([[5.0], [30.0]])
SIGMAS, NAMED_SIGMAS, NAMED = 5.0, 8.0, 2.0 * DEGREE
"""Corrections beyond so many sigmas are no chance; beyond the second, and of a tilt larger than the third, rad, they are named."""
HALF = 0.5
ATTITUDE = slice(6, 9)
FLOOR = (0.02 * DEGREE) ** 2
"""Variance of a tilt, rad^2, that says nothing of the sensors."""


class OneWay:
    """Sums of the corrections of attitude and biases over some windows, exponential.

    Parameters
    ----------
    layout : Layout
        Of an inertial core.
    imu, gps : str
        Parties of the contradiction.
    """

    def __init__(self, layout: Layout, imu: str, gps: str) -> None:
        self._latch = Latch("GPS corrects the attitude one way", (imu, gps), "deg", begin_s=3.0, end_s=10.0)
        attitude, (accel, gyro) = np.arange(6, 9), (np.flatnonzero(layout.kind == int(k)) for k in (Kind.ACCEL_BIAS, Kind.GYRO_BIAS))
        self._size, self._accel, self._gyro = layout.size, accel, gyro
        self._rows = np.concatenate((attitude, accel, gyro))
        tilts = [np.ones(3), np.full(len(accel), 1.0 / STANDARD_GRAVITY), np.full(len(gyro), HALF)]
        self._tilt = np.array([np.concatenate((*tilts[:2], tilts[2] * w)) for w in WINDOWS_S[:, 0]])
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._latch.clear()
        self._sums, self._variances, self._late = np.zeros((3, *self._tilt.shape))
        self._last_ns = 0

    @property
    def held(self) -> Contradiction | None:
        """The contradiction, while it lasts."""
        return self._latch.held

    def seen(self, P: np.ndarray) -> np.ndarray:
        """Variances of what is watched, of a covariance (n, n)."""
        return P.diagonal()[self._rows]

    def by_stamps(self, offsets: TimeOffsets | None) -> np.ndarray:
        """Error of what is watched by the offsets of stamps, as far as they are not known or not corrected yet."""
        if offsets is None or not offsets.known:
            return np.zeros(len(self._rows))
        return np.asarray(offsets.V[self._rows] @ [math.hypot(offset.sigma_s, offset.rest_s) for offset in offsets.known.values()])

    def take(self, stamp_ns: int, correction: np.ndarray, taken_off: np.ndarray, late: np.ndarray) -> np.ndarray | None:
        """Take a correction (n,), what it took off the variances watched and of it what late stamps may have done.

        Returns sigmas (n,) that there must be at least, or None.
        """
        keep = np.exp(-1e-9 * (stamp_ns - self._last_ns) / WINDOWS_S)
        self._last_ns = stamp_ns
        self._sums = keep * self._sums + correction[self._rows]
        self._variances = keep * keep * self._variances + np.maximum(taken_off, 0.0)
        self._late = keep * self._late + late
        tilts = self._tilt * np.abs(self._sums)
        sigmas = tilts / np.sqrt(self._tilt**2 * (self._variances + self._late**2) + FLOOR)
        if sigmas.max() <= SIGMAS and self._latch.held is None:
            self._latch.judge(stamp_ns, False, 0.0)
            return None
        named = (sigmas > NAMED_SIGMAS) & (tilts > NAMED)
        self._latch.judge(stamp_ns, bool(named.any()), float(tilts.max()) / DEGREE, self._latch.parties[0])
        tilt = HALF * float(np.where(sigmas > SIGMAS, tilts, 0.0).max())
        if tilt == 0.0:
            return None
        least = np.zeros(self._size)
        least[ATTITUDE], least[self._accel], least[self._gyro] = tilt, STANDARD_GRAVITY * tilt, tilt / float(WINDOWS_S[-1, 0])
        return least
