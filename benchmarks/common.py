"""What the benchmark scripts share: arguments, the last line of JSON, simulated flights as arrays."""

import argparse
import json
import os
import platform
import re
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lowcostnav_ros.base.measurements import Measurement, NavSolution
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue import config_files
from lowcostnav_ros.replay.columns import NavColumns, columns_of
from lowcostnav_ros.replay.evaluation import truth_columns
from lowcostnav_ros.replay.metrics import Errors, errors_between
from lowcostnav_ros.simulation.scenario import Scenario, scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

MINUTE_NS = 60_000_000_000


def run(description: str, measure: Callable[[argparse.Namespace], dict[str, Any]], *positional: str, **arguments: dict) -> None:
    """Parse --json and --quick (and ``arguments``: name to add_argument keywords), measure, print the result as the last line."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the result to this file")
    parser.add_argument("--quick", action="store_true", help="fewer runs, for a first look")
    for name in positional:
        parser.add_argument(name)
    for name, keywords in arguments.items():
        parser.add_argument(f"--{name}", **keywords)
    options = parser.parse_args()
    result = {"machine": machine(), **measure(options)}
    text = json.dumps(result)
    if options.json:
        options.json.write_text(text + "\n")
    print(text)


def machine() -> str:
    """Name, processor and cores of this machine, and the Python it runs."""
    cpus = Path("/proc/cpuinfo")
    models = re.findall(r"^model name\s*: (.*)$", cpus.read_text(), re.MULTILINE) if cpus.is_file() else []
    cores = f"{len(os.sched_getaffinity(0))} x {models[0] if models else platform.machine()}"
    return f"{platform.node()}, {cores}, python {platform.python_version()}"


def process(command: Sequence[str]) -> dict[str, float]:
    """Run a program to its end; return CPU and wall time, s, and peak memory, MB, of its whole process.

    Raises
    ------
    SystemExit
        When it fails, with what it said.
    """
    with tempfile.TemporaryFile() as said:
        began = perf_counter()
        child = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT)
        _, status, used = os.wait4(child.pid, 0)
        wall_s = perf_counter() - began
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            said.seek(0)
            raise SystemExit(f"{' '.join(command)} failed:\n{said.read().decode(errors='replace')[-2000:]}")
    return {"cpu_s": round(used.ru_utime + used.ru_stime, 3), "wall_s": round(wall_s, 3), "rss_mb": round(used.ru_maxrss / 1024.0, 1)}


def scenario(name: str, seed: int, **changes: Any) -> Scenario:
    """One of the shipped scenarios with another seed."""
    path = config_files.config_dir() / "scenarios" / f"{name}.yaml"
    return scenario_from_text(path.read_text(), path.name, seed=seed, **changes)


def fly(flight: Scenario) -> tuple[TruthBlock, list[Measurement]]:
    """Fly a scenario: the whole truth and all measurements in order of availability."""
    return Simulation(flight).whole()


def compare(truth: TruthBlock, solutions: list[NavSolution]) -> tuple[Errors, NavColumns]:
    """Errors of solutions against the truth at their stamps (solutions beyond the truth are left out), and the solutions as columns."""
    estimate = columns_of(solutions)
    rows = np.searchsorted(truth.stamps_ns, estimate.stamps_ns)
    inside = (rows < len(truth)) & (truth.stamps_ns[np.minimum(rows, len(truth) - 1)] == estimate.stamps_ns)
    estimate = estimate[inside]
    return errors_between(estimate, truth_columns(truth[rows[inside]])), estimate


def data_folder(name: str) -> Path:
    """Folder of recorded data: in $LOWCOSTNAV_DATA, else in ../shared/data beside the project."""
    root = Path(os.environ.get("LOWCOSTNAV_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")
    if not (root / name).is_dir():
        raise SystemExit(f"{root / name} does not exist; set LOWCOSTNAV_DATA to the folder that holds {name}.")
    return root / name


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
