"""The simulate job: a scenario flown offline, recorded as the nodes would have published it."""

import argparse
import dataclasses
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import yaml

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.catalogue.config_files import config_dir, find_config
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.catalogue.imu_by_name import profile_settings
from lowcostnav_ros.cli.replay import progress_bar
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.bag import SETTINGS_FOLDER, BagWriter
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.simulation.scenario import Scenario, scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

TRUTH_RATE_HZ = 20.0

Record = tuple[int, str, str, bytes]


def simulate(arguments: argparse.Namespace) -> int:
    """Fly a scenario and write the bag, with the settings a navigator needs to know its IMU by."""
    if arguments.duration is not None and not arguments.duration > 0.0:
        raise SettingsError(f"--duration must be positive, got {arguments.duration:g}.")
    scenario = load_scenario(arguments.scenario, arguments.seed)
    settings = navigator_settings(scenario)  # first: what cannot be used is better refused before the flight than after
    counts = write_bag(scenario, arguments.output, arguments.storage, arguments.duration)
    _write_settings(settings, Path(arguments.output) / SETTINGS_FOLDER)
    for topic, count in sorted(counts.items()):
        print(f"{topic:24} {count:8d}")
    print(f"flight '{scenario.name}' (seed {scenario.seed}) in {arguments.output}")
    return 0


def load_scenario(name: str, seed: int | None = None) -> Scenario:
    """Read a scenario by the name of a shipped one or by path.

    Raises
    ------
    SettingsError
        When there is none, or it holds what cannot be used.
    """
    is_path = "/" in name or name.endswith((".yaml", ".yml"))
    path = find_config(name if is_path else config_dir() / "scenarios" / f"{name}.yaml")
    changes = {} if seed is None else {"seed": seed}
    return scenario_from_text(path.read_text(encoding="utf-8"), str(path), **changes)


def write_bag(scenario: Scenario, output: str, storage: str = "mcap", duration_s: float | None = None) -> dict[str, int]:
    """Fly a scenario into a bag; print notes on its equipment, return the number of messages by topic.

    Every message is recorded at its stamp, truth at 20 Hz as the live truth source publishes it.

    Parameters
    ----------
    scenario : Scenario
    output : str
        Bag to create.
    storage : str
        ``mcap`` or ``sqlite3``.
    duration_s : float, optional
        Stop after this many seconds instead of flying the scenario to its end.
    """
    simulation = Simulation(scenario)
    planned_s = duration_s or scenario.truth.duration_s
    with BagWriter(output, storage) as writer, progress_bar("simulate") as advance:
        for flown_s, records in _flown(simulation.blocks(), duration_s):
            for stamp_ns, topic, msgtype, raw in records:
                writer.write(topic, msgtype, stamp_ns, raw)
            if advance is not None and planned_s:
                advance(min(1.0, flown_s / planned_s))
        counts = dict(writer.counts)
    for note in simulation.notes:
        print(note)
    return counts


def navigator_settings(scenario: Scenario) -> dict[str, str]:
    """Return settings files (navigator to YAML text) for a replay of a scenario: the numbers of the IMU it flies with.

    Empty where there is no IMU aboard, or one without errors, which leaves a filter nothing to know.
    """
    if "imu" not in scenario.sensors or not load_imu_profile(scenario.imu.profile).has_noise:
        return {}
    from lowcostnav_ros.cores.imu_errors import ImuSettings
    from lowcostnav_ros.navigators.registry import NAVIGATORS

    numbers = dataclasses.asdict(profile_settings(scenario.imu.profile, scenario.imu.turn_on_bias))
    del numbers["profile"]
    head = f"# The IMU of scenario {scenario.name}: profile {scenario.imu.profile}. Every other parameter keeps its default.\n"
    text = head + yaml.safe_dump({"/**": {"ros__parameters": {"imu": numbers}}}, sort_keys=False)
    return {name: text for name, (settings, _) in NAVIGATORS.items() if isinstance(getattr(settings(), "imu", None), ImuSettings)}


def _write_settings(files: dict[str, str], folder: Path) -> None:
    for name, text in files.items():
        folder.mkdir(exist_ok=True)
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")


def _flown(blocks: Iterable[tuple[TruthBlock, list[Measurement]]], duration_s: float | None) -> Iterator[tuple[float, list[Record]]]:
    """Records of each block in order of stamps, with the seconds flown."""
    origin: LocalFrame | None = None
    first_ns, due_ns = 0, 0
    for truth, measurements in blocks:
        records: list[Record] = []
        if origin is None:
            first_ns = due_ns = int(truth.stamps_ns[0])
            origin = LocalFrame(float(truth.lat[0]), float(truth.lon[0]), float(truth.height[0]))
            records.append((first_ns, "truth/origin", topics.NAV_SAT_FIX, to_cdr(encode.origin_fix(first_ns, origin))))
        rows, due_ns = _due(truth.stamps_ns, due_ns)
        records += [record for row in rows for record in _truth_records(truth, row, origin)]
        records += [record for m in measurements for record in encode.encode_cdr(m)]
        end_ns = first_ns + round(1e9 * duration_s) if duration_s else None
        kept = [r for r in records if end_ns is None or r[0] <= end_ns]
        yield (int(truth.stamps_ns[-1]) - first_ns) / 1e9, sorted(kept, key=lambda r: r[0])
        if end_ns is not None and truth.stamps_ns[-1] >= end_ns:
            return


def _due(stamps_ns: np.ndarray, due_ns: int) -> tuple[list[int], int]:
    """Rows at which truth is due, and when it is due next."""
    period_ns = round(1e9 / TRUTH_RATE_HZ)
    rows = []
    for row, stamp in enumerate(stamps_ns.tolist()):
        if stamp >= due_ns:
            rows.append(row)
            due_ns += period_ns * (1 + (stamp - due_ns) // period_ns)
    return rows, due_ns


def _truth_records(truth: TruthBlock, row: int, origin: LocalFrame) -> Iterator[Record]:
    stamp = int(truth.stamps_ns[row])
    yield stamp, "truth/odometry", topics.ODOMETRY, to_cdr(encode.truth_odometry(truth, row, origin))
    yield stamp, "truth/wind", topics.TWIST, to_cdr(encode.truth_wind(truth, row))
