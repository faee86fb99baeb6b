"""The ROS domain of a graph, the user's or a free one held by a bound TCP port, and the environment of node processes."""

import importlib.util
import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.catalogue.config_files import config_dir

INSTALL_ROS = "pip install '.[ros]' in the folder of this package, or source /opt/ros/jazzy/setup.bash"
DOMAINS = range(1, 101)
HIGHEST = 232  # of the ports that DDS derives from a domain
RANGE, LOCALHOST, PROFILE = "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST", "FASTRTPS_DEFAULT_PROFILES_FILE"
PEERS = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")  # by these the environment names other machines
FIRST_PORT = 32768  # domain d is taken while port 32768 + d is bound; other ROS test tools use the same rule


@contextmanager
def free_domain(wanted: int | None = None) -> Iterator[int]:
    """Hold a domain id for as long as the block runs.

    Parameters
    ----------
    wanted : int, optional
        This one, held or not; default is any from 1 to 100 that is free.

    Raises
    ------
    RuntimeError
        When all hundred are taken.
    """
    if wanted is not None:
        yield wanted
        return
    start = os.getpid() % len(DOMAINS)
    for domain in (*DOMAINS[start:], *DOMAINS[:start]):
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as holder:
            try:
                holder.bind(("127.0.0.1", FIRST_PORT + domain))
            except OSError:
                continue
            yield domain
            return
    raise RuntimeError("All ROS domains from 1 to 100 are taken on this machine; end a graph that is no longer needed.")


def require_ros() -> None:
    """Refuse to start nodes where there is no ROS: each would end in a traceback, and be started again.

    Raises
    ------
    SettingsError
    """
    missing = [name for name in ("rclpy", "diagnostic_msgs") if importlib.util.find_spec(name) is None]
    if missing:
        raise SettingsError(f"{missing[0]} is not installed: {INSTALL_ROS}.")


def users_domain() -> int:
    """Return the ROS domain of this environment, 0 where it names none, as ROS does.

    Raises
    ------
    ValueError
        When ROS_DOMAIN_ID is no domain.
    """
    stated = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not stated.isdecimal() or int(stated) > HIGHEST:
        raise ValueError(f"ROS_DOMAIN_ID is '{stated}'; set it to a whole number from 0 to {HIGHEST}, or give --domain.")
    return int(stated)


def discovery() -> dict[str, str]:
    """Return the variables that limit discovery to this machine, where the environment asks for that, or for nothing.

    Nodes of others on this machine are heard whatever their own range is.  Limited to this machine a node receives on the loopback
    interface only, unless a profile of Fast DDS is given.
    """
    usual = "" if any(os.environ.get(name) for name in PEERS) else LOCALHOST
    asked = LOCALHOST if os.environ.get("ROS_LOCALHOST_ONLY") == "1" else os.environ.get(RANGE, "").upper() or usual
    if asked not in ("OFF", LOCALHOST):  # OFF stops discovery on this machine, too
        return {}
    return {RANGE: LOCALHOST, PROFILE: os.environ.get(PROFILE) or str(config_dir() / "loopback.xml")}


def node_environment(domain: int, log_dir: Path | None = None) -> dict[str, str]:
    """Return the environment node processes run in: this one's, on the given domain, discovered as :func:`discovery` says."""
    environment = {**os.environ, **discovery()}
    environment.pop("ROS_LOCALHOST_ONLY", None)  # deprecated; it would override the range
    environment |= {
        "ROS_DOMAIN_ID": str(domain),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_LOG_DIR": str(log_dir or Path(tempfile.gettempdir()) / "lowcostnav_log"),
        "PYTHONUNBUFFERED": "1",
    }
    return environment
