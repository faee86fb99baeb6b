"""How accurate, how honest and how fast the attitude reference is on flight-dynamics flights of 20 minutes with repeated turns.

IMU of DMU-6X grade at 100 Hz, calibrated magnetometer, wind with variation and light turbulence.  Cases: GPS velocity throughout; GPS
withheld after alignment, with airspeed; neither GPS velocity nor airspeed after alignment (levelling in steady flight only).  Then the
constant-gain filters: with GPS attitude, with it withheld after five minutes, with GPS velocity, and without any GPS.
"""

import time

import numpy as np
from common import fly, run

from lowcostnav_ros.base.measurements import ImuBlock, Measurement, NavSolution
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.estimation.consistency import error_over_sigma_rms
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs, AhrsSettings
from lowcostnav_ros.physics.rotation import euler_jacobian_n, quat_to_euler, wrap
from lowcostnav_ros.simulation.scenario import scenario_from_text

SCENARIO = """
name: ahrs_accuracy
seed: {seed}
sensors: [imu, magnetometer, air_data, gps, gps_attitude]
truth:
  kind: {kind}
  name: banked_turns
  duration_s: {duration_s}
  wind: {{north_mps: 4.0, east_mps: 6.0, variation_sigma_mps: 2.0, turbulence_sigma_mps: 0.5}}
imu: {{profile: dmu6x}}
"""
# The data sheet's noise is per sample at 20 Hz; the flight's wind varies by 2 m/s and the magnetometer's residual is 4 mG, one degree.
SETTINGS = {
    "imu.gyro_noise_dps_rthz": 0.05 / 20**0.5,
    "imu.gyro_bias_dps": 0.05,
    "imu.gyro_bias_tau_s": 300.0,
    "imu.gyro_turn_on_dps": 0.0,
    "imu.accel_noise_mg_rthz": 1.0 / 20**0.5,
    "imu.accel_bias_mg": 1.2,
    "imu.accel_bias_tau_s": 100.0,
    "imu.accel_turn_on_mg": 0.0,
    "magnetic.bias_deg": 1.0,
    "airdata.wind_mps": 2.0,
}
WITHHELD_AFTER_S = 60.0
SETTLED_S = 90.0
ATTITUDE_WITHHELD_AFTER_S = 300.0
CASES = {
    "gps": ("full", ()),
    "gps_withheld": ("full", ("gps/vel", "gps/fix")),
    "gps_and_air_withheld": ("full", ("gps/vel", "gps/fix", "air/velocity")),
    "euler": ("euler", ()),
    "quaternion": ("quaternion", ()),
    "quaternion_gps_withheld": ("quaternion", ("gps/attitude", "gps/vel", "gps/fix")),
    "vector_matching": ("vector_matching", ()),
    "switched": ("switched", ()),
}
TARGETS = {"gps": (1.0, 1.0, 2.5), "gps_withheld": (1.5, 1.5, 3.0)}


def flight(kind: str, seed: int, duration_s: float) -> tuple[TruthBlock, list[Measurement]]:
    """Truth and measurements of one flight."""
    return fly(scenario_from_text(SCENARIO.format(kind=kind, seed=seed, duration_s=duration_s)))


def navigate(measurements: list[Measurement], kind: str, withheld: tuple[str, ...]) -> tuple[list[NavSolution], float]:
    """Fused solutions of a filter with some inputs withheld after a while, and the processor seconds they took."""
    navigator = Ahrs(from_mapping(AhrsSettings, SETTINGS | {"filter": kind}))
    after_s = ATTITUDE_WITHHELD_AFTER_S if "gps/attitude" in withheld else WITHHELD_AFTER_S
    end_ns = measurements[0].stamp_ns + round(1e9 * after_s)
    heard = [m for m in measurements if m.source in navigator.inputs and not (m.source in withheld and m.stamp_ns > end_ns)]
    begin = time.process_time()
    return navigator.feed_all(heard), time.process_time() - begin


def true_gyro_bias(truth: TruthBlock, measurements: list[Measurement], span: int = 3000) -> np.ndarray:
    """Moving mean over 30 s of measured minus true rate, (n, 3): the slow error an estimate can be compared with."""
    measured = np.concatenate([m.angular_rate_b for m in measurements if isinstance(m, ImuBlock)])
    window = np.ones(span) / span
    return np.column_stack([np.convolve(measured[:, i] - truth.angular_rate_b[: len(measured), i], window, "same") for i in range(3)])


def errors(truth: TruthBlock, bias: np.ndarray, solutions: list[NavSolution]) -> tuple[np.ndarray, np.ndarray]:
    """Errors and sigmas of roll, pitch, heading, three gyro biases (deg, deg/s), settled part only, shape (n, 6)."""
    rows = np.searchsorted(truth.stamps_ns, [s.stamp_ns for s in solutions])
    error, sigma = [], []
    for row, solution in zip(rows, solutions, strict=True):
        after_s = (solution.stamp_ns - truth.stamps_ns[0]) * 1e-9
        if after_s < SETTLED_S or row > len(truth) - 1500 or truth.stamps_ns[row] != solution.stamp_ns:
            continue
        euler = np.array(quat_to_euler(solution.q_nb))
        jacobian = euler_jacobian_n(*euler)
        states = [solution.states[f"gyro_bias_{axis}_radps"] for axis in "xyz"]
        angle = wrap(np.array(quat_to_euler(truth.q_nb[row])) - euler)
        error.append([*angle, *(bias[row] - [value for value, _ in states])])
        sigma.append([*np.sqrt(np.diag(jacobian @ solution.cov_att @ jacobian.T)), *(s for _, s in states)])
    return np.degrees(error), np.degrees(sigma)


def judge(case: str, flights: list[tuple]) -> dict:
    """Figures of one case over all flights."""
    results = [(errors(truth, bias, solutions), seconds, truth) for truth, bias, solutions, seconds in flights]
    error, sigma = (np.vstack([pair[i] for pair, _, _ in results]) for i in (0, 1))
    rms = np.sqrt(np.mean(error**2, axis=0))
    names = ("roll", "pitch", "heading")
    flown_s = sum(len(truth) for _, _, truth in results) / 100.0
    figures = {f"{n}_rms_deg": round(float(r), 3) for n, r in zip(names, rms, strict=False)}
    figures |= {f"{n}_worst_deg": round(float(w), 2) for n, w in zip(names, np.abs(error).max(axis=0), strict=False)}
    ratios = [error_over_sigma_rms(error[:, i], sigma[:, i]) for i in range(6)]
    figures |= {f"{n}_error_over_sigma": round(r, 2) for n, r in zip((*names, *(f"gyro_bias_{a}" for a in "xyz")), ratios, strict=True)}
    figures["cpu_ms_per_flight_second"] = round(1e3 * sum(seconds for _, seconds, _ in results) / flown_s, 2)
    if case in TARGETS:
        figures["accuracy_reached"] = bool(np.all(rms[:3] < TARGETS[case]))
    return figures


def measure(options) -> dict:
    """Fly every seed, run every case on it, judge the cases."""
    kind, seeds, duration_s = ("segments", (1,), 300.0) if options.quick else ("jsbsim", (1, 2, 3, 4), 0.0)
    warm = flight("segments", 9, 20.0)[1]
    for filter_kind, withheld in CASES.values():  # compile before the clock runs
        navigate(warm, filter_kind, withheld)
    flights: dict[str, list] = {case: [] for case in CASES}
    for seed in seeds:
        truth, measurements = flight(kind, seed, duration_s)
        bias = true_gyro_bias(truth, measurements)
        for case, (filter_kind, withheld) in CASES.items():
            flights[case].append((truth, bias, *navigate(measurements, filter_kind, withheld)))
    return {"kind": kind, "flights": len(seeds), **{case: judge(case, flown) for case, flown in flights.items()}}


if __name__ == "__main__":
    run(__doc__.splitlines()[0], measure)
