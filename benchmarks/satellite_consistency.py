"""Are the sigmas of the satellite filters honest?  Normalised innovations (NIS) and errors (NEES) over Monte Carlo flights.

gnss_only  PV and PVA; on motion drawn from the filter's own model, where nothing excuses it, and on LD and HD.
ins_gnss   tight, loose on the solution of each epoch alone (epochs), loose on the PVA filter (loose); LD and HD, three grades of IMU.

Noise as the sensors have it (consistent), and beside it the thesis's hand-inflated tuning.  Seeds of sensors and motion are fresh in
every run, the initial error of ins_gnss is drawn from its initial covariance.  The gates of the aids are opened as far as they go: a gate
cuts off the very tail the statistic is about (with the shipped one the mean NIS of a perfect filter is 0.7 % low).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from drawn_motion import drawn_motion

from lowcostnav_ros.base.measurements import GnssEpoch, NavSolution
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.estimation.aiding import AidStatus, GateSettings
from lowcostnav_ros.estimation.consistency import acceptance_band, nees
from lowcostnav_ros.gnss.receiver_clock import CLOCKS
from lowcostnav_ros.gnss.receiver_clock import simulate as simulate_clock
from lowcostnav_ros.navigators.gnss_only import GnssOnly, motion_blocks
from lowcostnav_ros.navigators.ins_gnss import SOLUTION, InsGnss
from lowcostnav_ros.reproduce.solimeno.flights import (
    GRADES,
    Case,
    epochs_of,
    fed,
    flight_of,
    gps_only_settings,
    imu_of,
    inertial_settings,
    started,
    truth_of,
)
from lowcostnav_ros.sensors.gnss_raw import GnssRawSimulatorSettings
from lowcostnav_ros.studies.campaign import run_campaign

OPEN = GateSettings(probability=0.9999999)
MATCHED = "matched"
"""A flight drawn from the filter's own motion model."""
GRID_NS = 1_000_000_000
"""NEES over time is kept this far apart."""
EPOCH_S = 0.1
EVERY_S = 20.0
"""Epochs are counted this far apart: about as long as an error of position stays correlated."""
SEED = 5000
PARTS = ("position", "velocity", "attitude", "clock")
DOF = (3, 3, 3, 2)


def truth_for(case: Case) -> TruthBlock:
    """The dataset of a case, or motion drawn from the model of its filter."""
    if case.dataset != MATCHED:
        return truth_of(case.dataset, case.duration_s)
    motion = motion_blocks(gps_only_settings(case))[-2]
    tau_s, start = (motion.tau_s, motion.sigma0[0]) if case.navigator == "pva" else (0.0, 0.0)
    return drawn_motion(stream(case.seed, "consistency.motion"), case.duration_s, motion.psd[0], tau_s, start)


def clock_truth(seed: int, count: int) -> np.ndarray:
    """Bias, m, and drift, m/s, of the simulated receiver clock at each epoch, (count, 2): the stream the simulator drew."""
    settings, rng = GnssRawSimulatorSettings(), stream(seed, "gnss.clock")
    state = np.array([settings.clock_bias_m, settings.clock_drift_mps]) * rng.standard_normal(2)
    return simulate_clock(CLOCKS[settings.clock], EPOCH_S, count, rng, state)


class Watch:
    """Listens to the aids of a navigator: sums of normalised innovations once settled, the clock after every epoch."""

    def __init__(self, navigator: GnssOnly | InsGnss, start_ns: int, settled_s: float) -> None:
        self.navigator, self.from_ns = navigator, start_ns + round(1e9 * settled_s)
        self.nis: dict[str, list[float]] = {}
        self.clock: list[tuple[int, np.ndarray, np.ndarray]] = []
        self._aids = {aid.status.name: aid for aid in navigator.aids}
        navigator.on_aid = self

    def __call__(self, status: AidStatus) -> None:
        if status.name == "gnss_range_rate":
            rows, core = self.navigator.layout["clock"], self.navigator.core
            self.clock.append((status.stamp_ns, core.estimate[rows].copy(), core.P[rows, rows].copy()))
        if status.stamp_ns <= self.from_ns or not status.accepted:
            return
        aid, total = self._aids[status.name], self.nis.setdefault(status.name, [0.0, 0])
        one_by_one = hasattr(aid, "epoch_dof")
        total[0] += aid.epoch_nis if one_by_one else status.nis
        total[1] += aid.epoch_dof if one_by_one else len(status.innovation)


@dataclass(frozen=True)
class Plan:
    """What to fly and from when on it counts."""

    case: Case
    settled_s: float


@lru_cache(maxsize=2)
def heard(case: Case) -> tuple[TruthBlock, list[GnssEpoch]]:
    """Truth and satellite observations, kept for the next filter that flies them."""
    truth = truth_for(case)
    return truth, epochs_of(case, truth)


def flown_together(plans: list[Plan]) -> list[dict]:
    """Several filters over the flights of one seed; those of one data set hear the same satellites."""
    return [flown(plan) for plan in plans]


def flown(plan: Plan) -> dict:
    """One flight: sums of NIS, NEES on a grid of seconds (n, 4) as :data:`PARTS`, 3D RMS of the errors."""
    case = plan.case
    own_motion = case.dataset == MATCHED
    truth, epochs = heard(case if own_motion else Case(dataset=case.dataset, seed=case.seed, duration_s=case.duration_s))
    source, start_ns = GnssOnly(opened(gps_only_settings(case))), int(truth.stamps_ns[0])
    if case.navigator in ("pv", "pva"):
        watch = Watch(source, start_ns, plan.settled_s)
        solutions = source.feed_all(epochs)
    else:
        profile = load_imu_profile(case.grade)
        navigator = started(InsGnss(opened(inertial_settings(case, imu_settings(profile.filter_noise())))), truth, case)
        watch = Watch(navigator, start_ns, plan.settled_s)
        aids = [replace(s, source=SOLUTION) for s in source.feed_all(epochs)] if case.navigator == "loose" else epochs
        solutions = fed(navigator, imu_of(profile, truth, case.seed), aids)
    return {"nis": watch.nis, **errors_of(plan, truth, solutions, clock_nees(watch, epochs, case.seed))}


def opened(settings):
    """The same settings with gates that cut nothing off, and nobody to leave a satellite out."""
    changes = {"gnss": replace(settings.gnss, gate=OPEN, integrity=replace(settings.gnss.integrity, enabled=False))}
    if hasattr(settings, "gps"):
        changes["gps"] = replace(settings.gps, gate=OPEN)
    return replace(settings, **changes)


def clock_nees(watch: Watch, epochs: list, seed: int) -> dict[int, float]:
    """NEES of the clock's bias and drift by stamp."""
    if not watch.clock:
        return {}
    true = dict(zip((e.stamp_ns for e in epochs), clock_truth(seed, len(epochs)), strict=True))
    stamps, estimates, covariances = zip(*watch.clock, strict=True)
    errors = np.array([true[s] for s in stamps]) - np.array(estimates)
    return dict(zip(stamps, nees(errors, np.array(covariances)), strict=True))


def errors_of(plan: Plan, truth: TruthBlock, solutions: list[NavSolution], clock: dict[int, float]) -> dict:
    """NEES and errors of the solutions on the grid of seconds."""
    start_ns = int(truth.stamps_ns[0])
    kept = list({(s.stamp_ns - start_ns) // GRID_NS: s for s in reversed(solutions)}.values())[::-1]
    clocks = {(stamp - start_ns) // GRID_NS: value for stamp, value in reversed(clock.items())}
    flight = flight_of(truth, kept)
    scores = np.column_stack((flight.nees, [clocks.get((s.stamp_ns - start_ns) // GRID_NS, np.nan) for s in kept]))
    return {
        "t_s": flight.t_s,
        "nees": scores,
        "position_m": flight.rms_3d(slice(0, 3), plan.settled_s),
        "velocity_mps": flight.rms_3d(slice(3, 6), plan.settled_s),
        "attitude_deg": float(np.degrees(flight.rms_3d(slice(6, 9), plan.settled_s))),
    }


def statistics(plan: Plan, flights: Sequence[dict]) -> dict:
    """NIS per degree of freedom, NEES averaged over flights, share of epochs inside the 95 % band, 3D RMS; of one filter."""
    runs, t_s = len(flights), flights[0]["t_s"]
    per_epoch = np.mean([f["nees"] for f in flights], axis=0)
    after = t_s > plan.settled_s
    spaced = after & (np.arange(len(t_s)) % round(EVERY_S) == 0)
    scores = {}
    for column, (part, dof) in enumerate(zip(PARTS, DOF, strict=True)):
        curve, (low, high) = per_epoch[:, column], acceptance_band(dof, runs)
        if np.isfinite(curve[after]).all():
            inside = float(np.mean((low <= curve[spaced]) & (curve[spaced] <= high)))
            shown = np.round(curve, 3).tolist()
            scores[part] = {"mean": float(curve[after].mean()), "band_95": [low, high], "epochs_inside": inside, "over_time": shown}
    keys = ("position_m", "velocity_mps", *(("attitude_deg",) if "attitude" in scores else ()))
    rms = {key: float(np.sqrt(np.mean([f[key] ** 2 for f in flights]))) for key in keys}
    return {"flights": runs, "epochs": int(spaced.sum()), "t_s": np.round(t_s, 2).tolist(), "nis": nis_of(flights), "nees": scores, **rms}


def nis_of(flights: Sequence[dict]) -> dict:
    """Mean NIS per degree of freedom over all flights and epochs, by aid, with the 95 % band of so many degrees of freedom."""
    out = {}
    for name in flights[0]["nis"]:
        total, dof = np.sum([f["nis"][name] for f in flights], axis=0)
        out[name] = {"mean": float(total / dof), "dof": int(dof), "band_95": acceptance_band(1, int(dof))}
    return out


def campaign(cases: list[Case], runs: int, settled_s: float, label: str) -> dict:
    """Statistics of every case over so many flights, by name."""
    plans = [[Plan(replace(case, seed=SEED + run), settled_s) for case in cases] for run in range(runs)]
    flights = run_campaign(flown_together, plans, label=f"{label} flights")
    results = {}
    for case, plan, of_case in zip(cases, plans[0], zip(*flights, strict=True), strict=True):
        results[name_of(case)] = statistics(plan, of_case)
        print("\n".join(rows(name_of(case), results[name_of(case)])), flush=True)
    return results


def name_of(case: Case) -> str:
    """Filter, flight, IMU where there is one, tuning."""
    grade = () if case.navigator in ("pv", "pva") else (case.grade,)
    return " ".join((case.navigator, case.dataset, *grade, case.tuning))


def gnss_only(runs: int, duration_s: float) -> dict:
    """The satellites-only filters; the thesis's tuning on one flight."""
    flights = (MATCHED, "LD", "HD")
    cases = [Case(model, flight, duration_s=duration_s) for flight in flights for model in ("pv", "pva")]
    cases += [Case(model, "LD", tuning="thesis", duration_s=duration_s) for model in ("pv", "pva")]
    return campaign(cases, runs, 20.0, "gnss_only")


def ins_gnss(runs: int, duration_s: float) -> dict:
    """The inertial filters; the filtered source and the thesis's tuning with the low-cost unit only."""
    kinds, flights = ("tight", "epochs"), ("LD", "HD")
    cases = [Case(kind, flight, grade, duration_s=duration_s) for flight in flights for kind in kinds for grade in GRADES]
    cases += [Case("loose", flight, duration_s=duration_s) for flight in flights]
    cases += [Case(kind, "LD", tuning="thesis", duration_s=duration_s) for kind in ("tight", "loose")]
    return campaign([replace(case, start="drawn") for case in cases], runs, 60.0, "ins_gnss")


HEAD = [
    "| filter | NIS / dof (95 % band) | NEES position, velocity, attitude | clock | epochs inside | position | velocity | attitude |",
    "|---|---|---|---|---|---|---|---|",
]


def rows(name: str, result: dict) -> list[str]:
    """One row of the table; what is outside its band is set in bold."""

    def marked(value: float, band: list[float], digits: int) -> str:
        text = f"{value:.{digits}f}"
        return text if band[0] <= value <= band[1] else f"**{text}**"

    nis = ", ".join(
        f"{aid.split('_', 1)[1].replace('_', ' ')} {marked(n['mean'], n['band_95'], 3)} (±{0.5 * (n['band_95'][1] - n['band_95'][0]):.3f})"
        for aid, n in result["nis"].items()
    )
    scores = {part: marked(n["mean"], n["band_95"], 2) for part, n in result["nees"].items()}
    inside = ", ".join(f"{100.0 * n['epochs_inside']:.0f}" for n in result["nees"].values())
    attitude = f"{result['attitude_deg']:.2f}°" if "attitude_deg" in result else ""
    three = ", ".join(scores[part] for part in PARTS[:3] if part in scores)
    rms = f"{result['position_m']:.2f} m | {result['velocity_mps']:.3f} m/s | {attitude}"
    return [f"| {name} | {nis} | {three} | {scores.get('clock', '')} | {inside} % | {rms} |"]
