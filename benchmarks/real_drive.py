"""GPS/INS on a real drive with GNSS thinned to 1 Hz: innovations, then the error at the end of many 15 s outages; prints JSON.

A car with a loosely mounted consumer IMU (100 Hz) and an RTK receiver, nine minutes.  It is looked for in
$LOWCOSTNAV_DATA/gnss_imu_road, else in ../shared/data, converted to a bag and read from it as a replay would.  The withheld RTK
fixes are the reference.  Settings are those of config/vehicles/road_car; its white-noise figures stand for vibration and were
chosen on this drive (tuned).
"""

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
from common import data_folder, run

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.catalogue import config_files
from lowcostnav_ros.convert import convert
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.studies.outages.result import statistics_of
from lowcostnav_ros.studies.outages.study import Plan, stream_outages

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


def outages(measurements: list[Measurement], settings: InsGpsSettings, step_s: float) -> dict:
    """Error at the end of an outage from every ``step_s`` of the drive."""
    plan = Plan((OUTAGE_S,), step_s, FIRST_S, LAST_S)
    found = stream_outages(measurements, {"ins_gps": InsGps(settings)}, plan, ("gps/fix", "gps/vel"))["ins_gps"]
    summed = statistics_of(found, OUTAGE_S)
    ends = [outage.ends[0] for outage in found]
    return {
        "outages": summed.windows,
        "outage_s": OUTAGE_S,
        "median_m": round(summed.median_m, 2),
        "p95_m": round(summed.p95_m, 2),
        "max_m": round(summed.max_m, 2),
        "error_over_sigma_rms": round(summed.error_over_sigma_rms, 2),
        "start_s": [round(outage.after_s, 3) for outage in found],
        "end_m": [round(end.horizontal_m, 1) for end in ends],
        "end_sigma_m": [round(end.sigma_m, 1) for end in ends],
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
