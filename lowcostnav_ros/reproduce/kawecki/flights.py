"""Flights of the pseudolite thesis: the criss-cross over the array, the six tests, what came of each.

Aircraft, inertial unit and signals are simulated; the inertial unit is integrated strapdown, and the true troposphere has no filter's form.
The thesis prints neither coordinates nor noise of the inertial unit; the network is fitted to its dilutions of precision.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from lowcostnav_ros.aids._carrier import EpochRecord
from lowcostnav_ros.aids.pseudolite import PseudoliteAid
from lowcostnav_ros.base.documents import parse_yaml, read_text
from lowcostnav_ros.base.measurements import ImuBlock, Measurement
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.config_files import find_config
from lowcostnav_ros.catalogue.equipment import load_imu_profile, load_stations
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.navigators.pseudolite_ins import PseudoliteIns
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.physics.rotation import quat_apply_phi_n, quats_to_euler
from lowcostnav_ros.radionav.stations import StationTable
from lowcostnav_ros.reproduce.solimeno.flights import Flight, fed, flight_of, imu_of
from lowcostnav_ros.sensors.carrier_errors import CarrierErrorSettings
from lowcostnav_ros.sensors.pseudolite import PseudoliteSimulator, PseudoliteSimulatorSettings
from lowcostnav_ros.trajectory.segments import build_segments
from lowcostnav_ros.trajectory.truth_settings import StartSettings, TruthSettings

RADIUS_M, HEIGHT_M = 12_000.0, 5550.0
LEG_S, TURN = 210.0, "turn by_deg={} bank_deg=22"
CENTRE_S = (310.0, 510.0)
"""The pass through the middle of the array, 200 s."""
BEGIN_S = 10.0
"""The period begins when the filter has had a few epochs."""
START_SIGMA = np.array([0.5] * 3 + [0.05] * 3 + [3e-4] * 3)
LARGE = CarrierErrorSettings(slip=0.004, slip_banked=0.049, false_doppler=0.003, false_doppler_banked=0.006)
"""Slips of six cycles or more, and false Dopplers: there is little between thresholds of 1.5 and 3 cycles but the latter."""
SMALL = CarrierErrorSettings(slip=0.006, slip_banked=0.101, slip_least_cycles=1)
"""Slips from one cycle on: the smaller the threshold, the fewer are missed."""
CLEAN = CarrierErrorSettings()
SIGNALS = {"large": LARGE, "small": SMALL, "clean": CLEAN}


@dataclass(frozen=True)
class Case:
    """One flight.

    ``test`` is a row of Table 4.1, 0 the navigator with its own settings; ``signals`` a key of :data:`SIGNALS`; ``lever_b`` the true
    antenna, of which the filter knows ``known_lever_b``; ``start``: ``known`` or ``drawn`` from :data:`START_SIGMA`; ``offset_m`` an
    error put into the first position, north and east, with a sigma to match; ``changes`` further settings of the filter, of the
    signals with ``sim.`` before the name.
    """

    test: int = 3
    seed: int = 1
    signals: str = "large"
    lever_b: tuple[float, float, float] = (0.0, 0.0, 0.0)
    known_lever_b: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start: str = "known"
    offset_m: float = 0.0
    duration_s: float = 820.0
    changes: tuple[tuple[str, Any], ...] = ()


@dataclass(slots=True, eq=False)
class Flown:
    """What came of a case: errors and sigmas, and an entry for each epoch and transmitter (k, m).

    ``code_m``, ``carrier_m`` residuals (NaN: none) with ``carrier_used``; ``renewed``, ``slipped`` (by the detector), ``timed`` (after a
    gap); ``ambiguity`` estimated, cycles; ``delay_m``; ``t_s``, ``roll`` (k,); ``true_slips`` and ``smallest`` of the simulator.
    """

    flight: Flight
    t_s: np.ndarray
    roll: np.ndarray
    idents: tuple[str, ...]
    code_m: np.ndarray
    carrier_m: np.ndarray
    carrier_used: np.ndarray
    renewed: np.ndarray
    slipped: np.ndarray
    timed: np.ndarray
    ambiguity: np.ndarray
    delay_m: np.ndarray
    true_slips: int
    rejected: Mapping[str, int] = field(default_factory=dict)

    def mean(self, dimensions: int, within: tuple[float, float] = (BEGIN_S, math.inf)) -> float:
        """Mean radial error, m: what Table 4.2 lists (4.1), (4.2)."""
        inside = (self.flight.t_s >= within[0]) & (self.flight.t_s <= within[1])
        return float(np.linalg.norm(self.flight.error[inside, :dimensions], axis=1).mean())

    def table_row(self) -> tuple[float, float, float, float]:
        """2-D and 3-D mean of the centre pass, then of the period, m."""
        return self.mean(2, CENTRE_S), self.mean(3, CENTRE_S), self.mean(2), self.mean(3)

    def drms(self, dimensions: int = 2) -> float:
        """Root mean square of the radial error over the period, m; twice that is the usual 2DRMS."""
        inside = self.flight.t_s >= BEGIN_S
        return float(np.sqrt((self.flight.error[inside, :dimensions] ** 2).sum(axis=1).mean()))


@lru_cache(maxsize=2)
def truth_of(duration_s: float = 820.0, *, straight: bool = False) -> TruthBlock:
    """The criss-cross: from the south-east, three legs between north and south, each farther west, at 120 m/s; or straight north."""
    start = StartSettings(lat_deg=32.8366, lon_deg=-106.0723, height_m=HEIGHT_M, heading_deg=0.0, airspeed_mps=120.0)
    legs = [f"straight duration_s={LEG_S:g}", TURN.format(-180)]
    mission = [*legs, f"straight duration_s={LEG_S:g}", TURN.format(180), f"straight duration_s={LEG_S:g}"]
    mission = [f"straight duration_s={duration_s:g}"] if straight else mission
    settings = TruthSettings(kind="segments", mission=mission, rate_hz=100, duration_s=duration_s, start=start)
    return build_segments(settings, 1).table()


@lru_cache(maxsize=1)
def table() -> StationTable:
    """The synthetic network."""
    return load_stations("pseudolites_range.csv")


def settings_of_test(number: int) -> dict[str, Any]:
    """Settings of a row of Table 4.1 with the thesis's filter; 0: the navigator as it is, with nothing of the thesis."""
    if number == 0:
        return {}
    listed = parse_yaml(read_text(find_config("studies/pseudolite_tests.yaml")), "pseudolite_tests.yaml")
    return {**listed["all"], **listed[str(number)]}


def simulator_of(case: Case) -> PseudoliteSimulator:
    """Signals of a case."""
    own = {key.removeprefix("sim."): list(v) if isinstance(v, tuple) else v for key, v in case.changes if key.startswith("sim.")}
    settings = from_mapping(PseudoliteSimulatorSettings, {"seed": case.seed, "lever_arm_b_m": list(case.lever_b), **own})
    errors = SIGNALS[case.signals]
    changed = {name: getattr(settings.errors, name) for name in (key.removeprefix("errors.") for key in own if key.startswith("errors."))}
    return PseudoliteSimulator(replace(settings, errors=replace(errors, **changed)), table())


def navigator_of(case: Case) -> PseudoliteIns:
    """Filter of a case, with the thesis's noise, not started; nothing comes late."""
    now = {"horizon.lag_s": 0.0, "gps.latency_s": 0.0, "aids": ["gps", "pseudolite"]}
    lever = {"pseudolite.lever_arm_b_m": list(case.known_lever_b)}
    own = {key: value for key, value in case.changes if not key.startswith("sim.")}
    values = now | lever | settings_of_test(case.test) | own
    imu = imu_settings(load_imu_profile("eegi").filter_noise())
    return PseudoliteIns(replace(from_mapping(PseudoliteIns.Settings, values), imu=imu), table())


def first_state(truth: TruthBlock, x: np.ndarray) -> np.ndarray:
    """The first true state, off by ``x`` (9,): m, m/s and rad, NED."""
    place = displace(truth.lat[0], truth.lon[0], truth.height[0], x[:3])
    return np.array([*place, *(truth.vel_n[0] + x[3:6]), *quat_apply_phi_n(truth.q_nb[0], x[6:9])])


def started(navigator: PseudoliteIns, truth: TruthBlock, case: Case) -> PseudoliteIns:
    """Begin at the true state, or at one drawn from the sigmas that the filter is given."""
    sigma, x = START_SIGMA.copy(), np.zeros(9)
    if case.start == "drawn":
        x = START_SIGMA * stream(case.seed, "kawecki.start").standard_normal(9)
    x[:2] += case.offset_m
    sigma[:2] = np.hypot(sigma[:2], case.offset_m)
    navigator.begin(int(truth.stamps_ns[0]), first_state(truth, x), np.diag(sigma**2))
    return navigator


def imu_of_case(case: Case, truth: TruthBlock) -> ImuBlock:
    """Inertial samples of a case."""
    return imu_of(load_imu_profile("eegi"), truth, case.seed)


def fly(case: Case) -> Flown:
    """Fly a case."""
    truth, simulator = truth_of(case.duration_s), simulator_of(case)
    measured: list[Measurement] = simulator.simulate(truth)
    navigator, epochs = started(navigator_of(case), truth, case), []
    receiver = navigator.aids_of(PseudoliteAid)[0]

    def keep(status: Any) -> None:
        if status is receiver.status and receiver.record is not None:
            states = [receiver.ambiguities.index(ident) for ident in receiver.record.ident.tolist()]
            epochs.append((receiver.record, navigator.core.estimate[states], [state >= 0 for state in states]))

    navigator.on_aid = keep
    solutions = fed(navigator, imu_of_case(case, truth), measured)
    return gathered(truth, flight_of(truth, solutions), epochs, int(simulator.errors.slips.sum()), dict(receiver.status.rejected))


def gathered(
    truth: TruthBlock, flight: Flight, epochs: list[tuple[EpochRecord, np.ndarray, list[bool]]], slips: int, rejected: dict
) -> Flown:
    """Columns by transmitter of the records of all epochs."""
    idents = tuple(s.ident for s in table())
    column = {ident: k for k, ident in enumerate(idents)}
    shape = len(epochs), len(idents)
    code, carrier, ambiguity, delay = (np.full(shape, np.nan) for _ in range(4))
    used, renewed, slipped, timed = (np.zeros(shape, dtype=bool) for _ in range(4))
    for k, (record, estimates, held) in enumerate(epochs):
        at = [column[ident] for ident in record.ident.tolist()]
        code[k, at], carrier[k, at], used[k, at], delay[k, at] = record.code_m, record.carrier_m, record.carrier_used, record.delays_m
        ambiguity[k, at] = np.where(held, estimates, np.nan)
        renewed[k, [column[ident] for ident in record.renewed]] = True
        for ident, kind, _ in record.slips:
            slipped[k, column[ident]] |= kind == "threshold slip"
            timed[k, column[ident]] |= kind == "time slip"
    rows = np.searchsorted(truth.stamps_ns, [record.stamp_ns for record, _, _ in epochs])
    t_s = (truth.stamps_ns[rows] - truth.stamps_ns[0]) * 1e-9
    roll = quats_to_euler(truth.q_nb[rows])[:, 0]
    return Flown(flight, t_s, roll, idents, code, carrier, used, renewed, slipped, timed, ambiguity, delay, slips, rejected)
