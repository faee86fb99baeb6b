"""What satellites measure at a navigation state, compiled: predicted ranges and rates with their Jacobians, and statistics of an epoch.

With p the antenna, e the unit vector from it to the satellite (both predicted), b and d the receiver clock's bias and drift,

    pseudorange: y = rho - (|s - p| + b),      H = [-e | 0 | e x L | 1 0]
    Doppler:     y = rate - (e . (v_s - v) + d), H = [h_r | -e | e x V | 0 1]

where L = C l is the lever arm and V = C (w x l) its velocity in n.  h_r holds the turn of the line of sight, -(u - rate e)/rho with u the
relative velocity, and the turn of n with position, -e . (dtheta x v) (Solimeno 2007, (5-36), (5-37), in metres; checked against
differences in the tests).  One satellite is worth as much as it is: nothing here needs four.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.small_matrices import matvec, weighted
from lowcostnav_ros.gnss.error_budget import COMMON_SHARE
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef, radii


@kernel
def satellite_model(nav, lever_n, swing_n, sat_pos, sat_vel, n):
    """Predict an epoch at a navigation state.

    Parameters
    ----------
    nav : ndarray (10,)
    lever_n, swing_n : ndarray (3,)
        Antenna relative to the IMU, m, and its velocity, m/s, in n.
    sat_pos, sat_vel : ndarray (m, 3)
        ECEF, m and m/s.
    n : int
        Number of states.

    Returns
    -------
    ranges, rates : ndarray (m,)
        Without the receiver clock, m and m/s.
    H_range, H_rate : ndarray (m, n)
        Position, velocity and attitude columns.
    sin_elevation : ndarray (m,)
    """
    m = sat_pos.shape[0]
    levered = np.any(lever_n != 0.0)  # without a lever arm nothing turns, and a navigator may have no attitude states
    C = dcm_ne(nav[0], nav[1])
    position_e = geodetic_to_ecef(nav[0], nav[1], nav[2])
    meridian, normal = radii(nav[0])
    along, across, tan_lat = meridian + nav[2], normal + nav[2], math.tan(nav[0])
    v = nav[3:6] + swing_n
    ranges, rates, sin_elevation = np.empty(m), np.empty(m), np.empty(m)
    H_range, H_rate = np.zeros((m, n)), np.zeros((m, n))
    for k in range(m):
        e = matvec(C, sat_pos[k] - position_e) - lever_n
        rho = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
        e /= rho
        u = matvec(C, sat_vel[k]) - v
        rate = e[0] * u[0] + e[1] * u[1] + e[2] * u[2]
        ranges[k], rates[k], sin_elevation[k] = rho, rate, -e[2]
        for j in range(3):
            i1, i2 = (j + 1) % 3, (j + 2) % 3
            H_range[k, j] = -e[j]
            H_rate[k, j] = -(u[j] - rate * e[j]) / rho
            H_rate[k, 3 + j] = -e[j]
            if levered:
                H_range[k, 6 + j] = e[i1] * lever_n[i2] - e[i2] * lever_n[i1]
                H_rate[k, 6 + j] = e[i1] * swing_n[i2] - e[i2] * swing_n[i1]
        c0, c1, c2 = v[1] * e[2] - v[2] * e[1], v[2] * e[0] - v[0] * e[2], v[0] * e[1] - v[1] * e[0]
        H_rate[k, 0] += c1 / along
        H_rate[k, 1] -= (c0 - c2 * tan_lat) / across
    return ranges, rates, H_range, H_rate, sin_elevation


@kernel
def scalar_variances(P, H, r):
    """Innovation variance h P h' + r of each row taken alone, (m,)."""
    out, Ph = r.copy(), np.empty(P.shape[0])
    for k in range(H.shape[0]):
        out[k] += weighted(P, H[k], Ph)
    return out


@kernel
def noise_covariance(r, common):
    """Covariance (n, n) of noise of variances r (n,) of which c c' with c = ``common`` (n,) is common to all."""
    n = r.shape[0]
    R = np.empty((n, n))
    for k in range(n):
        for j in range(n):
            R[k, j] = common[k] * common[j]
        R[k, k] = r[k]
    return R


SUDDEN = 1.0 / 3.0
"""A stated sigma counts for no less than this share of what is usual: a receiver does not get better at once."""
ABSURD = SUDDEN**2
"""A stated sigma below this share of the usual one is none: the usual one stays."""
USUAL_EPOCHS = 10.0
"""A stated sigma is usual that was stated over so many epochs."""
JUMP_SIGMAS = 8.0
"""A clock jump moves most satellites together by more than this many sigmas, and apart by less."""


@kernel
def believed(stated, usual):
    """Sigmas (n,) as far as the stated ones (n,) can be."""
    return np.where(stated < ABSURD * usual, usual, np.maximum(stated, SUDDEN * usual))


@kernel
def middle_of(column):
    """Median of an array (n,), n > 0."""
    ordered, half = np.sort(column), column.shape[0] // 2
    return ordered[half] if column.shape[0] % 2 else 0.5 * (ordered[half - 1] + ordered[half])


@kernel
def learnt(stated, usual):
    """What sigma is usual after an epoch of which these (n,) are stated."""
    if stated.shape[0] == 0:
        return usual
    size = middle_of(stated)
    return usual + (1.0 / USUAL_EPOCHS if usual else 1.0) * (size - usual) if size > ABSURD * usual else usual


@kernel
def observed(nav, lever_n, swing_n, estimate, satellites, measured, stated, valid, rate, states, least, scale, usual, shares):
    """What the satellites of an epoch say of ranges, or of rates, at a navigation state.

    Parameters
    ----------
    nav, lever_n, swing_n
        As of :func:`satellite_model`.
    estimate : ndarray (n,)
    satellites : tuple
        Places and velocities (m, 3), ECEF, signal strengths (m,) dB-Hz, whether their system is used and whether it is not that of the
        clock, bool (m,).
    measured, stated, valid : ndarray (m,)
        Pseudoranges, m, or range rates, m/s, their sigmas, and whether they mean anything.
    rate : bool
    states : (int, int)
        The clock's error that they show, and that between the systems, negative where it is no state.
    least : (float, float)
        Sine of the elevation and strength of a signal that is used.
    scale, usual : float
        Factor on the sigmas that are believed, and what sigma is usual.
    shares : bool
        Whether a part of the noise is common to all.

    Returns
    -------
    found : ndarray of int (m,)
        Of all satellites, see :func:`failed`; what follows is of those that pass.
    rows, y, H, r, common, sigma : ndarray
        As of :class:`Observations`.
    usual : float
        See :func:`learnt`.
    is_finite, is_steady : bool
        Whether all innovations are finite, and whether they show no jump of the clock at first sight.
    """
    pos_e, vel_e, cn0, wanted, other = satellites
    clock, offset = states
    ranges, rates, H_range, H_rate, sine = satellite_model(nav, lever_n, swing_n, pos_e, vel_e, estimate.shape[0])
    predicted, jacobian = (rates, H_rate) if rate else (ranges, H_range)
    found = np.empty(pos_e.shape[0], dtype=np.int64)
    failed(valid, measured, wanted, sine, cn0, least[0], least[1], found)
    rows = np.flatnonzero(found < 0)
    y, H, sigma = np.empty(rows.shape[0]), np.empty((rows.shape[0], estimate.shape[0])), np.empty(rows.shape[0])
    for k in range(rows.shape[0]):
        row = rows[k]
        y[k], H[k], sigma[k] = measured[row] - predicted[row] - estimate[clock], jacobian[row], stated[row]
        H[k, clock] = 1.0
        if offset >= 0 and other[row]:
            H[k, offset] = 1.0
            y[k] -= estimate[offset]
    r = (scale * believed(sigma, usual)) ** 2
    common = common_part(r, sine[rows]) if shares else np.zeros(rows.shape[0])
    is_steady = rows.shape[0] > 0 and abs(lower_middle(y)) < JUMP_SIGMAS * math.sqrt(r.min())
    return found, rows, y, H, r, common, sigma, learnt(sigma, usual), np.isfinite(y.sum()), is_steady


@kernel
def lower_middle(column):
    """Median of an array (n,), n > 0, the lower of two."""
    return np.sort(column)[(column.shape[0] - 1) // 2]


@kernel
def screened(P, y, H, r, common, excluded, threshold):
    """Test each satellite alone.

    Returns
    -------
    S : ndarray (m,)
        Innovation variances.
    ratios : ndarray (m,)
        Normalised squares over a threshold.
    shown : ndarray (6,)
        What :func:`summary` says.
    passed : ndarray of bool (m,)
        Which are neither beyond the threshold nor excluded.
    R : ndarray (m, m)
        Covariance of the noise.
    is_finite : bool
    """
    S = scalar_variances(P, H, r)
    ratios = y**2 / (S * threshold)
    shown, passed = summary(P, y, H, r, common, excluded, ratios), (ratios <= 1.0) & ~excluded
    return S, ratios, shown, passed, noise_covariance(r, common), np.isfinite(S.sum() + y.sum())


@kernel
def summary(P, y, H, r, common, excluded, ratios):
    """Median of the ratios of all satellites; of those that are not excluded their number, mean innovation and its variance, the largest
    ratio and the lower median of them; (6,).
    """
    out, shown = np.empty(6), ratios[~excluded]
    out[0] = middle_of(ratios)
    out[1], out[2], out[3] = mean_innovation(P, y, H, r, common, ~excluded)
    out[4], out[5] = shown.max(), lower_middle(shown)
    return out


@kernel
def mean_innovation(P, y, H, r, common, shown):
    """Number, mean innovation and its variance of the satellites to be shown."""
    n, count, mean = H.shape[1], 0.0, 0.0
    h, own, shared = np.zeros((1, n)), 0.0, 0.0
    for k in range(y.shape[0]):
        if shown[k]:
            count += 1.0
            mean += y[k]
            own += r[k] - common[k] * common[k]
            shared += common[k]
            for j in range(n):
                h[0, j] += H[k, j]
    noise = np.array([(own + shared * shared) / (count * count)])
    return count, mean / count, scalar_variances(P, h / count, noise)[0]


UNUSABLE = "not valid", "not finite", "system not used", "below the mask", "signal too weak"
"""Why a satellite cannot be used, in the order of the tests."""


@kernel
def failed(valid, observed, wanted, sin_elevation, cn0, least_sine, least_cn0, out):
    """Into ``out`` (n,) the number in :data:`UNUSABLE` of the first test that each satellite fails, else -1; return whether all pass."""
    sound = True
    for k in range(out.shape[0]):
        out[k] = -1
        if not valid[k]:
            out[k] = 0
        elif not (np.isfinite(observed[k]) and np.isfinite(sin_elevation[k])):
            out[k] = 1
        elif not wanted[k]:
            out[k] = 2
        elif not sin_elevation[k] >= least_sine:
            out[k] = 3
        elif not (cn0[k] == 0.0 or cn0[k] >= least_cn0):
            out[k] = 4
        sound = sound and out[k] < 0
    return sound


@dataclass(slots=True)
class Observations:
    """Usable observations of one kind at one epoch: satellite rows, innovations (m,), Jacobian (m, n), variances (m,).

    ``common`` (m,) is how one unit of an error common to all satellites shows in each; its square is part of the variance.  ``excluded``
    pairs each row that cannot be used with its reason.  ``clock_step`` is by how much the clock (m) or its drift (m/s) must be moved first,
    None: not at all; the innovations are those after it.  ``stated`` (m,) is the sigma that the receiver states.
    ``late`` (m,) and ``turns`` are as those of an :class:`.Innovation`, the former its variances.  ``usual`` is the sigma that is usual
    after this epoch; ``is_finite``: all innovations are.
    """

    rows: np.ndarray
    y: np.ndarray
    H: np.ndarray
    r: np.ndarray
    common: np.ndarray
    excluded: list[tuple[int, str]] = field(default_factory=list)
    clock_step: float | None = None
    stated: np.ndarray = field(default_factory=lambda: np.zeros(0))
    late: np.ndarray | None = None
    turns: np.ndarray | None = None
    usual: float = 0.0
    is_finite: bool = True

    def covariance(self, rows: np.ndarray) -> np.ndarray:
        """Covariance of the noise of some of them (rows or a mask), (k, k)."""
        return noise_covariance(self.r[rows], self.common[rows])

    def part(self, good: np.ndarray) -> "Observations":
        """Those of a mask (m,), all that innovations are made of; nearly always the whole."""
        if np.count_nonzero(good) == len(good):
            return self
        late = None if self.late is None else self.late[good]
        return Observations(self.rows[good], self.y[good], self.H[good], self.r[good], self.common[good], late=late)

    @property
    def R(self) -> np.ndarray:
        """Covariance of the noise of all of them, (m, m)."""
        return noise_covariance(self.r, self.common)


@kernel
def common_part(variance, sin_elevation):
    """What a common error is in each satellite, (m,) m, of stated variances (m,) m^2: f sigma/sqrt(8), f = 1.1/(sin El + 0.1) (2-40)."""
    f = 1.1 / (np.maximum(sin_elevation, 0.0) + 0.1)
    return f * np.sqrt(COMMON_SHARE * variance / (1.0 - COMMON_SHARE + COMMON_SHARE * f * f))
