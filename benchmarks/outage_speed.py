"""How long a study of outages takes: a ten-minute flight that loses GPS 40 times for 60 s, reading, start of the processes included.

The flight is the demonstration's with GPS all the way, IMU at 100 Hz, simulated into a bag.  CPU time is that of all processes.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from common import run

from lowcostnav_ros.catalogue import config_files

OUTAGES, LENGTH_S, FLIGHT_S, AFTER_S = 40, 60.0, 600.0, 20.0
SETS = ("ins_gps", "ahrs,dead_reckoning", "ahrs,dead_reckoning,ins_gps,supervisor")


def lowcostnav(*arguments: str) -> tuple[float, float]:
    """Run the command; return wall and CPU time, s."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, "-m", "lowcostnav_ros.cli.main", *arguments], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.perf_counter() - began, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(options) -> dict:
    """Time each set of navigators."""
    every_s = (FLIGHT_S - AFTER_S - LENGTH_S - 1.0) / (OUTAGES - 1)
    plan = ["--length", f"{LENGTH_S:g}", "--every", f"{every_s:.3f}", "--after", f"{AFTER_S:g}"]
    found = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = (config_files.config_dir() / "scenarios" / "livermore.yaml").read_text()
        (folder / "flight.yaml").write_text(text.replace(", outages_s: [[180.0, 540.0]]", ""))
        bag = str(folder / "flight")
        lowcostnav("simulate", str(folder / "flight.yaml"), "-o", bag, "--duration", f"{FLIGHT_S:g}")
        for navigators in SETS[:1] if options.quick else SETS:
            lowcostnav("outages", bag, "--navigators", navigators, "--length", "10", "--until", "95")  # compiles what is not yet
            wall_s, cpu_s = lowcostnav("outages", bag, "--navigators", navigators, *plan, "--out", str(folder / "out"))
            flown = json.loads((folder / "out" / "outages.json").read_text())["flown"]
            windows = {one["navigator"]: one["statistics"][0]["windows"] for one in flown}
            found[navigators] = {"windows": windows, "wall_s": round(wall_s, 1), "cpu_s": round(cpu_s, 1)}
    return {"flight_s": FLIGHT_S, "length_s": LENGTH_S, "studies": found}


if __name__ == "__main__":
    run(__doc__.splitlines()[0], measure)
