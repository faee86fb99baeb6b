"""Flights of the INS/GPS study: a dataset, an IMU grade, satellites by schedule, a navigator; and the errors that come of them.

The thesis prints neither trajectories nor tuning.  Datasets are those of :mod:`lowcostnav_ros.trajectory.datasets`; ranges are white with
5.5 m (its Table 7.8, typical C/A code), Dopplers with 0.2 m/s, the clock is a compensated crystal, constellation time is three hours.
Its flights start without error in position and attitude.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from lowcostnav_ros.aids.gnss import GnssSettings
from lowcostnav_ros.aids.gps import GpsSettings
from lowcostnav_ros.base.measurements import GnssEpoch, ImuBlock, NavSolution
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.imu_errors import ImuSettings, imu_settings
from lowcostnav_ros.estimation.consistency import nees
from lowcostnav_ros.estimation.error_state import Block
from lowcostnav_ros.estimation.satellite_integrity import IntegritySettings
from lowcostnav_ros.gnss.visibility import FOUR_GAPS, FULL_AVAILABILITY
from lowcostnav_ros.navigators.base import HorizonSettings, Navigator
from lowcostnav_ros.navigators.gnss_only import GnssOnly, GnssOnlySettings
from lowcostnav_ros.navigators.ins_gnss import SOLUTION, InsGnss, InsGnssSettings, LooseSettings
from lowcostnav_ros.physics.earth import difference_n, displace
from lowcostnav_ros.physics.rotation import quat_apply_phi_n, quat_conjugate, quat_multiply, quat_to_euler, rotvec_from_quat, wrap
from lowcostnav_ros.sensors.gnss_raw import GnssRawSimulator, GnssRawSimulatorSettings
from lowcostnav_ros.sensors.imu import ImuSimulator, ImuSimulatorSettings
from lowcostnav_ros.sensors.imu_profile import ImuProfile
from lowcostnav_ros.trajectory.datasets import build_dataset
from lowcostnav_ros.trajectory.truth_settings import TruthSettings

GRADES = ("crista", "mems", "fog")
"""Low-cost, better MEMS and fibre-optic unit (Tables 5.2 and 7.1)."""
START_SIGMA = np.array([3.0, 3.0, 5.0, 0.5, 0.5, 0.5, *[np.radians(1.0)] * 3])
"""Sigmas of the known start: m, m/s, rad."""
SETTLED_S = 60.0
"""From here on errors are counted.  The thesis gives a GPS-aided alignment "a few minutes to settle" (section 3.6), in which the
turn-on biases, up to 1.2 deg/s, are learnt; one minute is the least that can mean, and all results use it."""
PIECE = 10
"""Inertial samples fed at a time."""
NO_LAG: Any = HorizonSettings(lag_s=0.0)
SCHEDULES = {"full": FULL_AVAILABILITY, "gaps": FOUR_GAPS, "all": ()}
GAPS_S = {3: (120.0, 160.0), 2: (240.0, 280.0), 1: (360.0, 400.0), 0: (480.0, 520.0)}
"""Start and end of the gap with so many satellites."""


@dataclass(frozen=True)
class Case:
    """One flight.  ``navigator``: ``pv``, ``pva``, ``tight``, ``loose`` (on the PVA filter, as in the thesis) or ``epochs`` (loose on
    the solution of each epoch alone); ``schedule`` a key of :data:`SCHEDULES`.

    ``start``: at the ``known`` true state, as the thesis's flights do, or at one ``drawn`` from :data:`START_SIGMA`, which a judgement
    of the filter's own sigmas needs; the filter is given :data:`START_SIGMA` either way.  ``heading_error_deg`` is added at the start,
    and to the filter's sigma.  ``clock`` is the receiver's oscillator, which the filter knows.  ``position_noise`` multiplies the
    position random walk of the thesis's tuning.  ``gps_sigma_m`` and ``galileo_sigma_m`` of a range to a satellite.
    ``constellation_time_s`` is the age of the constellation at the start.
    """

    navigator: str = "tight"
    dataset: str = "LD"
    grade: str = "crista"
    seed: int = 1
    tuning: str = "consistent"
    schedule: str = "full"
    constellation: str = "gps"
    start: str = "known"
    clock: str = "compensated_crystal"
    driving_psd: float | None = None
    position_noise: float = 1.0
    heading_error_deg: float = 0.0
    gps_sigma_m: float = 5.5
    galileo_sigma_m: float = 4.18
    constellation_time_s: float = 10800.0
    duration_s: float = 600.0


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """What came of a case, one row per solution.

    ``t_s`` (n,); ``error`` (n, 9) true minus estimated, m and m/s NED, roll, pitch and heading in rad; ``sigma`` (n, 9), of the small
    rotation about north, east, down where the error has Euler angles; ``nees`` (n, 3) of position, velocity and attitude;
    ``states`` (n, m) the estimates of the further states, ``state_sigmas`` (n, m) theirs, ``labels`` their names.  Attitude is NaN where
    there is none.
    """

    t_s: np.ndarray
    error: np.ndarray
    sigma: np.ndarray
    nees: np.ndarray
    states: np.ndarray
    state_sigmas: np.ndarray
    labels: tuple[str, ...]

    def state(self, start: str) -> np.ndarray:
        """Estimates over time of the states whose label begins so, (n, k)."""
        return self.states[:, self._columns(start)]

    def seen(self, start: str) -> np.ndarray:
        """Sigma at the end over that at the start of the states whose label begins so, (k,)."""
        return self.state_sigmas[-1, self._columns(start)] / self.state_sigmas[0, self._columns(start)]

    def _columns(self, start: str) -> list[int]:
        return [k for k, label in enumerate(self.labels) if label.startswith(start)]

    def rms(self, columns: slice = slice(0, 3), after_s: float = SETTLED_S) -> np.ndarray:
        """RMS of some components after the filter has settled, in their units."""
        return np.sqrt(np.mean(self.error[self.t_s > after_s, columns] ** 2, axis=0))

    def rms_3d(self, columns: slice = slice(0, 3), after_s: float = SETTLED_S) -> float:
        """Root of the sum of the squares of :meth:`rms`."""
        return float(np.linalg.norm(self.rms(columns, after_s)))

    def worst(self, begin_s: float, end_s: float, columns: slice = slice(0, 3)) -> float:
        """Largest norm of some components within a time."""
        inside = (self.t_s >= begin_s) & (self.t_s <= end_s)
        return float(np.linalg.norm(self.error[inside][:, columns], axis=1).max())

    def settled(self, columns: slice = slice(0, 9)) -> np.ndarray:
        """Errors once the filter has settled, (n, k)."""
        return self.error[self.t_s > SETTLED_S, columns]


@lru_cache(maxsize=4)
def truth_of(dataset: str, duration_s: float = 600.0, rate_hz: int = 100) -> TruthBlock:
    """Truth of a dataset, kept."""
    return build_dataset(TruthSettings(name=dataset, duration_s=duration_s, rate_hz=rate_hz)).table()


def imu_of(profile: ImuProfile, truth: TruthBlock, seed: int) -> ImuBlock:
    """One block with all samples of an IMU without converter limits, which the thesis does not model."""
    settings = ImuSimulatorSettings(seed=seed, rate_hz=100.0, clipping=False, quantisation=False)
    return ImuSimulator(settings, profile).simulate(truth)[0]


def epochs_of(case: Case, truth: TruthBlock) -> list[GnssEpoch]:
    """Satellite observations of a case; both constellations together use up to sixteen satellites, one alone up to nine."""
    both = case.constellation == "gps_galileo"
    schedule = [] if both and case.schedule == "full" else list(SCHEDULES[case.schedule])
    settings = GnssRawSimulatorSettings(
        seed=case.seed,
        constellation=case.constellation,
        clock=case.clock,
        constellation_time_s=case.constellation_time_s,
        gps_sigma_m=case.gps_sigma_m,
        galileo_sigma_m=case.galileo_sigma_m,
        schedule=schedule,
        max_satellites=0 if both else 9,
        select_every_s=30.0,
    )
    return GnssRawSimulator(settings).simulate(truth)


def gnss_settings(case: Case) -> GnssSettings:
    """Settings of the satellite aids of a case; the thesis names screening and does none."""
    tested = case.tuning == "consistent"
    return GnssSettings(screening=tested, oscillator=case.clock, integrity=IntegritySettings(enabled=tested))


def gps_only_settings(case: Case) -> Any:
    """Settings of the satellites-only filter of a case (the PVA filter where it feeds loose coupling)."""
    model = case.navigator if case.navigator in ("pv", "pva") else "pva"
    gnss = gnss_settings(case)
    plain = GnssOnlySettings(horizon=NO_LAG, latency_s=0.0, model=model, tuning=case.tuning, gnss=gnss)
    if case.driving_psd is None:
        return plain
    return replace(plain, velocity_psd=case.driving_psd, acceleration_psd=case.driving_psd)


def inertial_settings(case: Case, imu: ImuSettings) -> Any:
    """Settings of the INS/GNSS filter of a case; the thesis takes the errors of the GPS filter for white and screens nothing."""
    now: dict[str, Any] = {"horizon": NO_LAG, "gps": GpsSettings(latency_s=0.0), "loose": LooseSettings(behind_s=0.0)}
    coupling = "tight" if case.navigator == "tight" else "loose"
    source = "gnss_only" if case.navigator == "loose" else "epochs"
    chosen: dict[str, Any] = {"coupling": coupling, "loose_source": source, "tuning": case.tuning, "gnss": gnss_settings(case)}
    plain = InsGnssSettings(imu=imu, **chosen, **now)
    if case.tuning == "consistent":
        return plain
    white = LooseSettings(position_tau_s=0.0, velocity_tau_s=0.0, behind_s=0.0)
    return replace(plain, loose=white)


class Noisier(InsGnss):
    """The thesis's tuning with another density of its position random walk."""

    def __init__(self, settings: Any, factor: float) -> None:
        self._factor = factor
        super().__init__(settings)

    def blocks(self) -> list[Block]:
        """The navigator's blocks with the first three densities multiplied."""
        core, *others = super().blocks()
        return [replace(core, psd=(*(self._factor * q for q in core.psd[:3]), *core.psd[3:])), *others]


def navigator_of(case: Case, profile: ImuProfile) -> InsGnss:
    """INS/GNSS navigator of a case, not started."""
    settings = inertial_settings(case, imu_settings(profile.filter_noise()))
    return InsGnss(settings) if case.position_noise == 1.0 else Noisier(settings, case.position_noise)


def started(navigator: InsGnss, truth: TruthBlock, case: Case) -> InsGnss:
    """Start at the true state, with errors drawn from :data:`START_SIGMA` where the case asks for it."""
    sigma, x = START_SIGMA.copy(), np.zeros(9)
    if case.start == "drawn":
        x = START_SIGMA * stream(case.seed, "solimeno.start").standard_normal(9)
    x[8] += np.radians(case.heading_error_deg)
    sigma[8] = np.hypot(sigma[8], np.radians(case.heading_error_deg))
    place = displace(truth.lat[0], truth.lon[0], truth.height[0], x[:3])
    nav = np.array([*place, *(truth.vel_n[0] + x[3:6]), *quat_apply_phi_n(truth.q_nb[0], x[6:9])])
    navigator.begin(int(truth.stamps_ns[0]), nav, np.diag(sigma**2))
    return navigator


def fly(case: Case) -> Flight:
    """Fly a case and return its errors."""
    truth = truth_of(case.dataset, case.duration_s)
    epochs = epochs_of(case, truth)
    if case.navigator in ("pv", "pva"):
        return flight_of(truth, GnssOnly(gps_only_settings(case)).feed_all(epochs))
    profile = load_imu_profile(case.grade)
    navigator = started(navigator_of(case, profile), truth, case)
    aids: Sequence = epochs
    if case.navigator == "loose":
        aids = [replace(s, source=SOLUTION) for s in GnssOnly(gps_only_settings(case)).feed_all(epochs)]
    return flight_of(truth, fed(navigator, imu_of(profile, truth, case.seed), aids))


def fed(navigator: Navigator, block: ImuBlock, aids: Sequence) -> list[NavSolution]:
    """Feed aids and inertial samples in order, none of them far ahead of the others; the first sample only dates the start."""
    waiting, out = deque(aids), list[NavSolution]()
    for first in range(1, len(block), PIECE):
        piece = block[first : first + PIECE]
        while waiting and waiting[0].stamp_ns <= piece.stamp_ns:
            out += navigator.feed(waiting.popleft())
        out += navigator.feed(piece)
    return out


def flight_of(truth: TruthBlock, solutions: Sequence[Any]) -> Flight:
    """Errors of solutions against the truth at their stamps."""
    rows = np.searchsorted(truth.stamps_ns, [s.stamp_ns for s in solutions])
    errors, sigmas, scores = [], [], []
    for row, s in zip(rows, solutions, strict=True):
        error, turn = np.full(9, np.nan), np.zeros(3)
        error[:3] = difference_n(truth.lat[row], truth.lon[row], truth.height[row], s.lat, s.lon, s.height)
        error[3:6] = truth.vel_n[row] - s.vel_n
        covs = [s.cov_pos, s.cov_vel, np.full((3, 3), np.nan) if s.cov_att is None else s.cov_att]
        if s.q_nb is not None:
            error[6:] = [wrap(a - b) for a, b in zip(quat_to_euler(truth.q_nb[row]), quat_to_euler(s.q_nb), strict=True)]
            turn = rotvec_from_quat(quat_multiply(truth.q_nb[row], quat_conjugate(s.q_nb)))
        errors.append(error)
        sigmas.append(np.sqrt(np.concatenate([np.diag(c) for c in covs])))
        scores.append([nees(e, c) for e, c in zip((error[:3], error[3:6], turn), covs, strict=True)])
    t_s = (truth.stamps_ns[rows] - truth.stamps_ns[0]) * 1e-9
    states = np.array([list(s.states.values()) for s in solutions]).reshape(len(solutions), -1, 2)
    found = np.array(errors), np.array(sigmas), np.array(scores), states[..., 0], states[..., 1]
    return Flight(t_s, *found, tuple(solutions[0].states))
