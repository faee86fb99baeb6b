"""Is the smoother right? Monte Carlo flights of every navigator it smooths: NEES of position and velocity, errors before and after.

ins_gps         automotive IMU, GPS at 1 Hz, no other aids; GPS lost for 30 s in every 100 s.
ins_gnss        tight, Crista IMU, dataset LD; satellites lost for 30 s in every 100 s.
gnss_only       PVA, on motion drawn from its own model; in an outage it gives no solutions to smooth.
dead_reckoning  as shipped, with the AHRS; GPS lost from a third of the flight on, back after two thirds.

NEES is 3 in the mean where the sigmas are right; its band is that of the mean of one epoch over all flights.
"""

import numpy as np
import satellite_consistency
from common import fly, rms, run, scenario
from consistency import plain_filter

from lowcostnav_ros.base.measurements import GnssEpoch, GpsPosition, GpsVelocity, NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.building import build_navigators
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.estimation.consistency import acceptance_band, nees
from lowcostnav_ros.navigators.gnss_only import GnssOnly
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.columns import columns_of
from lowcostnav_ros.replay.evaluation import truth_columns
from lowcostnav_ros.replay.metrics import errors_between
from lowcostnav_ros.replay.session import replay_stream, simulated
from lowcostnav_ros.reproduce.solimeno import flights as solimeno
from lowcostnav_ros.simulation.simulator import Simulation
from lowcostnav_ros.studies.campaign import run_campaign

SETTLED_S, EVERY_S = 60.0, 10.0
DURATION_S = {"ins_gps": 400.0, "ins_gnss": 400.0, "gnss_only": 200.0, "dead_reckoning": 900.0}


def lost(name: str, since_s: float, duration_s: float) -> bool:
    """Whether GPS is lost."""
    if name == "dead_reckoning":
        return duration_s / 3.0 <= since_s < duration_s / 1.5
    return name != "gnss_only" and since_s >= SETTLED_S and 50.0 <= since_s % 100.0 < 80.0


def flight(name: str, seed: int, duration_s: float) -> tuple[TruthBlock, list[NavSolution], list[NavSolution]]:
    """One flight: truth, the filter's solutions, the smoothed ones."""
    if name == "dead_reckoning":
        gone = [duration_s / 3.0, duration_s / 1.5]
        seconds = list(Simulation(scenario("livermore_long", seed, **{"truth.duration_s": duration_s, "gps.outages_s": gone})).blocks())
        navigators, filtered = build_navigators(["ahrs", name], NAVIGATORS, None), []
        navigator = navigators[name]
        publish, navigator.publish = navigator.publish, lambda s: (filtered.append(s), publish(s))[1]
        navigator.keep_history()
        replay_stream(simulated(seconds), navigators)
        return TruthBlock.joined(block for block, _ in seconds), filtered, list(navigator.history.smoothed())
    if name == "ins_gps":
        changes = {"gps.rate_hz": 1.0, "truth.duration_s": duration_s, "imu.profile": "automotive", "sensors": ["imu", "gps"]}
        truth, heard = fly(scenario("turns", seed, **changes))
        navigator = InsGps(plain_filter())
    else:
        case = solimeno.Case("pva" if name == "gnss_only" else "tight", "LD", seed=seed, start="drawn", duration_s=duration_s)
        if name == "gnss_only":
            case = solimeno.Case("pva", satellite_consistency.MATCHED, seed=seed, duration_s=duration_s)
        truth, heard = satellite_consistency.heard(case)
        navigator = GnssOnly(satellite_consistency.opened(solimeno.gps_only_settings(case)))
    zero = int(truth.stamps_ns[0])
    gps = GpsPosition | GpsVelocity | GnssEpoch
    kept = [m for m in heard if not (isinstance(m, gps) and lost(name, 1e-9 * (m.stamp_ns - zero), duration_s))]
    if name == "ins_gnss":
        profile = load_imu_profile(case.grade)
        settings = solimeno.inertial_settings(case, imu_settings(profile.filter_noise()))
        navigator = solimeno.started(InsGnss(satellite_consistency.opened(settings)), truth, case)
        navigator.keep_history()
        filtered = solimeno.fed(navigator, solimeno.imu_of(profile, truth, seed), kept)
    else:
        navigator.keep_history()
        filtered = navigator.feed_all(kept)
    return truth, filtered, list(navigator.history.smoothed())


def judged(case: tuple[str, int, float]) -> dict:
    """NEES and errors of one flight, before and after."""
    name, seed, duration_s = case
    truth, *pair = flight(name, seed, duration_s)
    zero, found = int(truth.stamps_ns[0]), {}
    for label, solutions in zip(("filtered", "smoothed"), pair, strict=True):
        estimate = columns_of(solutions)
        rows = np.searchsorted(truth.stamps_ns, estimate.stamps_ns)
        inside = (rows < len(truth)) & (truth.stamps_ns[np.minimum(rows, len(truth) - 1)] == estimate.stamps_ns)
        estimate, since_s = estimate[inside], 1e-9 * (estimate.stamps_ns[inside] - zero)
        errors = errors_between(estimate, truth_columns(truth[rows[inside]]))
        settled = since_s >= SETTLED_S
        grid = np.unique(np.searchsorted(since_s, np.arange(SETTLED_S, duration_s - EVERY_S, EVERY_S)))
        grid = grid[grid < len(since_s)]
        covariances = (estimate.cov_pos[grid], estimate.cov_vel[grid])
        scores = [nees(errors.values[grid, 3 * i : 3 * i + 3], covariance) for i, covariance in enumerate(covariances)]
        gone = settled & np.array([lost(name, s, duration_s) for s in since_s])
        found[label] = {
            "nees": np.column_stack(scores).tolist(),
            "rms": [rms(errors.values[settled, :3]), rms(errors.values[settled, 3:6])],
            "sigma": [rms(errors.sigmas[settled, :3]), rms(errors.sigmas[settled, 3:6])],
            "lost": [rms(errors.values[gone, :3]), rms(errors.values[gone, 3:6])] if gone.any() else None,
        }
    ends = [s[-1] for s in pair]
    sigmas = np.array([[np.diagonal(c) for s in solutions for c in (s.cov_pos, s.cov_vel)] for solutions in pair])
    found["end_equal"] = ends[0].stamp_ns == ends[1].stamp_ns and np.allclose(ends[0].cov_pos, ends[1].cov_pos, rtol=1e-9)
    found["largest_variance_ratio"] = float((sigmas[1] / sigmas[0]).max())
    return found


def root(values: list) -> list[float]:
    """Root mean square over flights, column by column."""
    return np.sqrt(np.mean(np.square(values), axis=0)).tolist()


def campaign(name: str, runs: int, duration_s: float) -> dict:
    """One navigator over Monte Carlo flights."""
    flights = run_campaign(judged, [(name, seed, duration_s) for seed in range(301, 301 + runs)], label=f"{name} flights")
    band = acceptance_band(3, runs)
    out = {"flights": runs, "nees_band_95": band, "largest_variance_ratio": max(f["largest_variance_ratio"] for f in flights)}
    out["end_equal"] = all(f["end_equal"] for f in flights)
    for label in ("filtered", "smoothed"):
        epochs = min(len(f[label]["nees"]) for f in flights)
        per_epoch = np.mean([f[label]["nees"][:epochs] for f in flights], axis=0)
        means = {key: root([f[label][key] for f in flights]) for key in ("rms", "sigma")}
        out[label] = {
            "nees": per_epoch.mean(axis=0).tolist(),
            "epochs_inside": np.mean((per_epoch >= band[0]) & (per_epoch <= band[1]), axis=0).tolist(),
            "rms_m_mps": means["rms"],
            "sigma_m_mps": means["sigma"],
            "lost_rms_m_mps": root([f[label]["lost"] for f in flights]) if flights[0][label]["lost"] else None,
        }
    return out


def measure(options) -> dict:
    """The navigators asked for."""
    scale, runs = (0.5, 4) if options.quick else (1.0, 20)
    return {name: campaign(name, runs, scale * DURATION_S[name]) for name in options.only.split(",")}


if __name__ == "__main__":
    run(__doc__, measure, only={"default": ",".join(DURATION_S), "metavar": "A,B", "help": "navigators to measure"})
