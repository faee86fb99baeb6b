"""Offsets of stamps that nobody declared: what the navigators make of GPS stamped late or early, corrected and not.

Every flight is flown with GPS that is stamped as much later as its messages come later (or earlier than they were valid), with every
offset, seed and way of treating stamps.  Errors are those of the last two thirds of the flight: first the offset is learned.
"""

import heapq
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from common import run

from lowcostnav_ros.base.measurements import GnssEpoch, GpsPosition, GpsVelocity, ImuBlock, Measurement
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.building import build_navigators
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.metrics import Errors
from lowcostnav_ros.replay.session import Session, simulated
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

SENSORS = """
sensors: [imu, magnetometer, air_data, gps{gnss}]
imu: {{profile: automotive, rate_hz: 100.0}}
magnetometer: {{rate_hz: 20.0, calibrated: true, calibration_residual_mg: 4.0, noise_mg: 1.0}}
air_data: {{rate_hz: 10.0}}
gps: {{rate_hz: 5.0}}
{further}
"""
FLIGHTS = {
    "ordinary": """
truth:
  mission: ["straight duration_s=30", "turn by_deg=90 bank_deg=25", "straight duration_s=60", "turn by_deg=-180 bank_deg=20",
            "climb to_height_m=900 rate_mps=4", "turn by_deg=90 bank_deg=25", "straight duration_s=60", "turn by_deg=270 bank_deg=25",
            "straight duration_s=60", "turn by_deg=-90 bank_deg=25", "straight duration_s=30"]
  wind: {north_mps: -4.0, east_mps: 6.0, turbulence_sigma_mps: 0.5}
""",
    "straight": """
truth:
  mission: ["straight duration_s=300"]
  wind: {north_mps: -4.0, east_mps: 6.0, turbulence_sigma_mps: 0.5}
""",
    "aerobatics": """
truth: {kind: aerobatics, start: {height_m: 1500.0, airspeed_mps: 80.0}, wind: {north_mps: -4.0, east_mps: 6.0}}
""",
}
GPS = GpsPosition | GpsVelocity | GnssEpoch
CHANGE_NS = 150_000_000_000


def arriving(items: Iterable, offset_s: Callable[[], float]) -> Iterator:
    """The same with GPS stamped later by so much, and arriving as much later; what is stamped early arrives when it is valid."""
    held: list[tuple[int, int, Measurement]] = []
    for count, item in enumerate(items):
        if isinstance(item, GPS):
            late_ns = round(1e9 * offset_s())
            if late_ns <= 0:
                yield replace(item, stamp_ns=item.stamp_ns + late_ns)
            else:
                heapq.heappush(held, (item.stamp_ns + late_ns, count, replace(item, stamp_ns=item.stamp_ns + late_ns)))
            continue
        while held and isinstance(item, ImuBlock) and held[0][0] <= item.stamp_ns:
            due = int(np.searchsorted(item.stamps_ns, held[0][0], side="right"))
            if due:
                yield item[:due]
            yield heapq.heappop(held)[2]
            item = item[due:]
            if not len(item):
                break
        else:
            yield item


def fly(flight: str, navigator: str, seed: int, stamps: str, offset_s: float, jitter_s: float = 0.0, change_s: float = 0.0) -> dict:
    """Errors of one flight, and what became known of the stamps; half way the offset grows by ``change_s``."""
    gnss = navigator == "ins_gnss"
    text = SENSORS.format(gnss=", gnss" if gnss else "", further="gnss: {rate_hz: 2.0}" if gnss else "")
    simulation = Simulation(scenario_from_text(text + FLIGHTS[flight], flight, seed=seed))
    names = ("ahrs", "dead_reckoning") if navigator == "dead_reckoning" else (navigator,)
    session = Session(trusting(build_navigators(names, NAVIGATORS, None), stamps), has_truth=True)
    found: list[Errors] = []
    session.runs[navigator].evaluation.listeners.append(found.append)
    rng, first_ns = np.random.default_rng(seed), 0

    def now_s() -> float:
        changed = session.newest_ns - first_ns > CHANGE_NS
        return offset_s + jitter_s * rng.random() + (change_s if changed else 0.0)

    for item in arriving(simulated(simulation.blocks()), now_s):
        if isinstance(item, TruthBlock):
            first_ns = first_ns or int(item.stamps_ns[0])
            session.feed_truth(item)
        else:
            session.feed(item)
    session.finish()
    offsets = session.runs[navigator].navigator.offsets
    return errors(found) | {
        "offsets": {s: (o.late_s, o.late_s + o.rest_s, o.sigma_s, o.spans) for s, o in offsets.known.items()} if offsets else {}
    }


def trusting(navigators: dict, stamps: str) -> dict:
    """The same navigators with this way of treating stamps."""
    return {
        name: type(one)(replace(one.settings, horizon=replace(one.settings.horizon, stamps=stamps))) for name, one in navigators.items()
    }


def errors(found: list[Errors]) -> dict:
    """Root mean square and 95 % of horizontal position, velocity and attitude over the last two thirds, and error over sigma."""
    if not found:
        return {}
    values, sigmas = np.concatenate([e.values for e in found]), np.concatenate([e.sigmas for e in found])
    values, sigmas = values[len(values) // 3 :], sigmas[len(sigmas) // 3 :]
    horizontal = np.hypot(values[:, 0], values[:, 1])
    return {
        "horizontal_m": float(np.sqrt(np.mean(horizontal**2))),
        "horizontal_worst_m": float(np.max(horizontal)),
        "over_sigma": float(np.sqrt(np.mean((values[:, :2] / sigmas[:, :2]) ** 2))),
        "roll_deg": float(np.sqrt(np.mean(values[:, 6] ** 2))),
        "heading_deg": float(np.sqrt(np.mean(values[:, 8] ** 2))),
    }


def words(one: dict) -> str:
    """A flight in one line."""
    offsets = "".join(f" {device} {late:+.3f} {total:+.3f} +- {sigma:.3f}" for device, (late, total, sigma, _) in one["offsets"].items())
    return " ".join(f"{name} {value:.3g}" for name, value in one.items() if name != "offsets") + ";" + offsets


def measure(options) -> dict:
    """All flights, offsets and ways."""
    out = {}
    offsets = (0.0, 0.35) if options.quick else tuple(map(float, options.offsets.split(",")))
    for flight in options.flights.split(","):
        for navigator in options.navigators.split(","):
            for offset_s in offsets:
                for stamps in options.stamps.split(","):
                    for seed in range(1, options.seeds + 1):
                        one = fly(flight, navigator, seed, stamps, offset_s, options.jitter, options.change)
                        out[f"{flight} {navigator} {offset_s} {stamps} {seed}"] = one
                        print(f"{flight} {navigator} {offset_s} {stamps} {seed}:", words(one), flush=True)
    return out


if __name__ == "__main__":
    run(
        __doc__,
        measure,
        flights={"default": "ordinary,aerobatics"},
        navigators={"default": "ins_gps,ins_gnss,dead_reckoning,ahrs"},
        offsets={"default": "0,0.1,0.2,0.35,0.5,-0.1", "help": "s, positive for stamps that are late"},
        stamps={"default": "trust,correct"},
        seeds={"type": int, "default": 1},
        jitter={"type": float, "default": 0.0, "help": "each stamp is later by up to this, s"},
        change={"type": float, "default": 0.0, "help": "after 150 s the offset is larger by this, s"},
    )
