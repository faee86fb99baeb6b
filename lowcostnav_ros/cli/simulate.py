"""The simulate job: a scenario flown offline, recorded as the nodes would have published it."""

import argparse
import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from lowcostnav_ros.base.measurements import Measurement
from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.progress import progress_bar

if TYPE_CHECKING:  # what works is imported by those that work: the options show at once
    from lowcostnav_ros.messages.encode import Record
    from lowcostnav_ros.simulation.scenario import Scenario


def add_arguments(simulate: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    from lowcostnav_ros.cli.list import names_of

    simulate.add_argument("scenario", help=f"a scenario ({names_of('scenarios')}), or a YAML file")
    simulate.add_argument("-o", "--output", required=True, metavar="BAG", help="bag to create")
    simulate.add_argument("--seed", type=int, help="seed instead of the scenario's")
    simulate.add_argument("--duration", type=float, metavar="S", help="seconds to fly instead of the scenario's")
    simulate.add_argument("--storage", choices=("mcap", "sqlite3"), default="mcap", help="storage of the bag (default: mcap)")


EXAMPLE = "example: lowcostnav simulate livermore -o flight"


@job("Fly a scenario offline and record truth and sensors as the nodes would publish them.", add_arguments, EXAMPLE)
def simulate(arguments: argparse.Namespace) -> int:
    """Fly a scenario and write the bag, with the settings a navigator needs to know its IMU by."""
    from lowcostnav_ros.simulation.scenario import load_scenario

    if arguments.duration is not None and not arguments.duration > 0.0:
        raise SettingsError(f"--duration must be positive, got {arguments.duration:g}.")
    scenario = load_scenario(arguments.scenario, arguments.seed)
    settings = navigator_settings(scenario)  # first: what cannot be used is better refused before the flight than after
    counts = write_bag(scenario, arguments.output, arguments.storage, arguments.duration, settings)
    for topic, count in sorted(counts.items()):
        print(f"{topic:24} {count:8d}")
    print(f"flight '{scenario.name}' (seed {scenario.seed}) in {arguments.output}")
    return 0


def write_bag(
    scenario: "Scenario", output: str, storage: str = "mcap", duration_s: float | None = None, settings: Mapping[str, str] | None = None
) -> dict[str, int]:
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
    settings : mapping of navigator to YAML text, optional
        Settings that the recording carries.
    """
    from lowcostnav_ros.messages.bag_writer import SETTINGS_FOLDER, new_bag
    from lowcostnav_ros.simulation.simulator import Simulation

    simulation = Simulation(scenario)
    planned_s = duration_s or scenario.truth.duration_s
    with new_bag(output, storage) as writer, progress_bar("simulate") as advance:
        for flown_s, records in _flown(simulation.blocks(), duration_s):
            for stamp_ns, topic, msgtype, raw in records:
                writer.write(topic, msgtype, stamp_ns, raw)
            if advance is not None and planned_s:
                advance(min(1.0, flown_s / planned_s))
        _write_settings(settings or {}, writer.path / SETTINGS_FOLDER)
        counts = dict(writer.counts)
    for note in simulation.notes:
        print(note)
    return counts


def navigator_settings(scenario: "Scenario") -> dict[str, str]:
    """Return settings files (navigator to YAML text) for a replay of a scenario: the numbers of the IMU it flies with.

    Empty where there is no IMU aboard, or one without errors, which leaves a filter nothing to know.
    """
    from lowcostnav_ros.catalogue.equipment import load_imu_profile
    from lowcostnav_ros.catalogue.imu_by_name import profile_settings
    from lowcostnav_ros.cores.imu_errors import ImuSettings
    from lowcostnav_ros.navigators.registry import NAVIGATORS


    imu = getattr(scenario, "imu", None)
    if imu is None or "imu" not in scenario.sensors or not load_imu_profile(imu.profile).has_noise:
        return {}
    numbers = dataclasses.asdict(profile_settings(imu.profile, imu.turn_on_bias))
    del numbers["profile"]
    head = f"# The IMU of scenario {scenario.name}: profile {imu.profile}. Every other parameter keeps its default.\n"
    text = head + yaml.safe_dump({"/**": {"ros__parameters": {"imu": numbers}}}, sort_keys=False)
    navigators: Mapping[str, Any] = NAVIGATORS
    return {name: text for name, kind in navigators.items() if isinstance(getattr(kind.Settings(), "imu", None), ImuSettings)}


def _write_settings(files: Mapping[str, str], folder: Path) -> None:
    for name, text in files.items():
        folder.mkdir(exist_ok=True)
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")


def _flown(blocks: Iterable[tuple[TruthBlock, list[Measurement]]], duration_s: float | None) -> "Iterator[tuple[float, list[Record]]]":
    """Records of each block in order of stamps, with the seconds flown."""
    from lowcostnav_ros.messages import encode
    from lowcostnav_ros.messages.store import to_cdr
    from lowcostnav_ros.simulation.truth_states import TruthStates

    states, first_ns = TruthStates(), None
    for truth, measurements in blocks:
        first_ns = int(truth.stamps_ns[0]) if first_ns is None else first_ns
        stamps = [first_ns, *truth.stamps_ns.tolist()]
        sent = [states.begin(truth), *(states.at(truth, row) for row in range(len(truth)))]
        records = [(t, topic, m.__msgtype__, to_cdr(m)) for t, messages in zip(stamps, sent, strict=True) for topic, m in messages]
        records += [record for m in measurements for record in encode.encode_cdr(m)]
        end_ns = first_ns + round(1e9 * duration_s) if duration_s else None
        kept = [r for r in records if end_ns is None or r[0] <= end_ns]
        yield (int(truth.stamps_ns[-1]) - first_ns) / 1e9, sorted(kept, key=lambda r: r[0])
        if end_ns is not None and truth.stamps_ns[-1] >= end_ns:
            return
