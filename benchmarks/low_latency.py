"""How honest the low-latency outputs are: error over sigma of what each navigator publishes at once, in turns and in aerobatics.

The chain ahrs, ins_gps, dead_reckoning, supervisor is fed as in flight; every 50 ms its outputs are compared with the truth.
"""

from dataclasses import replace

import numpy as np
from common import run

from lowcostnav_ros.base.measurements import ImuBlock, Measurement, NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.building import build_navigators
from lowcostnav_ros.navigators.base import Navigator
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.physics.rotation import quat_conjugate, quat_multiply, rotvec_from_quat
from lowcostnav_ros.replay.columns import interpolate
from lowcostnav_ros.replay.evaluation import truth_columns
from lowcostnav_ros.replay.session import Session, simulated
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

NAMES = ("ahrs", "ins_gps", "dead_reckoning", "supervisor")
PARTS = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9)}
SETTLED_S = 15.0
OUTPUT_NS = 50_000_000
SENSORS = """
sensors: [imu, magnetometer, air_data, gps, dme]
imu: {profile: automotive, rate_hz: 100.0}
magnetometer: {rate_hz: 20.0, calibrated: true, calibration_residual_mg: 4.0, noise_mg: 1.0}
air_data: {rate_hz: 10.0}
gps: {rate_hz: 5.0, latency_s: 0.1}
"""
FLIGHTS = {
    "turns": """
truth:
  mission: ["straight duration_s=15", "s_turns count=6 by_deg=90 bank_deg=45", "speed to_mps=60 accel_mps2=2",
            "turn by_deg=-360 bank_deg=60", "climb to_height_m=900 rate_mps=8", "straight duration_s=10"]
  wind: {north_mps: -4.0, east_mps: 6.0, turbulence_sigma_mps: 0.5}
""",
    "aerobatics": """
truth: {kind: aerobatics, start: {height_m: 1500.0, airspeed_mps: 80.0}, wind: {north_mps: -4.0, east_mps: 6.0}}
""",
}


def worn(measurements: list[Measurement], rng: np.random.Generator, drop: float, jitter_s: float) -> list[Measurement]:
    """The same with inertial samples dropped, and their stamps off by as much as ``jitter_s``."""
    out = []
    for m in measurements:
        if isinstance(m, ImuBlock):
            stamps = m.stamps_ns + rng.integers(-round(1e9 * jitter_s), round(1e9 * jitter_s) + 1, len(m))
            kept = np.flatnonzero(rng.random(len(m)) >= drop)
            if not len(kept):
                continue
            order = np.sort(stamps[kept])
            m = replace(m[kept], stamps_ns=order, stamp_ns=int(order[-1]))
        out.append(m)
    return out


def outputs(flight: str, seed: int, drop: float = 0.0, jitter_s: float = 0.0) -> dict[str, np.ndarray]:
    """Errors over sigmas, (n, 9) by navigator, of one flight; NaN where a navigator has no such datum."""
    simulation = Simulation(scenario_from_text(SENSORS + FLIGHTS[flight], flight, seed=seed))
    rng, truths = np.random.default_rng(seed), []

    def flown():
        for truth, measurements in simulation.blocks():
            truths.append(truth)
            yield truth, worn(measurements, rng, drop, jitter_s) if drop or jitter_s else measurements

    session = Session(build_navigators(NAMES, NAVIGATORS, None), has_truth=True)
    taken = {name: Taken(run.navigator) for name, run in session.runs.items()}
    for item in simulated(flown()):
        if isinstance(item, ImuBlock):
            for k in range(len(item)):
                session.feed(item[k : k + 1])
        elif isinstance(item, Measurement):
            session.feed(item)
    truth = TruthBlock.joined(truths)
    return {name: ratios(truth, taken[name].solutions) for name in NAMES}


class Taken:
    """The outputs of a navigator as its node takes them: after what it is fed, at 20 Hz of stamps."""

    def __init__(self, navigator: Navigator) -> None:
        self.solutions: list[NavSolution] = []
        self._navigator, self._feed, self._next_ns = navigator, navigator.feed, 0
        navigator.feed = self.feed

    def feed(self, measurement: Measurement) -> list[NavSolution]:
        """Feed, and keep the output when it is due."""
        fused = self._feed(measurement)
        if self._navigator.inertial in (None, measurement.source):
            solution = self._navigator.output()
            if solution is not None and solution.stamp_ns >= self._next_ns:
                self._next_ns = (solution.stamp_ns // OUTPUT_NS + 1) * OUTPUT_NS
                self.solutions.append(solution)
        return fused


def ratios(truth: TruthBlock, solutions: list[NavSolution]) -> np.ndarray:
    """Position, velocity and attitude as the rotation that is left, each component over its own sigma."""
    stamps = np.array([s.stamp_ns for s in solutions])
    reference, out = interpolate(truth_columns(truth), stamps, 1_000_000_000), []
    for s, place, vel_n, q_nb in zip(solutions, reference.position, reference.vel_n, reference.q_nb, strict=True):
        if s.stamp_ns < truth.stamps_ns[0] + 1e9 * SETTLED_S or not np.isfinite(place).all():
            continue
        row = np.full(9, np.nan)
        if s.has_position:
            row[0:3] = difference_n(*s.place, *place) / np.sqrt(np.diag(s.cov_pos))
        if s.vel_n is not None and s.cov_vel is not None:
            row[3:6] = (s.vel_n - vel_n) / np.sqrt(np.diag(s.cov_vel))
        if s.q_nb is not None and s.cov_att is not None:
            row[6:9] = rotvec_from_quat(quat_multiply(q_nb, quat_conjugate(s.q_nb))) / np.sqrt(np.diag(s.cov_att))
        out.append(np.abs(row))
    return np.array(out)


def summary(flights: list[np.ndarray]) -> dict:
    """Shares beyond 3 and 6 sigma, the worst and the root mean square, by position, velocity and attitude."""
    joined, out = np.concatenate(flights), {"outputs": sum(map(len, flights))}
    for part, columns in PARTS.items():
        values = joined[:, columns]
        values = values[np.isfinite(values).all(axis=1)]
        if len(values):
            worst = values.max(axis=1)
            out[part] = {
                "beyond_3_sigma": float(np.mean(worst > 3.0)),
                "beyond_6_sigma": float(np.mean(worst > 6.0)),
                "worst": float(worst.max()),
                "rms": float(np.sqrt(np.mean(values**2))),
            }
    return out


def measure(options) -> dict:
    """Both flights, and turns with a third of the inertial samples lost."""
    seeds = range(1, 2 if options.quick else 6)
    cases = {"turns": {}, "aerobatics": {}, "turns, 30 % of samples lost": {"drop": 0.3}}
    result = {}
    for case, wear in cases.items():
        flights = [outputs(case.split(",")[0], seed, **wear) for seed in seeds]
        result[case] = {name: summary([flight[name] for flight in flights]) for name in NAMES}
    return result


if __name__ == "__main__":
    run(__doc__, measure)
