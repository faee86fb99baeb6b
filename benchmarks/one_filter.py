"""Air data, DME, compass, barometer and inertial sensors in one filter, over the outage of the demonstration; prints JSON.

    python benchmarks/one_filter.py            # 20 flights
    python benchmarks/one_filter.py --quick    # 3

The flight of the demonstration with other seeds: GPS lost for six minutes, one DME receiver at 15 s, the error models of the sources.
Beside it the best of the single navigators, dead reckoning on the attitude reference, over the same flights.
"""

from argparse import Namespace

import numpy as np
from common import compare, rms, run, scenario

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.building import build_navigators, complete_settings, make_navigator
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.metrics import AXES
from lowcostnav_ros.replay.session import replay_stream, simulated
from lowcostnav_ros.simulation.simulator import Simulation
from lowcostnav_ros.studies.campaign import run_campaign

LOST_S, END_S = 183.0, 540.0
ALL = ["gps", "baro", "magnetic", "airdata", "dme"]
SINGLE = "dead_reckoning"
AIDS = {"all": ALL, "without_dme": ALL[:-1], "without_air_data": ["gps", "baro", "magnetic", "dme"]}


def one_flight(seed: int) -> dict[str, dict[str, np.ndarray]]:
    """Errors in the outage with each list of aids and of dead reckoning alone, every tenth of a second."""
    seconds = list(Simulation(scenario("livermore", seed)).blocks())
    truth = TruthBlock.joined(block for block, _ in seconds)
    found = {}
    for name, aids in AIDS.items():
        stations = {"dme.stations_file": "dme_stations_bay_area.csv"} if "dme" in aids else {}
        navigator = make_navigator(complete_settings(InsGps.Settings, {"imu.profile": "automotive", "aids": aids} | stations), InsGps)
        found[name] = in_outage(truth, navigator.feed_all(m for _, heard in seconds for m in heard))
    return found | {SINGLE: in_outage(truth, reckoned(seconds))}


def reckoned(seconds: list) -> list[NavSolution]:
    """Solutions of dead reckoning, which hears the attitude reference."""
    navigators, solutions = build_navigators(["ahrs", SINGLE], NAVIGATORS, None), []
    navigator = navigators[SINGLE]
    publish, navigator.publish = navigator.publish, lambda s: (solutions.append(s), publish(s))[1]
    replay_stream(simulated(seconds), navigators)
    return solutions


def in_outage(truth: TruthBlock, solutions: list[NavSolution]) -> dict[str, np.ndarray]:
    """Errors and sigmas without GPS, by axis, and NEES."""
    errors, _ = compare(truth, solutions)
    seconds = 1e-9 * (errors.stamps_ns - truth.stamps_ns[0])
    errors = errors[(seconds >= LOST_S) & (seconds < END_S)]
    found = {axis: errors.axis(axis) for axis in AXES} | {"nees": errors.nees_horizontal}
    return found | {f"{axis}_sigma": errors.sigmas[:, k] for k, axis in enumerate(AXES)}


def summary(flights: list[dict[str, np.ndarray]]) -> dict:
    """Errors over all flights and instants, and whether the sigmas fit."""
    joined = {key: np.concatenate([flight[key] for flight in flights]) for key in flights[0]}
    horizontal = np.hypot(joined["north_m"], joined["east_m"])
    each = [float(np.percentile(np.hypot(flight["north_m"], flight["east_m"]), 95)) for flight in flights]
    ratio = {axis: joined[axis] / joined[f"{axis}_sigma"] for axis in AXES}
    pairs = {"position": ("north_m", "east_m"), "velocity": ("vn_mps", "ve_mps"), "tilt": ("roll_deg", "pitch_deg")}
    pairs["heading"] = ("heading_deg",)
    return {
        "rms_m": round(rms(horizontal), 1),
        "p95_m": round(float(np.percentile(horizontal, 95)), 1),
        "worst_m": round(float(horizontal.max()), 1),
        "p95_of_each_m": [round(value) for value in each],
        "roll_pitch_heading_rms_deg": [round(rms(joined[axis]), 2) for axis in ("roll_deg", "pitch_deg", "heading_deg")],
        "error_over_sigma": {name: round(rms(np.concatenate([ratio[axis] for axis in axes])), 2) for name, axes in pairs.items()},
        "nees_of_2": round(float(np.mean(joined["nees"])), 2),
    }


def measure(options: Namespace) -> dict:
    """Fly, sum up."""
    seeds = list(range(1, 4 if options.quick else options.flights + 1))
    flights = run_campaign(one_flight, seeds, label="flights")
    return {"flights": len(seeds)} | {name: summary([flight[name] for flight in flights]) for name in (*AIDS, SINGLE)}


if __name__ == "__main__":
    run(__doc__.splitlines()[0], measure, flights={"type": int, "default": 20, "help": "seeds, from 1"})
