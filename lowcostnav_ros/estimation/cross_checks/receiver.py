"""A GPS receiver against itself: displacement of its fixes and its velocity, values that never change, scatter and stated sigma.

With p the fixes and v the velocities, r(t) = p(t) - integral of v dt is constant but for noise.  Medians of r over a few seconds, some time
apart, are compared: a jump shows at once, a ramp of the position alone as soon as it has outgrown the noise, and for as long as
``memory_s`` afterwards; a receiver that has agreed with itself for so long is believed, wherever it is.
"""

from collections.abc import Mapping

import numpy as np

from lowcostnav_ros.base.contradiction import Contradiction
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, Measurement
from lowcostnav_ros.estimation.cross_checks.latch import Latch
from lowcostnav_ros.estimation.cross_checks.scatter import ScatterCheck
from lowcostnav_ros.physics.earth import difference_n

REPEATS, REPEATS_NS = 3, 1_500_000_000
"""So many exact repetitions over such a time are no measurements, if anything moves; a receiver at rest may repeat itself."""
REPEATS_WORDS = "the receiver or its driver repeats old values"
SPACING_NS = 400_000_000
"""Fixes closer than this share their errors: one of them is compared."""
PART_S, MEDIAN = 4.0, 0.5 * np.pi
"""Fixes of so long count by their median, which one that strays does not move, of so many times the variance of a mean."""
HOLE_NS = 3_000_000_000
"""Velocities this far apart are not integrated across."""
SIGMAS = 5.0
SHARED = 0.35
"""Share of a fix's sigma that wanders within a minute and does not average out."""
VELOCITY_BIAS_MPS = 0.03
SMALLEST_M = 0.5
AGREED_S = 20.0
"""Position and velocity that have agreed for so long were sound, so that the navigator's state can tell which of them no longer is."""
FRAME = 0.3
"""Share of the way flown by which a velocity in a wrong frame or unit is off, at least."""
SETTLED_NS = 5_000_000_000
"""After so long the suspect stays: what is excluded no longer moves the navigator's state."""
MOVING_MPS = 1.5
Trusted = Mapping[type, bool]
DISAGREE, FROZEN = "position and velocity disagree", "values never change"


class Repetition:
    """How long a source has given exactly the same values."""

    def __init__(self) -> None:
        self.values: tuple[float, ...] = ()
        self.first_ns, self.count = 0, 0

    def take(self, stamp_ns: int, values: tuple[float, ...]) -> None:
        """Take the values of a measurement."""
        if values == self.values:
            self.count += 1
        else:
            self.values, self.first_ns, self.count = values, stamp_ns, 0

    def lasts(self, stamp_ns: int) -> bool:
        """Whether it has lasted so long that only a vehicle at rest explains it."""
        return self.count >= REPEATS and stamp_ns - self.first_ns >= REPEATS_NS


@kernel
def middle(column):
    """Median of an array (n,), n > 0."""
    ordered, half = column.copy(), column.shape[0] // 2  # a few values: by insertion
    for i in range(1, ordered.shape[0]):
        value, k = ordered[i], i
        while k > 0 and ordered[k - 1] > value:
            ordered[k] = ordered[k - 1]
            k -= 1
        ordered[k] = value
    return ordered[half] if column.shape[0] % 2 else 0.5 * (ordered[half - 1] + ordered[half])


@kernel
def continued(rows, oldest_s, seconds, residual, variance, bend):
    """Rows (n, 8) that are later than ``oldest_s``, and one more."""
    first = 0
    while first < rows.shape[0] and rows[first, 0] <= oldest_s:
        first += 1
    out = np.empty((rows.shape[0] - first + 1, 8))
    out[:-1] = rows[first:]
    last = out[-1]
    last[0], last[7] = seconds, bend
    for axis in range(3):
        last[1 + axis], last[4 + axis] = residual[axis], variance[axis]
    return out


@kernel
def scattered(step, variance, velocity_variance, span, bend):
    """Squared step (3,), m, between two fixes over what their noise, the velocity's and the bend of the way explain: 1 on average."""
    total = 0.0
    for axis in range(3):
        total += step[axis] * step[axis] / (2.0 * variance[axis] + velocity_variance * span**2 + (bend + 0.1 * span) ** 2)
    return total / 3.0


@kernel
def largest_change(rows, spans_s, velocity_variance):
    """Largest change of the residual over its limit, between the newest fixes and those some time before.

    Parameters
    ----------
    rows : ndarray, shape (n, 8)
        Seconds, residual NED, m, variances of the fixes, m^2, and what the integral of the velocity may be off by, m.
    spans_s : ndarray, shape (k,)
    velocity_variance : float
        Of one component, (m/s)^2.

    Returns
    -------
    size, ratio : float
        Length of the change, m, and its largest component over the limit.
    """
    times, last, size, ratio = rows[:, 0], rows.shape[0] - 1, 0.0, 0.0
    now = times[last]
    step = max(0.4, (now - times[0]) / max(last, 1))
    for span in spans_s:
        part = min(PART_S, 0.5 * span)
        new = np.searchsorted(times, now - part, side="right")
        first, end = np.searchsorted(times, now - span - part, side="right"), np.searchsorted(times, now - span, side="right")
        if end == first:
            continue
        free, squared, found = rows[new:, 7].max() + rows[first:end, 7].max(), 0.0, 0.0
        for axis in range(3):
            change = middle(rows[new:, 1 + axis]) - middle(rows[first:end, 1 + axis])
            variance = max(rows[new:, 4 + axis].mean(), rows[first:end, 4 + axis].mean())
            white = MEDIAN * variance * (1.0 / (last + 1 - new) + 1.0 / (end - first)) + velocity_variance * step * span
            sigma = np.sqrt(white + 2.0 * SHARED**2 * variance + (VELOCITY_BIAS_MPS * span) ** 2)
            found = max(found, (abs(change) - free) / (SIGMAS * sigma))
            squared += change * change
        if found > ratio:
            size, ratio = np.sqrt(squared), found
    return size, ratio


def frozen_latch(source: str, against: str) -> Latch:
    """The contradiction of values that never change with something that moves."""
    return Latch(FROZEN, (source, against), "s", begin_s=0.0, end_s=0.0)


class ReceiverCheck:
    """The checks of one receiver.

    Parameters
    ----------
    fix, velocity : str
        Its two sources; what concerns one of them is asked for by the type of its measurement.
    memory_s : float
        How long it must agree with itself to be believed again, s.
    """

    def __init__(self, fix: str, velocity: str, memory_s: float) -> None:
        self.sources, self.memory_s = (fix, velocity), memory_s
        self.fix, self.velocity = (fix, velocity) if fix != velocity else (f"{fix} position", f"{velocity} velocity")
        self.spans_s = np.array([span for span in (5.0, 10.0, 30.0) if span < memory_s] + [memory_s])
        self.disagreement = Latch(DISAGREE, (self.fix, self.velocity), "m", begin_s=1.0)
        parties = ((GpsPosition, self.fix), (GpsVelocity, self.velocity))
        self.frozen: dict[type, Latch] = {kind: frozen_latch(name, "motion") for kind, name in parties}
        self.scatter = ScatterCheck(self.fix)
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        for latch in (self.disagreement, self.scatter, *self.frozen.values()):
            latch.clear()
        self._repeats: dict[type, Repetition] = {GpsPosition: Repetition(), GpsVelocity: Repetition()}
        self._newest_ns = 0
        self._last_velocity: GpsVelocity | None = None
        self.speed_mps = 0.0  # over ground, as it states
        self._agreed_s = 0.0
        self.forget()

    def forget(self) -> None:
        """Begin the comparison anew with the next fix."""
        self.disagreement.clear()
        self._waiting: list[GpsPosition] = []
        self._fix: GpsPosition | None = None
        self._zero_ns = 0
        self._moved, self._moved_at_fix, self._bend, self._residual = np.zeros(3), np.zeros(3), 0.0, np.zeros(3)
        self._rows = np.zeros((0, 8))  # seconds, residual (3), variances (3), bend

    def take(self, item: Measurement, trusted: Trusted) -> None:
        """Take a fix or a velocity; ``trusted``: whether the navigator's state agrees with each source."""
        if isinstance(item, GpsPosition):
            self._repeats[GpsPosition].take(item.stamp_ns, (item.lat, item.lon, item.height))
            self._waiting.append(item)
        elif isinstance(item, GpsVelocity):
            self._repeats[GpsVelocity].take(item.stamp_ns, tuple(item.vel_n.tolist()))
            self._integrate(item, trusted)
        self._newest_ns = item.stamp_ns
        for kind in self.frozen:
            self._look_for_repetition(kind, moving=kind is GpsPosition and self.speed_mps > MOVING_MPS)

    def stuck(self, kind: type) -> bool:
        """Whether a kind of measurement repeats itself exactly, which is no fault of a receiver at rest."""
        return self._repeats[kind].lasts(self._newest_ns)

    def contradicted(self, kind: type) -> bool:
        """Note that the navigator's prediction moves otherwise; return whether this kind of measurement is frozen then."""
        if self.stuck(kind):
            self._look_for_repetition(kind, moving=True)
        return self.is_frozen(kind)

    def is_frozen(self, kind: type) -> bool:
        """Whether a kind of measurement repeats itself although the vehicle moves."""
        return self.frozen[kind].held is not None

    def excluded(self, kind: type) -> str:
        """Why a kind of measurement is not to be used; empty for nothing."""
        if self.is_frozen(kind) or (self.is_frozen(GpsPosition) and self.stuck(kind)):
            return FROZEN
        held = self.disagreement.held
        return DISAGREE if held is not None and held.suspect == (self.fix if kind is GpsPosition else self.velocity) else ""

    @property
    def never_agreed(self) -> bool:
        """Whether the velocity contradicts the fixes, and has from the beginning."""
        held = self.disagreement.held
        return held is not None and held.suspect == self.velocity and self._agreed_s < AGREED_S

    def held(self) -> list[Contradiction]:
        """Contradictions that last."""
        return [latch.held for latch in self.latches if latch.held is not None]

    @property
    def latches(self) -> tuple[Latch, ...]:
        """All its checks."""
        return (*self.frozen.values(), self.disagreement, self.scatter)

    # repetition --------------------------------------------------------------------------------------------------------------

    def _look_for_repetition(self, kind: type, *, moving: bool) -> None:
        latch, repeated = self.frozen[kind], self._repeats[kind]
        is_stuck = repeated.lasts(self._newest_ns) and (moving or latch.held is not None)
        size = 1e-9 * (self._newest_ns - repeated.first_ns)
        latch.judge(self._newest_ns, is_stuck, size, latch.parties[0], REPEATS_WORDS)
        if is_stuck:
            self.forget()

    # displacement ------------------------------------------------------------------------------------------------------------

    def _integrate(self, item: GpsVelocity, trusted: Trusted) -> None:
        """Move on to a velocity; compare the fixes it has waited for."""
        last, self._last_velocity = self._last_velocity, item
        self.speed_mps = float(np.hypot(item.vel_n[0], item.vel_n[1]))
        if last is None or not 0 < item.stamp_ns - last.stamp_ns <= HOLE_NS:
            self.forget()
            return
        span = 1e-9 * (item.stamp_ns - last.stamp_ns)
        waiting, self._waiting = self._waiting, []
        for fix in waiting:
            if fix.stamp_ns >= last.stamp_ns:
                t = 1e-9 * (fix.stamp_ns - last.stamp_ns)
                there = last.vel_n + (item.vel_n - last.vel_n) * (t / span)
                self._compare(fix, self._moved + 0.5 * t * (last.vel_n + there), item, trusted)
        self._moved += 0.5 * span * (last.vel_n + item.vel_n)
        # of a chord for an arc, -dt^2/12 times the change of acceleration is left (Euler-Maclaurin)
        self._bend = float(np.linalg.norm(item.vel_n - last.vel_n)) * span / 6.0

    def _compare(self, fix: GpsPosition, moved: np.ndarray, velocity: GpsVelocity, trusted: Trusted) -> None:
        last = self._fix
        if last is None or fix.stamp_ns - last.stamp_ns > HOLE_NS:
            self.forget()
            self._fix, self._zero_ns = fix, fix.stamp_ns
            return
        if fix.stamp_ns - last.stamp_ns < SPACING_NS:
            return
        step = difference_n(fix.lat, fix.lon, fix.height, last.lat, last.lon, last.height) - (moved - self._moved_at_fix)
        self._fix, self._moved_at_fix = fix, moved
        self._residual = self._residual + step
        variance, of_velocity = np.maximum(fix.cov_n.diagonal(), SMALLEST_M**2), max(velocity.cov_n.diagonal().tolist())
        self._watch_scatter(fix, last, step, variance, of_velocity)
        now_s, stated = 1e-9 * (fix.stamp_ns - self._zero_ns), self.scatter.noise_factor * variance
        self._rows = continued(self._rows, now_s - self.memory_s - PART_S, now_s, self._residual, stated, self._bend)
        size, ratio = largest_change(self._rows, self.spans_s, of_velocity)
        if self._agreed_s < AGREED_S and size < FRAME * float(np.linalg.norm(velocity.vel_n)) * self.spans_s[0]:
            ratio = 0.0  # fixes that wander from the start state too small a sigma; a velocity in a wrong frame is off by far more
        self._agreed_s += 1e-9 * (fix.stamp_ns - last.stamp_ns) if ratio <= 1.0 and self.disagreement.held is None else 0.0
        suspect = self._suspect(trusted)
        advice = "" if suspect == self.fix else "check frame, unit and sign of the velocity"
        began = self.disagreement.judge(fix.stamp_ns, ratio > 1.0, size, suspect, advice)
        if began:
            self._agreed_s = min(self._agreed_s, 2.0 * AGREED_S)

    def _suspect(self, trusted: Trusted) -> str:
        """Velocity where it never agreed with the fixes, whose displacement needs no frame; else what the navigator contradicts."""
        held = self.disagreement.held
        if held is not None and self._newest_ns - held.since_ns > SETTLED_NS:
            return held.suspect
        if self._agreed_s < AGREED_S or self.stuck(GpsVelocity):
            return self.velocity
        return self.velocity if trusted.get(GpsPosition, True) and not trusted.get(GpsVelocity, True) else self.fix

    def _watch_scatter(self, fix: GpsPosition, last: GpsPosition, step: np.ndarray, variance: np.ndarray, velocity_variance: float) -> None:
        if self.disagreement.held is not None and self.disagreement.held.suspect == self.velocity:
            return
        span = 1e-9 * (fix.stamp_ns - last.stamp_ns)
        self.scatter.take(fix.stamp_ns, span, scattered(step, variance, velocity_variance, span, self._bend))
