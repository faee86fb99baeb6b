"""The doctor's lines: ok, or what to do."""

import os
from time import struct_time

import pytest

from lowcostnav_ros.cli import doctor


@pytest.mark.parametrize(
    ("name", "value", "check", "advice"),
    [
        ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp", doctor.check_rmw, "set it to rmw_fastrtps_cpp"),
        ("ROS_LOCALHOST_ONLY", "1", doctor.check_environment, "unset ROS_LOCALHOST_ONLY"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "off", doctor.check_environment, "set it to LOCALHOST"),
    ],
)
def test_a_bad_variable_is_named_with_what_to_do(monkeypatch, name, value, check, advice):
    monkeypatch.setenv(name, value)
    finding = check()
    assert not finding.ok and advice in finding.text


def test_wheel_bootstrap_without_its_library_path_is_named(monkeypatch):
    monkeypatch.setenv("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "1")
    monkeypatch.delenv("LD_LIBRARY_PATH", raising=False)
    assert "unset _ROS_WHEELS_BOOTSTRAP_COMPLETE" in doctor.check_environment().text


def test_a_clock_that_lost_its_date_is_named(monkeypatch):
    monkeypatch.setattr(doctor.time, "gmtime", lambda: struct_time((1970, 1, 1, 0, 0, 0, 3, 1, 0)))
    assert doctor.check_clock().text == "the year is 1970: set the clock."


def test_shared_memory_that_is_missing_or_littered_is_named(tmp_path):
    assert doctor.check_shared_memory(tmp_path).ok
    assert "mount it" in doctor.check_shared_memory(tmp_path / "none").text
    left = tmp_path / "fastrtps_port7410"
    left.touch()
    os.utime(left, (0, 0))
    assert "fastdds shm clean" in doctor.check_shared_memory(tmp_path).text


def test_two_processes_find_each_other():
    pytest.importorskip("rclpy")
    assert doctor.check_discovery().ok
