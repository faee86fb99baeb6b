"""Watch the innovations of a filter over longer times: do its sources, all together, still agree with the prediction?

A consistent filter has white innovations of covariance S.  Let G be the columns of H that hold what the sources measure together
(position and clock, velocity and drift).  Each epoch gives information N = G' S^-1 G and its vector z = G' S^-1 y; over a window with
weights w they add up,

    zeta = sum w z,    Lambda_1 = sum w N,    Lambda_2 = sum w^2 N = cov(zeta),    offset = Lambda_1^-1 zeta

and zeta' (Lambda_2 + Lambda_1 F Lambda_1)^-1 zeta is chi-square, F being what a sound filter's mean innovation may be off by.  An offset
that all satellites share and that carries the filter along, which no comparison among satellites can see, shows here while the inertial
sensors resist.

References
----------
J. Diesel and S. Luu, "GPS/IRS AIME: calculation of thresholds and protection radius using chi-square methods", ION GPS (1995).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base.chi_square import exceeded_with
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import cholesky, forward_solve, matmul, matmul_transposed, matvec
from lowcostnav_ros.estimation import kalman

UNSEEN = 1e-6
"""What is added to an information matrix, as a share of its trace, so that a direction not measured yet does no harm."""


@kernel
def steadied(matrix):
    """A small multiple of the identity, to be added before a matrix (m, m) that may be singular is factored."""
    m, total = matrix.shape[0], 0.0
    for j in range(m):
        total += matrix[j, j]
    return np.eye(m) * (UNSEEN * total + 1e-300)


@kernel
def watch(y, G, S, dt, times, floor, zeta, first, second):
    """Add an epoch to all windows, in place, and test them.

    Parameters
    ----------
    y : ndarray, shape (n,)
    G : ndarray, shape (n, m)
    S : ndarray, shape (n, n)
    dt : float
        Since the epoch before, s.
    times : ndarray, shape (w,)
        Windows, s; exponential weights.
    floor : ndarray, shape (m,)
        1-sigma of the offset a sound filter may show.
    zeta : ndarray, shape (w, m)
    first, second : ndarray, shape (w, m, m)

    Returns
    -------
    worst : int
        Window with the largest test statistic.
    statistic : float
    """
    m = G.shape[1]
    b, A = kalman.whiten(y, G, S)
    columns = A.T.copy()
    N, z = matmul_transposed(columns, columns), matvec(columns, b)
    worst, largest = 0, -1.0
    for i in range(times.shape[0]):
        keep = np.exp(-dt / times[i]) if times[i] > 0.0 else 0.0
        zeta[i] = keep * zeta[i] + z
        first[i] = keep * first[i] + N
        second[i] = keep * keep * second[i] + N
        loose = first[i].copy()
        for j in range(m):
            loose[:, j] *= floor[j] * floor[j]
        spread = second[i] + matmul(loose, first[i])
        white = forward_solve(cholesky(spread + steadied(spread)), zeta[i])
        statistic = np.sum(white * white)
        if statistic > largest or np.isnan(statistic):
            worst, largest = i, statistic
    return worst, largest


@kernel
def watch_axes(y, variances, least, dt, times, floor, zeta, first, second):
    """The same of components that each measure one axis, with noise of these ``variances`` (m,), none of them below ``least``."""
    S = np.zeros((y.shape[0], y.shape[0]))
    for i in range(y.shape[0]):
        S[i, i] = max(variances[i], least)
    return watch(y, np.eye(y.shape[0]), S, dt, times, floor, zeta, first, second)


@dataclass(frozen=True, slots=True)
class Disagreement:
    """Sources and prediction disagree: by ``offset`` (m,) with ``sigma`` (m,) over ``window_s``."""

    window_s: float
    offset: np.ndarray
    sigma: np.ndarray

    def largest(self) -> int:
        """Component that is off by most sigmas."""
        return int(np.argmax(np.abs(self.offset) / self.sigma))


class InnovationWatch:
    """Innovations of one kind over several windows.

    Parameters
    ----------
    times_s : sequence of float
        Windows, s; 0 is the epoch alone.
    floor : sequence of float
        1-sigma of the mean innovation that a sound filter may show in each component.
    false_alarm_probability : float
        Of one test.
    """

    def __init__(self, times_s: Sequence[float], floor: Sequence[float], false_alarm_probability: float) -> None:
        self.times, self.floor = np.array(times_s, dtype=float), np.array(floor, dtype=float)
        self.limit = exceeded_with(false_alarm_probability, len(self.floor))
        self.clear()

    def clear(self) -> None:
        """Forget all windows."""
        w, m = len(self.times), len(self.floor)
        self.zeta, self.first, self.second = np.zeros((w, m)), np.zeros((w, m, m)), np.zeros((w, m, m))
        self.ratio = 0.0
        self._last_ns: int | None = None

    def observe(self, stamp_ns: int, y: np.ndarray, G: np.ndarray, S: np.ndarray) -> Disagreement | None:
        """Add the innovations y (n,) of an epoch with the columns G (n, m) and their covariance S (n, n); return a disagreement."""
        worst, statistic = watch(y, G, S, self._since_s(stamp_ns), self.times, self.floor, self.zeta, self.first, self.second)
        self.ratio = statistic / self.limit
        return self._disagreement(worst) if self.ratio > 1.0 else None

    def observe_axes(self, stamp_ns: int, y: np.ndarray, variances: np.ndarray, least: float) -> None:
        """Add innovations y (m,) of the components themselves, of ``variances`` (m,), none below ``least``; for their ratio alone."""
        windows = self.times, self.floor, self.zeta, self.first, self.second
        self.ratio = watch_axes(y, variances, least, self._since_s(stamp_ns), *windows)[1] / self.limit

    def _since_s(self, stamp_ns: int) -> float:
        """Since the epoch before, which this one takes the place of; 0 for the first, s."""
        dt = 0.0 if self._last_ns is None else 1e-9 * (stamp_ns - self._last_ns)
        self._last_ns = stamp_ns
        return dt

    def _disagreement(self, window: int) -> Disagreement:
        information = self.first[window]  # in numpy: a kernel met first at the alarm would be compiled just then
        inverse = np.linalg.inv(information + np.eye(len(information)) * (UNSEEN * np.trace(information) + 1e-300))
        covariance = inverse @ self.second[window] @ inverse + np.diag(self.floor**2)
        return Disagreement(float(self.times[window]), inverse @ self.zeta[window], np.sqrt(np.diag(covariance)))
