"""A state from before a suspicion, flown on: what a slow spoofer leads away is covered, named, and comes back."""

import copy
import dataclasses

import numpy as np
import pytest
from test_contradictions import SECOND, flown, moved, shares, truth  # noqa: F401 - a fixture
from test_ins_gps import GPS_ONLY

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, ImuBlock
from lowcostnav_ros.estimation.inertial_spikes import Jolt
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.navigators.trust import LED_AWAY
from lowcostnav_ros.navigators.witness import BEFORE_NS, SPACING_NS, Witness

OUTPUT_NS = 100_000_000


def spoofer(rate, rise_s=10.0, start=70.0, end=125.0):
    """A false place that moves off north, velocity and all."""

    def lie(item, t):
        since = t - start
        if not start <= t < end or not isinstance(item, GpsPosition | GpsVelocity):
            return item
        if isinstance(item, GpsVelocity):
            return dataclasses.replace(item, vel_n=item.vel_n + [rate * min(1.0, since / rise_s), 0.0, 0.0])
        return moved(item, rate * (0.5 * since**2 / rise_s if since < rise_s else since - 0.5 * rise_s))

    return lie


@pytest.mark.parametrize("rate", [5.0, 10.0, 30.0])
def test_a_spoofer_that_is_followed_is_covered_and_the_solution_returns_from_far_away(truth, rate):  # noqa: F811
    navigator, solutions, modes = flown(truth, spoofer(rate))
    t, size, ratio = shares(truth, solutions)
    assert size[t < 125.0].max() > 20.0 * rate  # it was followed
    assert np.mean(ratio > 4.0) < 0.01
    seconds = np.array([1e-9 * (s.stamp_ns - truth.stamps_ns[0]) for s in solutions])
    led_away = np.array([mode == "suspect" and LED_AWAY in found for mode, found in modes])
    assert led_away[(seconds > 90.0) & (seconds < 125.0)].all()
    if rate < 10.0:  # in the end within what the inertial sensors alone know
        return
    assert size[t > 135.0].max() < 10.0 and not led_away[seconds > 135.0].any()  # GPS is where it was expected
    assert navigator.restarts["GPS is back where it was expected"] == 1 and navigator.mode == "gps"


def moves(duration_s, samples, seed=1):
    """Inertial samples at 100 Hz in blocks of so many, with a jolt among them."""
    rng, n = np.random.default_rng(seed), round(100 * duration_s)
    stamps = SECOND + np.arange(1, n + 1) * 10_000_000
    force = np.array([0.0, 0.0, -9.8]) + rng.normal(size=(n, 3)) * 0.1
    rate = rng.normal(size=(n, 3)) * 0.01
    for first in range(0, n, samples):
        rows = slice(first, first + samples)
        yield ImuBlock.of("imu/data_raw", stamps[rows], force[rows], rate[rows])


def core_of():
    core = InsGps(GPS_ONLY).core
    core.start(SECOND, np.array([0.66, -2.1, 900.0, 40.0, 30.0, 0.0, 1.0, 0.0, 0.0, 0.0]), 0.01 * np.eye(9))
    return core


def run(core, witness, blocks, until_ns, called_ns=None):
    """Move a core, keep copies of it at its outputs, call the witness at a time."""
    for block in blocks:
        witness.take(block)
        first = 0
        while first < len(block) and core.t_ns < until_ns:
            first = core.advance(block, first, OUTPUT_NS)
            if core.t_ns % OUTPUT_NS:
                continue
            if witness.core is not None:
                witness.follow(core.t_ns)
            elif called_ns is not None and core.t_ns >= called_ns:
                witness.call(core.t_ns, core.t_ns)
                core.nav[3] += 5.0  # from here on led away
            else:
                witness.keep(core)


@pytest.mark.parametrize("samples", [10, 7])
def test_a_witness_flies_to_the_bit_as_the_core_would_have_flown(samples):
    alone, led, witness = core_of(), core_of(), Witness(OUTPUT_NS)
    run(alone, Witness(OUTPUT_NS), moves(40.0, 10), 41 * SECOND)
    run(led, witness, moves(40.0, samples), 41 * SECOND, called_ns=31 * SECOND)
    assert witness.core.t_ns == led.t_ns == alone.t_ns
    assert np.array_equal(witness.core.nav, alone.nav) and np.array_equal(witness.core.P, alone.P)
    assert abs(led.nav[3] - alone.nav[3]) > 4.0


def test_no_copy_is_young_and_a_hole_ends_the_witness():
    core, witness = core_of(), Witness(OUTPUT_NS)
    blocks = list(moves(30.0, 10))
    run(core, witness, blocks[:200], 21 * SECOND)
    assert not copy.deepcopy(witness).call(core.t_ns - 20 * SECOND, core.t_ns)
    assert witness.call(core.t_ns, core.t_ns) and witness.core.t_ns == core.t_ns
    witness.take(blocks[260])  # six seconds are missing
    witness.follow(blocks[260].stamp_ns)
    assert witness.core is None
    assert BEFORE_NS > SPACING_NS


def test_a_jolt_reaches_the_witness_at_its_time():
    core, witness = core_of(), Witness(OUTPUT_NS)
    blocks, jolt = list(moves(30.0, 10)), Jolt(np.array([1.0, 0, 0, 0, 0, 0]), np.full(6, 0.01))
    run(core, witness, blocks[:250], 26 * SECOND)
    witness.disturb(jolt, core.t_ns)
    core.disturb(jolt.kick, jolt.variance)
    run(core, witness, blocks[250:], 31 * SECOND)
    assert witness.call(core.t_ns, core.t_ns)
    assert np.array_equal(witness.core.nav, core.nav)
