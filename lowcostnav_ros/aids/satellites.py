"""Aids from single satellites: pseudoranges and Dopplers of an epoch, each satellite judged by its own innovation.

With p the antenna, e the unit vector from it to the satellite (both predicted), b and d the receiver clock's bias and drift,

    pseudorange: y = rho - (|s - p| + b),      H = [-e | 0 | e x L | 1 0]
    Doppler:     y = rate - (e . (v_s - v) + d), H = [h_r | -e | e x V | 0 1]

where L = C l is the lever arm and V = C (w x l) its velocity in n.  h_r holds the turn of the line of sight, -(u - rate e)/rho with u the
relative velocity, and the turn of n with position, -e . (dtheta x v) (Solimeno 2007, (5-36), (5-37), in metres; checked against
differences in the tests).  One satellite is worth as much as it is: nothing here needs four.
"""

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lowcostnav_ros.aids.gnss_integrity import LEFT_OUT, RANGE, RATE, IntegritySettings, Satellites, slots_of
from lowcostnav_ros.base.kernels import kernel
from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.base.settings import group, setting
from lowcostnav_ros.base.small_matrices import matvec
from lowcostnav_ros.cores.inertial import DEG, VEL
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.aiding import Aid, Decision, GateSettings
from lowcostnav_ros.gnss.error_budget import COMMON_SHARE
from lowcostnav_ros.gnss.receiver_clock import CLOCKS
from lowcostnav_ros.gnss.signals import name
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef, radii
from lowcostnav_ros.physics.rotation import quat_to_dcm, skew

if TYPE_CHECKING:
    from lowcostnav_ros.navigators.gnss_only import GnssOnly
    from lowcostnav_ros.navigators.ins_gnss import InsGnss

    Host = InsGnss | GnssOnly

CLOCK_SIGMA_M, CLOCK_SIGMA_MPS = 100.0, 10.0
"""Sigmas of a clock just seeded from the median innovation of an epoch."""
NOTHING = np.zeros(0, dtype=np.int64)
RECOVERED = "recovered after rejections"
JUMP_SIGMAS = 8.0
"""A clock jump moves most satellites together by more than this many sigmas, and apart by less."""


@dataclass(frozen=True)
class GnssSettings:
    """Satellite observations."""

    systems: str = setting("GE", "Letters of the systems used: G GPS, E Galileo.")
    oscillator: str = setting("compensated_crystal", "Receiver oscillator.", choices=tuple(CLOCKS))
    mask_deg: float = setting(5.0, "Lowest elevation used.", unit="deg", minimum=0.0, maximum=60.0)
    minimum_cn0: float = setting(0.0, "Weakest signal used where the receiver tells.", unit="dB-Hz", minimum=0.0, maximum=60.0)
    doppler: bool = setting(True, "Use Dopplers.")
    range_sigma_scale: float = setting(1.0, "Factor on the stated sigma of a pseudorange.", minimum=0.1, maximum=100.0)
    doppler_sigma_scale: float = setting(1.0, "Factor on the stated sigma of a Doppler.", minimum=0.1, maximum=100.0)
    common_error: bool = setting(False, "Part of the range noise is common to all satellites and grows towards the horizon.")
    system_offset_m: float = setting(0.0, "Sigma of Galileo's clock against that of GPS; 0 takes them as one.", unit="m", minimum=0.0)
    screening: bool = setting(True, "Leave out satellites whose innovation is beyond the gate.")
    gate: GateSettings = group(GateSettings)
    integrity: IntegritySettings = group(IntegritySettings)


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
    out = r.copy()
    for k in range(H.shape[0]):
        Ph = matvec(P, H[k])
        for i in range(H.shape[1]):
            out[k] += H[k, i] * Ph[i]
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


@dataclass(slots=True)
class Observations:
    """Usable observations of one kind at one epoch: satellite rows, innovations (m,), Jacobian (m, n), variances (m,).

    ``common`` (m,) is how one unit of an error common to all satellites shows in each; its square is part of the variance.
    """

    rows: np.ndarray
    y: np.ndarray
    H: np.ndarray
    r: np.ndarray
    common: np.ndarray

    def covariance(self, rows: np.ndarray) -> np.ndarray:
        """Covariance of the noise of some of them (rows or a mask), (k, k)."""
        return noise_covariance(self.r[rows], self.common[rows])


def common_part(variance: np.ndarray, sin_elevation: np.ndarray) -> np.ndarray:
    """What a common error is in each satellite, (m,) m, of stated variances (m,) m^2: f sigma/sqrt(8), f = 1.1/(sin El + 0.1) (2-40)."""
    f = 1.1 / (np.maximum(sin_elevation, 0.0) + 0.1)
    return f * np.sqrt(COMMON_SHARE * variance / (1.0 - COMMON_SHARE + COMMON_SHARE * f * f))


class SatelliteAid(Aid):
    """Base of the two: screening satellite by satellite, the integrity tests of the host, fusing what passes in one update, recovery when
    most do not.

    ``used`` holds the rows of the last epoch that were fused; ``epoch_nis`` and ``epoch_dof`` hold the normalised innovation
    squared of all of them together.  The status shows their mean innovation with its own variance, and the worst test ratio.
    """

    def __init__(self, aid: str, label: str, settings: GnssSettings, kind: str) -> None:
        super().__init__(aid, (label,), settings.gate)
        self.settings, self.kind = settings, kind
        self.used = NOTHING
        self.satellites = Counter()
        self.epoch_nis, self.epoch_dof = 0.0, 0
        self.fused_rows = np.zeros((0, 0))

    def observations(self, epoch: GnssEpoch, host: "Host") -> Observations:
        """Innovations of the usable satellites; counts why the others are not. Changes no state."""
        raise TypeError(f"{type(self).__name__} does not define its observations.")

    def shared(self, obs: Observations, host: "Host") -> np.ndarray:
        """Columns (n, m) of what all satellites measure together: position or velocity, and clocks."""
        raise TypeError(f"{type(self).__name__} does not define what its satellites share.")

    def process(self, measurement: GnssEpoch, host: "Host") -> bool:
        """Judge and fuse one epoch; return whether anything of it was used."""
        status, self.used = self.status, NOTHING
        status.stamp_ns = measurement.stamp_ns
        obs = self.observations(measurement, host)
        if not obs.rows.size:
            return self._refused("no usable satellite")
        S = scalar_variances(host.P, obs.H, obs.r)
        if not (np.isfinite(obs.y).all() and np.isfinite(S).all()):
            return self._refused("innovation not finite")
        ratios = obs.y**2 / (S * self.threshold) if self.settings.screening else np.zeros(len(S))
        slots = slots_of(measurement, obs.rows)
        shut = host.integrity.is_excluded(slots)
        if host.integrity.distrusted or shut.all():
            return self._refused("satellites not trusted since the alarm" if host.integrity.distrusted else LEFT_OUT)
        self._report(obs, ratios, ~shut, host)
        # the lower median: with most satellites beyond the gate it is the prediction that is wrong, not they
        told = np.sort(ratios[~shut])
        decision, reason = self.control(measurement.stamp_ns, float(told[(len(told) - 1) // 2]), host)
        if decision is Decision.REJECT:
            return self._refused(reason)
        status.reason = ""
        if decision is Decision.RECOVER:
            good = ~shut
            obs.r = obs.r + obs.y**2
            status.rejected[RECOVERED] += 1
            host.integrity.contradicted(measurement.stamp_ns, self.gate.recovery_s)
        else:
            passed = (ratios <= 1.0) & ~shut
            good = self._tested(measurement, obs, slots, passed, host)
            if not good.any():
                return self._refused("satellites contradict each other")
            if not good.all():
                self._name_rejected(measurement, obs, np.flatnonzero(~passed & ~shut), "innovation beyond gate")
                self._name_rejected(measurement, obs, np.flatnonzero(shut | (passed & ~good)), LEFT_OUT)
        self._apply(obs, good, host)
        self.used = obs.rows[good]
        status.accepted, status.accepted_ns = True, measurement.stamp_ns
        status.fused += 1
        return True

    def _tested(self, epoch: GnssEpoch, obs: Observations, slots: np.ndarray, passed: np.ndarray, host: "Host") -> np.ndarray:
        """Those of the satellites that passed which the integrity tests leave."""
        integrity = host.integrity
        if not integrity.settings.enabled:
            return passed
        shared = self.shared(obs, host)
        sats = Satellites(epoch, obs.rows, slots)
        good = integrity.compare(self.kind, sats, obs.y, shared, noise_covariance(obs.r, obs.common), passed)
        if integrity.watches and good.any():
            S = kalman.innovation_covariance(host.P, obs.H[good], obs.covariance(good))
            integrity.testify(self.kind, epoch.stamp_ns, obs.y[good], shared[good, :4], S)
        return good

    def _apply(self, obs: Observations, good: np.ndarray, host: "Host") -> None:
        y, H, R = obs.y[good], obs.H[good], obs.covariance(good)
        self.fused_rows = H
        self.epoch_nis = kalman.normalised_innovation_squared(y, kalman.innovation_covariance(host.P, H, R))
        self.epoch_dof = len(y)
        host.correct(kalman.update(host.P, y, H, R, np.ones(len(host.P))))

    def _report(self, obs: Observations, ratios: np.ndarray, shown: np.ndarray, host: "Host") -> None:
        count, mean, variance = mean_innovation(host.P, obs.y, obs.H, obs.r, obs.common, shown)
        status = self.status
        status.observation, status.innovation, status.innovation_variance = np.array([count]), np.array([mean]), np.array([variance])
        status.nis, status.test_ratio = mean**2 / variance, float(ratios[shown].max())

    def _name_rejected(self, epoch: GnssEpoch, obs: Observations, bad: np.ndarray, reason: str) -> None:
        for k in bad:
            self.leave_out(reason, epoch, obs.rows[k])

    def leave_out(self, reason: str, epoch: GnssEpoch, row: int) -> None:
        """Count one satellite under its reason."""
        satellite = name(epoch.system[row], epoch.sat_id[row])
        self.status.rejected[reason] += 1
        self.satellites[f"{satellite}: {reason}"] += 1
        self.status.reason = f"{satellite}: {reason}"

    def clock_step(self, y: np.ndarray, H: np.ndarray, r: np.ndarray, host: "Host", *, known: bool) -> float | None:
        """By how much the clock (or its drift) is to be moved: it was unknown, or it jumped; else None.

        A jump moves all satellites together, so most of them agree on it (two must both); no motion of the receiver does that.
        """
        if not y.size:
            return None
        if known and abs(float(np.sort(y)[(len(y) - 1) // 2])) < JUMP_SIGMAS * math.sqrt(r.min()):
            return None  # nearly always; the rest costs
        common = float(np.median(y))
        if not known:
            return common
        together = np.abs(y - common) <= JUMP_SIGMAS * np.sqrt(r)
        if len(y) < 2 or 2 * np.count_nonzero(together) <= len(y):
            return None
        if abs(common) < JUMP_SIGMAS * math.sqrt(scalar_variances(host.P, H, r).max()):
            return None
        self.status.rejected["clock jump followed"] += 1
        host.integrity.clock_jumped(self.status.stamp_ns)
        return common

    def usable(self, epoch: GnssEpoch, observed: np.ndarray, valid: np.ndarray, sin_elevation: np.ndarray) -> np.ndarray:
        """Rows that are valid and finite (``observed`` (n,) is what was measured), of a wanted system, high and strong enough."""
        settings = self.settings
        tests = (
            ("not valid", valid),
            ("not finite", np.isfinite(observed) & np.isfinite(sin_elevation)),
            ("system not used", np.char.find(settings.systems, epoch.system.astype(str)) >= 0),
            ("below the mask", sin_elevation >= math.sin(settings.mask_deg * DEG)),
            ("signal too weak", (epoch.cn0 == 0.0) | (epoch.cn0 >= settings.minimum_cn0)),
        )
        keep = np.ones(len(epoch), dtype=bool)
        for reason, passed in tests:
            if not passed.all():
                for row in np.flatnonzero(keep & ~passed):
                    self.leave_out(reason, epoch, row)
                keep &= passed
        return np.flatnonzero(keep)


def predicted(epoch: GnssEpoch, host: "Host") -> tuple:
    """Output of :func:`satellite_model` for an epoch at the state of the navigator."""
    lever_n, swing_n = np.zeros(3), np.zeros(3)
    if host.lever_b.any():
        C = quat_to_dcm(host.core.nav[6:10])
        lever_n, swing_n = C @ host.lever_b, C @ np.cross(host.rate_b, host.lever_b)
    return satellite_model(host.core.nav, lever_n, swing_n, epoch.sat_pos_e, epoch.sat_vel_e, host.layout.size)


class ClockHost:
    """The receiver clock of a navigator that uses satellites one by one: a ``clock`` block of bias, m, and drift, m/s, that can be seeded.

    For a host with ``core.estimate`` (n,), ``layout`` and ``P``; ``clock_known`` and ``drift_known`` say whether either was seeded.
    """

    clock_known = drift_known = False

    def forget_clock(self) -> None:
        """Seed both anew at the next epoch."""
        self.clock_known = self.drift_known = False

    def seed_clock(self, step_m: float) -> None:
        """Move the clock bias by ``step_m`` and forget how well it was known."""
        self._seed(0, step_m, CLOCK_SIGMA_M)
        self.clock_known = True

    def seed_drift(self, step_mps: float) -> None:
        """Move the clock drift by ``step_mps`` and forget how well it was known."""
        self._seed(1, step_mps, CLOCK_SIGMA_MPS)
        self.drift_known = True

    def _seed(self, k: int, step: float, sigma: float) -> None:
        row = self.layout["clock"].start + k
        self.core.estimate[row] += step
        kalman.reset_block(self.P, slice(row, row + 1), np.array([[sigma**2]]))


class RangeAid(SatelliteAid):
    """Pseudoranges, m."""

    def __init__(self, settings: GnssSettings) -> None:
        super().__init__("gnss_range", "mean_range_m", settings, RANGE)

    def observations(self, epoch: GnssEpoch, host: "Host") -> Observations:
        """y = pseudorange - (range + clock + system offset); a jump of the whole clock is followed first."""
        ranges, _, H, _, sin_elevation = predicted(epoch, host)
        rows = self.usable(epoch, epoch.pseudorange_m, epoch.range_valid, sin_elevation)
        clock = host.layout["clock"].start
        H = H[rows]
        H[:, clock] = 1.0
        y = epoch.pseudorange_m[rows] - ranges[rows] - host.core.estimate[clock]
        if "system_offset" in host.layout:
            offset = host.layout["system_offset"].start
            H[:, offset] = epoch.system[rows] == "E"
            y -= H[:, offset] * host.core.estimate[offset]
        r = (self.settings.range_sigma_scale * epoch.sigma_m[rows]) ** 2
        common = common_part(r, sin_elevation[rows]) if self.settings.common_error else np.zeros(len(rows))
        step = self.clock_step(y, H, r, host, known=host.clock_known)
        if step is not None:
            host.seed_clock(step)
            y = y - step
        return Observations(rows, y, H, r, common)

    def shared(self, obs: Observations, host: "Host") -> np.ndarray:
        """Position, clock, and the clock between systems where satellites of both are seen."""
        clock = host.layout["clock"].start
        columns = [0, 1, 2, clock]
        if "system_offset" in host.layout:
            offset = host.layout["system_offset"].start
            columns += [offset] if 0.0 < obs.H[:, offset].mean() < 1.0 else []
        return obs.H[:, columns]


class RangeRateAid(SatelliteAid):
    """Dopplers as range rates, m/s."""

    def __init__(self, settings: GnssSettings) -> None:
        super().__init__("gnss_range_rate", "mean_rate_mps", settings, RATE)

    def observations(self, epoch: GnssEpoch, host: "Host") -> Observations:
        """y = rate - (predicted rate + clock drift); the velocity of the lever arm also depends on the gyro bias."""
        _, rates, _, H, sin_elevation = predicted(epoch, host)
        rows = self.usable(epoch, epoch.doppler_mps, epoch.doppler_valid, sin_elevation)
        drift = host.layout["clock"].start + 1
        H = H[rows]
        H[:, drift] = 1.0
        if host.lever_b.any():
            turn = H[:, VEL] @ quat_to_dcm(host.core.nav[6:10]) @ skew(host.lever_b)
            for block in ("gyro_bias", "gyro_drift"):
                if block in host.layout:
                    H[:, host.layout[block]] = turn
        y = epoch.doppler_mps[rows] - rates[rows] - host.core.estimate[drift]
        r = (self.settings.doppler_sigma_scale * epoch.sigma_mps[rows]) ** 2
        step = self.clock_step(y, H, r, host, known=host.drift_known)
        if step is not None:
            host.seed_drift(step)
            y = y - step
        return Observations(rows, y, H, r, np.zeros(len(rows)))

    def shared(self, obs: Observations, host: "Host") -> np.ndarray:
        """Velocity and clock drift."""
        return obs.H[:, [3, 4, 5, host.layout["clock"].start + 1]]
