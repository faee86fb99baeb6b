"""The demonstration: a whole mission through all nodes over Fast DDS, then its tables, its report and the proof by replay."""

import dataclasses
import json
import shutil
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from lowcostnav_ros.cli.replay import progress_bar, result_console
from lowcostnav_ros.graph.description import Graph, GraphError, load_graph
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
from lowcostnav_ros.replay.tables import print_summary
from lowcostnav_ros.report.flight.page import write_page

LONGEST_S = 900.0
DRAW_S = 0.5


def demonstrate(graph_name: str = "demo", out: Path = Path("out/demo"), real_time_factor: float | None = None) -> int:
    """Fly, replay, report.

    Parameters
    ----------
    graph_name : str
        A lossless graph with a source and a recorder.
    out : Path
        Folder of the results; what an earlier demonstration left in it is replaced.
    real_time_factor : float, optional
        Simulated seconds per second, the graph's own where None.

    Returns
    -------
    int
        0 when nothing was lost and the replay equals the flight to the bit, 1 when not, 2 when the mission cannot be flown.
    """
    try:
        graph = load_graph(graph_name)
        if real_time_factor:
            graph = dataclasses.replace(graph, real_time_factor=real_time_factor)
        return _demonstrate(graph, _emptied(out), result_console())
    except GraphError as error:
        print(error, file=sys.stderr)
        return 2


def _emptied(out: Path) -> Path:
    """An empty result folder; only what an earlier demonstration left is removed."""
    for name in ("recording", "replay", "logs"):
        shutil.rmtree(out / name, ignore_errors=True)
    out.mkdir(parents=True, exist_ok=True)
    return out


def _demonstrate(graph: Graph, out: Path, console: Console) -> int:
    console.rule(f"1  Fly {graph.scenario}: {len(graph.nodes)} processes over Fast DDS, {graph.real_time_factor:g} x real time")
    counts, events = _fly(graph, out, console)
    lost = _print_counts(counts, console)
    for event in events:
        console.print(f"[yellow]{event}[/]")
    console.rule("2  Replay the recording through the same navigators, without middleware")
    with progress_bar("replay") as advance:
        flown = tuple(node.executable for node in graph.nodes if node.executable in NAVIGATORS)
        options = ReplayOptions(navigators=flown, out=out / "replay", on_progress=advance)
        summary = replay_bag(out / "recording", options).summary
    (out / "replay" / "summary.json").write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    print_summary(summary, console)
    console.rule("3  What came of it")
    write_page(out / "replay", out / "report.html", f"Demonstration: {graph.scenario}")
    equal = _print_equality(summary, console)
    console.print(f"Report: {out / 'report.html'}   recording: {out / 'recording'}", highlight=False)
    return 0 if equal and not lost and not events else 1


def _fly(graph: Graph, out: Path, console: Console) -> tuple[dict[str, dict[str, int]], list[str]]:
    """Fly the graph to its end; return messages per topic and what happened to nodes on the way."""
    began = time.monotonic()
    with GraphRunner(graph, out=out, log_dir=out / "logs", say=lambda sentence: console.print(f"[yellow]{sentence}[/]")) as runner:
        finished = runner.wait_until_finished(LONGEST_S, each=_Narrator(runner, console))
    counts, events = runner.counts(), list(runner.events)  # after the end: every node says its last counts as it goes
    if not finished:
        raise GraphError(f"The flight did not end within {LONGEST_S:.0f} s; the logs are in {out / 'logs'}.")
    console.print(f"Flown and landed in the recording after {time.monotonic() - began:.0f} s.", highlight=False)
    return counts, events


class _Narrator:
    """Say what the supervisor does while the mission flies."""

    def __init__(self, runner: GraphRunner, console: Console) -> None:
        self._runner, self._console = runner, console
        self._said, self._next = ("", ""), 0.0

    def __call__(self) -> None:
        if time.monotonic() < self._next:
            return
        self._next = time.monotonic() + DRAW_S
        source = self._runner.rows.get("truth_source: source", {})
        flown = float(source.get("values", {}).get("flown_s", 0.0))
        sentence = self._runner.navigator("supervisor").get("message", "")
        chosen = (sentence.partition(":")[0], sentence.partition("flying on ")[2].partition(" ")[0])  # mode, and on whom
        if sentence and chosen != self._said:
            self._said = chosen
            self._console.print(f"  {flown / 60.0:4.1f} min  {sentence}", highlight=False)


def _print_counts(counts: Mapping[str, Mapping[str, int]], console: Console) -> int:
    """Print messages published against received per topic; return how many were lost."""
    table = Table(title="Messages", title_justify="left")
    for head, justify in (("topic", "left"), ("published", "right"), ("received by", "left"), ("lost", "right")):
        table.add_column(head, justify=justify)
    total = 0
    for topic, entry in sorted(counts.items()):
        listeners = {node: count for node, count in entry.items() if node != "sent"}
        if topic in ("clock", "diagnostics") or not listeners or not entry["sent"]:
            continue
        missing = sum(max(entry["sent"] - count, 0) for count in listeners.values())
        total += missing
        heard = ", ".join(node if count >= entry["sent"] else f"{node} {count}" for node, count in listeners.items())
        table.add_row(topic, str(entry["sent"]), heard, str(missing) if missing else "-")
    console.print(table)
    console.print("Nothing was lost." if not total else f"[red]{total} messages were lost.[/]")
    return total


def _print_equality(summary: Mapping[str, Any], console: Console) -> bool:
    """Say, per navigator, whether the replayed fused solution is the one flown; return whether all are."""
    all_equal = True
    for name, entry in summary["navigators"].items():
        fused = entry["fused"]
        equal = bool(fused["equals_recorded"])
        all_equal &= equal
        if equal:
            verdict = f"[green]replay equals flight, bit for bit[/] ({fused['count_equal']} solutions, sha256 {fused['sha256'][:16]})"
        else:
            at = fused["first_differing_stamp_s"]
            where = f", first at {at - summary['first_stamp_s']:.1f} s" if at else ""
            verdict = f"[red]replay differs from flight[/]: {fused['count_differing']} differ, {fused['count_missing']} missing{where}"
        console.print(f"  {name:15} {verdict}", highlight=False)
    return all_equal
