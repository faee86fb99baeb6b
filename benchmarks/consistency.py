"""Are the sigmas honest? Monte Carlo flights of every navigator: NIS, NEES, error over sigma, and the accuracy that goes with them.

ins_gps         automotive IMU, GPS at 1 Hz, the 15-state filter without other aids; then the same flights with 10 s outages.
dead_reckoning  30 minutes, GPS lost after ten, one DME receiver that alternates stations every 15 s, heading from the AHRS.
ahrs            20 minutes of repeated turns, DMU-6X grade, calibrated magnetometer; with GPS velocity, then with GPS withheld.
gnss_only, ins_gnss  the satellite filters; see satellite_consistency.py.

The simulated receiver and IMU have the errors the filters are told of; nothing here is tuned to these flights.
"""

import ahrs_accuracy
import numpy as np
import satellite_consistency
from common import compare, fly, rms, run, scenario

from lowcostnav_ros.aids.airdata import AirDataSettings
from lowcostnav_ros.aids.baro import BaroSettings
from lowcostnav_ros.aids.gps import GpsSettings
from lowcostnav_ros.aids.magnetic import MagneticSettings
from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, Measurement, NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue import config_files
from lowcostnav_ros.catalogue.building import build_navigators
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.estimation.consistency import acceptance_band, nees
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, rotvec_from_quat
from lowcostnav_ros.replay.columns import NavColumns, position_difference_n
from lowcostnav_ros.replay.session import replay_stream, simulated
from lowcostnav_ros.sensors.imu_profile import imu_profile_from_text
from lowcostnav_ros.simulation.simulator import Simulation
from lowcostnav_ros.studies.campaign import run_campaign

SETTLED_S = 120.0
EVERY_S = 10.0
"""NEES is taken this far apart, about as long as the errors stay correlated."""
OUTAGE_S = 10.0


def profile(name: str):
    """IMU profile shipped under this name."""
    path = config_files.config_dir() / "profiles" / f"{name}.yaml"
    return imu_profile_from_text(path.read_text(), path.name)


def plain_filter() -> InsGpsSettings:
    """The 15-state filter told exactly what the simulated sensors are."""
    return InsGpsSettings(
        imu=imu_settings(profile("automotive").filter_noise()),
        gps=GpsSettings(latency_s=0.2),
        baro=BaroSettings(enabled=False),
        magnetic=MagneticSettings(enabled=False),
        airdata=AirDataSettings(enabled=False),
    )


def nees_of(truth: TruthBlock, estimate: NavColumns) -> np.ndarray:
    """NEES of position, velocity and attitude at each solution, shape (n, 3); 3 is expected of each."""
    rows = np.searchsorted(truth.stamps_ns, estimate.stamps_ns)
    true_position = np.column_stack((truth.lat, truth.lon, truth.height))[rows]
    position = -position_difference_n(estimate.position, true_position)
    attitude = np.array(
        [rotvec_from_quat(quat_multiply(true, quat_conjugate(est))) for true, est in zip(truth.q_nb[rows], estimate.q_nb, strict=True)]
    )
    return np.column_stack(
        (
            nees(position, estimate.cov_pos),
            nees(truth.vel_n[rows] - estimate.vel_n, estimate.cov_vel),
            nees(attitude, estimate.cov_att),
        )
    )


def ins_gps_flight(case: tuple[int, float]) -> dict:
    """One flight of ins_gps without and with outages."""
    seed, duration_s = case
    changes = {"gps.rate_hz": 1.0, "truth.duration_s": duration_s, "imu.profile": "automotive", "sensors": ["imu", "gps"]}
    truth, heard = fly(scenario("turns", seed, **changes))
    navigator, nis = InsGps(plain_filter()), {"gps_position": [], "gps_velocity": []}
    navigator.on_aid = lambda status: nis[status.name].append((status.stamp_ns, status.nis))
    errors, estimate = compare(truth, navigator.feed_all(heard))
    start = truth.stamps_ns[0]
    settled = estimate.stamps_ns - start > 1e9 * SETTLED_S
    spaced = settled & ((estimate.stamps_ns - start) % round(1e9 * EVERY_S) < 100_000_000)
    outage_ends = []
    first, period = SETTLED_S + 20.0, 60.0
    starts = np.arange(first, duration_s - OUTAGE_S - 5.0, period)
    gaps = [(start + 1e9 * s, start + 1e9 * (s + OUTAGE_S)) for s in starts]
    cut = [m for m in heard if not (isinstance(m, GpsPosition | GpsVelocity) and any(a <= m.stamp_ns < b for a, b in gaps))]
    coasted, _ = compare(truth, InsGps(plain_filter()).feed_all(cut))
    for _, end in gaps:
        row = np.searchsorted(coasted.stamps_ns, end) - 1
        outage_ends.append(float(np.hypot(*coasted.values[row, :2])))
    return {
        "nis": {name: [v for t, v in values if t - start > 1e9 * SETTLED_S] for name, values in nis.items()},
        "nees": nees_of(truth, estimate[spaced]).tolist(),
        "attitude_deg": [rms(errors[settled].axis(a)) for a in ("roll_deg", "pitch_deg", "heading_deg")],
        "error_over_sigma": np.sqrt(np.mean((errors.values[settled, :9] / errors.sigmas[settled, :9]) ** 2, axis=0)).tolist(),
        "outage_end_m": outage_ends,
    }


def ins_gps(runs: int, duration_s: float) -> dict:
    """Consistency and accuracy of ins_gps over Monte Carlo flights."""
    flights = run_campaign(ins_gps_flight, [(seed, duration_s) for seed in range(101, 101 + runs)], label="ins_gps flights")
    scores = np.array([f["nees"] for f in flights])  # runs, epochs, 3
    band = acceptance_band(3, runs)
    per_epoch = scores.mean(axis=0)
    nis = {name: float(np.mean(np.concatenate([f["nis"][name] for f in flights]))) for name in ("gps_position", "gps_velocity")}
    samples = {name: sum(len(f["nis"][name]) for f in flights) for name in nis}
    ends = np.concatenate([f["outage_end_m"] for f in flights])
    return {
        "flights": runs,
        "nees_band_95": band,
        "nees": dict(zip(("position", "velocity", "attitude"), scores.mean(axis=(0, 1)).tolist(), strict=True)),
        "nees_epochs_inside": float(np.mean((per_epoch >= band[0]) & (per_epoch <= band[1]))),
        "nis_band_95": {name: acceptance_band(3, count) for name, count in samples.items()},
        "nis_band_95_one_epoch": band,
        "nis": nis,
        "attitude_rms_deg": {axis: rms([f["attitude_deg"][i] for f in flights]) for i, axis in enumerate(("roll", "pitch", "heading"))},
        "error_over_sigma": np.sqrt(np.mean([np.square(f["error_over_sigma"]) for f in flights], axis=0)).tolist(),
        "outage_10s_end_m": {"median": float(np.median(ends)), "p95": float(np.percentile(ends, 95)), "max": float(ends.max())},
    }


def dead_reckoning_flight(case: tuple[int, float]) -> dict:
    """One flight of the AHRS and the dead reckoner that listens to it, as shipped; errors once GPS is lost."""
    seed, duration_s = case
    lost_s = min(600.0, duration_s / 3.0)
    changes = {"truth.duration_s": duration_s, "gps.outages_s": [lost_s, 1e5]}
    seconds = list(Simulation(scenario("livermore_long", seed, **changes)).blocks())
    truth = TruthBlock.joined(block for block, _ in seconds)
    navigators = build_navigators(["ahrs", "dead_reckoning"], NAVIGATORS, None)
    solutions: list[NavSolution] = []
    feed = navigators["dead_reckoning"].feed

    def keep(measurement: Measurement) -> list[NavSolution]:
        fused = feed(measurement)
        solutions.extend(fused)
        return fused

    navigators["dead_reckoning"].feed = keep
    replay_stream(simulated(seconds), navigators)
    errors, _ = compare(truth, solutions)
    lost = errors[errors.stamps_ns - truth.stamps_ns[0] > 1e9 * (lost_s + SETTLED_S)]
    spaced = lost[np.unique((lost.stamps_ns // round(6e9 * EVERY_S)), return_index=True)[1]]
    horizontal = np.hypot(lost.values[:, 0], lost.values[:, 1])
    return {
        "within_half_nm": float(np.mean(horizontal < 926.0)),
        "p95_m": float(np.percentile(horizontal, 95)),
        "max_m": float(horizontal.max()),
        "nees": spaced.nees_horizontal.tolist(),
        "error_over_sigma": [rms(lost.values[:, i] / lost.sigmas[:, i]) for i in (0, 1, 9, 10)],
        "aids": {aid.name: [aid.fused, dict(aid.rejected)] for aid in navigators["dead_reckoning"].status().aids},
    }


def dead_reckoning(runs: int, duration_s: float) -> dict:
    """Accuracy and consistency of DME-aided dead reckoning after GPS loss."""
    flights = run_campaign(dead_reckoning_flight, [(seed, duration_s) for seed in range(201, 201 + runs)], label="dead_reckoning flights")
    epochs = min(len(f["nees"]) for f in flights)
    scores = np.array([f["nees"][:epochs] for f in flights])
    band = acceptance_band(2, runs)
    per_epoch = scores.mean(axis=0)
    return {
        "flights": runs,
        "within_half_nm": float(np.mean([f["within_half_nm"] for f in flights])),
        "p95_m": [round(f["p95_m"]) for f in flights],
        "max_m": [round(f["max_m"]) for f in flights],
        "nees_position": float(scores.mean()),
        "nees_band_95": band,
        "nees_epochs_inside": float(np.mean((per_epoch >= band[0]) & (per_epoch <= band[1]))),
        "error_over_sigma_north_east_wind": np.sqrt(np.mean([np.square(f["error_over_sigma"]) for f in flights], axis=0)).tolist(),
        "dme_fused": [f["aids"].get("dme", [0])[0] for f in flights],
    }


def measure(options) -> dict:
    """The navigators asked for."""
    quick = options.quick
    parts = {
        "ins_gps": lambda: ins_gps(4 if quick else 20, 300.0 if quick else 600.0),
        "dead_reckoning": lambda: dead_reckoning(3 if quick else 10, 900.0 if quick else 1800.0),
        "ahrs": lambda: ahrs_accuracy.measure(options),
        "gnss_only": lambda: satellite_consistency.gnss_only(5 if quick else 50, 100.0 if quick else 240.0),
        "ins_gnss": lambda: satellite_consistency.ins_gnss(5 if quick else 50, 120.0 if quick else 240.0),
    }
    return {name: parts[name]() for name in options.only.split(",")}


if __name__ == "__main__":
    everything = "ins_gps,dead_reckoning,ahrs,gnss_only,ins_gnss"
    run(__doc__, measure, only={"default": everything, "metavar": "A,B", "help": "navigators to measure"})
