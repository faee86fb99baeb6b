"""Integrity of the satellite navigators: are faults found, how soon, how far off is the position by then, and how often is the alarm false?

Every flight is five minutes of low dynamics with up to nine satellites (5.5 m, 0.2 m/s, 10 Hz); the fault begins after two.  The satellite
that lies is drawn anew for each flight.  ``sound`` flights are ten minutes of low and high dynamics with all grades of IMU, also through
gaps with three to no satellites.  ``at_the_limit`` puts the fault that moves the position by just the protection level on the satellite it
is computed from: it should go unnoticed about as often as set.
"""

import dataclasses
from collections import Counter

import numpy as np
from common import run

from lowcostnav_ros.aids.gnss import GnssSettings
from lowcostnav_ros.base.chi_square import exceeded_with
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.estimation.satellite_integrity import IntegritySettings
from lowcostnav_ros.gnss import parity, raim
from lowcostnav_ros.gnss.positioning import solve
from lowcostnav_ros.navigators.gnss_only import GnssOnly, GnssOnlySettings
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.reproduce.solimeno.flights import NO_LAG, SCHEDULES, Case, fed, flight_of, imu_of, inertial_settings, started, truth_of
from lowcostnav_ros.sensors.gnss_raw import GnssRawSimulator, GnssRawSimulatorSettings
from lowcostnav_ros.studies.campaign import run_campaign

FLIGHT_S, FAULT_S = 300.0, 120.0
SATELLITE = -1
"""Stands for the satellite that is drawn."""
FAULTS = {
    "step_50_m": {"range_faults": [FAULT_S, SATELLITE, 50.0]},
    "step_20_m": {"range_faults": [FAULT_S, SATELLITE, 20.0]},
    "ramp_0.5_mps": {"range_ramps": [FAULT_S, SATELLITE, 0.5]},
    "ramp_0.5_mps_code_alone": {"range_ramps": [FAULT_S, SATELLITE, 0.5], "faults_in_doppler": False},
    "ramp_0.1_mps_code_alone": {"range_ramps": [FAULT_S, SATELLITE, 0.1], "faults_in_doppler": False},
}
SPOOFING = {
    "common_ramp_0.5_mps_code_alone": {"spoofing": [FAULT_S, 0.0, 0.0, 0.0, 0.5, 0.0], "faults_in_doppler": False},
    "false_place_0.5_mps_code_alone": {"spoofing": [FAULT_S, 0.5, 0.0, 0.0, 0.0, 0.0], "faults_in_doppler": False},
    "false_place_0.5_mps": {"spoofing": [FAULT_S, 0.5, 0.0, 0.0, 0.0, 0.0]},
    "false_place_1_mps": {"spoofing": [FAULT_S, 1.0, 0.0, 0.0, 0.0, 0.0]},
    "false_place_2_mps_in_20_s": {"spoofing": [FAULT_S, 2.0, 0.0, 0.0, 0.0, 20.0]},
    "false_place_2_mps_in_60_s": {"spoofing": [FAULT_S, 2.0, 0.0, 0.0, 0.0, 60.0]},
}


@dataclasses.dataclass(frozen=True)
class Flight:
    """One flight: navigator (``pva``, ``tight``), IMU, data set, schedule, fault by name, seed."""

    navigator: str
    grade: str
    dataset: str
    schedule: str
    fault: str
    seed: int
    duration_s: float = FLIGHT_S


def observations(flight: Flight, **fault) -> list:
    """Epochs of a flight with a fault."""
    settings = GnssRawSimulatorSettings(seed=flight.seed, max_satellites=9, schedule=list(SCHEDULES[flight.schedule]), **fault)
    return GnssRawSimulator(settings).simulate(truth_of(flight.dataset, flight.duration_s))


def with_fault(flight: Flight) -> tuple[list, str]:
    """Epochs with the fault, and the name of the satellite that lies."""
    fault = dict({**FAULTS, **SPOOFING}.get(flight.fault, {}))
    listed = next((key for key in ("range_faults", "range_ramps") if key in fault), None)
    if listed is None:
        return observations(flight, **fault), ""
    seen = {
        int(s)
        for e in observations(flight)
        if 0.0 <= 1e-9 * (e.stamp_ns - truth_of(flight.dataset, flight.duration_s).stamps_ns[0]) - FAULT_S < 60.0
        for s in e.sat_id
    }
    number = int(np.random.default_rng(flight.seed).choice(sorted(seen)))
    fault[listed] = [fault[listed][0], number, fault[listed][2]]
    return observations(flight, **fault), f"G{number:02d}"


def flown(flight: Flight) -> dict:
    """Fly; what the integrity tests said, and the errors."""
    truth, (epochs, liar) = truth_of(flight.dataset, flight.duration_s), with_fault(flight)
    if flight.navigator == "tight":
        profile = load_imu_profile(flight.grade)
        case = Case("tight", flight.dataset, flight.grade, flight.seed, start="drawn")
        settings = inertial_settings(case, imu_settings(profile.filter_noise()))
        navigator = started(InsGnss(settings), truth, case)
        solutions = fed(navigator, imu_of(profile, truth, flight.seed), epochs)
    else:
        navigator = GnssOnly(GnssOnlySettings(horizon=NO_LAG, latency_s=0.0, model=flight.navigator, gnss=GnssSettings()))
        solutions = navigator.feed_all(epochs)
    errors = flight_of(truth, solutions)
    horizontal, t_s = np.hypot(errors.error[:, 0], errors.error[:, 1]), errors.t_s
    reports = [s.integrity for s in solutions]
    excluded = next((t for t, r in zip(t_s, reports, strict=True) if liar and liar in r.excluded), None)
    alarm = navigator.receiver.integrity.status.alarm_ns
    alarm_s = None if alarm is None else 1e-9 * (alarm - int(truth.stamps_ns[0]))
    level = np.array([np.nan if r.hpl_m is None else r.hpl_m for r in reports])
    after = t_s >= FAULT_S
    return {
        "excluded_after_s": None if excluded is None else excluded - FAULT_S,
        "wrongly_excluded": sorted({s for r in reports for s in r.excluded if s != liar}),
        "alarm_after_s": None if alarm_s is None else alarm_s - FAULT_S,
        "alarm": navigator.receiver.integrity.status.alarm,
        "error_at_alarm_m": None if alarm_s is None else float(horizontal[max(0, np.searchsorted(t_s, alarm_s) - 1)]),
        "worst_horizontal_m": float(horizontal[after].max()),
        "epochs_beyond_hpl": int(np.sum(horizontal > level)),
        "verdicts": dict(Counter(r.verdict for r in reports)),
        "hpl_m": [float(np.nanmedian(level)), float(np.nanmax(level))] if np.isfinite(level).any() else None,
        "lasting_hpl_m": [float(np.median(x)), float(np.max(x))] if (x := [r.lasting_hpl_m for r in reports if r.lasting_hpl_m]) else None,
        "seconds": float(t_s[-1] - t_s[0]),
    }


def spread(values: list) -> dict | None:
    """Median, 95th percentile and maximum."""
    known = [v for v in values if v is not None]
    return {"median": float(np.median(known)), "p95": float(np.percentile(known, 95)), "max": float(np.max(known))} if known else None


def one_satellite(runs: int) -> dict:
    """Faults of one satellite, per navigator."""
    out = {}
    for navigator, grade in (("pva", "mems"), ("tight", "mems"), ("tight", "crista")):
        for fault in FAULTS:
            cases = [Flight(navigator, grade, "LD", "all", fault, seed) for seed in range(301, 301 + runs)]
            flights = run_campaign(flown, cases, label=f"{navigator} {grade} {fault}")
            out[f"{navigator} {'' if navigator == 'pva' else grade} {fault}".replace("  ", " ")] = {
                "found": sum(f["excluded_after_s"] is not None for f in flights) / runs,
                "wrongly_excluded": sum(len(f["wrongly_excluded"]) for f in flights),
                "time_to_exclusion_s": spread([f["excluded_after_s"] for f in flights]),
                "worst_horizontal_m": spread([f["worst_horizontal_m"] for f in flights]),
                "epochs_beyond_hpl": sum(f["epochs_beyond_hpl"] for f in flights),
            }
    return out


def all_satellites(runs: int) -> dict:
    """Faults common to all satellites, against the inertial sensors."""
    out = {}
    for grade in ("crista", "mems", "fog"):
        for fault in SPOOFING:
            cases = [Flight("tight", grade, "LD", "all", fault, seed) for seed in range(401, 401 + runs)]
            flights = run_campaign(flown, cases, label=f"{grade} {fault}")
            in_time = [f for f in flights if f["alarm_after_s"] is not None and f["alarm_after_s"] >= 0.0]
            out[f"{grade} {fault}"] = {
                "alarmed": len(in_time) / runs,
                "time_to_alarm_s": spread([f["alarm_after_s"] for f in in_time]),
                "horizontal_error_at_alarm_m": spread([f["error_at_alarm_m"] for f in in_time]),
                "worst_horizontal_m": spread([f["worst_horizontal_m"] for f in flights]),
            }
    return out


def sound(runs: int) -> dict:
    """False alarms and false exclusions of flights without a fault."""
    out = {}
    plans = [("tight", g, d, s) for g in ("crista", "mems", "fog") for d in ("LD", "HD") for s in ("all", "gaps")] + [
        ("pva", "mems", d, "all") for d in ("LD", "HD")
    ]
    for navigator, grade, dataset, schedule in plans:
        cases = [Flight(navigator, grade, dataset, schedule, "none", seed, 600.0) for seed in range(501, 501 + runs)]
        flights = run_campaign(flown, cases, label=f"sound {navigator} {grade} {dataset} {schedule}")
        levels = [f["hpl_m"] for f in flights if f["hpl_m"]]
        lasting = [f["lasting_hpl_m"] for f in flights if f["lasting_hpl_m"]]
        out[f"{navigator} {grade} {dataset} {schedule}"] = {
            "hours": round(sum(f["seconds"] for f in flights) / 3600.0, 2),
            "false_alarms": sum(f["alarm_after_s"] is not None for f in flights),
            "alarms": sorted({f["alarm"] for f in flights if f["alarm"]}),
            "false_exclusions": sum(len(f["wrongly_excluded"]) for f in flights),
            "epochs_beyond_hpl": sum(f["epochs_beyond_hpl"] for f in flights),
            "verdicts": dict(sum((Counter(f["verdicts"]) for f in flights), Counter())),
            "hpl_m_median": float(np.median([x[0] for x in levels])) if levels else None,
            "lasting_hpl_m_median": float(np.median([x[0] for x in lasting])) if lasting else None,
        }
    return out


def at_the_limit(draws: int) -> dict:
    """Snapshot test of a fault that moves the position by the protection level: share missed, against what is set."""
    epoch = observations(Flight("pva", "mems", "LD", "all", "none", 1))[1200]
    settings = raim.RaimSettings(IntegritySettings().false_alarm_probability, IntegritySettings().missed_detection_probability)
    fix, rng = solve(epoch), np.random.default_rng(7)
    root = np.linalg.cholesky(fix.weight).T
    A = root @ fix.geometry
    _, _, gain, _, S = parity.parity(A, np.zeros(len(A)))
    steep = np.hypot(gain[0], gain[1]) / np.sqrt(np.diag(S))
    worst = int(np.argmax(steep))
    level, _ = raim.protection_levels(fix, settings)
    bias = level / np.hypot(gain[0, worst], gain[1, worst])
    limit = exceeded_with(settings.false_alarm_probability, fix.test.redundancy)
    noise = rng.standard_normal((draws, len(A)))
    noise[:, worst] += bias
    w = noise @ S
    missed = float(np.mean(np.sum(w * w, axis=1) <= limit))
    return {"satellites": len(A), "hpl_m": level, "draws": draws, "missed": missed, "set": settings.missed_detection_probability}


def measure(options) -> dict:
    """The parts asked for."""
    runs = 3 if options.quick else 10
    parts = {
        "one_satellite": lambda: one_satellite(runs),
        "all_satellites": lambda: all_satellites(runs),
        "sound": lambda: sound(2 if options.quick else 6),
        "at_the_limit": lambda: at_the_limit(20_000 if options.quick else 400_000),
    }
    return {name: parts[name]() for name in options.only.split(",")}


if __name__ == "__main__":
    run(__doc__, measure, only={"default": "one_satellite,all_satellites,sound,at_the_limit", "metavar": "A,B", "help": "parts to measure"})
