"""The doctor job: check the installation, everything that a graph of nodes needs; each line is ok or what to do."""

import argparse
import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.cli.jobs import job

SHM = Path("/dev/shm")
PINNED = {"ros-jazzy-rclpy": "7.1.6", "ros-jazzy-common-interfaces": "5.3.6", "ros-jazzy-rmw-fastrtps-cpp": "8.4.3"}
PROBE = """
import sys, time, rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("doctor_" + sys.argv[1])
if sys.argv[1] == "server":
    node.create_service(Trigger, "doctor_probe", lambda request, response: response)
    end = time.monotonic() + 15.0
    while rclpy.ok() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.2)
else:
    client = node.create_client(Trigger, "doctor_probe")
    found = client.wait_for_service(timeout_sec=10.0)
    future = client.call_async(Trigger.Request()) if found else None
    if found:
        rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
    sys.exit(0 if found and future.done() else 1)
"""


class Finding(NamedTuple):
    """One line: whether it is well, and what was found or what to do."""

    ok: bool
    text: str


def check_python() -> Finding:
    """Python 3.11 to 3.13: what the ROS wheels exist for and this package is written in."""
    version = ".".join(map(str, sys.version_info[:3]))
    good = (3, 11) <= sys.version_info[:2] <= (3, 13)
    return Finding(good, version if good else f"{version}: make the environment with Python 3.11, 3.12 or 3.13.")


def check_rclpy() -> Finding:
    """Rclpy, from wheels of the pinned versions or from a system ROS."""
    if importlib.util.find_spec("rclpy") is None:
        from lowcostnav_ros.graph.domain import INSTALL_ROS

        return Finding(False, f"not installed: {INSTALL_ROS}.")
    other = []
    for name, wanted in PINNED.items():
        try:
            found = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            return Finding(True, f"of the system ROS ({os.environ.get('ROS_DISTRO', 'distribution unknown')})")
        if found != wanted:
            other.append(f"{name} {found} instead of {wanted}")
    return Finding(not other, f"install the tried versions, pip install '.[ros]': {', '.join(other)}." if other else "pinned wheels")


def check_rmw() -> Finding:
    """Fast DDS, the one middleware this package is tried with."""
    chosen = os.environ.get("RMW_IMPLEMENTATION", "")
    if chosen not in ("", "rmw_fastrtps_cpp"):
        return Finding(False, f"RMW_IMPLEMENTATION is {chosen}: unset it, or set it to rmw_fastrtps_cpp.")
    return Finding(True, "rmw_fastrtps_cpp")


def check_environment() -> Finding:
    """Variables that break discovery or the wheels' libraries."""
    if os.environ.get("ROS_LOCALHOST_ONLY"):
        return Finding(False, "unset ROS_LOCALHOST_ONLY and set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST instead.")
    if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() == "OFF":
        return Finding(False, "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF stops local discovery, too: set it to LOCALHOST.")
    if os.environ.get("_ROS_WHEELS_BOOTSTRAP_COMPLETE") and not os.environ.get("LD_LIBRARY_PATH"):
        return Finding(False, "unset _ROS_WHEELS_BOOTSTRAP_COMPLETE: without LD_LIBRARY_PATH beside it ROS is not found.")
    from lowcostnav_ros.graph.domain import RANGE, discovery, users_domain

    try:
        domain = users_domain()
    except ValueError as error:
        return Finding(False, str(error))
    heard = f"this machine only (more: {RANGE}=SUBNET)" if discovery() else f"the network ({os.environ.get(RANGE) or 'its peers'})"
    return Finding(True, f"your own sensors are heard on ROS domain {domain} from {heard}; a simulated graph takes a free domain")


def check_ament_index() -> Finding:
    """AMENT_PREFIX_PATH, which `ros2 run` and `ros2 launch` look packages up in."""
    marker = Path("share/ament_index/resource_index/packages/lowcostnav_ros")
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    if any((prefix / marker).exists() for prefix in prefixes):
        return Finding(True, "ros2 run finds lowcostnav_ros")
    if shutil.which("ros2") is None:
        return Finding(True, "no ros2 command here, so not needed: use 'lowcostnav up' and 'lowcostnav run'")
    return Finding(False, f"ros2 run will not find this package: export AMENT_PREFIX_PATH={sys.prefix}, or source install/setup.bash.")


def check_shared_memory(folder: Path = SHM) -> Finding:
    """Fast DDS's shared memory: usable, and not full of what killed processes left."""
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        return Finding(False, f"{folder} is not writable: mount it (docker: --shm-size=512m), or DDS falls back to the network.")
    segments = [p for p in folder.glob("fastrtps_*") if not p.name.endswith("_el")]
    foreign = [p for p in segments if not os.access(p, os.W_OK)]
    if foreign:
        return Finding(False, f"{len(foreign)} segments in {folder} belong to another user: run all nodes as one user, or reboot.")
    free_mb = shutil.disk_usage(folder).free / 2**20
    if free_mb < 64:
        return Finding(False, f"only {free_mb:.0f} MB free in {folder}: end old nodes and run 'fastdds shm clean'.")
    old = [p for p in segments if time.time() - p.stat().st_mtime > 86_400]
    if old:
        return Finding(False, f"{len(old)} segments in {folder} are older than a day: end old nodes and run 'fastdds shm clean'.")
    return Finding(True, f"{free_mb:.0f} MB free, {len(segments)} segments in use")


def check_clock() -> Finding:
    """A wall clock that is not lost (a computer without battery starts in 1970): the magnetic model and logs need the date."""
    year = time.gmtime().tm_year
    good = 2024 <= year <= 2040
    return Finding(good, time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()) if good else f"the year is {year}: set the clock.")


def check_kernel_cache() -> Finding:
    """Where compiled kernels are kept between starts; without it every start compiles for half a minute."""
    from lowcostnav_ros.base import kernels

    folder = kernels.cache_root()
    if folder is None:
        return Finding(False, "there is no folder that only this user can write to: set NUMBA_CACHE_DIR to one.")
    if folder.parent == Path(tempfile.gettempdir()):
        return Finding(False, f"kept in {folder} only until the next reboot: set NUMBA_CACHE_DIR to a folder that stays.")
    return Finding(os.access(folder, os.W_OK), f"{folder}")


def check_discovery() -> Finding:
    """Two processes that find and answer each other over DDS."""
    if importlib.util.find_spec("rclpy") is None:
        return Finding(False, "not tried without rclpy.")
    from lowcostnav_ros.graph.domain import free_domain, node_environment

    with free_domain() as domain, tempfile.TemporaryDirectory() as folder:
        environment = node_environment(domain, Path(folder))
        server = subprocess.Popen([sys.executable, "-c", PROBE, "server"], env=environment, stderr=subprocess.DEVNULL)
        began = time.monotonic()
        try:
            answered = (
                subprocess.run([sys.executable, "-c", PROBE, "client"], env=environment, capture_output=True, timeout=20).returncode == 0
            )
        except subprocess.TimeoutExpired:
            answered = False
        finally:
            server.terminate()
            server.wait(5.0)
    if answered:
        return Finding(True, f"two processes found each other, {time.monotonic() - began:.1f} s")
    return Finding(False, "two processes did not find each other: check that the loopback interface is up and /dev/shm usable.")


CHECKS = {name.removeprefix("check_").replace("_", " "): check for name, check in globals().items() if name.startswith("check_")}


@job("Check the installation: everything that the nodes need, each line ok or what to do.")
def doctor(_: argparse.Namespace | None = None) -> int:
    """Print every finding; return 0 when all is well, 1 when something is to be done."""
    well = True
    for subject, check in CHECKS.items():
        ok, text = check()
        print(f"{'ok  ' if ok else 'TO DO'} {subject}: {text}", flush=True)
        well &= ok
    return Exit.OK if well else Exit.WORSE
