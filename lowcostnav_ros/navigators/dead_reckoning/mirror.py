"""Two ranges fit two places, mirror images about the line through the stations; which is the true one, the history of the flight tells.

Both are carried by the same air data and heading, so only the true one goes on fitting the ranges (Gebre-Egziabher 2004, section 2.6,
system G51).  The other place is a core of its own, and what each foretells of the ranges weighs them (Magill, "Optimal adaptive
estimation", IEEE TAC 10, 1965).
"""

import math
from typing import Any, cast

import numpy as np

from lowcostnav_ros.aids._station import StationAid
from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.cores.reckoning import ReckoningCore
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Host, Innovation
from lowcostnav_ros.navigators.headings import Alternative
from lowcostnav_ros.physics.earth import difference_n, displace

APART = 2.0
"""Sigmas between the two places from which on they are two and not one that is known poorly."""
FOR_OWN = 3.0
"""Sigmas that count for the own place at first: the ranges of which the question comes have made them small already."""
DECIDED = 9.0
"""Logarithm of the odds that decides: one in eight thousand."""
MOST = 3.0
"""What one measurement may add to it: a single bad range decides nothing."""
LIMIT = 5.0
"""Sigmas to which an innovation of the other place is limited."""
AGAIN_NS = 120_000_000_000
"""For so long after a decision there is no new question."""


class Mirror:
    """The other place, while it is possible.

    Attributes
    ----------
    core : ReckoningCore or None
    log_odds : float
        Of the navigator's own place against the other.
    moved_ns : int or None
        When history last decided for the other place.
    """

    def __init__(self) -> None:
        self.core: ReckoningCore | None = None
        self.log_odds, self.moved_ns = 0.0, None
        self._decided_ns: int | None = None

    def begin(self, own: ReckoningCore, mirror_n: np.ndarray) -> None:
        """Carry the other place, ``mirror_n`` (2,) m north and east of the own one, too; the covariance is reflected with it."""
        if self.core is not None or (self._decided_ns is not None and own.t_ns - self._decided_ns < AGAIN_NS):
            return
        distance = math.hypot(*mirror_n)
        across = mirror_n / max(distance, 1e-9)
        sigmas = distance / math.sqrt(across @ own.P[0:2, 0:2] @ across)
        if sigmas < APART:
            return
        twin, turned = own.branch(), np.eye(len(own.P))
        turned[0:2, 0:2] -= 2.0 * np.outer(across, across)
        twin.P[:] = turned @ own.P @ turned.T
        twin.nav[:] = displace(own.nav[0], own.nav[1], own.nav[2], np.append(mirror_n, 0.0))
        self.core, self.log_odds = twin, 0.5 * min(sigmas, FOR_OWN) ** 2

    def close(self) -> None:
        """There is one place."""
        self.core = None

    def carry(self, t_ns: int) -> None:
        """Move on to a time."""
        if self.core is not None:
            self.core.arrive(t_ns)

    def hold(self, item: Measurement) -> None:
        """Hold what carries both."""
        if self.core is not None:
            self.core.hold(item)

    def foresee(self, aid: Aid, measurement: Measurement, navigator: Any) -> tuple[float, int | None]:
        """Log likelihood of a measurement at the own place, and the state of its station, before the navigator takes it."""
        innovation = aid.innovation(measurement, navigator)
        score = math.nan if isinstance(innovation, str) else _score(navigator.core, innovation)[0]
        return score, _slot(aid, measurement)

    def take(self, aid: Aid, measurement: Measurement, navigator: Any, before: tuple[float, int | None]) -> None:
        """Let the other place take what the navigator has just been given, and weigh both; where it is decided, be one again."""
        twin, (own, slot) = self.core, before
        if twin is None or not math.isfinite(own) or navigator.excluded(aid):
            return
        if slot != _slot(aid, measurement):  # a new station took a state
            new = cast(int, _slot(aid, measurement))
            kalman.reset_block(twin.P, slice(new, new + 1), np.array([[cast(StationAid, aid).bias_sigma ** 2]]))
            twin.estimate[new] = 0.0
        host = Alternative(navigator, cast(Any, twin))
        innovation = aid.innovation(measurement, cast(Host, host))
        if isinstance(innovation, str):
            return
        other, squared = _score(twin, innovation)
        self.log_odds += float(np.clip(own - other, -MOST, MOST))
        innovation.y = innovation.y / max(1.0, math.sqrt(squared / len(innovation.y)) / LIMIT)
        free = np.ones(len(twin.P)) if innovation.free is None else innovation.free
        host.correct(kalman.update(twin.P, innovation.y, innovation.H, innovation.R, free))
        if abs(self.log_odds) > DECIDED:
            self._decide(navigator)

    def _decide(self, navigator: Any) -> None:
        core, twin = navigator.core, cast(ReckoningCore, self.core)
        self._decided_ns = core.t_ns
        if self.log_odds < 0.0:
            core.settle()
            core.become(twin)
            if navigator.history is not None:
                navigator.history.cut()
            if navigator.offsets is not None:
                navigator.offsets.rest(core.t_ns)
            self.moved_ns = core.t_ns
        self.close()

    def doubt(self, own: ReckoningCore) -> np.ndarray:
        """What the other place adds to the covariance of the position (3, 3), m^2: that of a mixture of both about the own one."""
        if self.core is None:
            return np.zeros((3, 3))
        away = difference_n(*self.core.nav, *own.nav)
        return np.outer(away, away) / (1.0 + math.exp(min(self.log_odds, 700.0)))


def _score(core: ReckoningCore, innovation: Innovation) -> tuple[float, float]:
    return kalman.log_likelihood(core.P, innovation.y, innovation.H, innovation.R)


def _slot(aid: Aid, measurement: Any) -> int | None:
    return aid.slots.index(measurement.station) if isinstance(aid, StationAid) else None
