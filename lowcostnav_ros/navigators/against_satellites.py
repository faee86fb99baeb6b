"""A state that has satellites alone, against them: what is published while they scatter more than they state, or agree elsewhere.

Screening refuses satellites one by one and fuses what passes, so that epochs which contradict the state move it slowly, by the satellites
that are least against it, and its covariance shrinks as if all were well.  Two things show it:

    scatter     the lower median of the squared innovations in their sigmas, over the satellites refused as well, which is a half for sound
                ones, over some seconds: by its excess all that is believed of position and velocity is too good
    elsewhere   where they agree, each epoch by itself, is off the state in the mean over some seconds: half of it covers both

Neither is forgotten for a minute: that the state has come to where they are does not make them right.
"""

import math

import numpy as np

from lowcostnav_ros.aids.gnss import RangeAid, SatelliteAid
from lowcostnav_ros.base import chi_square
from lowcostnav_ros.cores.inertial import CORE, POS, VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.navigators.trust import covering

MEDIAN = 0.455
"""Median of the square of a standard normal variable."""
OVER_S, LONGEST_S = 3.0, 2.5
"""Scatter is averaged over so long; without satellites for longer than the second it begins anew."""
EXCESS, MOST = 3.0, 100.0
"""Excess of the squares that is no chance, and the most that one epoch counts for."""
MEAN_S, WORST = 5.0, 1e6
"""Places are averaged over so long, half of their noise being white; a condition of the geometry beyond which there are none."""
ELSEWHERE = chi_square.threshold(0.9999, 3)
MEMORY_NS = 60_000_000_000


class AgainstSatellites:
    """By how much a state of satellites alone is less well known than its filter believes."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all: the state begins anew."""
        self._scatter: dict[str, float] = {}
        self._excess, self._apart, self._mean = 1.0, np.zeros(3), np.zeros(3)
        self._seen_ns = self._last_ns = 0

    def take(self, stamp_ns: int, aids: list[SatelliteAid], P: np.ndarray) -> None:
        """Take what became of an epoch; ``P`` (n, n) begins with position and velocity."""
        share, self._last_ns = 1e-9 * (stamp_ns - self._last_ns) / OVER_S, stamp_ns
        if share * OVER_S > LONGEST_S:
            self._scatter, self._mean = {}, np.zeros(3)
            return  # what is seen after a pause is what the state has strayed by meanwhile
        for aid in aids:
            before = self._scatter.get(aid.kind, MEDIAN)
            self._scatter[aid.kind] = before + share * (min(aid.scatter, MOST) - before)
        if stamp_ns - self._seen_ns > MEMORY_NS:
            self._excess, self._apart = 1.0, np.zeros(3)
        excess = max(self._scatter.values()) / MEDIAN
        if excess > EXCESS:
            self._excess, self._seen_ns = max(self._excess, excess), stamp_ns
        if isinstance(aids[0], RangeAid):
            self._look_elsewhere(stamp_ns, share * OVER_S, aids[0], P)

    def _look_elsewhere(self, stamp_ns: int, dt_s: float, aid: RangeAid, P: np.ndarray) -> None:
        """Compare the state with the mean of where the satellites are agreed, each epoch by itself."""
        obs = aid.observed
        if obs is None:
            return
        columns = aid.shared(obs)
        if len(obs.y) <= columns.shape[1]:
            return
        weighed = columns.T / obs.r
        information = weighed @ columns
        if np.linalg.cond(information) > WORST:
            return
        covariance = np.linalg.inv(information)
        share = min(dt_s / MEAN_S, 1.0)
        self._mean += share * ((covariance @ weighed @ obs.y)[POS] - self._mean)
        noise = covariance[POS, POS] * 2.0 * share / (2.0 - share)
        if kalman.normalised_innovation_squared(self._mean, P[POS, POS] + noise) > ELSEWHERE:
            self._seen_ns = stamp_ns
            if float(self._mean @ self._mean) > float(self._apart @ self._apart):
                self._apart = self._mean.copy()

    def doubt(self, P: np.ndarray) -> np.ndarray | None:
        """What is added to the covariance (9, 9) of position, velocity and attitude; None for nothing."""
        if self._excess == 1.0 and not self._apart.any():
            return None
        added = np.zeros((CORE, CORE))
        added[:6, :6] = (self._excess - 1.0) * P[:6, :6]
        added[POS, POS] += covering(self._apart)
        added[VEL, VEL] += covering(self._apart) / (1e-9 * MEMORY_NS) ** 2
        return added

    def words(self) -> str:
        """What is doubted, for people; empty for nothing."""
        apart = math.sqrt(float(self._apart @ self._apart))
        if apart > 0.0:
            return f"satellites agreed {apart:.3g} m away from the state"
        return f"satellites scatter {math.sqrt(self._excess):.2g} times as far as they state" if self._excess > 1.0 else ""
