"""A window of inertial samples: turn, specific force and rate summed since its beginning, however the samples are cut into blocks."""

from typing import cast

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.physics.rotation import quat_from_rotvec, quat_multiply, quat_normalise, quat_rotate

WINDOW_SIZE = 11
ENDLESS_NS = 2**62


@kernel
def gather_window(t_ns, window, stamps, f, w, start, limit_ns):
    """Integrate specific force in the body axes of the window's beginning; stop after the sample that reaches ``limit_ns``.

    Parameters
    ----------
    t_ns : int
        Time reached so far.
    window : ndarray, shape (11,)
        Changed in place: turn since the beginning ``q_b0b`` (4), integral of ``C_b0b f`` (3) m/s, of w (3) rad, elapsed s.
    stamps, f, w : ndarray
        Columns of an inertial block, m/s^2 and rad/s.
    start : int
        First sample to use.
    limit_ns : int

    Returns
    -------
    next, t_ns : int
    """
    for k in range(start, stamps.shape[0]):
        dt = (stamps[k] - t_ns) * 1e-9
        q = window[0:4]
        middle = quat_multiply(q, quat_from_rotvec(0.5 * dt * w[k]))
        window[4:7] += quat_rotate(middle, f[k]) * dt
        window[7:10] += w[k] * dt
        window[10] += dt
        window[0:4] = quat_normalise(quat_multiply(q, quat_from_rotvec(dt * w[k])))
        t_ns = stamps[k]
        if t_ns >= limit_ns:
            return k + 1, t_ns
    return stamps.shape[0], t_ns


class InertialWindow:
    """Sums over a window that begins at a stamp.

    Attributes
    ----------
    t_ns : int or None
        Time reached; None before the first sample.
    turn : ndarray (4,)
        ``q_b0b``, from the present body axes to those of the beginning.
    force_b0, rate_b : ndarray (3,)
        Integrals of specific force in the axes of the beginning, m/s, and of the rate, rad.
    """

    def __init__(self) -> None:
        self.begin(None)

    def begin(self, t_ns: int | None) -> None:
        """Begin anew at a stamp."""
        self.t_ns, self._sums = t_ns, np.zeros(WINDOW_SIZE)
        self._sums[0] = 1.0
        self.turn, self.force_b0, self.rate_b = self._sums[0:4], self._sums[4:7], self._sums[7:10]

    @property
    def end_ns(self) -> int:
        """Time reached, of a window that has begun."""
        return cast("int", self.t_ns)

    @property
    def seconds(self) -> float:
        """Its length so far."""
        return float(self._sums[10])

    def gather(self, block: ImuBlock, start: int, stop: int | None = None, limit_ns: int = ENDLESS_NS) -> int:
        """Take samples ``start`` to ``stop`` of a block in, none after the one that reaches ``limit_ns``; return the next index."""
        columns = (block.stamps_ns[:stop], block.specific_force_b, block.angular_rate_b)
        following, t_ns = gather_window(self.t_ns, self._sums, *columns, start, limit_ns)
        self.t_ns = int(t_ns)
        return following
