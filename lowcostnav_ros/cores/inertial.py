"""The inertial core: strapdown mean and error covariance, carried through whole blocks of samples by one compiled call.

Core error state (9), true minus estimated: position NED [m], velocity NED [m/s], attitude ``phi_n`` [rad] with
``C_true = (I + [phi x]) C_est``.  Further blocks couple by their kind.  With f the specific force and C = C_nb:

    d(dp)/dt  = P2P dp + dv
    d(dv)/dt  = P2V dp + V2V dv - [f_n x] phi - C db_a - C diag(f_b) ds_a
    d(phi)/dt = P2A dp + V2A dv - [w_in x] phi - C db_g - C diag(w_b) ds_g

The blocks are the linearised navigation equations in metres (Solimeno (3-47), (3-51), (3-54); Gebre-Egziabher appendix A as
corrected), checked against differences of the strapdown step in the tests.
"""

import copy

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.base.small_matrices import matmul, turned
from lowcostnav_ros.cores import rows
from lowcostnav_ros.cores.bridging import LastMotion
from lowcostnav_ros.cores.views import Motion, VelocitySeen
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Kind, Layout
from lowcostnav_ros.estimation.horizon import HOLE_NS
from lowcostnav_ros.estimation.smoothing import History
from lowcostnav_ros.physics.earth import EARTH_RATE, STANDARD_GRAVITY, displace, gravity, radii
from lowcostnav_ros.physics.rotation import quat_apply_phi_n, quat_rotate, quat_to_dcm, rotated, rows_of, skew
from lowcostnav_ros.physics.strapdown import strapdown_step

POS, VEL, ATT = slice(0, 3), slice(3, 6), slice(6, 9)
CORE = 9
COVARIANCE_STEP_NS, NO_OUTPUT_NS = 100_000_000, 2**62
GAP_NS = HOLE_NS
SMOOTHED_S = 2.0
DOUBTS = 2.0
"""Sigmas; with 4 a straight flight is no better covered, and weak accelerations are thrown away."""
ACCEL_BIAS, GYRO_BIAS, ACCEL_SCALE, GYRO_SCALE, CHAIN = map(
    int, (Kind.ACCEL_BIAS, Kind.GYRO_BIAS, Kind.ACCEL_SCALE, Kind.GYRO_SCALE, Kind.CHAIN)
)


@kernel
def inertial_dynamics(nav, f_n, f_b, w_b, C, kind, axis, rate):
    """Continuous error dynamics F (n, n) at a navigation state; the equations of the module head.

    ``f_n`` mean specific force in n, ``f_b``, ``w_b`` mean corrected specific force and rate in b, ``C`` mean C_nb of the interval.
    """
    n = kind.shape[0]
    F = np.zeros((n, n))
    lat, height = nav[0], nav[2]
    vn, ve, vd = nav[3], nav[4], nav[5]
    rm, rn = radii(lat)
    a, b = rm + height, rn + height
    s, c = np.sin(lat), np.cos(lat)
    t = s / c
    wx, wz = EARTH_RATE * c, EARTH_RATE * s
    # position, coordinates (R_M+h) dlat, (R_N+h) cos(lat) dlon, -dh
    F[0, 0], F[0, 2], F[0, 3] = -vd / a, vn / a, 1.0
    F[1, 0], F[1, 1], F[1, 2], F[1, 4] = ve * t / a, -(vd + vn * t) / b, ve / b, 1.0
    F[2, 5] = 1.0
    # velocity from position: earth rate and meridian convergence turn with latitude, gravity falls with height
    F[3, 0] = (-2.0 * ve * wx - ve * ve / (b * c * c)) / a
    F[3, 2] = vn * vd / (a * a) - ve * ve * t / (b * b)
    F[4, 0] = (2.0 * (vn * wx - vd * wz) + ve * vn / (b * c * c)) / a
    F[4, 2] = ve * (vd + vn * t) / (b * b)
    F[5, 0] = 2.0 * ve * wz / a
    F[5, 2] = 2.0 * gravity(lat, height) / (np.sqrt(rm * rn) + height) - ve * ve / (b * b) - vn * vn / (a * a)
    # velocity from velocity: Coriolis and transport rate
    F[3, 3], F[3, 4], F[3, 5] = vd / a, -2.0 * (wz + ve * t / b), vn / a
    F[4, 3], F[4, 4], F[4, 5] = 2.0 * wz + ve * t / b, (vd + vn * t) / b, 2.0 * wx + ve / b
    F[5, 3], F[5, 4] = -2.0 * vn / a, -2.0 * (wx + ve / b)
    # velocity from attitude: -[f_n x]
    F[3, 7], F[3, 8] = f_n[2], -f_n[1]
    F[4, 6], F[4, 8] = -f_n[2], f_n[0]
    F[5, 6], F[5, 7] = f_n[1], -f_n[0]
    # attitude from position and velocity: the error of the rate of n
    F[6, 0], F[6, 2], F[6, 4] = wz / a, -ve / (b * b), -1.0 / b
    F[7, 2], F[7, 3] = vn / (a * a), 1.0 / a
    F[8, 0], F[8, 2], F[8, 4] = (wx + ve / (b * c * c)) / a, ve * t / (b * b), t / b
    # attitude from attitude: -[w_in x]
    w0, w1, w2 = wx + ve / b, -vn / a, -wz - ve * t / b
    F[6, 7], F[6, 8] = w2, -w1
    F[7, 6], F[7, 8] = -w2, w0
    F[8, 6], F[8, 7] = w1, -w0
    for i in range(CORE, n):
        F[i, i] = -rate[i]
        k = axis[i]
        for r in range(3):
            if kind[i] == ACCEL_BIAS:
                F[3 + r, i] = -C[r, k]
            elif kind[i] == GYRO_BIAS:
                F[6 + r, i] = -C[r, k]
            elif kind[i] == ACCEL_SCALE:
                F[3 + r, i] = -C[r, k] * f_b[k]
            elif kind[i] == GYRO_SCALE:
                F[6 + r, i] = -C[r, k] * w_b[k]
        if kind[i] == CHAIN and k > 0:
            F[i - 1, i] = 1.0
    return F


@kernel
def noise_density(C, psd):
    """Driving-noise density mapped to the states, G Q G' (n, n): sensor white noise turned to n, the rest on the diagonal."""
    n = psd.shape[0]
    GQG = np.zeros((n, n))
    for i in range(3):
        for j in range(3):
            accel, gyro = 0.0, 0.0
            for k in range(3):
                accel += C[i, k] * psd[3 + k] * C[j, k]
                gyro += C[i, k] * psd[6 + k] * C[j, k]
            GQG[3 + i, 3 + j] = accel
            GQG[6 + i, 6 + j] = gyro
    for i in range(3):
        GQG[i, i] = psd[i]
    for i in range(CORE, n):
        GQG[i, i] = psd[i]
    return GQG


@kernel
def sensor_errors(estimate, kind, axis):
    """Sum the estimated sensor errors over the blocks: rows accel bias, gyro bias, accel scale, gyro scale, shape (4, 3)."""
    total = np.zeros((4, 3))
    for i in range(CORE, kind.shape[0]):
        if ACCEL_BIAS <= kind[i] <= GYRO_SCALE:
            total[kind[i] - 1, axis[i]] += estimate[i]
    return total


@kernel
def without_errors(f, w, estimate, kind, axis, out):
    """Specific force and rate of a sample with the estimated sensor errors taken out, into ``out`` (2, 3)."""
    errors = sensor_errors(estimate, kind, axis)
    out[0] = (f - errors[0]) / (1.0 + errors[2])
    out[1] = (w - errors[1]) / (1.0 + errors[3])


@kernel
def heading_shown(F, P, sums, psd):
    """Share 0..1 of the horizontal specific force that is more than the filter's own doubt of it, and shows the heading.

    The force that turns with a heading error is the true one; the estimated one is wrong by tilt, sensor errors and noise.  In straight
    flight nothing else is left of it, and a filter that takes it as it is gathers information about a heading which nothing shows: of a
    low-cost unit whose heading wandered off by 100 deg it said 8 deg.  Judged on the mean of the interval and on one of ``SMOOTHED_S``,
    in which noise falls and a long weak acceleration stays; what reaches ``DOUBTS`` sigmas counts by what it is beyond them.
    """
    dt, n = sums[0], P.shape[0]
    doubt = 0.0
    for r in range(3, 5):
        for i in range(6, n):
            if i != 8 and F[r, i] != 0.0:
                for j in range(6, n):
                    if j != 8:
                        doubt += F[r, i] * P[i, j] * F[r, j]
    noise = psd[3] + psd[4]
    weight = np.exp(-dt / SMOOTHED_S)
    now, long = 0.0, 0.0
    for r in range(2):
        mean = sums[1 + r] / dt
        sums[19 + r] = weight * sums[19 + r] + (1.0 - weight) * mean
        now += mean * mean
        long += sums[19 + r] * sums[19 + r]
    least = DOUBTS * DOUBTS
    shown = 1.0 - least * (doubt + noise / dt) / max(now, 1e-12)
    shown = max(shown, 1.0 - least * (doubt + 0.5 * noise / SMOOTHED_S) / max(long, 1e-12))
    return max(shown, 0.0)


@kernel
def covariance_step(nav, sums, P, estimate, kind, axis, rate, psd, track):
    """Carry P over the interval gathered in ``sums`` and clear it; estimates of Gauss-Markov states decay, those of a chain add up.

    ``sums`` (23,): elapsed s, then integrals of f_n (3), C_nb (9), f_b (3), w_b (3); the horizontal force smoothed (2) stays, and so do the
    integral of what of it shows the heading and its time (:meth:`InertialCore.shown`).
    ``track``: see :func:`.kalman.lead`.
    """
    dt = sums[0]
    if dt <= 0.0:
        return
    C = sums[4:13].reshape(3, 3) / dt
    F = inertial_dynamics(nav, sums[1:4] / dt, sums[13:16] / dt, sums[16:19] / dt, C, kind, axis, rate)
    share = heading_shown(F, P, sums, psd)
    sums[21] += share * dt
    sums[22] += dt
    F[3, 8] *= share
    F[4, 8] *= share
    Phi = kalman.transition(F, dt)
    kalman.predict_covariance(P, Phi, noise_density(C, psd), dt)
    kalman.lead(track, Phi)
    for i in range(CORE, kind.shape[0]):
        if rate[i] > 0.0:
            estimate[i] *= np.exp(-rate[i] * dt)
        if kind[i] == CHAIN and axis[i] > 0:
            estimate[i - 1] += estimate[i] * dt
    sums[:19] = 0.0


@kernel
def mean_step(nav, last, f, w, dt):
    """One strapdown step from mean specific force and rate; ``last`` (6,) holds the previous sample's for coning and sculling."""
    before_f, before_w = (last[0] * dt, last[1] * dt, last[2] * dt), (last[3] * dt, last[4] * dt, last[5] * dt)
    strapdown_step(nav, (f[0] * dt, f[1] * dt, f[2] * dt), (w[0] * dt, w[1] * dt, w[2] * dt), before_f, before_w, dt)
    for r in range(3):
        last[r] = f[r]
        last[3 + r] = w[r]


@kernel
def gather(sums, q, f, w, dt):
    """Add a sample to the integrals of :func:`covariance_step`, ``q`` (4,) the attitude at its end."""
    C = rows_of(q)
    sums[0] += dt
    for r in range(3):
        sums[1 + r] += (C[r][0] * f[0] + C[r][1] * f[1] + C[r][2] * f[2]) * dt
        sums[13 + r] += f[r] * dt
        sums[16 + r] += w[r] * dt
        for j in range(3):
            sums[4 + 3 * r + j] += C[r][j] * dt


@kernel
def run_block(t_ns, nav, last, sums, P, estimate, kind, axis, rate, psd, track, stamps, f_m, w_m, start, step_ns, output_ns, seen):
    """Carry mean and covariance through inertial samples ``start``...; stop after the one on which an output falls due.

    Returns the index of the next sample and the stamp reached; that one sample goes, its errors taken out, into ``seen`` (2, 3).
    Covariance steps fall on a grid of stamps, never on the cut of a block.
    """
    errors, f, w = sensor_errors(estimate, kind, axis), np.empty(3), np.empty(3)
    for k in range(start, stamps.shape[0]):
        dt = (stamps[k] - t_ns) * 1e-9
        for r in range(3):
            f[r] = (f_m[k, r] - errors[0, r]) / (1.0 + errors[2, r])
            w[r] = (w_m[k, r] - errors[1, r]) / (1.0 + errors[3, r])
        mean_step(nav, last, f, w, dt)
        gather(sums, nav[6:10], f, w, dt)
        due = stamps[k] // output_ns != t_ns // output_ns
        if due or stamps[k] // step_ns != t_ns // step_ns:
            covariance_step(nav, sums, P, estimate, kind, axis, rate, psd, track)
            errors = sensor_errors(estimate, kind, axis)
        t_ns = stamps[k]
        if due:
            for r in range(3):
                seen[0, r] = (f_m[k, r] - errors[0, r]) / (1.0 + errors[2, r])
                seen[1, r] = (w_m[k, r] - errors[1, r]) / (1.0 + errors[3, r])
            return k + 1, t_ns
    return stamps.shape[0], t_ns


@kernel
def run_rows(t_ns, nav, last, sums, P, estimate, kind, axis, rate, psd, track, stamps, f_m, w_m, start, step_ns, output_ns, seen,
             until_ns, added, wind, row_stamps, table):
    """The same from one output to the next, each written into ``table``; stop after one that comes at ``until_ns`` or later, or fills it.

    Returns the index of the next sample, the stamp reached, how many rows were written, and whether a solution was none.
    """  # fmt: skip
    k, count, is_lost = start, 0, False
    while k < stamps.shape[0]:
        before_ns = t_ns
        k, t_ns = run_block(t_ns, nav, last, sums, P, estimate, kind, axis, rate, psd, track, stamps, f_m, w_m, k, step_ns, output_ns, seen)
        if t_ns // output_ns == before_ns // output_ns:
            break
        if count < table.shape[0]:
            if rows.write(nav, P, added, estimate, seen[0], seen[1], wind, table[count]):
                row_stamps[count] = t_ns
                count += 1
            else:
                is_lost = True
        if t_ns >= until_ns or count == table.shape[0]:
            break
    return k, t_ns, count, is_lost


@kernel
def turn_covariance(P, heading):
    """Turn the covariance of tilt and heading errors with a correction of the heading, rad, in place.

    How the attitude errors hang together with the sensor errors was gathered along the heading estimated until now, and belongs to the
    body.  Left in n through a large correction (a low-cost unit before its first turn), those correlations point where the sensor no
    longer is, and the filter treats as observed what is not.  So far the left-invariant filter (Barrau and Bonnabel, IEEE TAC 62, 2017);
    position and velocity stay, and so does what a tilt would turn: aids measure them in n, and an ellipsoid that is flat, as a barometer
    leaves it in an outage, would be thinned along its length.
    """
    c, s = np.cos(heading), np.sin(heading)
    n = P.shape[0]
    for j in range(n):
        north, east = P[6, j], P[7, j]
        P[6, j], P[7, j] = c * north - s * east, s * north + c * east
    for i in range(n):
        north, east = P[i, 6], P[i, 7]
        P[i, 6], P[i, 7] = c * north - s * east, s * north + c * east
    P[7, 6] = P[6, 7]


@kernel
def inject(nav, estimate, P, track, dx, floor, ceiling):
    """Move the state by a correction (n,), in place, and turn and guard its covariance; return how often the guard had to act.

    ``track``: see :func:`.kalman.lead`; the correction turns it as it turns the covariance.
    """
    for j in range(track.shape[1]):
        north, east = track[6, j], track[7, j]
        track[6, j], track[7, j] = np.cos(dx[8]) * north - np.sin(dx[8]) * east, np.sin(dx[8]) * north + np.cos(dx[8]) * east
    nav[0], nav[1], nav[2] = displace(nav[0], nav[1], nav[2], dx[0:3])
    nav[3:6] += dx[3:6]
    nav[6:10] = quat_apply_phi_n(nav[6:10], dx[6:9])
    turn_covariance(P, dx[8])
    estimate[CORE:] += dx[CORE:]
    return kalman.guard_covariance(P, floor, ceiling)


@kernel
def rate_of(nav, last, force_b, rate_b, out):
    """Velocity, acceleration over ground and rate of turn into the first nine of ``out``; by ``last`` (6,) where there is such a sample."""
    moved = False
    for k in range(6):
        moved = moved or last[k] != 0.0
    force_n = rotated(nav[6:10], last[0:3] if moved else force_b)
    rate_n = rotated(nav[6:10], last[3:6] if moved else rate_b)
    for k in range(3):
        out[k], out[3 + k], out[6 + k] = nav[3 + k], force_n[k], rate_n[k]
    out[5] += STANDARD_GRAVITY


@kernel
def swing(q, rate_b, arm_b, kind, axis, H):
    """What a lever arm adds to a velocity, C (w x l), shape (3,); its Jacobian and the velocity's into ``H`` (3, n) of zeros."""
    w, a = rate_b, arm_b
    out = np.array(rotated(q, (w[1] * a[2] - w[2] * a[1], w[2] * a[0] - w[0] * a[2], w[0] * a[1] - w[1] * a[0])))
    by_attitude, by_rate = skew(out), matmul(quat_to_dcm(q), skew(arm_b))
    for i in range(3):
        H[i, 3 + i] = 1.0
        for j in range(3):
            H[i, 6 + j] = -by_attitude[i, j]
        for j in range(CORE, kind.shape[0]):
            if kind[j] == GYRO_BIAS:
                H[i, j] = by_rate[i, axis[j]]
    return out


class InertialCore:
    """Mean state, estimates of all further blocks and covariance of a navigator that integrates an IMU.

    Attributes
    ----------
    nav : ndarray (10,)
        lat, lon [rad], height [m], velocity NED [m/s], q_nb.
    estimate : ndarray (n,)
        Current estimates of the block states; the first nine are unused (they live in ``nav``).
    P : ndarray (n, n)
    t_ns : int
    force_b, rate_b : ndarray (3,)
        Specific force, m/s^2, and rate, rad/s, of a late sample, sensor errors taken out: of that of an output, or by :meth:`note`.
    """

    velocity_rows, attitude_rows = VEL, ATT
    ranging = None
    climbs_by_aids = False
    history: History | None = None

    def __init__(self, layout: Layout, variance_ceiling: np.ndarray | None = None) -> None:
        self.layout, self.wind_rows = layout, layout.components(Kind.WIND, 2)
        self.nav = np.zeros(10)
        self.estimate = np.zeros(layout.size)
        self.P = layout.initial_covariance()
        self.t_ns = 0
        self.guard_actions = 0
        self._newest: ImuBlock | None = None
        self.rest()
        self._last = np.zeros(6)
        self._sums = np.zeros(23)
        self._motion: LastMotion | None = None  # that a hole began with
        self._feigned = DOUBTS**2 * 2.0 / 3.0 * float(np.sum(layout.sigma0[layout.kind == ACCEL_BIAS] ** 2))
        self._floor = 1e-12 * np.maximum(layout.sigma0, 1e-9) ** 2
        self._ceiling = np.full(layout.size, 1e14) if variance_ceiling is None else variance_ceiling

    def start(self, t_ns: int, nav: np.ndarray, core_covariance: np.ndarray) -> None:
        """Begin at a state with the covariance of the nine core states; all other blocks at their initial sigma."""
        self.nav[:] = nav
        self.t_ns = int(t_ns)
        self.estimate[:] = 0.0
        self.P = self.layout.initial_covariance()
        self.P[:CORE, :CORE] = core_covariance
        self._last[:] = 0.0
        self._sums[:] = 0.0
        self._motion = None

    def advance(self, block: ImuBlock, start: int, output_ns: int, page: rows.Page = rows.NO_PAGE) -> int:
        """Run samples of an ImuBlock from index ``start``, writing what falls due on a page; return the next index.

        Short of the end of the block, the state is that of the output that ended the run.
        """
        layout, self._motion, seen = self.layout, None, np.empty((2, 3))
        track = kalman.NO_TRACK if self.history is None else self.history.begin(self.P)
        following, t_ns, count, is_lost = run_rows(
            *(self.t_ns, self.nav, self._last, self._sums, self.P, self.estimate, layout.kind, layout.axis, layout.rate, layout.psd, track),
            *(block.stamps_ns, block.specific_force_b, block.angular_rate_b, start, COVARIANCE_STEP_NS, output_ns, seen),
            *(page.until_ns, page.added, page.wind, page.stamps_ns, page.table),
        )
        if t_ns // output_ns != self.t_ns // output_ns:
            self.force_b, self.rate_b = seen
        self.t_ns = int(t_ns)
        if page is not rows.NO_PAGE:
            page.close(count, is_lost=is_lost)
        if self.history is not None:
            self.history.end(self.P)
        return following

    def branch(self) -> "InertialCore":
        """A copy that may be flown on alone."""
        twin = copy.copy(self)
        twin.history, twin.layout, twin._newest = None, self.layout.branch(), None
        twin.nav, twin.estimate, twin.P = self.nav.copy(), self.estimate.copy(), self.P.copy()
        twin._last, twin._sums = self._last.copy(), self._sums.copy()
        return twin

    def fly(self, block: ImuBlock, until_ns: int, output_ns: int) -> bool:
        """Run the samples of a block that are later than the state, and no later than ``until_ns``; return whether none is left."""
        stop = int(np.searchsorted(block.stamps_ns, until_ns, side="right"))
        part, first = block[:stop], int(np.searchsorted(block.stamps_ns[:stop], self.t_ns, side="right"))
        while first < stop:
            first = self.advance(part, first, output_ns)
        return stop == len(block)

    def arrive(self, t_ns: int) -> None:
        """Come to a time that no sample bears: as they are pieced together, one always does."""

    def shown(self) -> float:
        """Mean share 0..1 of the horizontal force that has shown the heading since this was asked last (:func:`heading_shown`)."""
        share = self._sums[21] / self._sums[22] if self._sums[22] > 0.0 else 0.0
        self._sums[21:] = 0.0
        return float(share)

    def hides_heading(self) -> bool:
        """Whether the horizontal force of the last seconds is no more than what accelerometer biases may be, and shows no heading.

        What is known of these biases is known for the heading that is believed: in a slow, steady circle a wrong heading and a bias that
        is constant in the body explain the force as well as the true ones do.  So they count as little known as they were at the start.
        """
        return bool(self._sums[19] ** 2 + self._sums[20] ** 2 < self._feigned)

    def become(self, other: "InertialCore") -> None:
        """Take over the state of another core of the same layout and time."""
        self.nav[:], self.estimate[:], self.P[:] = other.nav, other.estimate, other.P
        self._last[:], self._sums[:] = other._last, other._sums

    def motion(self) -> Motion:
        """Place, velocity and attitude with their covariance."""
        return Motion((self.nav[0], self.nav[1], self.nav[2]), self.nav[VEL], self.nav[6:10], self.P[:CORE, :CORE])

    def settle(self) -> None:
        """Bring the covariance to the time of the mean (before an aid)."""
        layout = self.layout
        track = kalman.NO_TRACK if self.history is None else self.history.begin(self.P)
        covariance_step(self.nav, self._sums, self.P, self.estimate, layout.kind, layout.axis, layout.rate, layout.psd, track)
        if layout.is_paced:  # here, not in advance: aids and outputs fall at stamps, blocks of samples are cut anywhere
            layout.pace(self.speed_mps)
        if self.history is not None:
            self.history.end(self.P)

    def disturb(self, kick_b: np.ndarray, variance_b: np.ndarray) -> None:
        """Add a velocity and a rotation (6,) in b, m/s and rad, that samples did not show, and their variances (6,)."""
        self.settle()
        C = self.C_nb()
        self.nav[3:6] += C @ kick_b[:3]
        self.nav[6:10] = quat_apply_phi_n(self.nav[6:10], C @ kick_b[3:])
        for part, variance in ((VEL, variance_b[:3]), (ATT, variance_b[3:])):
            kalman.add_variance(self.P, part, turned(C, np.diag(variance)), self.history)

    def widen(self, least: np.ndarray) -> None:
        """Raise the sigmas of the error state to those of ``least`` (n,)."""
        self.settle()
        kalman.raise_sigmas(self.P, least, self.history)

    def bridge(self, t_ns: int) -> None:
        """Carry the state to ``t_ns`` over a hole in the inertial data (:mod:`.bridging`)."""
        self.settle()
        layout, dt = self.layout, 1e-9 * (t_ns - self.t_ns)
        if self._motion is None:
            self._motion = LastMotion(self.C_nb(), self._last[0:3], self._last[3:6])
        decay, Phi = np.exp(-layout.rate * dt), np.diag(np.where(layout.kind == CHAIN, 1.0, np.exp(-layout.rate * dt)))
        Phi[:CORE, :CORE] = self._motion.carry(self.nav, dt)
        before = self.P if self.history is None else self.history.begin(self.P)
        Q = np.diag(layout.psd * dt)
        Q[:CORE, :CORE] = self._motion.noise(self.P, dt)
        for i in np.flatnonzero((layout.kind == CHAIN) & (layout.axis > 0)):
            Phi[i - 1, i] = dt
            self.estimate[i - 1] += self.estimate[i] * dt
        self.P[:] = Phi @ self.P @ Phi.T + Q
        self.estimate[CORE:] *= decay[CORE:]
        if self.history is not None:
            kalman.lead(before, Phi)
            self.history.end(self.P)
        self.t_ns, self._newest = int(t_ns), None
        C = self.C_nb()
        self.force_b, self.rate_b = C.T @ np.array([0.0, 0.0, -STANDARD_GRAVITY]), C.T @ np.array([0.0, 0.0, self._motion.turn])
        self._last[0:3], self._last[3:6] = 0.0, 0.0

    def correct(self, dx: np.ndarray) -> None:
        """Inject a correction (n,): the estimate moves, the error state is zero again."""
        if self.history is not None:
            self.history.correct(dx)
        track = kalman.NO_TRACK if self.history is None else self.history.begin(self.P)
        self.guard_actions += inject(self.nav, self.estimate, self.P, track, dx, self._floor, self._ceiling)
        if self.history is not None:
            self.history.end(self.P)

    def errors(self) -> np.ndarray:
        """Estimated sensor errors, shape (4, 3): accel bias, gyro bias, accel scale, gyro scale."""
        return sensor_errors(self.estimate, self.layout.kind, self.layout.axis)

    def corrected(self, specific_force_b: np.ndarray, angular_rate_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Take the estimated sensor errors out of a sample."""
        out = np.empty((2, 3))
        without_errors(specific_force_b, angular_rate_b, self.estimate, self.layout.kind, self.layout.axis, out)
        return out[0], out[1]

    def predicted(self, block: ImuBlock | None) -> tuple[int, np.ndarray, np.ndarray]:
        """Mean state and covariance at the end of ``block`` (samples beyond the horizon, or None), leaving this state alone."""
        layout, t_ns = self.layout, self.t_ns
        nav, sums, P, estimate = self.nav.copy(), self._sums.copy(), self.P.copy(), self.estimate.copy()
        kinds = layout.kind, layout.axis, layout.rate, layout.psd, kalman.NO_TRACK
        if block is not None:
            samples, last = (block.stamps_ns, block.specific_force_b, block.angular_rate_b), self._last.copy()
            steps = 0, COVARIANCE_STEP_NS, NO_OUTPUT_NS, np.empty((2, 3))
            _, t_ns = run_block(t_ns, nav, last, sums, P, estimate, *kinds, *samples, *steps)
        covariance_step(nav, sums, P, estimate, *kinds)
        return int(t_ns), nav, P

    def rest(self) -> None:
        """Take the latest sample for that of a unit at rest."""
        self.rate_b, self.force_b = np.zeros(3), np.array([0.0, 0.0, -STANDARD_GRAVITY])
        self._newest = None

    def note(self, block: ImuBlock | None = None, row: int = -1) -> None:
        """Keep the corrected specific force and rate of a sample; without a block, of the newest one passed."""
        block = self._newest if block is None else block
        if block is not None:
            self.force_b, self.rate_b = self.corrected(block.specific_force_b[row], block.angular_rate_b[row])

    def passed(self, block: ImuBlock) -> None:
        """Remember a block that was run through."""
        self._newest = block

    def latest(self, block: ImuBlock | None) -> tuple[np.ndarray, np.ndarray]:
        """Corrected specific force and rate of the last sample of a block beyond the horizon, or of the newest passed."""
        block = self._newest if block is None else block
        if block is None:
            return self.force_b, self.rate_b
        return self.corrected(block.specific_force_b[-1], block.angular_rate_b[-1])

    def course_n(self) -> np.ndarray:
        """Velocity (3,), m/s, by which the true one changes but for what is estimated."""
        return self.nav[VEL].copy()

    def state_rate(self) -> np.ndarray:
        """How fast the true state moves, in the coordinates of the error state (n,) per second; by the last sample that was run."""
        out = np.zeros(self.layout.size)
        rate_of(self.nav, self._last, self.force_b, self.rate_b, out)
        return out

    def output_rows(self) -> dict[str, np.ndarray]:
        """Quantities of a solution by the error states, (m, n) each, for the smoother."""
        states = np.eye(self.layout.size)
        return {"pos": states[POS], "vel": states[VEL], "att": states[ATT], "wind": self.wind_rows}

    # views of aids -----------------------------------------------------------------------------------------------------------

    @property
    def speed_mps(self) -> float:
        """Speed over ground, m/s."""
        return float(np.hypot(self.nav[3], self.nav[4]))

    def C_nb(self) -> np.ndarray:
        """Rotation (3, 3) from b to n."""
        return quat_to_dcm(self.nav[6:10])

    def lever_n(self, lever_b: np.ndarray) -> np.ndarray:
        """Lever arm (3,), m, turned to n."""
        return quat_rotate(self.nav[6:10], lever_b)

    def height_residual(self, height: float, bias: float) -> float:
        """A height, m, less the estimated one and an estimated bias."""
        return height - self.nav[2] - bias

    def velocity_at(self, lever_b: np.ndarray) -> VelocitySeen | str:
        """Velocity of an antenna: v + C (w x l); what the lever arm adds depends on attitude and gyro bias, too."""
        H = np.zeros((3, self.layout.size))
        swing_n = swing(self.nav[6:10], self.rate_b, lever_b, self.layout.kind, self.layout.axis, H)
        return VelocitySeen(self.nav[3:6], swing_n, H)

    def wind_n(self) -> np.ndarray:
        """Estimated wind (2,), m/s, north and east."""
        return self.wind_rows @ self.estimate

    def dynamics(self) -> np.ndarray:
        """Continuous error dynamics F (n, n) at the present state and sample."""
        C, layout = self.C_nb(), self.layout
        return inertial_dynamics(self.nav, C @ self.force_b, self.force_b, self.rate_b, C, layout.kind, layout.axis, layout.rate)
