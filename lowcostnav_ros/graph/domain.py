"""A free ROS domain on this machine, held by a bound TCP port, and the environment of node processes."""

import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lowcostnav_ros.catalogue.config_files import config_dir

DOMAINS = range(1, 101)
RANGE, LOCALHOST, PROFILE = "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST", "FASTRTPS_DEFAULT_PROFILES_FILE"
FIRST_PORT = 32768  # domain d is taken while port 32768 + d is bound; other ROS test tools use the same rule


@contextmanager
def free_domain(wanted: int | None = None) -> Iterator[int]:
    """Hold a domain id for as long as the block runs.

    Parameters
    ----------
    wanted : int, optional
        This one, 1 to 100, held or not; default is any that is free.

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


def discovery() -> dict[str, str]:
    """Return the variables that say from where a node can be discovered: the range that is asked for, this machine if none is.

    Limited to this machine a node receives on the loopback interface only, unless a profile of Fast DDS is given.
    """
    asked = os.environ.get(RANGE, "").upper()
    if asked not in ("", "OFF", LOCALHOST):  # OFF stops discovery on this machine, too
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
