"""Several headings at once, for a navigator that does not know its own: each flown by a core, weighed by how well it foretells the aids.

While it lasts the navigator's core holds the mean and the covariance of all of them: it is what is published, gated and looked at.  Every
measurement that it takes is taken by each core at its own heading, and the likelihood of each innovation weighs them (Magill, "Optimal
adaptive estimation", IEEE TAC 10, 1965).  When the mixture is as narrow as one heading, it is one again.

Positions and velocities tell headings apart by the force that moved the vehicle.  In straight flight there is none, and what the sensors'
errors and the receiver's noise chance to have in common would weigh the headings at random, further and further: of 1.2 deg/s of turn-on
bias and 0.1 m/s of noise came a sigma of 50 deg after a minute.  Their likelihood counts by the share of the force that stands out of the
filter's doubt of it (:func:`.inertial.heading_shown`).
"""

import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.headings import HEADING, NEGLIGIBLE, WIDTH, merged, spread
from lowcostnav_ros.cores.inertial import InertialCore
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision, Host
from lowcostnav_ros.estimation.error_state import Kind
from lowcostnav_ros.estimation.inertial_spikes import Jolt
from lowcostnav_ros.estimation.time_offsets import TimeOffsets
from lowcostnav_ros.physics.rotation import quat_to_dcm

WIDE, NARROW = 30.0 * DEGREE, 15.0 * DEGREE
"""Sigma of the heading from which on one core does not do, and below which one does."""
GROWN = 0.5 * WIDTH
"""A core whose own sigma has grown to this is cut again."""
UNSEEN = "heading is not known yet"


def all_but_heading(core: InertialCore) -> np.ndarray:
    """States that a position or a velocity may move while nothing shows the heading, (n,): neither it nor its rate's bias.

    Their doubt stays in all that hangs on them (a consider state: Schmidt, "Application of state-space methods to navigation problems",
    Advances in Control Systems 3, 1966), and is there when a force shows the heading.
    """
    free, layout = np.ones(len(core.P)), core.layout
    upright = int(np.argmax(np.abs(quat_to_dcm(core.nav[6:10])[2])))
    free[HEADING] = 0.0
    free[(layout.kind == Kind.GYRO_BIAS) & (layout.axis == upright)] = 0.0
    return free


class Alternative:
    """A navigator as an aid sees it, with another core than its own; no offset of a stamp is learned from it."""

    offsets: TimeOffsets | None = None

    def __init__(self, navigator: Any, core: InertialCore) -> None:
        self._navigator, self.core, self.P = navigator, core, core.P

    def __getattr__(self, name: str) -> Any:
        return getattr(self._navigator, name)

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction; one that is not finite is left out, and the core loses its weight."""
        if np.isfinite(dx).all():
            self.core.correct(dx)


class Headings:
    """The cores of a navigator whose heading is not known, and their shares.

    Attributes
    ----------
    cores : list of InertialCore
        None while one core does.
    shares : ndarray (k,)
    """

    def __init__(self) -> None:
        self.close()

    def close(self) -> None:
        """One core does, or nothing is known."""
        self.cores: list[InertialCore] = []
        self.shares = np.zeros(0)
        self._seen_ns, self._shown = 0, 0.0

    def begin(self, core: InertialCore, states: Sequence[np.ndarray]) -> None:
        """Begin with a state ``nav`` (10,) for each heading, all alike likely; ``core`` has the covariance but for the heading's."""
        self.cores, self.shares = [core.branch() for _ in states], np.full(len(states), 1.0 / len(states))
        for twin, nav in zip(self.cores, states, strict=True):
            twin.nav[:], twin.layout = nav, core.layout
            twin.P[HEADING, HEADING] = (2.0 * math.pi / len(states)) ** 2 / 12.0
        self.show(core)

    def divide(self, core: InertialCore) -> None:
        """Cut the core where its heading is too wide for one, or those of its cores that have grown too wide."""
        if self.cores:
            if max(twin.P[HEADING, HEADING] for twin in self.cores) <= GROWN**2:
                return
            self.shares, self.cores = spread(self.shares, self.cores, core.nav[6:10])
        elif core.P[HEADING, HEADING] > WIDE**2:
            self.shares, self.cores = spread(np.ones(1), [core], core.nav[6:10])
        for twin in self.cores:
            twin.layout = core.layout  # speed and levels are the same for all

    # what moves the navigator's core moves these ------------------------------------------------------------------------------

    def advance(self, block: ImuBlock, start: int, output_ns: int) -> None:
        """As :meth:`.InertialCore.advance`."""
        for twin in self.cores:
            twin.advance(block, start, output_ns)

    def settle(self) -> None:
        """As :meth:`.InertialCore.settle`."""
        for twin in self.cores:
            twin.settle()

    def disturb(self, jolt: Jolt) -> None:
        """As :meth:`.InertialCore.disturb`."""
        for twin in self.cores:
            twin.disturb(jolt.kick, jolt.variance)

    def take(self, aid: Aid, measurement: Measurement, navigator: Any) -> None:
        """Let each core take what an aid has just made the navigator's take, and weigh it by the likelihood of its innovation."""
        if not self.cores or aid.applied is None:
            return
        if measurement.stamp_ns != self._seen_ns:
            self._seen_ns = measurement.stamp_ns
            self._shown = float(self.shares @ [0.0 if twin.hides_heading() else twin.shown() for twin in self.cores])
        scores = np.array([self._taken(aid, measurement, Alternative(navigator, twin), navigator) for twin in self.cores])
        if not np.isfinite(scores).all():
            return
        power = self._shown if aid.seeds else 1.0
        shares = self.shares * np.exp(power * (scores - scores.max()))
        kept = shares >= NEGLIGIBLE * shares.sum()
        self.cores = [twin for twin, stays in zip(self.cores, kept, strict=True) if stays]
        self.shares = shares[kept] / shares[kept].sum()

    def _taken(self, aid: Aid, measurement: Measurement, host: Alternative, navigator: Any) -> float:
        """Log likelihood of a measurement for one core, which takes it; NaN where it says nothing about the heading."""
        core, own = host.core, navigator.core
        core.force_b, core.rate_b = own.force_b, own.rate_b
        innovation = aid.seen_by(cast(Host, host), measurement)
        if isinstance(innovation, str) or aid.applied is None:
            return math.nan
        if navigator.offsets is not None:
            navigator.offsets.take_back(aid, innovation, host)
        if aid.decision is Decision.RECOVER:  # the state was wrong, whatever the heading
            aid.recover(measurement, innovation, cast(Host, host))
            return math.nan
        R = aid.applied.R if aid.applied.late is None else aid.applied.R + aid.applied.late
        score, _ = kalman.log_likelihood(core.P, innovation.y, innovation.H, R)
        free = np.ones(len(core.P)) if aid.applied.free is None else aid.applied.free
        if aid.seeds and core.hides_heading():
            free = all_but_heading(core)
        host.correct(kalman.update(core.P, innovation.y, innovation.H, R, free))
        return score if aid.decision is Decision.FUSE else math.nan

    def show(self, core: InertialCore) -> bool:
        """Give the navigator's core the mean and the covariance of all; return whether one core does from now on."""
        if not self.cores:
            return False
        moved = merged(self.shares, self.cores, core)
        if core.history is not None:
            core.history.correct(moved)
        if core.P[HEADING, HEADING] > NARROW**2:
            return False
        self.close()
        return True
