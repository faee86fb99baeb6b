"""How many inertial samples a second of processor time the filters take, arrays in memory, one core.

ins_gps   15 states, IMU at 100 Hz in blocks of a second, a fix and a velocity each second.
ins_gnss  29 states, tight: IMU at 100 Hz, nine satellites at 10 Hz with pseudorange and Doppler, integrity tests included and without.
"""

import time
from dataclasses import replace
from functools import cache

import numpy as np
from common import run

from lowcostnav_ros.aids.airdata import AirDataSettings
from lowcostnav_ros.aids.baro import BaroSettings
from lowcostnav_ros.aids.magnetic import MagneticSettings
from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, ImuBlock
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.reproduce.solimeno.flights import Case, epochs_of, fed, imu_of, inertial_settings, started, truth_of
from lowcostnav_ros.trajectory import build
from lowcostnav_ros.trajectory.missions import standard

PLAIN = InsGpsSettings(baro=BaroSettings(enabled=False), magnetic=MagneticSettings(enabled=False), airdata=AirDataSettings(enabled=False))


@cache
def flown(seconds: int) -> TruthBlock:
    """The true states of a banked flight at 100 Hz."""
    return build(standard("banked_turns", kind="segments", duration_s=float(seconds))).table()


def stream(seconds: int, seed: int = 1) -> list:
    """That flight in blocks of one second with a fix each, sensor noise included."""
    truth, rng = flown(seconds), np.random.default_rng(seed)
    measurements = []
    for start in range(0, len(truth) - 99, 100):
        t = truth[start : start + 100]
        last = t[99:100]
        velocity = last.vel_n[0] + 0.1 * rng.standard_normal(3)
        stamp = int(last.stamps_ns[0])
        force = t.specific_force_b + 0.02 * rng.standard_normal((100, 3))
        measurements.append(ImuBlock.of("imu/data_raw", t.stamps_ns, force, t.angular_rate_b + 0.002 * rng.standard_normal((100, 3))))
        measurements.append(GpsPosition(stamp, "gps/fix", last.lat[0], last.lon[0], last.height[0], np.eye(3) * 4.0))
        measurements.append(GpsVelocity(stamp, "gps/vel", velocity, np.eye(3) * 0.01))
    return measurements


def tight(options, *, integrity: bool) -> dict:
    """Best and median of several passes of the 29-state filter; nine satellites wherever so many are in view."""
    case = Case("tight", "LD", "crista", schedule="all", duration_s=60.0 if options.quick else 300.0)
    truth, profile = truth_of(case.dataset, case.duration_s), load_imu_profile(case.grade)
    epochs, imu = epochs_of(case, truth), imu_of(profile, truth, case.seed)
    settings = inertial_settings(case, imu_settings(profile.filter_noise()))
    settings = replace(settings, gnss=replace(settings.gnss, integrity=replace(settings.gnss.integrity, enabled=integrity)))
    seconds = []
    for _ in range(2 if options.quick else 4):
        navigator = started(InsGnss(settings), truth, case)
        start = time.process_time()
        fed(navigator, imu, epochs)
        seconds.append(time.process_time() - start)
    if navigator.mode != "gps":
        raise SystemExit(f"The filter did not run as it should: mode {navigator.mode}.")
    return {
        "samples_per_s": len(imu) / float(np.median(seconds[1:])),
        "best_samples_per_s": len(imu) / min(seconds[1:]),
        "samples": len(imu),
        "states": navigator.layout.size,
        "satellites": float(np.mean([len(e) for e in epochs])),
    }


def measure(options) -> dict:
    """Both filters."""
    return {
        **ins_gps(options),
        "ins_gnss_tight": tight(options, integrity=True),
        "ins_gnss_tight_without_integrity": tight(options, integrity=False),
    }


def ins_gps(options) -> dict:
    """Best and median of several passes of the 15-state filter."""
    flight = stream(120 if options.quick else 600)
    samples = sum(len(m) for m in flight if isinstance(m, ImuBlock))
    seconds = []
    for _ in range(2 if options.quick else 6):  # the first pass compiles or loads the kernels
        navigator = InsGps(PLAIN)
        start = time.process_time()
        solutions = navigator.feed_all(flight)
        seconds.append(time.process_time() - start)
    if navigator.mode != "gps" or navigator.layout.size != 15 or len(solutions) < samples / 11:
        raise SystemExit(f"The filter did not run as it should: mode {navigator.mode}, {navigator.layout.size} states.")
    return {
        "samples_per_s": samples / float(np.median(seconds[1:])),
        "best_samples_per_s": samples / min(seconds[1:]),
        "samples": samples,
        "states": navigator.layout.size,
        "fused_solutions": len(solutions),
    }


if __name__ == "__main__":
    run(__doc__, measure)
