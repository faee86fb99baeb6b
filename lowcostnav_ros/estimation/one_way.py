"""Corrections of attitude and sensor errors that go one way: what a sensor that drifts away does to a filter, unseen by any gate.

The corrections K y of a consistent filter are white, and of covariance K S K', which is what the update takes off the covariance.  So
over some seconds

    c = sum K y  ~  N(0, sum (P- - P+))

An accelerometer that drifts is followed by the tilt, through a gyro bias where that is slow; a gyro that drifts is held by it.  Either
way the tilt is off by no more than c, and half of it covers both.

What is beyond two and a half sigmas but no proof yet is published alone: an attitude (or a wind) that was moved so far may be off by as
much, and by a rate more each second; that is forgotten within a minute.

Late stamps look the same for as long as an aircraft turns.  An offset of sigma s that is not known yet moves the sum by s sum K U, U being
what it does to an innovation (:mod:`.time_offsets`): that much of it is no fault of the sensors.
"""

import math

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.error_state import Kind, Layout
from lowcostnav_ros.estimation.time_offsets import TimeOffsets
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

WINDOWS_S = np.array([5.0, 30.0])
SIGMAS, NAMED_SIGMAS, NAMED = 5.0, 8.0, 2.0 * DEGREE
"""Corrections beyond so many sigmas are no chance; beyond the second, and of a tilt larger than the third, rad, they are named."""
HALF = 0.5
CHANCE, MEMORY_S, FURTHEST = 2.5, 60.0, np.array([60.0 * DEGREE, 60.0 * DEGREE, 30.0])
"""Sigmas up to which a sum says nothing; how long what was beyond is remembered, s; the most that it may grow to, rad, rad, m/s."""
PER_MPS = 0.02
"""A wind of 1 m/s counts for the drift that it makes at 50 m/s."""
ATTITUDE = slice(6, 9)
FLOOR = (0.02 * DEGREE) ** 2
"""Variance of a tilt, rad^2, that says nothing of the sensors."""
NOTHING = np.zeros((0, 0)), np.zeros(0)


@kernel
def look(P, V, errors, rows, out):
    """Into ``out`` (2, m) the variances of the states ``rows`` (m,), and what offsets of stamps, sigma ``errors`` (k,), may do to them."""
    for i in range(rows.shape[0]):
        out[0, i], out[1, i] = P[rows[i], rows[i]], 0.0
        for j in range(errors.shape[0]):
            out[1, i] += V[rows[i], j] * errors[j]


@kernel
def add(dt, times, correction, rows, before, after, tilt, sums, sigmas):
    """Add a correction (n,) to all windows, in place; return the largest of what it makes in sigmas.

    ``before``, ``after`` (2, m): of :func:`look`; ``tilt`` (w, m): tilt by each; ``sums`` (3, w, m): of the corrections, of their variances
    and of what late stamps may have done; ``sigmas`` (w, m): size of the sums.
    """
    largest = 0.0
    for k in range(times.shape[0]):
        keep = np.exp(-dt / times[k])
        for i in range(rows.shape[0]):
            sums[0, k, i] = keep * sums[0, k, i] + correction[rows[i]]
            sums[1, k, i] = keep * keep * sums[1, k, i] + max(before[0, i] - after[0, i], 0.0)
            sums[2, k, i] = keep * sums[2, k, i] + before[1, i] - after[1, i]
            t = tilt[k, i]
            sigmas[k, i] = t * abs(sums[0, k, i]) / np.sqrt(t * t * (sums[1, k, i] + sums[2, k, i] ** 2) + FLOOR)
            largest = max(largest, sigmas[k, i])
    return largest


@kernel
def lead(dt_s, keep, sums, sigmas, ends, moved):
    """Forget a part of ``moved`` (3,), take what of the sums (w, m) is more than chance; ``ends`` (3,): after attitude, forces, rates."""
    seen = np.zeros(6)
    for k in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            if sigmas[k, i] > CHANCE:
                kind = i if i < ends[0] else 3 if i < ends[1] else 4 if i < ends[2] else 5
                seen[kind] = max(seen[kind], abs(sums[k, i]) * np.sqrt(1.0 - (CHANCE / sigmas[k, i]) ** 2))
    tilt = max(seen[0], seen[1], seen[3] / STANDARD_GRAVITY)
    for i in range(3):
        moved[i] = min(max(keep * moved[i] + (seen[4] * dt_s if i < 2 else 0.0), (tilt, seen[2], seen[5])[i]), FURTHEST[i])


class OneWay:
    """Sums of the corrections of attitude and biases over some windows, exponential.

    Parameters
    ----------
    layout : Layout
        Of an inertial core.
    imu, gps : str
        Parties of the contradiction.
    with_wind : bool
        Whether the wind is watched as well.

    Attributes
    ----------
    moved : ndarray (3,)
        By how much tilt, heading and wind may be off by what they were moved by lately, rad and m/s.
    """

    def __init__(self, layout: Layout, imu: str, gps: str, *, with_wind: bool = False) -> None:
        self._latch = Latch("GPS corrects the attitude one way", (imu, gps), "deg", begin_s=3.0, end_s=10.0)
        attitude, (accel, gyro) = np.arange(6, 9), (np.flatnonzero(layout.kind == int(k)) for k in (Kind.ACCEL_BIAS, Kind.GYRO_BIAS))
        self._size, self._accel, self._gyro = layout.size, accel, gyro
        blown = layout.get("wind") if with_wind else None
        wind = np.arange(layout.size)[[*range(3, 6), *range(blown.start, blown.stop)]] if blown is not None else np.zeros(0, dtype=int)
        self._rows = np.concatenate((attitude, accel, gyro, wind))
        self._ends = np.cumsum([3, len(accel), len(gyro)])
        tilts = [np.ones(3), np.full(len(accel), 1.0 / STANDARD_GRAVITY), np.full(len(gyro), HALF), np.full(len(wind), PER_MPS)]
        self._tilt = np.array([np.concatenate((*tilts[:2], tilts[2] * w, tilts[3])) for w in WINDOWS_S])
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._latch.clear()
        self._sums, self._sigmas = np.zeros((3, *self._tilt.shape)), np.zeros(self._tilt.shape)
        self._before, self._after = np.zeros((2, 2, len(self._rows)))
        self._last_ns = 0
        self.moved = np.zeros(3)

    @property
    def held(self) -> Contradiction | None:
        """The contradiction, while it lasts."""
        return self._latch.held

    def before(self, P: np.ndarray, offsets: TimeOffsets | None) -> None:
        """Look at a covariance (n, n) before a measurement is used."""
        look(P, *errors_of(offsets), self._rows, self._before)

    def take(self, stamp_ns: int, correction: np.ndarray, P: np.ndarray, offsets: TimeOffsets | None) -> np.ndarray | None:
        """Take the correction (n,) of a measurement, and the covariance that it leaves.

        Returns sigmas (n,) that there must be at least, or None.
        """
        largest, sigmas = self.follow(stamp_ns, correction, P, offsets), self._sigmas
        if largest <= SIGMAS and self._latch.held is None:
            self._latch.judge(stamp_ns, False, 0.0)
            return None
        tilts = self._tilt * np.abs(self._sums[0])
        named = (sigmas > NAMED_SIGMAS) & (tilts > NAMED)
        self._latch.judge(stamp_ns, bool(named.any()), float(tilts.max()) / DEGREE, self._latch.parties[0])
        tilt = HALF * float(np.where(sigmas > SIGMAS, tilts, 0.0).max())
        if tilt == 0.0:
            return None
        least = np.zeros(self._size)
        least[ATTITUDE], least[self._accel], least[self._gyro] = tilt, STANDARD_GRAVITY * tilt, tilt / float(WINDOWS_S[-1])
        return least

    def follow(self, stamp_ns: int, correction: np.ndarray, P: np.ndarray, offsets: TimeOffsets | None) -> float:
        """The same for what is published alone (:attr:`moved`); return the largest sum in sigmas."""
        look(P, *errors_of(offsets), self._rows, self._after)
        dt_s, self._last_ns = 1e-9 * (stamp_ns - self._last_ns), stamp_ns
        largest = add(dt_s, WINDOWS_S, correction, self._rows, self._before, self._after, self._tilt, self._sums, self._sigmas)
        lead(dt_s, math.exp(-dt_s / MEMORY_S), self._sums[0], self._sigmas, self._ends, self.moved)
        return largest


def errors_of(offsets: TimeOffsets | None) -> tuple[np.ndarray, np.ndarray]:
    """What offsets of stamps do to the state (n, k), and their sigmas (k,) as far as they are not known or not corrected yet, s."""
    if offsets is None:
        return NOTHING
    return offsets.V, offsets.errors
