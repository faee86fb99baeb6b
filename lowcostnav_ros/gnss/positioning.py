"""Point positioning: position and receiver clock from pseudoranges, velocity and clock drift from Dopplers, by weighted least squares.

    delta_rho = H [delta_r, delta_clock],   H = [-e, 1],   x += (H'WH)^-1 H'W delta_rho  until it stands still

(Solimeno 2007, equations 2-10 to 2-24; the clock has the sign of the pseudorange.)  Where both GPS and Galileo are used, their system
times may be given a clock each.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lowcostnav_ros.base import chi_square
from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.dop import Dops, cofactor, design, of_cofactor
from lowcostnav_ros.gnss.observables import line_of_sight, range_and_rate
from lowcostnav_ros.physics.earth import dcm_ne, ecef_to_geodetic

PASSED, FAILED, NOT_POSSIBLE = "passed", "failed", "not possible"
MAX_ITERATIONS = 20
CONVERGED_M = 1.0e-4
LOWEST_M, HIGHEST_M = -20.0e3, 100.0e3
"""Heights outside belong to the second solution of the equations, or to wrong data."""
NO_GEOMETRY = "Singular satellite geometry: no {} (lines of sight on one cone); wait for another one."


@dataclass(frozen=True, slots=True)
class ResidualTest:
    """Whether the residuals fit their sigmas: weighted sum of squares against its chi-square threshold.

    ``verdict`` is ``passed``, ``failed`` or, without more observations than unknowns, ``not possible`` (which is not healthy).
    """

    verdict: str
    statistic: float
    threshold: float
    redundancy: int


@dataclass(frozen=True, slots=True, eq=False)
class PointFix:
    """A position.

    Attributes
    ----------
    position_e : ndarray, shape (3,)
        ECEF, m.
    lat, lon, height : float
        Rad, rad, m above the ellipsoid.
    clocks_m : dict
        Receiver clock, m, by system; the same number for all when one clock is solved for.
    cov_n : ndarray, shape (3, 3)
        NED, m^2, from the stated sigmas.
    rows : ndarray of int, shape (n,)
        Rows of the epoch that were used.
    residuals_m : ndarray, shape (n,)
        Measured minus computed.
    geometry : ndarray, shape (n, 3 + m)
        Design rows in NED and clocks.
    weight : ndarray, shape (n, n)
        Inverse covariance of the pseudoranges.
    dops : Dops
        Of the geometry alone.
    test : ResidualTest
    iterations : int
    """

    position_e: np.ndarray
    lat: float
    lon: float
    height: float
    clocks_m: dict[str, float]
    cov_n: np.ndarray
    rows: np.ndarray
    residuals_m: np.ndarray
    geometry: np.ndarray
    weight: np.ndarray
    dops: Dops
    test: ResidualTest
    iterations: int


@dataclass(frozen=True, slots=True, eq=False)
class VelocityFix:
    """Velocity ``vel_n`` (3,) m/s NED with ``cov_n`` (3, 3), clock drift m/s, residuals (n,) m/s and their test."""

    vel_n: np.ndarray
    cov_n: np.ndarray
    clock_drift_mps: float
    residuals_mps: np.ndarray
    test: ResidualTest


def residual_test(residuals: np.ndarray, weight: np.ndarray, unknowns: int, probability: float) -> ResidualTest:
    """Test residuals (n,) of a least-squares solution with ``unknowns`` against ``weight`` (n, n), their inverse covariance."""
    statistic, redundancy = float(residuals @ weight @ residuals), len(residuals) - unknowns
    if redundancy < 1:
        return ResidualTest(NOT_POSSIBLE, statistic, math.inf, redundancy)
    threshold = chi_square.threshold(probability, redundancy)
    return ResidualTest(PASSED if statistic <= threshold else FAILED, statistic, threshold, redundancy)


def solve(
    epoch: GnssEpoch,
    *,
    rows: np.ndarray | None = None,
    covariance: np.ndarray | None = None,
    start_e: Sequence[float] = (0.0, 0.0, 0.0),
    probability: float = 0.999,
    clock_per_system: bool = False,
    anywhere: bool = False,
) -> PointFix:
    """Position from the pseudoranges of one epoch.

    Parameters
    ----------
    epoch : GnssEpoch
    rows : ndarray of int, optional
        Satellites to use, all with a valid pseudorange by default.
    covariance : ndarray, shape (n, n), optional
        Of the pseudoranges of ``rows``, m^2; from the epoch's sigmas by default.
    start_e : sequence of 3 floats
        Where to start, ECEF, m; the centre of the earth will do.
    probability : float
        With which a good set of residuals passes the test.
    clock_per_system : bool
        Solve a clock for each system; takes one satellite more per system.
    anywhere : bool
        Accept a solution far from the ground, to look for the fault that put it there.

    Raises
    ------
    GnssError
        With fewer satellites than unknowns, in a singular geometry, or when the solution does not lie near the earth's surface.
    """
    rows = np.flatnonzero(epoch.range_valid) if rows is None else np.asarray(rows)
    systems = sorted(set(epoch.system[rows].tolist())) if clock_per_system else ["all"]
    clock = np.searchsorted(systems, epoch.system[rows]) if clock_per_system else np.zeros(len(rows), dtype=int)
    unknowns = 3 + len(systems)
    if len(rows) < unknowns:
        raise GnssError(f"{len(rows)} satellites give no position; wait until at least {unknowns} are in view.")
    weight = np.diag(epoch.sigma_m[rows] ** -2.0) if covariance is None else np.linalg.inv(covariance)
    x, iterations = _iterate(epoch, rows, clock, weight, np.concatenate((np.asarray(start_e, float), np.zeros(len(systems)))))
    lat, lon, height = ecef_to_geodetic(x[:3])
    if not anywhere:
        require_near_ground(height)
    ranges, los = line_of_sight(x[:3], epoch.sat_pos_e[rows])
    residuals = epoch.pseudorange_m[rows] - ranges - x[3 + clock]
    geometry = design(los @ dcm_ne(lat, lon).T, clock)
    weighted, flat = cofactor(geometry, weight), cofactor(geometry)
    if weighted is None or flat is None:
        raise GnssError(NO_GEOMETRY.format("position"))
    clocks = {str(s): float(x[3 + k]) for s, k in zip(epoch.system[rows], clock, strict=True)}
    cov_n, plain = weighted[:3, :3], of_cofactor(flat)
    test = residual_test(residuals, weight, unknowns, probability)
    return PointFix(x[:3], lat, lon, height, clocks, cov_n, rows, residuals, geometry, weight, plain, test, iterations)


def require_near_ground(height: float) -> None:
    """Refuse a solution whose height, m, no aircraft flies at.

    Raises
    ------
    GnssError
    """
    if not LOWEST_M <= height <= HIGHEST_M:
        raise GnssError(f"The pseudoranges meet {height / 1000.0:.0f} km above the ellipsoid, not near the ground; check their source.")


def _iterate(epoch: GnssEpoch, rows: np.ndarray, clock: np.ndarray, weight: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, int]:
    for iteration in range(1, MAX_ITERATIONS + 1):
        ranges, los = line_of_sight(x[:3], epoch.sat_pos_e[rows])
        H = design(los, clock)
        inverse = cofactor(H, weight / np.trace(weight))
        if inverse is None:
            raise GnssError(NO_GEOMETRY.format("position"))
        step = inverse @ H.T @ (weight / np.trace(weight)) @ (epoch.pseudorange_m[rows] - ranges - x[3 + clock])
        x = x + step
        if np.linalg.norm(step[:3]) < CONVERGED_M:
            return x, iteration
    raise GnssError("The position did not settle; the pseudoranges contradict each other, check their source.")


def solve_velocity(
    epoch: GnssEpoch, position_e: np.ndarray, *, rows: np.ndarray | None = None, probability: float = 0.999
) -> VelocityFix:
    """Velocity and clock drift from the Dopplers of one epoch at a known position, ECEF, m (100 m off turn a Doppler by 0.02 m/s).

    ``rows`` are the satellites to use, all with a valid Doppler by default; ``probability`` that of a good set to pass the test.

    Raises
    ------
    GnssError
        With fewer than four valid Dopplers or in a singular geometry.
    """
    rows = np.flatnonzero(epoch.doppler_valid) if rows is None else rows
    if len(rows) < 4:
        raise GnssError(f"{len(rows)} Dopplers give no velocity; wait until at least 4 are there.")
    lat, lon, _ = ecef_to_geodetic(position_e)
    C_ne = dcm_ne(lat, lon)
    _, rates, los = range_and_rate(position_e, np.zeros(3), epoch.sat_pos_e[rows], epoch.sat_vel_e[rows])
    H, weight = design(los @ C_ne.T), np.diag(epoch.sigma_mps[rows] ** -2.0)
    inverse = cofactor(H, weight)
    if inverse is None:
        raise GnssError(NO_GEOMETRY.format("velocity"))
    innovation = epoch.doppler_mps[rows] - rates
    x = inverse @ H.T @ weight @ innovation
    residuals = innovation - H @ x
    return VelocityFix(x[:3], inverse[:3, :3], float(x[3]), residuals, residual_test(residuals, weight, 4, probability))
