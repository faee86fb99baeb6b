"""How fast a recording is replayed, decoding included, per navigator, and whether memory stays flat in the length of the flight.

A simulated 100 Hz flight is recorded, then replayed in fresh processes: each navigator alone (with those it listens to), and all together;
the memory of all together is compared between a short recording and the whole one.  Whole processes of the command are timed too: loading,
reading, flying, judging, printing.
"""

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from common import process, run

NAVIGATORS = ("ahrs", "ins_gps", "dead_reckoning", "supervisor")


def record(folder: Path, name: str, duration_s: float) -> Path:
    """Simulate a flight into a bag, in a process of its own so that its memory does not count here."""
    bag = folder / name
    command = [sys.executable, "-m", "lowcostnav_ros.cli.main", "simulate", "livermore_long", "-o", str(bag), "--duration", str(duration_s)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return bag


def replayed(bag: Path, navigators: str = "") -> dict:
    """Replay in a fresh process; return its figures and its peak memory."""
    command = [sys.executable, __file__, "--child", str(bag), "--navigators", navigators]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])


def child(bag: str, navigators: str) -> dict:
    """What the fresh process does."""
    from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag

    names = tuple(n for n in navigators.split(",") if n) or None
    times = replay_bag(bag, ReplayOptions(navigators=names)).time
    return {
        "factor": times.real_time_factor_by_navigator,
        "wall_factor": times.real_time_factor,
        "rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }


def measure(options) -> dict:
    """Speed per navigator; memory at two lengths."""
    if options.child:
        return child(options.child, options.navigators)
    long_s, short_s = (300.0, 100.0) if options.quick else (1800.0, 300.0)
    with tempfile.TemporaryDirectory() as folder:
        short, whole = record(Path(folder), "short", short_s), record(Path(folder), "whole", long_s)
        replayed(short)  # load or compile the kernels before the clock counts
        all_short, all_long = replayed(short), replayed(whole)
        alone = {name: replayed(whole, name) for name in ("ahrs", "ins_gps")}
        command = [sys.executable, "-m", "lowcostnav_ros.cli.main", "replay", str(whole)]
        processes = {name: process([*command, *further]) for name, further in (("ins_gps", ["--navigators", "ins_gps"]), ("all", []))}
        first_line = {name: process([*command[:3], *name.split()])["cpu_s"] for name in ("--help", "replay --help", "list")}
    return {
        "flight_s": long_s,
        "real_time_factor": {name: round(all_long["factor"][name], 1) for name in NAVIGATORS},
        "wall_factor_alone": {name: round(entry["wall_factor"], 1) for name, entry in alone.items()},
        "wall_factor_all_four": round(all_long["wall_factor"], 1),
        "rss_mb": round(all_long["rss_mb"], 1),
        "rss_mb_short_flight": round(all_short["rss_mb"], 1),
        "short_flight_s": short_s,
        "whole_process": processes,
        "cpu_s_to_the_first_line": first_line,
    }


if __name__ == "__main__":
    hidden = {"default": "", "help": "used by the script itself"}
    run(__doc__.splitlines()[0], measure, child=hidden, navigators=hidden)
