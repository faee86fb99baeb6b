"""The demonstration: a whole mission through all nodes over Fast DDS, then its tables, its report and the proof by replay."""

import argparse
import dataclasses
import json
import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.base.tables import Table
from lowcostnav_ros.base.text import numeric
from lowcostnav_ros.cli.jobs import job
from lowcostnav_ros.cli.options import check_folder
from lowcostnav_ros.cli.progress import progress_bar
from lowcostnav_ros.graph.description import Graph, GraphError, graph_names, load_graph
from lowcostnav_ros.graph.process import Event
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.graph.up import once_shown
from lowcostnav_ros.graph.wiring import with_page
from lowcostnav_ros.navigators.registry import NAVIGATORS

if TYPE_CHECKING:  # the flight starts at once; what comes after it is imported after it
    from rich.console import Console

    from lowcostnav_ros.replay.result import ReplayResult

LONGEST_S = 900.0
DRAW_S = 0.5


def add_arguments(demo: argparse.ArgumentParser) -> None:
    """Add the options of the job."""
    demo.add_argument("--out", default="out/demo", metavar="DIR", help="folder of the results, replaced (default: out/demo)")
    demo.add_argument("--graph", default="demo", metavar="GRAPH", help="lossless graph to fly, with a recorder (default: demo)")
    demo.add_argument("--real-time-factor", type=float, metavar="X", help="simulated seconds per second (default: the graph's)")


EXAMPLE = "example: lowcostnav demo --out out/demo"


@job("Fly a simulated mission with a GPS outage and write its report.", add_arguments, EXAMPLE)
def demo(arguments: argparse.Namespace) -> int:
    """Fly, replay, report; 0 when nothing was lost and the replay equals the flight to the bit, else 1."""
    from lowcostnav_ros.report.terminal import result_console

    graph = load_graph(arguments.graph)
    if not graph.lossless:
        names = ", ".join(name for name in graph_names() if load_graph(name).lossless)
        raise GraphError(f"--graph: {graph.name} may lose messages, so its replay need not equal it; lossless graphs: {names}.")
    check_folder(arguments.out)
    if arguments.real_time_factor:
        graph = dataclasses.replace(graph, real_time_factor=arguments.real_time_factor)
    return _demonstrate(with_page(graph), _emptied(Path(arguments.out)), result_console())


def _emptied(out: Path) -> Path:
    """An empty result folder; only what an earlier demonstration left is removed."""
    for name in ("recording", "replay", "logs"):
        shutil.rmtree(out / name, ignore_errors=True)
    out.mkdir(parents=True, exist_ok=True)
    return out


def _demonstrate(graph: Graph, out: Path, console: "Console") -> int:
    console.rule(f"1  Fly {graph.scenario}: {len(graph.nodes)} processes over Fast DDS, {graph.real_time_factor:g} x real time")
    counts, events = _fly(graph, out, console)
    lost = _print_counts(counts, console)
    for event in events:
        console.print(f"[yellow]{event}[/]")
    from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
    from lowcostnav_ros.report.flight.page import write_page
    from lowcostnav_ros.report.terminal import print_result

    console.rule("2  Replay the recording through the same navigators, without middleware")
    with progress_bar("replay") as advance:
        flown = tuple(node.executable for node in graph.nodes if node.executable in NAVIGATORS)
        options = ReplayOptions(navigators=flown, out=out / "replay", on_progress=advance)
        result = replay_bag(out / "recording", options)
    text = json.dumps(result.to_mapping(), indent=1, allow_nan=False)
    (out / "replay" / "summary.json").write_text(text + "\n", encoding="utf-8")
    print_result(result, console)
    console.rule("3  Results")
    write_page(out / "replay", out / "report.html", f"Demonstration: {graph.scenario}")
    equal = _print_equality(result, console)
    console.print(f"Report: {out / 'report.html'}   recording: {out / 'recording'}", highlight=False)
    return Exit.OK if equal and not lost and not events else Exit.WORSE


def _fly(graph: Graph, out: Path, console: "Console") -> tuple[dict[str, dict[str, int]], list[Event]]:
    """Fly the graph to its end; return messages per topic and what happened to nodes on the way."""
    began = time.monotonic()
    with GraphRunner(graph, out=out, log_dir=out / "logs", on_event=lambda event: console.print(f"[yellow]{event}[/]")) as runner:
        finished = runner.wait_until_finished(LONGEST_S, each=_Narrator(runner, console))
    counts, events = runner.counts(), list(runner.events)  # after the end: every node publishes its last counts when it shuts down
    if not finished:
        raise GraphError(f"The flight did not end within {LONGEST_S:.0f} s; the logs are in {out / 'logs'}.")
    console.print(f"Flight recorded after {time.monotonic() - began:.0f} s.", highlight=False)
    return counts, events


class _Narrator:
    """Print what the supervisor does while the mission flies."""

    def __init__(self, runner: GraphRunner, console: "Console") -> None:
        self._runner, self._console = runner, console
        self._printed, self._next = ("", ""), 0.0
        self._show = once_shown(runner, lambda words: console.print(f"  {words}", highlight=False))

    def __call__(self) -> None:
        if time.monotonic() < self._next:
            return
        self._next = time.monotonic() + DRAW_S
        self._show()
        source = self._runner.rows.get("truth_source: source", {})
        flown = numeric(source.get("values", {}), "flown_s") or 0.0
        row = self._runner.navigator("supervisor")
        chosen = tuple(row.get("values", {}).get(key, "") for key in ("mode", "flying_on"))
        if row and chosen != self._printed:
            self._printed = chosen
            self._console.print(f"  {flown / 60.0:4.1f} min  {row['message']}", highlight=False)


def _print_counts(counts: Mapping[str, Mapping[str, int]], console: "Console") -> int:
    """Print messages published against received per topic; return how many were lost."""
    from lowcostnav_ros.report.terminal import print_table

    rows, total = [], 0
    for topic, entry in sorted(counts.items()):
        subscribers = {node: count for node, count in entry.items() if node != "sent"}
        if topic in ("clock", "diagnostics") or not subscribers or not entry["sent"]:
            continue
        missing = sum(max(entry["sent"] - count, 0) for count in subscribers.values())
        total += missing
        received = ", ".join(node if count >= entry["sent"] else f"{node} {count}" for node, count in subscribers.items())
        rows.append((topic, received, str(entry["sent"]), str(missing) if missing else "-"))
    print_table(Table.plain("Messages", ("topic", "received by", "published", "lost"), rows, left=2), console)
    console.print("Nothing was lost." if not total else f"[red]{total} messages were lost.[/]")
    return total


def _print_equality(result: "ReplayResult", console: "Console") -> bool:
    """Print, per navigator, whether the replayed fused solution is the one flown; return whether all are."""
    for name, navigator in result.navigators.items():
        fused, at = navigator.fused, navigator.fused.first_differing_stamp_s
        if fused.equals_recorded:
            verdict = f"[green]replay equals flight, bit for bit[/] ({fused.count_equal} solutions, sha256 {(fused.sha256 or '')[:16]})"
        else:
            where = f", first at {at - result.first_stamp_s:.1f} s" if at else ""
            verdict = f"[red]replay differs from flight[/]: {fused.count_differing} differ, {fused.count_missing} missing{where}"
        console.print(f"  {name:15} {verdict}", highlight=False)
    return all(navigator.fused.equals_recorded for navigator in result.navigators.values())
