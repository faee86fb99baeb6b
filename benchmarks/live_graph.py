"""The live graph at 100 Hz in real time: processor share, memory per node, stamp-to-publish latency, lost messages, start-up.

A graph of the package (Livermore by default: truth, five sensors, four navigators, recorder; processes over Fast DDS) flies in real time.
A probe in this process hears imu/data_raw and the low-latency odometry of the inertial navigator, and takes from the middleware the time at
which each arrived: latency is from the arrival of an inertial sample to the arrival of the solution that bears its stamp.  The probe costs
the graph two more readers.  Losses are counted from diagnostics, published against received, between two rounds in steady flight.

    python benchmarks/live_graph.py --graph gnss_tight         satellites one by one: 29 states, 100 Hz IMU, 10 Hz epochs
    python benchmarks/live_graph.py --graph pseudolite_range   fourteen transmitters: 46 states, 100 Hz IMU, 10 Hz epochs

A graph that ships faster than real time flies here as a live one would: real time, lossy, and without the longer horizon and the rarer
output that its pace asks for.
"""

import contextlib
import os
import statistics
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

from common import run

from lowcostnav_ros.graph.description import Graph, load_graph
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.navigators.registry import NAVIGATORS

SETTLE_S = 12.0
PROBED = ("ins_gps", "ins_gnss", "pseudolite_ins")
"""Navigators on inertial data, the first of which in a graph is timed; the first navigator of any kind where there is none."""
OF_THE_PACE = ("horizon.lag_s", "output.rate_hz")
"""Parameters a graph sets because it flies faster than real time."""


def live(name: str) -> Graph:
    """A shipped graph as it would fly on an aircraft."""
    graph = load_graph(name)
    if graph.real_time_factor == 1.0:
        return graph
    plain = [replace(n, parameters={k: v for k, v in n.parameters.items() if k not in OF_THE_PACE}) for n in graph.nodes]
    return replace(graph, nodes=tuple(plain), real_time_factor=1.0, lossless=False)


def navigators_in(graph: Graph) -> tuple[str, ...]:
    """Names of the nodes that navigate."""
    return tuple(n.name for n in graph.nodes if n.executable in NAVIGATORS)


def timed_in(graph: Graph) -> str:
    """Name of the navigator whose latency is taken."""
    names = navigators_in(graph)
    return next((n for n in names if graph.node(n).executable in PROBED), names[0])


class Probe:
    """Arrival times, by stamp, of the inertial samples and of the solutions of one navigator."""

    def __init__(self, domain: int, navigator: str) -> None:
        import rclpy
        from nav_msgs.msg import Odometry
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import Imu

        from lowcostnav_ros.ros.flow import header_stamp_ns

        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("latency_probe", context=self.context)
        self.solution = f"{navigator}/odometry"
        self.arrived: dict[str, dict[int, int]] = {"imu/data_raw": {}, self.solution: {}}

        def listen(kind, topic: str) -> None:
            """Note when each stamp of a topic arrives."""
            table = self.arrived[topic]

            def heard(raw: bytes, info: dict) -> None:
                table[header_stamp_ns(raw)] = info["received_timestamp"]

            self.node.create_subscription(kind, topic, heard, qos_profile_sensor_data, raw=True)

        listen(Imu, "imu/data_raw")
        listen(Odometry, self.solution)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        with contextlib.suppress(ExternalShutdownException):
            self.executor.spin()

    def latencies_ms(self) -> list[float]:
        """Milliseconds from sample to solution, one per solution whose sample was heard."""
        samples, solutions = self.arrived["imu/data_raw"], self.arrived[self.solution]
        return [1e-6 * (at - samples[stamp]) for stamp, at in list(solutions.items()) if stamp in samples]

    def close(self) -> None:
        """Stop listening."""
        import rclpy

        rclpy.shutdown(context=self.context)
        self._thread.join(5.0)


def first_outputs(runner: GraphRunner, began: float, names: tuple[str, ...]) -> dict[str, float]:
    """Seconds from process start until each navigator first reported its status: imports, kernels, warm-up included."""
    ready: dict[str, float] = {}
    while len(ready) < len(names) and time.monotonic() - began < 90.0:
        runner.watch()
        for name in names:
            if name not in ready and runner.navigator(name):
                ready[name] = round(time.monotonic() - began, 2)
        time.sleep(0.05)
    return ready


def alone(graph: Graph, name: str, out: Path) -> float:
    """Seconds from process start to first output of one navigator on an otherwise idle machine, kernels cached."""
    graph = graph.without(*(n.name for n in graph.nodes if n.name != name))
    for _ in range(2):  # the first start fills the caches
        began = time.monotonic()
        with GraphRunner(graph, out=out, log_dir=out / f"logs_{name}") as runner:
            ready = first_outputs(runner, began, (name,))
    return ready.get(name, float("nan"))


def lost_between(before: dict, after: dict) -> int:
    """Messages published and not received between two rounds of counts, in excess of what can be on its way (a second's worth)."""
    lost = 0
    for topic, entry in after.items():
        if topic in ("clock", "diagnostics") or topic not in before:
            continue
        sent = entry["sent"] - before[topic]["sent"]
        rate = sent / max(1.0, before["_seconds"])
        for node, count in entry.items():
            if node != "sent" and node in before[topic]:
                missing = sent - (count - before[topic][node])
                lost += max(0, round(missing - 1.5 * rate - 2))
    return lost


def pss_mb(pid: int) -> float:
    """Memory of a process, what it shares with others divided among them, MB."""
    line = next(line for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines() if line.startswith("Pss:"))
    return round(int(line.split()[1]) / 1024, 1)


def fly(graph, seconds: float, out: Path) -> dict:
    """One flight, measured in its steady part."""
    began = time.monotonic()
    with GraphRunner(graph, out=out, log_dir=out / "logs") as runner:
        ready = first_outputs(runner, began, navigators_in(graph))
        probe = Probe(runner.domain, timed_in(graph))
        runner.wait_for(lambda: runner.rows.get("truth_source: source", {}).get("values", {}).get("state") == "flying", 60.0)
        runner.wait_for(lambda: False, SETTLE_S)
        for table in probe.arrived.values():
            table.clear()
        cpu, at = {n: p.cpu_seconds() for n, p in runner.processes.items()}, time.monotonic()
        counts = {**runner.counts(), "_seconds": seconds}
        runner.wait_for(lambda: False, seconds)
        span = time.monotonic() - at
        used = {n: (p.cpu_seconds() - cpu[n]) / span for n, p in runner.processes.items()}
        lost = lost_between(counts, runner.counts())
        rss = {n: round(p.rss_mb(), 1) for n, p in runner.processes.items()}
        parents = {f"parent_{name}": one.pid for name, one in runner.parents.items() if one.pid}
        pss = {n: pss_mb(pid) for n, pid in ({n: p.process.pid for n, p in runner.processes.items()} | parents).items()}
        latencies = sorted(probe.latencies_ms())
        probe.close()
        events = [str(event) for event in runner.events]
    return {
        "seconds": round(span, 1),
        "cpu_cores": round(sum(used.values()), 3),
        "cpu_cores_by_node": {n: round(v, 3) for n, v in used.items()},
        "latency_p50_ms": round(statistics.median(latencies), 2) if latencies else None,
        "latency_p99_ms": round(latencies[int(0.99 * (len(latencies) - 1))], 2) if latencies else None,
        "latency_samples": len(latencies),
        "lost": lost,
        "rss_mb": rss,
        "pss_mb": pss,
        "pss_mb_together": round(sum(pss.values()), 1),
        "ready_s": ready,
        "events": events,
    }


def measure(options) -> dict:
    """Fly the graph; the discovery range and the middleware are set as the graph runner sets them."""
    os.environ.setdefault("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault("ROS_LOG_DIR", folder)
        out = Path(folder) / "out"
        graph = live(options.graph)
        names = [timed_in(graph)] if options.quick else navigators_in(graph)
        started = {name: alone(graph, name, out) for name in names}
        flown = fly(graph, 15.0 if options.quick else 60.0, out)
        return {"graph": graph.name, "timed": timed_in(graph), "start_to_first_output_s": started, **flown}


if __name__ == "__main__":
    graphs = {"default": "livermore", "metavar": "NAME", "help": "graph with an IMU (livermore, gnss_tight, pseudolite_range, ...)"}
    run(__doc__.splitlines()[0], measure, graph=graphs)
