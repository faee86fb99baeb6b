"""Axes that repeat one value, and a nose that leaves the way."""

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.estimation.cross_checks.flow import FlowWatch
from lowcostnav_ros.estimation.error_state import Kind
from lowcostnav_ros.estimation.inertial_spikes import InertialSpikes
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.navigators.silent_axes import FORCE, RATE
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_to_dcm

SECOND = 1_000_000_000
REST = np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0])


def heard(values, rate_hz=100.0, cut=10**9):
    """Changes of silence: time, s, and the axes."""
    stamps = SECOND + np.round(1e9 / rate_hz * np.arange(1, len(values) + 1)).astype(np.int64)
    screen, out = InertialSpikes(), []
    for first in range(0, len(values), cut):
        piece = slice(first, first + cut)
        block = ImuBlock.of("imu", stamps[piece], np.ascontiguousarray(values[piece, :3]), np.ascontiguousarray(values[piece, 3:]))
        for jolt, part, _ in screen.screen(block):
            if jolt is not None and jolt.silent is not None:
                out.append((1e-9 * (part.stamps_ns[0] - SECOND), np.flatnonzero(jolt.silent).tolist()))
    return out


def noisy(count=2000, step=0.002, seed=1):
    values = REST + np.random.default_rng(seed).standard_normal((count, 6)) * [0.1, 0.1, 0.1, 0.01, 0.01, 0.01]
    return np.round(values / step) * step


@pytest.mark.parametrize("cut", [10**9, 7])
def test_an_axis_that_repeats_itself_is_heard_within_a_fifth_of_a_second_however_blocks_are_cut(cut):
    values = noisy()
    values[1000:1500, 5] = 0.0
    (begins, silent), (ends, again) = heard(values, cut=cut)
    assert silent == [5] and again == []
    assert 10.0 < begins < 10.2 and ends == pytest.approx(15.01)


def test_coarse_sensors_and_values_read_twice_are_not_silent():
    assert heard(noisy(step=0.02)) == []  # a gyro of two steps either way
    assert heard(np.repeat(noisy(1000), 2, axis=0)) == []
    assert heard(np.tile(REST, (500, 1))) == []  # never spoke


def test_a_silent_axis_is_as_uncertain_as_the_motion_and_its_bias_comes_back():
    navigator = InsGps(InsGps.Settings())
    navigator.begin(SECOND, np.array([0.7, 0.1, 500.0, 50.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), np.eye(9) * 1e-4)
    rows = [np.flatnonzero((navigator.layout.kind == int(k)) & (navigator.layout.axis == 2))[0] for k in (Kind.GYRO_BIAS, Kind.ACCEL_BIAS)]
    navigator.core.estimate[rows] = 1e-3, 2e-3
    before = navigator.P.copy()
    silent = np.isin(np.arange(6), (2, 5))
    navigator.silent.take(SECOND, silent)
    navigator.silent.look(SECOND)
    assert np.sqrt(navigator.P[rows, rows]) == pytest.approx([RATE, FORCE])
    assert navigator.silent.held.name == "values never change" and "gyro z" in navigator.silent.held.advice
    navigator.core.estimate[rows] = 0.1, 1.0  # what the motion was taken for
    navigator.silent.take(2 * SECOND, np.zeros(6, dtype=bool))
    navigator.silent.look(2 * SECOND)
    assert navigator.core.estimate[rows] == pytest.approx([1e-3, 2e-3])
    assert navigator.P[rows, rows] == pytest.approx(before[rows, rows])


def flown(heading_deg, track_deg, pitch_deg=0.0, climb_mps=0.0, sigma_deg=0.5):
    """What is off after a flight of 10 Hz at 50 m/s (2,), deg."""
    watch, count = FlowWatch(), len(heading_deg)
    pitch, climb = np.broadcast_to(pitch_deg, count), np.broadcast_to(climb_mps, count)
    for k in range(count):
        C = quat_to_dcm(euler_to_quat(0.0, pitch[k] * DEGREE, heading_deg[k] * DEGREE))
        track = track_deg[k] * DEGREE
        vel_n = np.array([50.0 * np.cos(track), 50.0 * np.sin(track), -climb[k]])
        watch.take(10 * SECOND + k * SECOND // 10, C, vel_n, np.eye(6) * (sigma_deg * DEGREE) ** 2)
    return watch.off / DEGREE


def test_a_nose_that_leaves_the_way_is_told_from_wind_and_turns():
    t = np.arange(0.0, 60.0, 0.1)
    straight, turning = np.zeros(len(t)), 5.0 * t
    assert not flown(straight + 15.0, straight).any()  # a crab that was there before
    assert not flown(turning + 10.0 * np.sin(turning * DEGREE), turning).any()  # 9 m/s of wind in circles
    assert not flown(straight, straight, 3.0 * np.sin(t), 4.0 * np.sin(t)).any()
    gyro = np.clip(5.0 * (t - 50.0), 0.0, None)
    assert flown(gyro, straight)[0] > 30.0 and flown(gyro, straight)[1] == 0.0
    falling = np.clip(-9.8 * (t - 55.0), None, 0.0)
    assert flown(straight, straight, 0.0, falling)[1] > 25.0
    assert not flown(gyro, straight, sigma_deg=30.0).any()  # nobody knows where it points
