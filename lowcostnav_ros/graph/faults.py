"""Faults flown live: the flight with a fault as a recording, played to the navigators over the middleware, recorded and replayed."""

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.base.modes import Level
from lowcostnav_ros.base.tables import Column, Table, number
from lowcostnav_ros.graph.description import Graph, GraphError, parse_graph
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
from lowcostnav_ros.simulation.fault import FAULTS, Arrived, Fault, inject
from lowcostnav_ros.simulation.truth_states import TruthStates
from lowcostnav_ros.studies.faults.flight import CHAIN, Flight, flight, navigator
from lowcostnav_ros.studies.faults.judge import EXCESS

NAVIGATORS = ("ahrs", "ins_gps", "dead_reckoning", "supervisor")
LONGEST_S = 600.0
DOZEN = (
    *("gps_stuck", "gps_spoofed_2_mps", "gps_fix_rank_one_once", "gps_clock_plus_1_s", "gps_vel_ned_for_enu", "imu_gyro_spike_large"),
    *("imu_dropped", "imu_stamp_9_s_ahead_in_outage", "mag_turned_90", "pitot_emptied", "static_stuck", "dme_wrong_station_in_outage"),
)
"""Flown where none is named."""


@dataclass(frozen=True, slots=True)
class Live:
    """What one navigator made of a fault in a live graph.

    Attributes
    ----------
    named_s, sentence
        When diagnostics first named the faulty source, seconds from the start of the fault, and how.
    level : Level
        Worst of the navigator after the start of the fault.
    solutions, equal
        Fused solutions recorded, and whether a replay gives the same bits.
    worst_m : float or None
        Largest horizontal error of the flight.
    """

    fault: str
    navigator: str
    named_s: float | None
    sentence: str
    level: Level
    solutions: int
    equal: bool | None
    worst_m: float | None


class _Listener:
    """Hears on the diagnostics what the navigators say from the start of the fault on."""

    def __init__(self, runner: GraphRunner, fault: Fault) -> None:
        self._runner, self._fault = runner, fault
        self._before: dict[str, int] = {}
        self._sources = {name: {f"aid {aid.status.name}": aid.source for aid in navigator(name).aids} for name in NAVIGATORS}
        self.named: dict[str, tuple[float, str]] = {}
        self.levels = dict.fromkeys(NAVIGATORS, Level.OK)

    def __call__(self) -> None:
        source = self._runner.rows.get("player: source", {})
        since_s = float(source.get("values", {}).get("flown_s", 0.0)) - self._fault.start_s
        for name, row in list(self._runner.rows.items()):
            node, _, what = name.partition(": ")
            if node not in NAVIGATORS:
                continue
            refused = {f"{source} {phrase}": count for source, phrase, count in self._refused(node, what, row)}
            if since_s <= 0.0:
                self._before |= {f"{node} {words}": count for words, count in refused.items()}
                continue
            level = Level(min(int(row["level"]), Level.ERROR))
            if what == "navigator":
                self.levels[node] = max(self.levels[node], level)
            more = [words for words, count in refused.items() if count > self._before.get(f"{node} {words}", 0) + EXCESS]
            reports = [*([f"{what}: {row['message']}"] if level > Level.OK else []), *more]
            found = next((words for words in reports if any(source in words for source in self._fault.sources)), "")
            if found and node not in self.named:
                self.named[node] = since_s, found

    def _refused(self, node: str, what: str, row: Mapping[str, Any]) -> Iterator[tuple[str, str, int]]:
        """Source, phrase and count of what a row of a navigator has refused so far."""
        for key, count in row["values"].items():
            if key.startswith("rejected["):
                words = key.removeprefix("rejected[").removesuffix("]")
                source, _, phrase = words.partition(": ") if what == "navigator" else (self._sources[node].get(what, ""), "", words)
                yield source, phrase, int(count)


def fly_live(name: str, out: Path, seed: int = 1, factor: float = 8.0, until_s: float = 1e6) -> list[Live]:
    """Fly one fault over the middleware; return what became of each navigator.

    Parameters
    ----------
    name : str
        In :data:`FAULTS`.
    out : Path
        Folder of the recordings and logs, replaced.
    seed : int
    factor : float
        Seconds of flight per second.
    until_s : float
        End of the flight.

    Raises
    ------
    GraphError
        When a node cannot run, or the flight does not end.
    """
    fault, sound = FAULTS[name], flight(seed)
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    write_recording(out / "flight", sound, inject(sound.arrived, fault, seed), until_s)
    with GraphRunner(graph_of(out / "flight", fault, factor), out=out, log_dir=out / "logs") as runner:
        listener = _Listener(runner, fault)
        finished = runner.wait_until_finished(LONGEST_S, each=listener)
    if not finished:
        raise GraphError(f"{name}: the flight did not end within {LONGEST_S:.0f} s; the logs are in {out / 'logs'}.")
    result = replay_bag(out / "recording", ReplayOptions(navigators=NAVIGATORS))
    rows = []
    for flown, found in result.navigators.items():
        named_s, sentence = listener.named.get(flown, (None, ""))
        errors = found.errors.flight and found.errors.flight.horizontal_m
        fused = found.fused.count_recorded, found.fused.equals_recorded
        rows.append(Live(name, flown, named_s, sentence, listener.levels[flown], *fused, errors.max if errors else None))
    return rows


def graph_of(recording: Path, fault: Fault, factor: float) -> Graph:
    """The graph that a recording with a fault is played to."""
    nodes = [{"executable": n, "parameters": {**CHAIN[n][1], "output.rate_hz": 5.0}} for n in NAVIGATORS]
    topics = ["truth/origin", "truth/odometry", *_sensed(recording)]
    player = {"executable": "player", "parameters": {"path": str(recording), "topics": topics}}
    return parse_graph({"lossless": True, "real_time_factor": factor, "nodes": [player, *nodes, "recorder"]}, f"fault_{fault.name}")


def _sensed(recording: Path) -> list[str]:
    with BagReader(recording) as bag:
        return [name for name in bag.types if not name.startswith("truth/")]


def write_recording(path: Path, sound: Flight, arrived: Sequence[Arrived], until_s: float = 1e6) -> None:
    """Write a flight with a fault as a recording, each message at its arrival, with the true states."""
    records = [record for a in arrived for record in _records(a)]
    states = TruthStates()
    for block in sound.truth:
        for row, stamp_ns in enumerate(block.stamps_ns.tolist()):
            for topic, message in (*states.begin(block), *states.at(block, row)):
                records.append((stamp_ns, topic, message.__msgtype__, to_cdr(message)))
    end_ns = sound.start_ns + round(1e9 * until_s)
    with BagWriter(path) as writer:
        for at_ns, topic, msgtype, raw in sorted(records, key=lambda record: record[0]):
            if at_ns <= end_ns:
                writer.write(topic, msgtype, at_ns, raw)


def _records(arrived: Arrived) -> list[tuple[int, str, str, bytes]]:
    """The messages of a measurement; samples of a block arrive one after the other."""
    measurement = arrived.measurement
    before = measurement.stamps_ns - measurement.stamp_ns if isinstance(measurement, ImuBlock) else [0]
    return [(arrived.at_ns + int(b), *r[1:]) for b, r in zip(before, encode_cdr(measurement), strict=True)]


def live_table(rows: Sequence[Live]) -> Table:
    """One line for each fault and navigator."""
    columns = (
        Column("fault", lambda r: r.fault, left=True),
        Column("navigator", lambda r: r.navigator, left=True),
        Column("solutions", lambda r: str(r.solutions)),
        Column("replay equal", lambda r: {True: "yes", False: "NO", None: "-"}[r.equal], short="replay\nequal"),
        Column("worst error", lambda r: number(r.worst_m), "m", short="worst"),
        Column("level", lambda r: r.level.name),
        Column("named after", lambda r: number(r.named_s), "s", short="named"),
        Column("reported", lambda r: r.sentence, left=True),
    )
    return Table.of("Live", columns, rows)


def study_live(names: Sequence[str], out: Path, seed: int, on_fault: Callable[[str], None] = lambda _: None) -> list[Live]:
    """Fly several, one after the other; each in a folder of its name."""
    rows = []
    for name in names:
        on_fault(name)
        rows += fly_live(name, out / name, seed)
    return rows
