"""Is INS/GPS right again after a minute of sound GPS, whatever IMU it is given and wherever it begins?

Each flight draws its manoeuvres, where in them the navigator begins, and an IMU whose white noise, drift, turn-on bias and scale factor
are up to so many times those of the filter's settings, each sensor's times drawn for itself.  Judged is what is published from a minute
after the first solution on: horizontal error, and the share of time beyond 4 sigma in position and in attitude.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from common import compare, run
from consistency import plain_filter, profile

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.replay.metrics import AXES
from lowcostnav_ros.sensors.gps import GpsSimulator, GpsSimulatorSettings
from lowcostnav_ros.sensors.imu import ImuSimulator, ImuSimulatorSettings
from lowcostnav_ros.sensors.imu_profile import ImuProfile
from lowcostnav_ros.studies.campaign import run_campaign
from lowcostnav_ros.trajectory import build
from lowcostnav_ros.trajectory.missions import standard

MINUTE_S, DURATION_S, BEYOND = 60.0, 180.0, 4.0
TURN_ON_DEG_PER_H, TURN_ON_MPS2 = 360.0, 0.049
"""Turn-on biases as the settings of the package state them, 0.1 deg/s and 5 mg; the profile states none."""
SCALE_PPM = 1000.0
ATTITUDE = [AXES.index(axis) for axis in ("roll_deg", "pitch_deg", "heading_deg")]


def poor(rng: np.random.Generator, worst: float) -> ImuProfile:
    """An automotive unit, each sensor's errors up to ``worst`` times as large."""
    sound = profile("automotive")

    def times(part: Any, turn_on: dict[str, float]) -> Any:
        own = worst ** rng.uniform(0.0, 1.0)
        drawn = [n for n in part.__dataclass_fields__ if n.startswith(("noise_per_sample", "bias_drift")) and not n.endswith("tau_s")]
        values = {name: [own * value for value in getattr(part, name)] for name in drawn}
        values |= {name: [worst * value] * 3 for name, value in turn_on.items()}
        return replace(part, **values, scale_factor_ppm=[worst * SCALE_PPM] * 3)

    gyro = times(sound.gyro, {"turn_on_bias_deg_per_h": TURN_ON_DEG_PER_H})
    return replace(sound, gyro=gyro, accelerometer=times(sound.accelerometer, {"turn_on_bias_mps2": TURN_ON_MPS2}))


def mission(rng: np.random.Generator) -> list[str]:
    """Turns, climbs and straight legs in an order of the flight's own."""
    lines = []
    while len(lines) < 30:
        lines.append(f"turn by_deg={rng.choice([-1, 1]) * rng.integers(40, 200)} bank_deg={rng.integers(15, 35)}")
        lines.append(f"straight duration_s={rng.integers(5, 25)}")
        if rng.uniform() < 0.3:
            lines.append(f"climb to_height_m={rng.integers(700, 1200)} rate_mps=3")
    return lines


def heard(seed: int, worst: float, truth: Any) -> Iterator[Measurement]:
    """What the navigator hears: from some time on, in the order of arrival."""
    rng = np.random.default_rng([seed, round(10 * worst)])
    imu = ImuSimulator(ImuSimulatorSettings(seed=seed, rate_hz=100.0), poor(rng, worst))
    gps = GpsSimulator(GpsSimulatorSettings(seed=seed, rate_hz=2.0))
    begins_ns = truth.stamps_ns[0] + round(1e9 * rng.uniform(0.0, 60.0))
    for start in range(0, len(truth), 10):
        block = truth[start : start + 10]
        for item in gps.simulate(block) + imu.simulate(block):
            if item.stamp_ns >= begins_ns:
                yield item


def flight(case: tuple[int, float]) -> dict[str, Any]:
    """One flight."""
    seed, worst = case
    rng, plain = np.random.default_rng([seed, 7]), plain_filter()
    truth = build(standard("demo", kind="segments", mission=mission(rng), duration_s=60.0 + DURATION_S)).table()
    navigator = InsGps(replace(plain, imu=replace(plain.imu, gyro_turn_on_dps=0.1, accel_turn_on_mg=5.0)))
    solutions = navigator.feed_all(heard(seed, worst, truth))
    errors, _ = compare(truth, solutions)
    later = errors.stamps_ns > errors.stamps_ns[0] + round(1e9 * MINUTE_S)
    ratio, size = np.sqrt(errors.nees_horizontal[later]), np.hypot(errors.values[later, 0], errors.values[later, 1])
    attitude = np.abs(errors.values[later][:, ATTITUDE]) / errors.sigmas[later][:, ATTITUDE]
    return {
        "seed": seed,
        "worst": worst,
        "largest_m": float(size.max()),
        "beyond": float(np.mean(ratio > BEYOND)),
        "attitude_beyond": float(np.mean(attitude.max(axis=1) > BEYOND)),
        "attitude_deg": float(np.abs(errors.values[later][:, ATTITUDE]).max()),
        "restarts": dict(navigator.restarts),
        "said": [c.advice for c in navigator.contradictions()],
    }


def measure(options: Any) -> dict[str, Any]:
    """All flights."""
    worst = [float(w) for w in options.worst.split(",")]
    seeds = range(1, (3 if options.quick else options.seeds) + 1)
    rows = run_campaign(flight, list(product(seeds, worst)), options.workers, label="poor IMU")
    for row in rows:
        wrong = "WRONG" if max(row["beyond"], row["attitude_beyond"]) > 0.01 else "     "
        print(wrong, {k: round(v, 3) if isinstance(v, float) else v for k, v in row.items()})
    return {
        f"{w:g} times": {
            "flights": len(own := [row for row in rows if row["worst"] == w]),
            "wrong and sure": sum(max(row["beyond"], row["attitude_beyond"]) > 0.01 for row in own),
            "median largest error, m": float(np.median([row["largest_m"] for row in own])),
            "largest error, m": max(row["largest_m"] for row in own),
            "settings named": sum(any("set it to" in said for said in row["said"]) for row in own),
        }
        for w in worst
    }


if __name__ == "__main__":
    run(
        __doc__ or "", measure, seeds={"type": int, "default": 10}, workers={"type": int, "default": None},
        worst={"default": "1,3,10,30", "help": "times the settings, with commas"},
    )  # fmt: skip
