"""Fixtures for tests with live nodes: a ROS domain of one's own, a context in this process, processes that end."""

import os
import signal
import subprocess
import sys
import time

import pytest
from hypothesis import settings

from lowcostnav_ros.base import kernels
from lowcostnav_ros.graph.domain import free_domain, node_environment

settings.register_profile("compiled", deadline=None)  # the first example pays for compilation
settings.load_profile("compiled")
kernels.tell = lambda words: None  # what a command prints is compared to the letter, wherever kernels are compiled first


@pytest.fixture
def domain():
    """A ROS domain nobody else on this machine uses."""
    with free_domain() as number:
        yield number


class Harness:
    """One context and executor in this process; ``spin_until`` waits on a condition, never on a fixed time."""

    def __init__(self, domain_id: int) -> None:
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain_id)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.probe = self.add(rclpy.create_node("probe", context=self.context))

    def add(self, node):
        self.executor.add_node(node)
        return node

    def make(self, factory, **parameters):
        """Build a node with parameter values (a double underscore stands for the dot)."""
        from rclpy.parameter import Parameter

        overrides = [Parameter(name.replace("__", "."), value=value) for name, value in parameters.items()]
        return self.add(factory(context=self.context, parameter_overrides=overrides))

    def spin_until(self, condition, timeout_s: float = 8.0) -> bool:
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if condition():
                return True
            self.spin_once()
        return condition()

    def spin_once(self) -> None:
        polled = sum(node.poll() for node in self.executor.get_nodes() if hasattr(node, "poll"))
        self.executor.spin_once(timeout_sec=0.0 if polled else 0.01)

    def diagnostics(self) -> dict:
        """A table of the last status by name, filled as the executor spins."""
        from diagnostic_msgs.msg import DiagnosticArray

        table: dict = {}
        self.probe.create_subscription(DiagnosticArray, "/diagnostics", lambda m: table.update({s.name: s for s in m.status}), 50)
        return table

    def close(self) -> None:
        for node in list(self.executor.get_nodes()):
            node.destroy_node()
        self.executor.shutdown()
        self.context.try_shutdown()


@pytest.fixture
def ros(domain, monkeypatch):
    """A harness on a domain of its own; skipped where rclpy is not installed."""
    pytest.importorskip("rclpy")
    for key, value in node_environment(domain).items():
        monkeypatch.setenv(key, value)
    harness = Harness(domain)
    yield harness
    harness.close()


@pytest.fixture
def start(domain, tmp_path):
    """Start node processes: ``start('ins_gps', '-p', 'name:=value') -> Popen`` with ``.log``; all are ended, by force if need be."""
    started = []

    def run(executable: str, *ros_args: str) -> subprocess.Popen:
        log = tmp_path / f"{executable}_{len(started)}.log"
        command = [sys.executable, "-m", "lowcostnav_ros.nodes.dispatch", executable, "--ros-args", *ros_args]
        with log.open("wb") as out:
            process = subprocess.Popen(
                command, stdout=out, stderr=out, env=node_environment(domain, tmp_path), cwd=tmp_path, start_new_session=True
            )
        process.log = log
        started.append(process)
        return process

    yield run
    for process in started:
        if process.poll() is None:
            os.kill(process.pid, signal.SIGKILL)
        process.wait()
