"""Carrying a solution to a later stamp with the turning and acceleration that the attitude reference saw, and what may have been missed.

Attitude turns as the attitude reference turned; the velocity changes by gravity and its specific force, by the trapezoid from attitude to
attitude; beyond the newest one its rate and force are held.  Where there is none, the solution's own rate turns its velocity with the
aircraft.  The covariance grows by the velocity's own error over the time, and by what changes between looks can hide.
"""

import itertools
import math
from collections import deque
from dataclasses import replace

import numpy as np

from lowcostnav_ros.base.measurements import Attitude, NavSolution
from lowcostnav_ros.cores.held import LONGEST_TURN_S, Unsteadiness, turn_sigma, turned_on
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY, displace
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, quat_rotate

GRAVITY_N = np.array([0.0, 0.0, STANDARD_GRAVITY])
KEPT_NS = 3_000_000_000
BUMPY = 0.5
"""Acceleration of which an aircraft in rough air shows nothing at the instant it is looked at, m/s^2, sigma."""
BLIND = 5.0
"""The same while nothing shows the specific force."""
ONSET = 3.0
"""Rate of change of the specific force of an aircraft in the air, m/s^3, sigma, when none was seen lately."""
HIDDEN = 0.3
"""Share of a change between two looks by which the trapezoid may be off."""


class Motion:
    """Attitudes of the last seconds, in order, and how unsteady they are."""

    def __init__(self) -> None:
        self._seen: deque[Attitude] = deque()
        self._rate, self._force = Unsteadiness(), Unsteadiness()

    def see(self, attitude: Attitude) -> None:
        """Take the next attitude in; one without rate or force counts as one in steady flight."""
        if attitude.angular_rate_b is None or attitude.specific_force_b is None:
            rate_b = np.zeros(3) if attitude.angular_rate_b is None else attitude.angular_rate_b
            attitude = replace(attitude, angular_rate_b=rate_b, specific_force_b=quat_rotate(quat_conjugate(attitude.q_nb), -GRAVITY_N))
        last = self._seen[-1] if self._seen else None
        if last is not None:
            dt_s = 1e-9 * (attitude.stamp_ns - last.stamp_ns)
            self._rate = self._rate.after(last.angular_rate_b, attitude.angular_rate_b, dt_s)
            self._force = self._force.after(last.specific_force_b, attitude.specific_force_b, dt_s)
        self._seen.append(attitude)
        while attitude.stamp_ns - self._seen[0].stamp_ns > KEPT_NS:
            self._seen.popleft()

    def with_newer(self, attitudes: list[Attitude]) -> "Motion":
        """A copy that has seen further attitudes."""
        twin = Motion()
        twin._seen = deque(self._seen)
        twin._rate, twin._force = self._rate, self._force
        for attitude in attitudes:
            twin.see(attitude)
        return twin

    def at(self, stamp_ns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float] | None:
        """Attitude (4,), rate (3,), specific force (3,) at a stamp, and the sigma per axis, rad, that its age adds; None without any."""
        held = next((a for a in reversed(self._seen) if a.stamp_ns <= stamp_ns), None)
        if held is None:
            return None
        age_s = 1e-9 * (stamp_ns - held.stamp_ns)
        sigma = turn_sigma(held.angular_rate_b, self._rate.value, age_s)
        return turned_on(held.q_nb, held.angular_rate_b, age_s), held.angular_rate_b, held.specific_force_b, sigma

    def attitude(self, stamp_ns: int) -> tuple[np.ndarray, float]:
        """Attitude (4,) at a stamp after one that was seen, and the sigma per axis, rad, that its age adds."""
        q_nb, _, _, sigma = self.at(stamp_ns) or (np.array([1.0, 0.0, 0.0, 0.0]), None, None, math.pi)
        return q_nb, sigma

    def carried(self, solution: NavSolution, stamp_ns: int) -> NavSolution:
        """Return a solution carried to ``stamp_ns``, not before its own, with the covariance grown."""
        dt = 1e-9 * (stamp_ns - solution.stamp_ns)
        if dt <= 0.0 or solution.vel_n is None:
            return solution
        start, end = self.at(solution.stamp_ns), self.at(stamp_ns)
        if solution.q_nb is None or start is None or end is None:
            return self._by_its_own(solution, stamp_ns, dt)
        offset = quat_multiply(solution.q_nb, quat_conjugate(start[0]))  # between both attitude estimates, in n: hardly changes
        inner = [a for a in self._seen if solution.stamp_ns < a.stamp_ns < stamp_ns]
        knots = [(solution.stamp_ns, *start[:3]), *((a.stamp_ns, a.q_nb, a.angular_rate_b, a.specific_force_b) for a in inner)]
        accelerations = [quat_rotate(quat_multiply(offset, q), f) + GRAVITY_N for _, q, _, f in [*knots, (stamp_ns, *end[:3])]]
        stamps = [*(knot[0] for knot in knots), stamp_ns]
        velocity, way, variance = solution.vel_n, np.zeros(3), 0.0
        for (t0, t1), (a0, a1) in zip(itertools.pairwise(stamps), itertools.pairwise(accelerations), strict=True):
            step_s = 1e-9 * (t1 - t0)
            after = velocity + 0.5 * (a0 + a1) * step_s
            way = way + 0.5 * (velocity + after) * step_s
            hidden = math.hypot(BUMPY, HIDDEN * float(np.linalg.norm(a1 - a0)))
            velocity, variance = after, variance + (hidden * step_s) ** 2
        newest_ns = knots[-1][0]
        age_s = 1e-9 * (stamp_ns - newest_ns)
        onset = 0.5 * math.hypot(ONSET, self._force.value) * min(age_s, LONGEST_TURN_S) ** 2
        swung = float(np.linalg.norm(end[2])) * end[3] * age_s / math.sqrt(3.0)  # the force held, in an attitude that may have turned
        variance += onset**2 + swung**2 + (BLIND * max(age_s - LONGEST_TURN_S, 0.0)) ** 2
        q_nb = quat_multiply(offset, end[0])
        sigma = math.hypot(end[3], start[3])
        return _grown(solution, stamp_ns, dt, way, velocity, q_nb, variance, sigma)

    def _by_its_own(self, solution: NavSolution, stamp_ns: int, dt: float) -> NavSolution:
        """Carried without any attitude to go by: the velocity turns with the aircraft, if at all."""
        q_nb, rate_b, velocity = solution.q_nb, solution.angular_rate_b, np.asarray(solution.vel_n)
        turned_s, swing, before = min(dt, LONGEST_TURN_S), 0.0, velocity
        if q_nb is not None and rate_b is not None:
            q_before, q_nb = q_nb, turned_on(q_nb, rate_b, dt)
            velocity = quat_rotate(quat_multiply(q_nb, quat_conjugate(q_before)), velocity)
            swing = turn_sigma(rate_b, self._rate.value, dt)
        way = 0.5 * (before + velocity) * turned_s + velocity * (dt - turned_s)
        variance = (BLIND * dt) ** 2 + float(np.sum((velocity - before) ** 2)) / 4.0
        return _grown(solution, stamp_ns, dt, way, velocity, q_nb, variance, swing)


def _grown(
    solution: NavSolution,
    stamp_ns: int,
    dt: float,
    way: np.ndarray,
    velocity: np.ndarray,
    q_nb: np.ndarray | None,
    variance: float,
    swing: float,
) -> NavSolution:
    lat, lon, height = displace(solution.lat, solution.lon, solution.height, way)
    cov_vel = np.zeros((3, 3)) if solution.cov_vel is None else solution.cov_vel
    tilt = np.zeros((3, 3)) if solution.cov_att is None else solution.cov_att
    unknown = variance * np.eye(3) + tilt * (STANDARD_GRAVITY * dt) ** 2
    return replace(
        solution,
        stamp_ns=stamp_ns,
        lat=lat,
        lon=lon,
        height=height,
        vel_n=velocity,
        q_nb=q_nb,
        cov_pos=_sum_of_sigmas(solution.place_cov, cov_vel * dt * dt) + unknown * (0.5 * dt) ** 2,
        cov_vel=None if solution.cov_vel is None else cov_vel + unknown,
        cov_att=None if solution.cov_att is None else tilt + swing**2 * np.eye(3),
    )


def _sum_of_sigmas(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Covariance of a sum whose parts may be fully correlated: (a + b)(1 + r + 1/r) kept by the best r; not below either."""
    ratio = math.sqrt(max(np.trace(b), 0.0) / max(np.trace(a), 1e-12))
    return a * (1.0 + ratio) + b * (1.0 + 1.0 / ratio) if ratio > 0.0 else a
