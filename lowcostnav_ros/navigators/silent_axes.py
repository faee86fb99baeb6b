"""Axes of an inertial unit that repeat one value: their bias is whatever the motion is, until they speak again.

A gyro that reads zero, or stands at its limit, and GPS velocity are explained together by a tilt that is not there, so that no gate ever
sees it.  The bits tell (:mod:`lowcostnav_ros.estimation.inertial_spikes`): such an axis is no measurement, and the state of its bias, as
uncertain as the motion, is what the other sensors find it to be.  Once it speaks again, its bias is that of before.
"""

from typing import Any

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.error_state import Kind
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY

FORCE, RATE = 0.3 * STANDARD_GRAVITY, 5.0 * DEGREE
"""1-sigma of what an axis does not show, m/s^2 and rad/s: a turn, a climb."""
SLOWEST_MPS = 5.0
"""At rest the values of a coarse sensor may well stay as they are."""
GYROS = {3, 4, 5}
NAMES = "accelerometer x", "accelerometer y", "accelerometer z", "gyro x", "gyro y", "gyro z"


class SilentAxes:
    """Which axes say nothing, and their biases of before.

    Parameters
    ----------
    host : InertialNavigator
        With its layout; what it is told changes its core.
    """

    def __init__(self, host: Any) -> None:
        self._host, layout = host, host.layout
        kinds = [(int(kind), axis) for kind in (Kind.ACCEL_BIAS, Kind.GYRO_BIAS) for axis in range(3)]
        self._rows = [np.flatnonzero((layout.kind == kind) & (layout.axis == axis)) for kind, axis in kinds]
        self._latch = Latch("values never change", (host.inertial, "the motion"), "s", begin_s=0.0, end_s=5.0)
        self.clear()

    def clear(self) -> None:
        """Forget all: the state begins anew."""
        self._latch.clear()
        self._silent: dict[int, list[tuple[int, float, float]]] = {}
        self._since_ns = 0

    @property
    def held(self) -> Contradiction | None:
        """The contradiction, while it lasts."""
        return self._latch.held

    @property
    def is_quiet(self) -> bool:
        """Whether a look changes nothing, until an axis falls silent."""
        return not self._silent and self._latch.held is None

    def blind_s(self, t_ns: int) -> float:
        """Since when no gyro has said anything, s; 0 where one does."""
        return 1e-9 * (t_ns - self._since_ns) if self._silent.keys() >= GYROS else 0.0

    def take(self, t_ns: int, silent: np.ndarray) -> None:
        """Take which axes (6,) say nothing from now on."""
        host, core = self._host, self._host.core
        for axis in np.flatnonzero(silent).tolist():
            if axis not in self._silent:
                self._since_ns = self._since_ns if self._silent else t_ns
                self._silent[axis] = [(row, float(core.estimate[row]), float(host.P[row, row])) for row in self._rows[axis].tolist()]
        for axis in [axis for axis in self._silent if not silent[axis]]:
            for row, estimate, variance in self._silent.pop(axis):
                kalman.reset_block(host.P, slice(row, row + 1), np.array([[variance]]), core.history)
                core.estimate[row] = estimate

    def look(self, t_ns: int) -> None:
        """Keep what silent axes do not show as uncertain as a motion; called at every output."""
        speaks = not self._silent or self._host.core.speed_mps < SLOWEST_MPS
        if not speaks:
            least = np.zeros(self._host.layout.size)
            for axis in self._silent:
                least[self._rows[axis][:1]] = FORCE if axis < 3 else RATE
            self._host.widen(least)
        if not speaks or self._latch.held is not None:
            advice = f"{', '.join(NAMES[axis] for axis in sorted(self._silent))} at one value" if self._silent else ""
            self._latch.judge(t_ns, not speaks, 1e-9 * (t_ns - self._since_ns), self._host.inertial, advice)
