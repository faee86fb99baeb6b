"""GPS/INS on a real drive with GNSS thinned to 1 Hz: innovations, then the error at the end of many 15 s outages; prints JSON.

A car with a loosely mounted consumer IMU (100 Hz) and an RTK receiver, nine minutes.  It is looked for in
$LOWCOSTNAV_DATA/gnss_imu_road, else in ../shared/data, converted to a bag and read from it as a replay would.  The withheld RTK
fixes are the reference.  Settings are those of config/vehicles/road_car; its white-noise figures stand for vibration and were
chosen on this drive (tuned).
"""

import copy
import dataclasses
import math
import tempfile
from pathlib import Path

import numpy as np
from common import data_folder, rms, run

from lowcostnav_ros.base.measurements import GpsPosition, ImuBlock, Measurement, NavSolution
from lowcostnav_ros.catalogue import config_files
from lowcostnav_ros.convert import convert
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.physics.earth import difference_n

OUTAGE_S = 15.0
FIRST_S, LAST_S = 60.0, 535.0
SOURCES = ("imu/data_raw", "gps/fix", "gps/vel")


def recorded() -> list[Measurement]:
    """The drive as measurements, through the bag that a conversion makes of it."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "drive"
        convert(data_folder("gnss_imu_road"), "convert/road_drive", bag)
        with BagReader(bag) as reader:
            return list(reader.measurements(SOURCES))


def road_car(**changes) -> InsGpsSettings:
    """Settings of the shipped road car, fixes thinned to 1 Hz."""
    settings = config_files.load_settings(InsGpsSettings, config_files.config_dir() / "vehicles" / "road_car" / "ins_gps.yaml", "ins_gps")
    return dataclasses.replace(settings, gps=dataclasses.replace(settings.gps, period_s=1.0), **changes)


def end_of_outage(navigator: InsGps, after: list[Measurement], start_ns: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Horizontal error (2,) and sigma (2,) at the last withheld fix, m; None while the car stands."""
    end_ns = start_ns + round(1e9 * OUTAGE_S)
    fixes = [m for m in after if isinstance(m, GpsPosition) and start_ns <= m.stamp_ns < end_ns]
    solutions: list[NavSolution] = []
    for m in after:
        if m.stamp_ns > end_ns + 1_000_000_000:
            break
        if isinstance(m, ImuBlock) or m.stamp_ns >= end_ns:
            solutions += navigator.feed(m)
    last = fixes[-1]
    solution = max((s for s in solutions if s.stamp_ns <= last.stamp_ns), key=lambda s: s.stamp_ns)
    ahead_s = 1e-9 * (last.stamp_ns - solution.stamp_ns)
    error = difference_n(last.lat, last.lon, last.height, solution.lat, solution.lon, solution.height) - solution.vel_n * ahead_s
    return error[:2], np.sqrt(np.diag(solution.cov_pos)[:2])


def outages(measurements: list[Measurement], settings: InsGpsSettings, step_s: float) -> dict:
    """Error at the end of an outage from every ``step_s`` of the drive."""
    first_ns = measurements[0].stamp_ns
    navigator, todo = InsGps(settings), iter(enumerate(measurements))
    ends, index, following = [], *next(todo)
    for start_s in np.arange(FIRST_S, LAST_S - OUTAGE_S, step_s):
        start_ns = first_ns + round(1e9 * start_s)
        while following.stamp_ns < start_ns:
            navigator.feed(following)
            index, following = next(todo)
        ends.append(end_of_outage(copy.deepcopy(navigator), measurements[index : index + 12_000], start_ns))
    horizontal = np.array([math.hypot(*error) for error, _ in ends])
    return {
        "outages": len(ends),
        "outage_s": OUTAGE_S,
        "median_m": round(float(np.median(horizontal)), 2),
        "p95_m": round(float(np.percentile(horizontal, 95)), 2),
        "max_m": round(float(horizontal.max()), 2),
        "error_over_sigma_rms": round(rms(np.array([error / sigma for error, sigma in ends])), 2),
        "start_s": np.arange(FIRST_S, LAST_S - OUTAGE_S, step_s).tolist(),
        "end_m": [round(float(h), 1) for h in horizontal],
        "end_sigma_m": [round(float(np.hypot(*sigma)), 1) for _, sigma in ends],
    }


def whole_drive(measurements: list[Measurement], settings: InsGpsSettings) -> dict:
    """Innovations with GNSS at 1 Hz all the way."""
    navigator = InsGps(settings)
    nis: dict[str, list[float]] = {"gps_position": [], "gps_velocity": []}
    navigator.on_aid = lambda status: nis[status.name].append(status.nis) if status.name in nis else None
    solutions = navigator.feed_all(measurements)
    rejected = {aid.name: dict(aid.rejected) for aid in navigator.status().aids if aid.rejected}
    nis_over_dof = {name: round(float(np.mean(values)) / 3.0, 2) for name, values in nis.items()}
    return {"nis_over_dof": nis_over_dof, "rejected": rejected, "solutions": len(solutions)}


def measure(options) -> dict:
    """With the wheels as a constraint, and without."""
    measurements = recorded()
    step_s = 30.0 if options.quick else 10.0
    result = {"benchmark": "real_drive", "quick": options.quick}
    settings = road_car()
    for name, chosen in (("wheels", settings), ("free", road_car(wheels=dataclasses.replace(settings.wheels, enabled=False)))):
        result[name] = {**whole_drive(measurements, chosen), **outages(measurements, chosen, step_s)}
    return result


if __name__ == "__main__":
    run(__doc__.splitlines()[0], measure)
