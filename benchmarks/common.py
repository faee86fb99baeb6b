"""What the benchmark scripts share: arguments, the last line of JSON, simulated flights as arrays."""

import argparse
import json
import os
import platform
from collections.abc import Callable
from pathlib import Path
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


def run(description: str, measure: Callable[[argparse.Namespace], dict[str, Any]], **arguments: dict) -> None:
    """Parse --json and --quick (and ``arguments``: name to add_argument keywords), measure, print the result as the last line."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the result to this file")
    parser.add_argument("--quick", action="store_true", help="fewer runs, for a first look")
    for name, keywords in arguments.items():
        parser.add_argument(f"--{name}", **keywords)
    options = parser.parse_args()
    result = {"machine": f"{platform.machine()} python {platform.python_version()}", **measure(options)}
    text = json.dumps(result)
    if options.json:
        options.json.write_text(text + "\n")
    print(text)


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
