"""A stop may fall anywhere in the executor's cycle."""

import os
import subprocess
import sys

import pytest

SCRIPT = """
import sys, rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from lowcostnav_ros.ros.run import run

class Node:
    def spin(self):
        if {stopped}:
            rclpy.shutdown()
        raise rclpy_implementation.RCLError("failed to initialize wait set")

    def destroy_node(self):
        pass

sys.exit(run(Node, args=[]))
"""


@pytest.mark.parametrize(("stopped", "code"), [(True, 0), (False, 1)])
def test_wait_error_is_a_clean_stop_only_after_shutdown(stopped: bool, code: int) -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT.format(stopped=stopped)], capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == code, done.stderr


@pytest.mark.parametrize("text", ["hello", "a: [1", "", "ahrs: {rate: 1}"])
def test_a_parameter_file_that_holds_none_is_a_sentence_and_exit_status_2(tmp_path, text):
    (tmp_path / "p.yaml").write_text(text)
    command = [sys.executable, "-m", "lowcostnav_ros.nodes.dispatch", "monitor", "--ros-args", "--params-file", str(tmp_path / "p.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2 and str(tmp_path) in done.stderr and "Traceback" not in done.stderr


def test_security_that_cannot_be_had_is_a_sentence_and_exit_status_2(tmp_path):
    environment = {**os.environ, "ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce", "ROS_SECURITY_KEYSTORE": str(tmp_path)}
    command = [sys.executable, "-m", "lowcostnav_ros.nodes.dispatch", "monitor"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 2 and "ROS_SECURITY_ENABLE is true" in done.stderr and "Traceback" not in done.stderr
