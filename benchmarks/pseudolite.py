"""The pseudolite navigator: consistency over seeds, speed with 31 states, ranging beacons and GPS carrier in its place.

nees       mean over seeds of position, velocity and attitude (3 each), cross-covariances kept and zeroed, with the band of 95 %.
beacons    horizontal and vertical RMS, m, and error over sigma, by beacons and ranges a second; no GPS, automotive inertial unit.
carrier    the same with GPS carrier against a base.
epoch_ms   processor time that an epoch takes, with the thesis's filter and with the navigator's own.
"""

import time
from collections import deque
from dataclasses import replace

import numpy as np
from common import run

from lowcostnav_ros.base.measurements import CarrierEpoch
from lowcostnav_ros.estimation.consistency import acceptance_band
from lowcostnav_ros.reproduce.kawecki.beyond import OtherCase, fly_other
from lowcostnav_ros.reproduce.kawecki.flights import Case, fly, imu_of_case, navigator_of, simulator_of, started, truth_of
from lowcostnav_ros.reproduce.solimeno.flights import Flight, fed
from lowcostnav_ros.studies.campaign import run_campaign

SETTLED_S = 30.0


def nees(case: Case) -> np.ndarray:
    """Mean NEES of a flight, and the 3-D mean error of the period."""
    flown = fly(case)
    return np.append(flown.flight.nees[flown.flight.t_s > SETTLED_S].mean(axis=0), flown.mean(3))


def speed(seconds: float = 200.0) -> dict:
    """Samples a second of the thesis's filter: 31 states, 14 transmitters at 10 Hz."""
    case = Case(test=3, signals="clean", duration_s=seconds)
    truth = truth_of(seconds)
    measured, imu, taken = simulator_of(case).simulate(truth), imu_of_case(case, truth), []
    for _ in range(4):
        navigator = started(navigator_of(case), truth, case)
        begun = time.process_time()
        fed(navigator, imu, measured)
        taken.append(time.process_time() - begun)
    return {"samples_per_cpu_s": len(imu) / min(taken[1:]), "states": navigator.layout.size}


def epoch_ms(case: Case, seconds: float = 100.0) -> dict:
    """Processor time between the last inertial sample before an epoch and its solution, sample by sample as live, ms."""
    truth = truth_of(seconds)
    navigator, imu = started(navigator_of(case), truth, case), imu_of_case(case, truth)
    waiting, spent = deque(simulator_of(case).simulate(truth)), []
    for k in range(1, len(imu)):
        sample, begun, epochs = imu[k : k + 1], time.process_time(), 0
        while waiting and waiting[0].stamp_ns <= sample.stamp_ns:
            one = waiting.popleft()
            epochs += isinstance(one, CarrierEpoch)
            navigator.feed(one)
        navigator.feed(sample)
        navigator.output()
        if epochs:
            spent.append(1e3 * (time.process_time() - begun))
    median, late = np.percentile(spent[100:], (50, 99))
    return {"states": navigator.layout.size, "median": float(median), "p99": float(late)}


def summary(flights: list[Flight], after_s: float = 120.0) -> dict:
    """RMS and honesty of flights once settled."""
    late = [f.t_s > after_s for f in flights]
    error = np.concatenate([f.error[k, :3] for f, k in zip(flights, late, strict=True)])
    sigma = np.concatenate([f.sigma[k, :3] for f, k in zip(flights, late, strict=True)])
    return {
        "horizontal_rms_m": float(np.sqrt((error[:, :2] ** 2).sum(axis=1).mean())),
        "vertical_rms_m": float(np.sqrt((error[:, 2] ** 2).mean())),
        "error_over_sigma": float(np.sqrt(((error / sigma) ** 2).mean())),
    }


def measure(options) -> dict:
    """Everything."""
    seeds = range(1, 3 if options.quick else 21)
    kept = Case(0, start="drawn")
    zeroed = replace(kept, changes=(("pseudolite.reset.covariance", "zeroed"),))
    flown = (("kept", kept, list(seeds)), ("zeroed", zeroed, list(seeds)[:4]))
    scores = {name: np.array(run_campaign(nees, [replace(case, seed=s) for s in some])) for name, case, some in flown}
    found: dict = {"speed": speed(), "epoch_ms": [epoch_ms(Case(test)) for test in (3, 0)], "band": acceptance_band(3, len(seeds))}
    found["nees"] = {name: {"mean": s[:, :3].mean(axis=0).tolist(), "largest": s[:, :3].max(axis=0).tolist()} for name, s in scores.items()}
    found["mean_3d_m"] = {name: float(s[:, 3].mean()) for name, s in scores.items()}
    few = list(seeds)[:3]
    beacons = [OtherCase(beacons=n, rate_hz=r) for n, r in ((4, 2.0), (4, 0.5), (3, 2.0), (2, 2.0))]
    for case in beacons:
        flights = run_campaign(fly_other, [replace(case, seed=s) for s in few])
        found[f"beacons {case.beacons}, {case.rate_hz:g} Hz"] = summary(flights)
    found["carrier"] = summary(run_campaign(fly_other, [OtherCase("gnss_carrier", seed=s) for s in few]))
    return found


if __name__ == "__main__":
    run(__doc__, measure)
