"""The manoeuvre switch by body rates: how soon it opens, that it does not flicker, and what the slower one does to a turn."""

import math

import numpy as np
import pytest
from ahrs_flights import T0, Turn

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.estimation.manoeuvre import ManoeuvreSwitch, RateSwitch, RateSwitchSettings, SteadyLimits, follow_switch, switch_limits
from lowcostnav_ros.reproduce.gebre.attitude_switch import turning_flight
from lowcostnav_ros.studies.attitude_filters import HEADING_SWITCH, RATE_SWITCH, accel_mag_filter

DEG = math.pi / 180.0
LIMITS = switch_limits(SteadyLimits(), RateSwitchSettings())
DOWN, LEVEL = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -9.80665])


def steps(rates_dps: list[float], axis: int, dt: float = 0.05) -> list[bool]:
    """Steady or not, sample by sample, of a rate about one axis."""
    memory, out = np.zeros(5), []
    for rate in rates_dps:
        w = np.zeros(3)
        w[axis] = rate * DEG
        out.append(follow_switch(memory, LIMITS, LEVEL, w, DOWN, dt))
    return out


def test_closes_after_the_hold_off_and_opens_within_a_tenth_of_a_second_of_roll_in():
    history = steps([0.0] * 40 + [10.0] * 10, 0)
    assert history.index(True) == 19  # 1 s of quiet at 20 Hz
    assert not any(history[41:])  # 10 deg/s seen through 0.2 s passes 2 deg/s in 45 ms


@pytest.mark.parametrize(("rate_dps", "steady"), [(0.45, True), (0.6, False)])
def test_yaw_rate_limit_is_the_source_s(rate_dps, steady):
    assert steps([rate_dps] * 200, 2)[-1] is steady


def test_released_only_below_the_smaller_limit():
    assert not steps([1.0] * 100 + [0.45] * 200, 2)[-1]
    assert steps([1.0] * 100 + [0.3] * 200, 2)[-1]


@pytest.mark.parametrize(("load", "steady"), [(1.045, True), (1.06, False), (0.94, False)])
def test_load_limit_is_the_source_s(load, steady):
    """(4.67) has two halves: a pull-up without any turn is no steady flight either."""
    memory = np.zeros(5)
    assert [follow_switch(memory, LIMITS, load * LEVEL, np.zeros(3), DOWN, 0.05) for _ in range(200)][-1] is steady
    slow = ManoeuvreSwitch(SteadyLimits())
    stamps = T0 + 50_000_000 * np.arange(1, 201, dtype=np.int64)
    slow.restart(T0)
    slow.follow(ImuBlock.of("imu/data_raw", stamps, np.tile(load * LEVEL, (200, 1)), np.zeros((200, 3))), 0, 200)
    slow.decide(np.eye(3), np.zeros(3))
    assert (slow.steady_since_ns is not None) is (abs(load - 1.0) < SteadyLimits().force_g * SteadyLimits().release)


@pytest.mark.parametrize(("feedback", "load", "fed"), [(2, 1.04, 10), (2, 1.06, 0), (4, 1.06, 0), (3, 1.06, 0), (1, 1.06, 10)])
def test_a_load_alone_stops_the_feedback(feedback, load, fed):
    rates, forces = np.zeros((200, 3)), np.tile(load * LEVEL, (200, 1))
    _, used, _ = accel_mag_filter(np.zeros(3), rates, forces, np.zeros(10), 20, 0.97, 0.35, 0.05, feedback, LIMITS)
    assert used.sum() == fed


def test_cut_of_the_blocks_does_not_matter():
    turn, results = Turn(1.0), []
    block = turn.imu(0.0, 5.0)
    for cut in (500, 7):
        switch = RateSwitch(SteadyLimits(), RateSwitchSettings())
        switch.restart(T0)
        switch.begin_span()
        for start in range(0, 500, cut):
            part = slice(start, start + cut)
            rows = (block.stamps_ns[part], block.specific_force_b[part], block.angular_rate_b[part])
            piece = ImuBlock.of(block.source, *rows)
            switch.follow(piece, 0, len(piece), turn.dcm(0.0), np.zeros(3))
        results.append((switch.is_steady, switch._memory.copy(), switch._total.copy()))
    np.testing.assert_array_equal(results[0][1], results[1][1])
    np.testing.assert_array_equal(results[0][2], results[1][2])
    assert results[0][0]


@pytest.mark.parametrize(("feedback", "lowest", "highest"), [(HEADING_SWITCH, 1.5, 5.0), (RATE_SWITCH, 0.0, 0.02)])
def test_roll_in_between_two_updates_spoils_the_heading_switch_only(feedback, lowest, highest):
    truth, rates, forces = turning_flight(60.5)
    heading = truth[19::20, 2]
    found, _, _ = accel_mag_filter(np.zeros(3), rates, forces, heading, 20, 0.97, 0.35, 0.05, feedback, LIMITS)
    rms = math.sqrt(np.mean((found[:, 0] - truth[:, 0]) ** 2)) / DEG
    assert lowest <= rms < highest
