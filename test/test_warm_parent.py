"""Processes forked from a warm parent: they are the runner's own, survive it, and a new one takes its place."""

import ctypes
import os
import select
import signal
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from lowcostnav_ros.base.exit_codes import Exit
from lowcostnav_ros.graph import warm_parent
from lowcostnav_ros.graph.domain import free_domain, node_environment
from lowcostnav_ros.graph.process import NodeProcess
from lowcostnav_ros.graph.warm_parent import WarmParent

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="orphans are adopted by a process on Linux only")


@pytest.fixture
def parent(tmp_path):
    with free_domain() as domain:
        made = WarmParent(["monitor"], node_environment(domain, tmp_path), tmp_path / "parent.log")
        yield made
        made.end()


def forked(parent: WarmParent, executable: str, log: Path) -> warm_parent.Forked | None:
    with log.open("ab") as out:
        return parent.fork([sys.executable, "-m", "lowcostnav_ros.nodes.dispatch", executable], out.fileno(), out.fileno())


def stated(pid: int) -> tuple[int, str]:
    """Parent and command line of a process, as the kernel states them."""
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1]), Path(f"/proc/{pid}/cmdline").read_text()


def is_adopting() -> bool:
    value = ctypes.c_int()
    ctypes.CDLL(None).prctl(37, ctypes.byref(value), 0, 0, 0)  # PR_GET_CHILD_SUBREAPER
    return bool(value.value)


def test_what_is_forked_is_the_runners_own_and_outlives_its_warm_parent(parent, tmp_path, monkeypatch):
    parent.begin()
    parent.prepare(tmp_path)
    refused = forked(parent, "nothing", tmp_path / "nothing.log")
    assert refused.wait(20.0) == Exit.CANNOT_RUN and "There is no executable 'nothing'" in (tmp_path / "nothing.log").read_text()
    node = forked(parent, "monitor", tmp_path / "monitor.log")
    killed = parent._process
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait(10.0)
    assert forked(parent, "monitor", tmp_path / "monitor.log") is None  # nothing in flight waits for the next one to get ready
    assert parent._process is not killed and select.select([parent._socket], [], [], 30.0)[0]
    assert node.poll() is None
    assert not is_adopting(), "orphans of others would stay here, never waited for"
    adopter, command = stated(node.pid)
    assert adopter == os.getpid() and command.rstrip("\0").split("\0")[1:] == ["-m", "lowcostnav_ros.nodes.dispatch", "monitor"]
    node.kill()
    assert node.wait(10.0) == -signal.SIGKILL

    pids = []
    monkeypatch.setattr(warm_parent, "Forked", pids.append)
    monkeypatch.setattr(warm_parent.os, "write", lambda *_: pytest.fail("must not be called") if not pids else os.close(-1))
    assert forked(parent, "monitor", tmp_path / "monitor.log") is None  # its id came, and then something failed: it must not fly
    assert os.waitstatus_to_exitcode(os.waitpid(pids[0], 0)[1]) == 1


def test_without_adoption_a_node_is_started_as_a_command(parent, tmp_path, monkeypatch):
    monkeypatch.setattr(warm_parent.sys, "platform", "other")
    parent.begin()
    process = NodeProcess("x", "monitor", [], dict(os.environ), tmp_path / "x.log", parent=parent)
    process._command = [sys.executable, "-S", "-c", "raise SystemExit(3)"]
    process.start()
    assert process.process.wait(10.0) == 3 and parent._process is None
