"""Our replay and any other program on the same flight, in turn, as whole processes: CPU time, wall time, memory and their ratios.

python benchmarks/against.py "KF-GINS {folder}/kf-gins.yaml" --files mine/      a C++ program whose configuration names the exported files
python benchmarks/against.py "python other.py {folder}/imu.csv {folder}/gps.csv" --bag flight

{folder} holds the flight: `imu.txt` (seconds, increments of angle, rad, and of velocity, m/s, FRD) and `gnss.txt` (seconds, latitude
and longitude in degrees, height above the ellipsoid, m, sigmas north, east, down, m), as KF-GINS and its like read them; `imu.csv` and
`gps.csv`, rates and specific force, with a header; and what --files copies there, in which {folder}, {start} and {end} (seconds), {lat},
{lon}, {height} are filled in.
"""

import json
import shlex
import shutil
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np
from common import process, run

from lowcostnav_ros.base.measurements import GpsPosition, ImuBlock
from lowcostnav_ros.messages.bag import BagReader

SCENARIO = """
name: imu_and_gps
description: Turns over hills with an automotive-grade IMU and GPS, never lost
seed: 1
sensors: [imu, gps]
truth:
  kind: jsbsim
  name: turns_then_approach
  rate_hz: 100
  duration_s: 1800.0
  start: {lat_deg: 37.777, lon_deg: -121.5189, height_m: 1200.0, heading_deg: 0.0, airspeed_mps: 52.0}
  wind: {north_mps: -3.0, east_mps: 7.0, variation_sigma_mps: 2.0, variation_tau_s: 400.0, turbulence_sigma_mps: 0.7}
imu: {profile: automotive, rate_hz: 100.0}
gps: {rate_hz: 5.0, latency_s: 0.1}
"""


def simulated(folder: Path, duration_s: float) -> Path:
    """Fly the scenario into a bag."""
    (folder / "imu_and_gps.yaml").write_text(SCENARIO)
    command = [*CLI, "simulate", str(folder / "imu_and_gps.yaml"), "-o", str(folder / "flight"), "--duration", str(duration_s)]
    process(command)
    return folder / "flight"


CLI = [sys.executable, "-m", "lowcostnav_ros.cli.main"]


def export(bag: Path, folder: Path) -> dict[str, float]:
    """Write a recording as text; return where and when it begins."""
    with BagReader(bag) as reader:
        measurements = list(reader.measurements(["imu/data_raw", "gps/fix"]))
    imu = ImuBlock.joined([m for m in measurements if isinstance(m, ImuBlock)])
    fixes = [m for m in measurements if isinstance(m, GpsPosition) and m.has_height]
    midnight_ns = int(imu.stamps_ns[0]) // 86_400_000_000_000 * 86_400_000_000_000  # seconds of the day keep their decimals
    t_s, step_s = 1e-9 * (imu.stamps_ns - midnight_ns), 1e-9 * np.diff(imu.stamps_ns, prepend=2 * imu.stamps_ns[0] - imu.stamps_ns[1])
    increments = imu.angular_rate_b * step_s[:, np.newaxis], imu.specific_force_b * step_s[:, np.newaxis]
    np.savetxt(folder / "imu.txt", np.column_stack([t_s, *increments]), "%.9f" + 6 * " %.12e")
    header = "t_s,rate_x_radps,rate_y_radps,rate_z_radps,force_x_mps2,force_y_mps2,force_z_mps2"
    columns = np.column_stack([t_s, imu.angular_rate_b, imu.specific_force_b])
    np.savetxt(folder / "imu.csv", columns, "%.9f" + 6 * ",%.12e", header=header, comments="")
    rows = [(1e-9 * (m.stamp_ns - midnight_ns), *np.degrees((m.lat, m.lon)), m.height, *np.sqrt(np.diag(m.cov_n))) for m in fixes]
    np.savetxt(folder / "gnss.txt", rows, "%.9f %.11f %.11f" + 4 * " %.4f")
    header = "t_s,lat_deg,lon_deg,height_m,sigma_north_m,sigma_east_m,sigma_down_m"
    np.savetxt(folder / "gps.csv", rows, "%.9f,%.11f,%.11f" + 4 * ",%.4f", header=header, comments="")
    return dict(zip(("start", "lat", "lon", "height"), rows[0][:4], strict=True)) | {"end": float(t_s[-1])}


def fill(source: Path, folder: Path, values: dict[str, str]) -> None:
    """Copy files of the other program, with what they say of the flight filled in."""
    for file in sorted(source.iterdir()):
        text = file.read_text()
        for name, value in values.items():
            text = text.replace(f"{{{name}}}", value)
        (folder / file.name).write_text(text)


def measure(options) -> dict:
    """Run both in turn; medians of each and the ratio, ours to the other's."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        bag = Path(options.bag) if options.bag else simulated(folder, 120.0 if options.quick else 1800.0)
        values = {name: repr(value) for name, value in export(bag, folder).items()} | {"folder": str(folder)}
        if options.files:
            fill(Path(options.files), folder, values)
        theirs = [word.format(**values) for word in shlex.split(options.command)]
        ours = [*CLI, "replay", str(bag), "--navigators", options.navigators, "--out", str(folder / "result")]
        process(ours)  # compiles the kernels, or finds them compiled
        runs: dict[str, list[dict]] = {"ours": [], "other": []}
        for _ in range(int(options.rounds)):
            shutil.rmtree(folder / "result", ignore_errors=True)
            for name, command in (("ours", ours), ("other", theirs)):
                runs[name].append(process(command))
        span_s = json.loads((folder / "result" / "summary.json").read_text())["duration_s"]
    found = {name: {key: statistics.median(one[key] for one in of) for key in of[0]} for name, of in runs.items()}
    ratios = {key: round(value / max(found["other"][key], 1e-9), 3) for key, value in found["ours"].items()}
    return {"flight_s": round(span_s, 1), "navigators": options.navigators, "rounds": int(options.rounds), **found, "ratio": ratios}


if __name__ == "__main__":
    texts = {
        "bag": "recording to fly (default: a simulated half hour, IMU at 100 Hz and GPS at 5 Hz)",
        "files": "folder of files that the other program needs",
    }
    optional = {name: {"default": "", "help": text, "metavar": "PATH"} for name, text in texts.items()}
    further = {"navigators": {"default": "ins_gps", "help": "of ours"}, "rounds": {"default": 3, "help": "runs of each", "type": int}}
    run(__doc__.splitlines()[0], measure, "command", **optional, **further)
