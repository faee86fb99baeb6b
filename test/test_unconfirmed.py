"""An airspeed that changes while no GPS confirms it."""

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirVelocity
from lowcostnav_ros.cores.reckoning import AirspeedSettings, HeldInputs
from lowcostnav_ros.estimation.unconfirmed import UnconfirmedSpeed

SECOND = 1_000_000_000


def allowed(speeds, confirmed=lambda k: k == 0, share=0.5):
    """Sigma gained in all, one speed a second."""
    doubt = UnconfirmedSpeed(share)
    return np.sqrt(sum(doubt.take(k * SECOND, float(v), confirmed=confirmed(k)) for k, v in enumerate(speeds)))


def test_a_steady_or_a_confirmed_airspeed_gains_nothing():
    assert allowed(np.full(60, 50.0)) == 0.0
    assert allowed(np.linspace(50.0, 20.0, 60), confirmed=lambda k: True) == 0.0


@pytest.mark.parametrize("fault", [np.r_[50.0, np.full(30, 65.0)], np.r_[50.0, np.full(30, 100.0)], np.linspace(50.0, 10.0, 41)])
def test_ice_a_jump_and_a_wrong_gain_are_covered_within_three_sigmas(fault):
    assert allowed(fault) > abs(fault[-1] - fault[0]) / 3.0


def test_gusts_gain_little_and_a_fault_that_ends_is_a_change_as_well():
    gusts = 50.0 + np.random.default_rng(1).normal(0.0, 0.7, 120)
    assert allowed(gusts) < 1.0
    there = allowed(np.r_[50.0, np.full(60, 90.0)])
    assert allowed(np.r_[50.0, np.full(60, 90.0), np.full(10, 50.0)]) > 1.2 * there


def test_a_pitot_that_reads_backwards_does_not_fly():
    held = HeldInputs()
    cov = np.diag([1.0, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])
    held.take_air(AirVelocity(SECOND, "air/velocity", np.array([30.0, 0.0, 0.0]), cov), AirspeedSettings())
    assert held.airborne
    held.take_air(AirVelocity(2 * SECOND, "air/velocity", np.array([-15.0, 0.0, 0.0]), cov), AirspeedSettings())
    assert not held.airborne and held.fastest == 30.0


@pytest.mark.parametrize(
    ("stamps_s", "fresh_s", "late_s"),
    [((0, 1, 2), 2.0, 2.1), ((0, 3, 6), 4.4, 4.6), ((0, 3, 60), 4.4, 4.6), ((0, 60, 120), 9.9, 10.1)],
)
def test_an_airspeed_that_comes_slowly_is_waited_for_and_a_gap_is_no_custom(stamps_s, fresh_s, late_s):
    held = HeldInputs(cov_att=np.zeros((3, 3)))
    cov = np.diag([1.0, UNKNOWN_VARIANCE, UNKNOWN_VARIANCE])
    for stamp_s in stamps_s:
        held.take_air(AirVelocity(stamp_s * SECOND, "air/velocity", np.array([30.0, 0.0, 0.0]), cov), AirspeedSettings())
    held.attitude_ns, last_ns = stamps_s[-1] * SECOND, stamps_s[-1] * SECOND
    assert held.timed_out(last_ns + round(fresh_s * SECOND), 30.0, AirspeedSettings().timeout_s) == ""
    assert held.timed_out(last_ns + round(late_s * SECOND), 30.0, AirspeedSettings().timeout_s).startswith("no airspeed for")
