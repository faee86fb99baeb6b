"""Aids: one small module per source of information, all of one form.

An aid has three verbs.  ``innovation`` computes measured minus predicted with its Jacobian and noise and changes nothing;
``control`` decides: fuse, reject, limit, or recover after a long run of rejections; ``fuse`` applies.  One status record serves all,
so that a person reads in flight, for every aid alike, what it saw, whether it was used and, if not, why.
"""

from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.settings import setting
from lowcostnav_ros.estimation import kalman


class Decision(Enum):
    """What ``control`` made of an innovation."""

    FUSE = "fuse"
    LIMIT = "limit"
    REJECT = "reject"
    RECOVER = "recover"


@dataclass(frozen=True)
class GateSettings:
    """How an aid's innovations are tested."""

    probability: float = setting(0.9995, "Share of true innovations the gate lets pass.", minimum=0.5, maximum=0.9999999)
    recovery_s: float = setting(10.0, "Rejecting this long makes the aid recover (widen or re-initialise).", unit="s", minimum=0.0)


@dataclass(slots=True)
class Innovation:
    """Measured minus predicted, with what is needed to fuse it.

    ``y`` (m,), ``H`` (m, n), ``R`` (m, m); ``observation`` (m,) is what was measured, in the units of ``Aid.labels``; ``free`` (n,) holds
    0 for states that are considered, not moved; None moves all.
    """

    y: np.ndarray
    H: np.ndarray
    R: np.ndarray
    observation: np.ndarray
    free: np.ndarray | None = None


@dataclass(slots=True)
class AidStatus:
    """The record every aid keeps; the same names live, in replay files and in reports.

    ``test_ratio`` is the normalised innovation squared over its gate: above 1 is rejected.  Arrays have one entry per label.
    """

    name: str
    labels: tuple[str, ...]
    stamp_ns: int = 0
    observation: np.ndarray | None = None
    innovation: np.ndarray | None = None
    innovation_variance: np.ndarray | None = None
    nis: float = 0.0
    test_ratio: float = 0.0
    accepted: bool = False
    reason: str = "nothing received yet"
    accepted_ns: int | None = None
    fused: int = 0
    rejected: Counter = field(default_factory=Counter)

    def age_s(self, now_ns: int) -> float | None:
        """Seconds since the last accepted measurement, None before the first."""
        return None if self.accepted_ns is None else 1e-9 * (now_ns - self.accepted_ns)


class Aid:
    """Base of all aids.

    A subclass gives ``innovation`` and may override ``control`` or ``recover``.  The host is the navigator: it offers ``P`` (n, n),
    ``correct(dx)`` which injects a correction, and whatever state the innovation needs.
    """

    limit_instead_of_reject = False

    def __init__(self, name: str, labels: tuple[str, ...], gate: GateSettings) -> None:
        self.gate = gate
        self.threshold = chi_square.threshold(gate.probability, len(labels))
        self.status = AidStatus(name, labels)
        self._rejecting_since_ns: int | None = None

    def innovation(self, measurement: Measurement, host: Any) -> Innovation | str:
        """Measured minus predicted, or the reason why there is none (one short phrase). Changes nothing."""
        raise TypeError(f"{type(self).__name__} does not define an innovation.")

    def control(self, stamp_ns: int, test_ratio: float, host: Any) -> tuple[Decision, str]:
        """Decide what to do with an innovation of this test ratio, and why when it is not fused."""
        if test_ratio <= 1.0:
            self._rejecting_since_ns = None
            return Decision.FUSE, ""
        if self.limit_instead_of_reject:
            return Decision.LIMIT, "innovation limited"
        if self._rejecting_since_ns is None:
            self._rejecting_since_ns = stamp_ns
        if stamp_ns - self._rejecting_since_ns >= 1e9 * self.gate.recovery_s:
            self._rejecting_since_ns = None
            return Decision.RECOVER, "recovered after rejections"
        return Decision.REJECT, "innovation beyond gate"

    def fuse(self, innovation: Innovation, host: Any) -> None:
        """Apply: update the covariance, inject the correction."""
        free = np.ones(len(host.P)) if innovation.free is None else innovation.free
        host.correct(kalman.update(host.P, innovation.y, innovation.H, innovation.R, free))

    def recover(self, measurement: Measurement, innovation: Innovation, host: Any) -> None:
        """After a long run of rejections: widen the noise until the innovation is believable, and fuse."""
        innovation.R = innovation.R + np.outer(innovation.y, innovation.y)
        self.fuse(innovation, host)

    def process(self, measurement: Measurement, host: Any) -> bool:
        """Run the three verbs on one measurement; return whether it was used."""
        status = self.status
        status.stamp_ns = measurement.stamp_ns
        innovation = self.innovation(measurement, host)
        if isinstance(innovation, str):
            return self._refused(innovation)
        if not all(np.isfinite(part).all() for part in (innovation.y, innovation.H, innovation.R)):
            return self._refused("innovation not finite")
        S = kalman.innovation_covariance(host.P, innovation.H, innovation.R)
        nis = kalman.normalised_innovation_squared(innovation.y, S)
        status.observation, status.innovation, status.innovation_variance = innovation.observation, innovation.y.copy(), np.diag(S).copy()
        status.nis, status.test_ratio = nis, nis / self.threshold
        decision, reason = self.control(measurement.stamp_ns, status.test_ratio, host)
        if decision is Decision.REJECT:
            return self._refused(reason)
        if decision is Decision.RECOVER:
            status.rejected[reason] += 1
            self.recover(measurement, innovation, host)
        else:
            if decision is Decision.LIMIT:
                status.rejected[reason] += 1
                innovation.y = innovation.y / np.sqrt(status.test_ratio)
            self.fuse(innovation, host)
        status.accepted, status.reason, status.accepted_ns = True, reason, measurement.stamp_ns
        status.fused += 1
        return True

    def _refused(self, reason: str) -> bool:
        self.status.accepted, self.status.reason = False, reason
        self.status.rejected[reason.partition(":")[0]] += 1  # counted by name; what follows the colon is this measurement's own
        return False
