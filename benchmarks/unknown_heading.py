"""Starts at any heading: heading error, its sigma and NEES in straight, gentle and turning flight, uniform over the circle.

The low-cost unit of the INS/GPS study (turn-on bias up to 1.2 deg/s); ins_gps with fixes at 1 Hz, ins_gnss tight at 2 Hz.  ``--linear``
flies the filter with one heading, for comparison.
"""

import time
from typing import Any

import numpy as np
from common import run

from lowcostnav_ros.aids.airdata import AirDataSettings
from lowcostnav_ros.aids.baro import BaroSettings
from lowcostnav_ros.aids.magnetic import MagneticSettings
from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.physics.earth import displace
from lowcostnav_ros.physics.rotation import quat_apply_phi_n, wrap
from lowcostnav_ros.reproduce.solimeno.flights import START_SIGMA, Case, fed, flight_of, imu_of, inertial_settings, truth_of
from lowcostnav_ros.sensors.gnss_raw import GnssRawSimulator, GnssRawSimulatorSettings
from lowcostnav_ros.sensors.gps import GpsSimulator, GpsSimulatorSettings

FLIGHTS = {
    "STR": (120.0, (10.0, 60.0, 119.0)),
    "LD-gentle": (300.0, (10.0, 60.0, 150.0, 299.0)),
    "LD": (125.0, (10.0, 30.0, 60.0, 95.0, 124.0)),
}
"""Length, s, and when it is looked at; LD turns by 90 deg from 55 to 95 s."""
KNOWN = 5.0 * DEGREE


def navigator(name: str, grade: str) -> Any:
    """A navigator with nothing that shows a heading, but motion."""
    imu = imu_settings(load_imu_profile(grade).filter_noise())
    if name == "ins_gnss":
        return InsGnss(inertial_settings(Case(), imu))
    off = {"baro": BaroSettings(enabled=False), "magnetic": MagneticSettings(enabled=False), "airdata": AirDataSettings(enabled=False)}
    return InsGps(InsGpsSettings(imu=imu, **off))


def flight(name: str, dataset: str, seed: int, grade: str = "crista", linear: bool = False) -> tuple[Any, float]:
    """Errors of one flight from a heading drawn from the circle, and how long it took, s."""
    duration_s = FLIGHTS[dataset][0]
    truth = truth_of(dataset, duration_s)
    if name == "ins_gnss":
        aids = GnssRawSimulator(GnssRawSimulatorSettings(seed=seed, rate_hz=2.0, max_satellites=9, select_every_s=30.0)).simulate(truth)
    else:
        aids = GpsSimulator(GpsSimulatorSettings(seed=seed, rate_hz=1.0, latency_s=0.0)).simulate(truth)
    rng, sigma = stream(seed, "unknown_heading"), START_SIGMA.copy()
    x, turn = START_SIGMA * rng.standard_normal(9), np.array([0.0, 0.0, np.pi * (2.0 * rng.random() - 1.0)])
    x[8], sigma[8] = 0.0, np.pi / np.sqrt(3.0)
    q = quat_apply_phi_n(quat_apply_phi_n(truth.q_nb[0], x[6:9]), turn)
    made = navigator(name, grade)
    made.tries_headings = not linear
    nav = np.array([*displace(truth.lat[0], truth.lon[0], truth.height[0], x[:3]), *(truth.vel_n[0] + x[3:6]), *q])
    made.begin(int(truth.stamps_ns[0]), nav, np.diag(sigma**2))
    imu = imu_of(load_imu_profile(grade), truth, seed)
    begun = time.process_time()
    solutions = fed(made, imu, aids)
    return flight_of(truth, solutions), time.process_time() - begun


def study(name: str, dataset: str, seeds: int, *, linear: bool) -> dict:
    """Heading of many flights: error, sigma and NEES at some times, NEES over all of the flight, share of known headings at the end."""
    flown = [flight(name, dataset, seed, linear=linear) for seed in range(1, seeds + 1)]
    t_s = flown[0][0].t_s
    error, sigma = (np.array([values(f) for f, _ in flown]) for values in (lambda f: wrap(f.error[:, 8]), lambda f: f.sigma[:, 8]))
    score = (error / sigma) ** 2
    found: dict[str, Any] = {"seconds": round(sum(s for _, s in flown), 1)}
    for at_s in FLIGHTS[dataset][1]:
        k = int(np.searchsorted(t_s, at_s))
        rms = [round(float(np.sqrt(np.mean(v[:, k] ** 2)) / DEGREE), 1) for v in (error, sigma)]
        found[f"{at_s:.0f} s"] = {"rms_deg": rms[0], "sigma_deg": rms[1], "nees": round(float(score[:, k].mean()), 2)}
    found["nees"] = round(float(score[:, t_s > 1.0].mean()), 2)
    found["attitude_nees"] = round(float(np.mean([f.nees[f.t_s > 1.0, 2].mean() for f, _ in flown])), 2)
    found["known"] = float(np.mean((np.abs(error[:, -1]) < 3.0 * KNOWN) & (sigma[:, -1] < KNOWN)))
    print(name, dataset, found, flush=True)
    return found


def measure(options) -> dict:
    """Every navigator on every flight."""
    seeds = options.seeds or (3 if options.quick else 50)
    names, datasets = options.navigators.split(","), options.flights.split(",")
    return {name: {dataset: study(name, dataset, seeds, linear=options.linear) for dataset in datasets} for name in names}


if __name__ == "__main__":
    run(
        __doc__,
        measure,
        seeds={"type": int, "default": 0, "help": "flights of each"},
        linear={"action": "store_true", "help": "one heading, as a linear filter has"},
        navigators={"default": "ins_gps,ins_gnss", "help": "which"},
        flights={"default": ",".join(FLIGHTS), "help": "which"},
    )
