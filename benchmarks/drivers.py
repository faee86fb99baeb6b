"""What a driver costs, loses and takes to come back: `mavlink_driver` on a pseudo-terminal, beside a recorder; prints JSON.

usual     200 inertial samples a second, GPS, airspeed, heartbeat: share of a core (processor time), samples sent and recorded
full      inertial samples as fast as 1 Mbaud carries them, 100 000 bytes a second; what the port's own 4 kB could not take at once waits
          here, as it would be lost by a receiver without flow control: the longest such wait, beside the 41 ms that 4 kB hold; where
          this process itself comes late, the device pauses (hz is what it reached)
replug    the device away for 3 s, four times: from its return to the first sample, the longest

    python benchmarks/drivers.py                  a minute of each
    python benchmarks/drivers.py --seconds 1800   half an hour of each
    python benchmarks/drivers.py --only full      one of them

A loss is traced: ``port_bytes`` that the port took beside ``driver_bytes`` that the driver read, frames, broken frames and refusals of the
driver, what was sent, published and recorded, and the numbers of the first samples that the recording lacks. What a driver publishes before
the recorder has found it (its topics begin with their first message) counts apart.
"""

import argparse
import contextlib
import os
import select
import struct
import tempfile
import time
import tty
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from common import run
from fuzz_formats import mavlink_frame

from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.graph.runner import GraphRunner
from lowcostnav_ros.messages.bag import BagReader

BYTES_PER_S = 100_000
"""Of 1 Mbaud: ten bits a byte."""
STEP_S, HOLDS_S = 0.005, 4096 / BYTES_PER_S
DRAIN_S = 60.0
"""How long what waits at the end may take."""
AWAY_S = (3.05, 3.15, 3.25, 3.35)
"""At any phase of the half second in which a driver tries again."""
HEART = mavlink_frame(0, struct.pack("<IBBBBB", 0, 1, 3, 81, 4, 3))


def inertial(at_us: int, number: int = 0) -> bytes:
    """HIGHRES_IMU of an aircraft that flies level; its number is in the forward specific force, so that one that is lost is known."""
    values = 1e-6 * number, 0.0, -9.8, 0.0, 0.01, 0.0, 0.2, 0.0, 0.4, 900.0, 0.0, 980.0, 20.0
    return mavlink_frame(105, struct.pack("<Q13fH", at_us, *values, 0x1FFF))


def number_of(raw: bytes) -> int:
    """The number in a recorded sensor_msgs/Imu, whose last are the specific force and its covariance."""
    return round(1e6 * struct.unpack_from("<d", raw, len(raw) - 96)[0])


def others(at_us: int) -> bytes:
    """Fix and airspeed."""
    fix = struct.pack("<QiiiHHHHBBiIII", at_us, 377_000_000, -1_217_000_000, 980_000, 90, 140, 5000, 9000, 3, 12, 980_000, 2500, 4000, 200)
    return mavlink_frame(24, fix) + mavlink_frame(74, struct.pack("<ffffhH", 50.0, 50.0, 980.0, 0.0, 90, 50))


@dataclass
class Device:
    """A pseudo-terminal under a name of its own; what the port does not take at once waits."""

    path: Path
    waiting: bytearray = field(default_factory=bytearray)
    longest_s: float = 0.0
    taken: int = 0

    def plug(self) -> None:
        """Appear."""
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.path.symlink_to(os.ttyname(self.slave))

    def unplug(self) -> None:
        """Vanish."""
        self.path.unlink()
        os.close(self.master)
        os.close(self.slave)

    def send(self, data: bytes) -> None:
        """Hand over what the port takes."""
        self.waiting += data
        with contextlib.suppress(BlockingIOError):
            taken = os.write(self.master, self.waiting)
            self.taken += taken
            del self.waiting[:taken]
        self.longest_s = max(self.longest_s, len(self.waiting) / BYTES_PER_S)

    def rest(self, seconds: float) -> None:
        """Pass a time; what waits goes as soon as the driver has made room: none waits for this process to wake up."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            if self.waiting and select.select([], [self.master], [], left)[1]:
                self.send(b"")
            elif not self.waiting:
                time.sleep(left)

    def fly(self, seconds: float, hertz: float) -> int:
        """Send for a time; return the inertial samples sent."""
        self.send(HEART)  # an autopilot is known by it
        begun, sent, first_us = time.monotonic(), 0, time.monotonic_ns() // 1000
        while (now := time.monotonic() - begun) < seconds:
            due, most, part = int(now * hertz) - sent, int(4 * STEP_S * hertz) + 1, b""
            if due > most:
                begun, seconds, due = begun + (due - most) / hertz, seconds - (due - most) / hertz, most
            for k in range(sent, sent + due):
                part += inertial(first_us + round(1e6 * k / hertz), k)
                part += others(first_us + round(1e6 * k / hertz)) if k % round(hertz / 5.0) == 0 else b""
                part += HEART if k % round(hertz) == 0 else b""
            sent += due
            self.send(part)
            self.rest(STEP_S)
        return sent


def flown(hertz: float, seconds: float, *, replug: bool = False) -> dict[str, Any]:
    """A graph of driver and recorder on a device."""
    with tempfile.TemporaryDirectory() as name:
        folder, device = Path(name), Device(Path(name) / "autopilot")
        device.plug()
        driver = {"executable": "mavlink_driver", "parameters": {"source": str(device.path), "baud": 921_600}}
        (folder / "graph.yaml").write_text(yaml.safe_dump({"lossless": False, "nodes": [driver, {"executable": "recorder"}]}))
        with GraphRunner(load_graph(folder / "graph.yaml"), out=folder, log_dir=folder / "logs") as runner:
            runner.wait_for(lambda: {"mavlink_driver: port", "recorder: recording"} <= set(runner.rows), 60.0)
            port = lambda: runner.rows["mavlink_driver: port"]["values"]  # noqa: E731
            runner.wait_for(lambda: int(port()["opened"]) > 0, 60.0)
            before, begun = runner.processes["mavlink_driver"].cpu_seconds(), time.monotonic()
            sent, back = device.fly(seconds, hertz), []
            elapsed = time.monotonic() - begun
            share = (runner.processes["mavlink_driver"].cpu_seconds() - before) / elapsed
            for away_s in AWAY_S if replug else ():
                device.unplug()
                time.sleep(away_s)
                device.waiting.clear()
                device.plug()
                back.append(time.time_ns())
                device.fly(5.0, hertz)
            while device.waiting and time.monotonic() < begun + elapsed + DRAIN_S:
                device.rest(STEP_S)
            time.sleep(3.0)  # longer than between two reports
            traced = {"port_bytes": device.taken, "driver_bytes": int(port()["bytes"])}
            traced |= {name: port()[name] for name in ("frames", "broken", "skipped_bytes", "refused")}
            published = runner.counts().get("imu/data_raw", {}).get("sent", 0)
        device.unplug()
        with BagReader(folder / "recording") as bag:
            arrived, numbers = np.array([(stamp, number_of(raw)) for _, stamp, raw in bag.stream(["imu/data_raw"])]).T
    if replug:
        return {"back_after_s": round(1e-9 * max(int(arrived[arrived > at][0]) - at for at in back), 2)}
    waited = {"longest_wait_ms": round(1e3 * device.longest_s, 1), "port_holds_ms": round(1e3 * HOLDS_S, 1)}
    lost = np.setdiff1d(np.arange(int(numbers[0]), sent), numbers)
    counts = {"sent": sent, "published": published, "recorded": len(arrived), "before_the_recorder_heard": int(numbers[0])}
    counts |= {"lost": len(lost), "first_lost": lost[:20].tolist(), "hz": round(sent / elapsed, 1)}
    return counts | {"driver_core_share": round(share, 3)} | waited | traced


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """All."""
    os.environ.setdefault("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    seconds = 10.0 if options.quick else options.seconds
    full = BYTES_PER_S / (len(inertial(0)) + 1.0)
    parts = {
        "usual": lambda: flown(200.0, seconds),
        "full": lambda: flown(full, seconds),
        "replug": lambda: flown(200.0, 3.0, replug=True),
    }
    return {name: fly() for name, fly in parts.items() if options.only in ("", name)}


if __name__ == "__main__":
    only = {"choices": ("usual", "full", "replug"), "default": ""}
    run(__doc__.splitlines()[0], measure, seconds={"type": float, "default": 60.0}, only=only)
