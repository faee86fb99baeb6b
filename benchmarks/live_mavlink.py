"""An autopilot on a pseudo-terminal: `lowcostnav up real_mavlink` flies the navigators on a simulated flight sent as MAVLink; prints JSON.

    python benchmarks/live_mavlink.py            # 90 s at the pace of the clock
    python benchmarks/live_mavlink.py --seconds 30

Reported: what the recording holds, the modes the navigators reached, messages lost on the way, the processor time of the driver, and
whether the replay of the recording gives the fused solution of the flight to the bit, as it does where neither lost anything on the way:
--lossless lets the driver wait for its listeners, as no aircraft should, so that a busy machine loses nothing.
"""

import argparse
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
import tty
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from common import fly, run, scenario
from fuzz_formats import mavlink_frame

from lowcostnav_ros.base.measurements import AirVelocity, GpsPosition, GpsVelocity, ImuBlock, MagneticField, Measurement, Pressure
from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag


def stream(measurements: list[Measurement], seconds: float) -> list[tuple[float, bytes]]:
    """Frames with the time since the start at which they are sent."""
    first = min(one.stamp_ns for one in measurements)
    field, pressure, velocity = np.zeros(3), 101_325.0, np.zeros(3)
    out: list[tuple[float, bytes]] = []
    for one in sorted(measurements, key=lambda one: one.stamp_ns):
        since = 1e-9 * (one.stamp_ns - first)
        if since > seconds:
            break
        boot_us = 1_000_000 + int(1e6 * since)
        if isinstance(one, MagneticField):
            field = one.field_b * 1e4
        elif isinstance(one, Pressure) and one.source == "air/static_pressure":
            pressure = one.pressure_pa
        elif isinstance(one, GpsVelocity):
            velocity = one.vel_n
        elif isinstance(one, ImuBlock):
            for k, stamp in enumerate(one.stamps_ns.tolist()):
                at = 1e-9 * (stamp - first)
                values = (*one.specific_force_b[k], *one.angular_rate_b[k], *field, pressure / 100.0, 0.0, 0.0, 20.0)
                out.append((at, mavlink_frame(105, struct.pack("<Q13fH", 1_000_000 + int(1e6 * at), *values, 0x1FFF))))
        elif isinstance(one, GpsPosition):
            place = round(np.degrees(one.lat) * 1e7), round(np.degrees(one.lon) * 1e7), round(1000 * one.height)
            speed, track = round(100 * np.hypot(*velocity[:2])), round(np.degrees(np.arctan2(velocity[1], velocity[0])) % 360.0 * 100)
            payload = struct.pack("<QiiiHHHHBBiIII", boot_us, *place, 90, 140, speed, track, 3, 12, place[2], 2500, 4000, 200)
            out.append((since, mavlink_frame(24, payload)))
        elif isinstance(one, AirVelocity):
            out.append((since, mavlink_frame(74, struct.pack("<ffffhH", one.vel_b[0], 0.0, 0.0, 0.0, 0, 0))))
    heart = mavlink_frame(0, struct.pack("<IBBBBB", 0, 1, 3, 81, 4, 3)) + mavlink_frame(1, struct.pack("<III19x", 16, 16, 16))
    out += [(float(k), heart) for k in range(int(seconds))]
    return sorted(out, key=lambda pair: pair[0])


def graph(folder: Path, port: Path, *, lossless: bool) -> Path:
    """The shipped graph with another port and a recording in the folder."""
    content = yaml.safe_load((config_dir() / "graphs" / "real_mavlink.yaml").read_text())
    content["lossless"] = lossless
    for node in content["nodes"]:
        if node["executable"] == "mavlink_driver":
            node["parameters"] = {"source": str(port), "baud": 921_600}
        if node["executable"] == "recorder":
            node["parameters"] = {"path": str(folder / "recording")}
    (folder / "real.yaml").write_text(yaml.safe_dump(content))
    return folder / "real.yaml"


def processor_s(name: str, parent: int) -> float:
    """Processor time of the node of a name among the descendants of a process, s."""
    used = 0.0
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            words, stat = (entry / "cmdline").read_bytes().decode(), (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if name in words and int(stat[1]) == parent:
            used = max(used, (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK"))
    return used


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Fly."""
    seconds = 30.0 if arguments.quick else arguments.seconds
    _, measurements = fly(scenario("livermore", 1))
    frames = stream(measurements, seconds)
    with tempfile.TemporaryDirectory() as name:
        folder, (master, slave) = Path(name), os.openpty()
        tty.setraw(slave)
        (folder / "autopilot").symlink_to(os.ttyname(slave))
        command = [sys.executable, "-m", "lowcostnav_ros.cli", "up", str(graph(folder, folder / "autopilot", lossless=arguments.lossless))]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT)
        try:
            time.sleep(arguments.settle)
            began, before = time.monotonic(), processor_s("mavlink_driver", process.pid)
            for due, frame in frames:
                time.sleep(max(began + due - time.monotonic(), 0.0))
                os.write(master, frame)
            elapsed, used = time.monotonic() - began, processor_s("mavlink_driver", process.pid) - before
            time.sleep(2.0)
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(30.0)
            os.close(master)
            os.close(slave)
        sent = sum(frame[7] == 105 for _, frame in frames)
        with BagReader(folder / "recording") as bag:
            counts = dict(sorted(bag.counts.items()))
            modes = {source: sorted({one.mode for one in bag.measurements([source])}) for source in bag.types if source.endswith("/health")}
        result = replay_bag(folder / "recording", ReplayOptions())
        same = {name: one.fused.equals_recorded for name, one in result.navigators.items() if one.fused.count}
    return {
        "inertial_sent": sent, "inertial_recorded": counts.get("imu/data_raw", 0), "driver_core_share": round(used / elapsed, 3),
        "recorded": {topic: count for topic, count in counts.items() if not topic.startswith("diag")}, "modes": modes,
        "replay_equals_live": same,
    }  # fmt: skip


if __name__ == "__main__":
    run(
        __doc__ or "",
        measure,
        seconds={"type": float, "default": 90.0},
        settle={"type": float, "default": 20.0},
        lossless={"action": "store_true"},
    )
