"""Corrections that go one way, a heading that no wind explains, and fixes that only scatter."""

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.units import DEGREE
from lowcostnav_ros.cores.imu_errors import ImuSettings, bias_blocks, core_block
from lowcostnav_ros.estimation.cross_checks.heading import OwnHeadingCheck
from lowcostnav_ros.estimation.error_state import Layout
from lowcostnav_ros.estimation.one_way import OneWay
from lowcostnav_ros.estimation.time_offsets import TimeOffsets
from lowcostnav_ros.navigators.supervisor.candidate import Candidate
from lowcostnav_ros.physics.earth import displace

SECOND = 1_000_000_000
LAYOUT = Layout([core_block(ImuSettings()), *bias_blocks(ImuSettings())])
SIGMA = 0.05 * DEGREE


def fed(duration_s, drift=0.0, seed=1, late=0.0):
    """When corrections of 2 Hz with sigma SIGMA, as their covariance says, and a drift, rad/s, of north call for larger sigmas."""
    rng, check, out = np.random.default_rng(seed), OneWay(LAYOUT, "imu", "gps"), []
    P, nothing = np.diag(np.r_[np.zeros(6), np.full(3, SIGMA**2), np.zeros(LAYOUT.size - 9)]), np.zeros((LAYOUT.size, LAYOUT.size))
    before, after = TimeOffsets(LAYOUT.size, None), TimeOffsets(LAYOUT.size, None)
    for offsets, error in ((before, late), (after, 0.0)):
        offsets.declare("gps/fix", 0.0)
        offsets.V[6:] = error / offsets.known["gps"].sigma_s
    for k in range(round(2 * duration_s)):
        correction = np.zeros(LAYOUT.size)
        correction[6:9] = rng.normal(size=3) * SIGMA
        correction[6] += 0.5 * drift
        check.before(P, before)
        least = check.take(k * SECOND // 2 + SECOND, correction, nothing, after)
        out.append((0.5 * k, least, check.held))
    return out


def test_white_corrections_call_for_next_to_nothing_and_name_nobody():
    out = [looked for seed in range(20) for looked in fed(300.0, seed=seed)]
    assert np.mean([least is not None for _, least, _ in out]) < 1e-3
    assert all(held is None for _, _, held in out)


def test_corrections_that_go_one_way_widen_attitude_and_sensors_and_are_named():
    out = fed(60.0, drift=0.4 * DEGREE)
    first = next(t for t, least, _ in out if least is not None)
    assert 0.0 < first < 5.0
    _, least, held = out[-1]
    moved = 0.4 * DEGREE * 30.0 * (1.0 - np.exp(-2.0))  # the sum that an exponential window of 30 s has come to in 60 s
    assert least[6] == pytest.approx(0.5 * moved, rel=0.1)
    assert least[9] == pytest.approx(9.80665 * least[6]) and least[12] == pytest.approx(least[6] / 30.0)
    assert not least[:6].any()
    assert held.name == "GPS corrects the attitude one way" and held.parties == ("imu", "gps")


def test_what_is_no_proof_yet_is_remembered_for_a_minute():
    check, nothing = OneWay(LAYOUT, "imu", "gps"), np.zeros((LAYOUT.size, LAYOUT.size))
    P = np.diag(np.r_[np.zeros(6), np.full(3, SIGMA**2), np.zeros(LAYOUT.size - 9)])
    for k in range(8):  # of one sigma each, one way
        correction = np.zeros(LAYOUT.size)
        correction[6] = 1.5 * SIGMA
        check.before(P, None)
        largest = check.follow(k * SECOND // 2 + SECOND, correction, nothing, None)
    assert 2.5 < largest < 5.0 and 1.5 * SIGMA < check.moved[0] < 12.0 * SIGMA and not check.moved[1:].any()
    seen = check.moved[0]
    for k in range(8, 128):
        check.before(P, None)
        check.follow(k * SECOND // 2 + SECOND, np.zeros(LAYOUT.size), nothing, None)
    assert check.moved[0] == pytest.approx(seen * np.exp(-1.0), rel=0.1)


def test_what_late_stamps_may_have_done_is_no_fault_of_the_sensors():
    assert all(least is None for _, least, _ in fed(20.0, drift=0.4 * DEGREE, late=0.1 * DEGREE))


def test_a_heading_is_taken_from_the_track_only_where_no_wind_explains_it():
    cases = (10.0, 50.0, 1.0, False), (40.0, 50.0, 1.0, False), (60.0, 50.0, 1.0, True), (60.0, 15.0, 1.0, False), (150.0, 15.0, 1.0, True)
    for apart_deg, speed, sigma_deg, taken in (*cases, (60.0, 50.0, 25.0, False)):
        check = OwnHeadingCheck("imu/data_raw")
        found = [check.compare(round(t * SECOND), apart_deg * DEGREE, sigma_deg * DEGREE, speed, 0.0) for t in np.arange(1.0, 4.0, 0.5)]
        assert any(f is not None for f in found) == taken
        if taken:
            assert found[:2] == [None, None]
            assert found[2] == pytest.approx(apart_deg * DEGREE)
            assert [f is not None for f in found[3:]] == [False, True, False]  # again after a second, not at once


def test_fixes_that_scatter_as_stated_do_not_contradict_their_velocity_and_a_jump_does():
    for seed in range(4):
        rng, candidate = np.random.default_rng(seed), Candidate("gps", fixes=True)
        for k in range(400):
            if k == 399:
                assert candidate.contradiction is None and not candidate.doubted_ns
            true_n = np.array([5.0 * k, 150.0 * (k == 399), 0.0])
            place = displace(0.66, -2.1, 500.0, true_n + rng.normal(size=3) * 8.0)
            sigmas = {"cov_pos": 64.0 * np.eye(3), "cov_vel": 0.01 * np.eye(3)}
            candidate.take(NavSolution(SECOND + k * SECOND // 10, "gps", *map(float, place), np.array([50.0, 0.0, 0.0]), **sigmas))
        assert candidate.contradiction is not None
