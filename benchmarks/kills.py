"""Kill and stop every node of a flying graph in turn, its runner and its recorder, and fill its disk: what is named, what comes back, when.

A graph of the package flies in real time over Fast DDS, GPS good.  In each round, a flight, every node but the source (a flight that starts
again from its beginning would be another flight) and the monitor get SIGKILL, then SIGSTOP.  ``named_s`` is the time until the runner
names the node, ``back_s`` the time until its first topic (of recorder and monitor: its report) arrives again, ``nav_gap_s`` the longest
pause of nav/odometry from the signal to ten seconds later and ``nav_error_sigma`` its largest horizontal error over its sigma in that
time, against the truth.  A stopped node is not continued: the runner has to find it.

    python benchmarks/kills.py --rounds 10      all of it; needs a machine that flies the graph at leisure
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from common import run
from live_graph import live

from lowcostnav_ros.catalogue.navigator_topics import topics_of
from lowcostnav_ros.graph.description import Graph
from lowcostnav_ros.graph.domain import node_environment
from lowcostnav_ros.graph.executables import NAVIGATOR, SIMULATOR, SOURCE, kind_of, sensor_of
from lowcostnav_ros.graph.process import What
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.messages import topics
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagError
from lowcostnav_ros.messages.decode import Decoder, Rejected
from lowcostnav_ros.sensors.registry import SIMULATORS

NAV, TRUTH = "nav/odometry", "truth/odometry"
SETTLE_S, AFTER_S, LONGEST_S = 10.0, 10.0, 20.0


def topic_of(executable: str) -> str:
    """The first topic of a node, empty where it has none."""
    if kind_of(executable) == SIMULATOR:
        return str(SIMULATORS.label(sensor_of(executable)).topics[0])
    return topics_of(executable)[0] if kind_of(executable) == NAVIGATOR else ""


class Probe:
    """Arrivals of the first topic of every node, and the errors of nav/odometry, in a thread of this process."""

    def __init__(self, domain: int, wanted: set[str]) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import qos_profile_sensor_data

        from lowcostnav_ros.ros import qos
        from lowcostnav_ros.ros.publishing import message_class

        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("kill_probe", context=self.context)
        self.last: dict[str, float] = {}
        self.stamp_ns: dict[str, int] = {}
        self.nav: list[tuple[float, float | None]] = []  # arrival, error over sigma
        self._decoder, self._truth = Decoder(), None
        for name in wanted | {NAV, TRUTH, "nav/origin", "truth/origin"}:
            profile = qos.latched() if name.endswith("/origin") else qos_profile_sensor_data
            kind = message_class(topics.spec(name).msgtype)
            self.node.create_subscription(kind, name, lambda raw, name=name: self._arrived(name, raw), profile, raw=True)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        with suppress(Exception):  # shut down
            self._executor.spin()

    def _arrived(self, name: str, raw: bytes) -> None:
        now = self.last[name] = time.monotonic()
        found = self._decoder.decode(name, topics.spec(name).msgtype, raw)
        if isinstance(found, Rejected):
            return
        self.stamp_ns[name] = found.stamp_ns
        if name == TRUTH:
            self._truth = found
        elif name == NAV:
            self.nav.append((now, self._error(found)))

    def _error(self, solution) -> float | None:
        """Horizontal error over sigma; the truth, at 20 Hz, is carried to the stamp."""
        import numpy as np

        truth = self._truth
        if truth is None or not solution.has_position or abs(solution.stamp_ns - truth.stamp_ns) > 0.5e9:
            return None
        step = 1e-9 * (solution.stamp_ns - truth.stamp_ns) * truth.vel_n[:2]
        north = (solution.lat - truth.lat) * 6.37e6 - step[0]
        east = (solution.lon - truth.lon) * 6.37e6 * np.cos(truth.lat) - step[1]
        return float(np.hypot(north, east) / max(np.sqrt(np.trace(solution.cov_pos[:2, :2])), 1e-9))

    def close(self) -> None:
        """Stop listening."""
        import rclpy

        rclpy.shutdown(context=self.context)
        self._thread.join(5.0)


def strike(runner: GraphRunner, probe: Probe, name: str, number: int) -> dict:
    """Send a signal to a node and watch what becomes of it."""
    process = next(one for one in runner._running() if one.name == name)
    topic, first = topic_of(process.executable), len(runner.events)
    pid, at = process.process.pid, time.monotonic()
    restarts = process.restarts
    os.kill(pid, number)
    named, back = None, None
    expected = {signal.SIGKILL: (What.DIED,), signal.SIGSTOP: (What.SILENT, What.KILLED)}[number]
    while time.monotonic() - at < LONGEST_S and not (named and back and time.monotonic() - at > AFTER_S):
        runner.watch()
        if named is None and any(e.node == name and e.what in expected for e in runner.events[first:]):
            named = time.monotonic() - at
        if back is None and process.restarts > restarts and process.process.pid != pid:
            restarted = process._started_at
            is_back = probe.last.get(topic, 0.0) > restarted if topic else runner.unreported_s(name) is not None
            back = time.monotonic() - at if is_back else None
        time.sleep(0.02)
    arrivals = [t for t, _ in probe.nav if t > at - 1.0]
    errors = [e for t, e in probe.nav if t > at and e is not None]
    return {
        "node": name,
        "signal": number.name,
        "named_s": None if named is None else round(named, 2),
        "back_s": None if back is None else round(back, 2),
        "nav_gap_s": round(max((b - a for a, b in zip(arrivals, arrivals[1:], strict=False)), default=float("inf")), 2),
        "nav_error_sigma": round(max(errors, default=float("nan")), 2),
    }


@contextmanager
def flying(graph: Graph, out: Path) -> Iterator[tuple[GraphRunner, Probe]]:
    """Fly a graph until its supervisor has a solution, and some time more."""
    wanted = {topic_of(node.executable) for node in graph.nodes} - {""}
    with GraphRunner(graph, out=out, log_dir=out / "logs") as runner:
        probe = Probe(runner.domain, wanted)
        try:
            if not runner.wait_for(lambda: bool(probe.nav), 120.0):
                raise SystemExit("nav/odometry did not come within two minutes")
            runner.wait_for(lambda: False, SETTLE_S)
            yield runner, probe
        finally:
            probe.close()


def readable(path: Path) -> dict:
    """Whether a recording can be read, how much of it, and its last stamp."""
    try:
        with BagReader(path) as bag:
            count = sum(1 for _ in bag.stream())
            return {"readable": True, "closed": bag.is_closed, "messages": count, "end_ns": bag.end_ns}
    except BagError as error:
        return {"readable": False, "why": str(error)}


def fly_round(graph: Graph, out: Path, names: list[str]) -> list[dict]:
    """Kill, then stop, every node of one flight."""
    strikes = []
    with flying(graph, out) as (runner, probe):
        for number in (signal.SIGKILL, signal.SIGSTOP):
            for name in names:
                strikes.append(strike(runner, probe, name, number))
                print(strikes[-1], file=sys.stderr, flush=True)
    shutil.rmtree(out)
    return strikes


def kill_recorder(graph: Graph, out: Path) -> dict:
    """Kill the recorder in flight: its recording is readable, and another is begun."""
    with flying(graph, out) as (runner, probe):
        result = strike(runner, probe, "recorder", signal.SIGKILL)
        os.kill(runner.processes["recorder"].process.pid, signal.SIGKILL)
        stamp_ns = probe.stamp_ns["imu/data_raw"]
        found = readable(out / "recording_2")
    if found["readable"]:
        found["lost_s"] = round(1e-9 * (stamp_ns - found.pop("end_ns")), 2)
    return {**result, **found}


def children(pid: int) -> list[int]:
    """Ids of the children of a process."""
    with suppress(OSError):
        return [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return []


def kill_runner(graph: str, out: Path, number: signal.Signals) -> dict:
    """End the runner by a signal: no node flies on, the recording can be read."""
    command = [sys.executable, "-m", "lowcostnav_ros.cli", "up", graph, "--out", str(out), "--no-table"]
    with (out.parent / "up.log").open("ab") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env=dict(os.environ), start_new_session=True)
    deadline = time.monotonic() + 90.0
    while not _has_recorded(out) and time.monotonic() < deadline:
        time.sleep(0.2)
    nodes = children(process.pid)
    os.kill(process.pid, number)
    at = time.monotonic()
    process.wait(30.0)
    while any(_runs(pid) for pid in nodes) and time.monotonic() - at < 15.0:
        time.sleep(0.05)
    orphans = sum(_runs(pid) for pid in nodes)
    ended = round(time.monotonic() - at, 2)
    return {"signal": number.name, "nodes": len(nodes), "orphans": orphans, "ended_s": ended, **readable(out / "recording")}


def _has_recorded(out: Path) -> bool:
    file = out / "recording" / "recording.mcap"
    return file.is_file() and file.stat().st_size > 300_000


def _runs(pid: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def fill_disk(graph: str, folder: Path) -> dict | None:
    """Fly onto a disk of 3 MB: said, exit status 1, what was recorded is readable.  None where no such disk can be made."""
    folder.mkdir()
    if os.getuid() != 0 or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(folder)], capture_output=True).returncode:
        return None
    try:
        command = [sys.executable, "-m", "lowcostnav_ros.cli", "up", graph, "--out", str(folder / "out"), "--no-table"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        said, at = [], time.monotonic()
        while not any("No space left" in line for line in said) and time.monotonic() - at < 180.0:
            said.append(process.stdout.readline())
        time.sleep(3.0)
        process.send_signal(signal.SIGINT)
        said += process.communicate(timeout=30.0)[0].splitlines()
        words = next((line.strip() for line in said if "No space left" in line), "")
        return {"said": words, "exit_status": process.returncode, **readable(folder / "out" / "recording")}
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=False)


def summary(strikes: list[dict]) -> dict:
    """Counts and worst times."""

    def of(key: str) -> list[float]:
        return sorted(s[key] for s in strikes if s[key] is not None)

    named, back = of("named_s"), of("back_s")
    return {
        "strikes": len(strikes),
        "named_within_2_s": sum(t <= 2.0 for t in named),
        "back_within_5_s": sum(t <= 5.0 for t in back),
        "named_max_s": max(named, default=None),
        "back_median_s": back[len(back) // 2] if back else None,
        "back_max_s": max(back, default=None),
        "nav_gap_max_s": max((s["nav_gap_s"] for s in strikes if s["node"] != "supervisor"), default=None),
        "nav_gap_max_supervisor_s": max((s["nav_gap_s"] for s in strikes if s["node"] == "supervisor"), default=None),
        "nav_error_sigma_max": max((s["nav_error_sigma"] for s in strikes), default=None),
    }


def measure(options) -> dict:
    """Fly and strike."""
    graph = live(options.graph).with_parameters("gps_simulator", outages_s=[])
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder)
        os.environ.update(node_environment(0, base))
        del os.environ["ROS_DOMAIN_ID"]
        names = [node.name for node in graph.nodes if kind_of(node.executable) != SOURCE] + ["monitor"]
        names = options.nodes.split(",") if options.nodes else ["ins_gps", "supervisor", "monitor"] if options.quick else names
        strikes = [one for _ in range(int(options.rounds)) for one in fly_round(graph, base / "out", names)]
        rest = {}
        if not options.strikes_only:
            rest["recorder"] = kill_recorder(graph, base / "out2")
            for number in (signal.SIGHUP, signal.SIGKILL, signal.SIGTERM):
                rest[f"runner_{number.name}"] = kill_runner(graph.name, base / f"out_{number.name}", number)
            rest["disk_full"] = fill_disk(graph.name, base / "full")
    machine = {"graph": graph.name, "cores": os.cpu_count(), "load": os.getloadavg()[0]}
    return {**machine, **summary(strikes), **rest, "each": strikes}


if __name__ == "__main__":
    arguments = {
        "graph": {"default": "livermore", "metavar": "NAME", "help": "graph of the package with a supervisor and a recorder"},
        "rounds": {"default": "1", "metavar": "N", "help": "each node is killed and stopped so often"},
        "nodes": {"default": "", "metavar": "A,B", "help": "these nodes only"},
        "strikes-only": {"action": "store_true", "help": "leave out runner, recorder and disk"},
    }
    run(__doc__.splitlines()[0], measure, **arguments)
