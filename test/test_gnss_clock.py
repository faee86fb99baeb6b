"""Receiver clock: exact noise by Van Loan, Allan deviation by allantools; resets, jumps and a clock that runs away."""

import math

import allantools
import numpy as np
import pytest

from lowcostnav_ros.estimation.kalman import van_loan
from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss.clock_watch import MILLISECOND_M, ClockWatch
from lowcostnav_ros.gnss.gps_time import SECOND
from lowcostnav_ros.gnss.raw_epoch import RawEpoch
from lowcostnav_ros.gnss.receiver_clock import CLOCKS, ClockModel, process_noise, simulate, transition
from lowcostnav_ros.gnss.signals import SPEED_OF_LIGHT


@pytest.mark.parametrize(
    ("name", "white", "walk"),
    [
        ("compensated_crystal", 8.988e-3, 3.548e-2),
        ("ovenized_crystal", 3.595e-3, 7.096e-5),
        ("rubidium", 8.988e-4, 7.096e-11),
    ],
)
def test_densities_in_metres(name, white, walk):
    assert (CLOCKS[name].bias_psd(), CLOCKS[name].drift_psd()) == pytest.approx((white, walk), rel=1e-3)


@pytest.mark.parametrize("dt", [0.01, 0.1, 1.0, 30.0])
def test_noise_is_exact(dt):
    model = CLOCKS["compensated_crystal"]
    Phi, Q = van_loan(np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([model.bias_psd(), model.drift_psd()]), dt)
    assert process_noise(model, dt) == pytest.approx(Q, rel=1e-9)
    assert transition(dt) == pytest.approx(Phi)


def test_simulated_clock_has_its_allan_deviation_and_blocks_join():
    model = CLOCKS["compensated_crystal"]
    whole = simulate(model, 1.0, 60_000, np.random.default_rng(5), np.zeros(2))
    rng, state = np.random.default_rng(5), np.zeros(2)
    joined = np.vstack([simulate(model, 1.0, n, rng, state) for n in (1, 999, 59_000)])
    assert np.array_equal(joined, whole)
    taus, measured, _, _ = allantools.oadev(whole[:, 0] / SPEED_OF_LIGHT, rate=1.0, data_type="phase", taus=[1.0, 4.0, 16.0, 64.0])
    expected = np.sqrt(0.5 * model.h0 / taus + 2.0 * np.pi**2 / 3.0 * model.h_minus2 * taus)
    assert measured == pytest.approx(expected, rel=0.08)


def test_a_noiseless_clock_and_a_senseless_one():
    state = np.array([5.0, 0.5])
    assert simulate(ClockModel(0.0, 0.0), 2.0, 2, np.random.default_rng(0), state).tolist() == [[6.0, 0.5], [7.0, 0.5]]
    with pytest.raises(GnssError, match="finite and not negative"):
        ClockModel(-1e-20, 0.0)


def epoch(k, extra=0.0, one=0.0, doppler=True, sats=(1, 2, 3, 4, 5)):
    rates = np.linspace(-600.0, 600.0, len(sats)) + 200.0
    ranges = 2.2e7 + 1e6 * np.arange(len(sats)) + rates * k + extra
    ranges[0] += one
    rates = rates if doppler else rates * math.nan
    return RawEpoch(k * SECOND, np.full(len(sats), "G"), np.array(sats), ranges, rates, np.zeros(len(sats)))


@pytest.mark.parametrize("doppler", [True, False])
@pytest.mark.parametrize("ms", [-3, 1, 20])
def test_a_clock_reset_is_named_with_its_size(doppler, ms):
    watch = ClockWatch()
    assert watch.observe(epoch(0, doppler=doppler)).sentences == ()
    assert watch.observe(epoch(30, doppler=doppler)).sentences == ()
    report = watch.observe(epoch(60, ms * MILLISECOND_M, doppler=doppler))
    assert report.reset_ms == ms
    assert report.jumped == ()
    assert report.sentences == (f"The receiver set its clock by {ms} ms.",)
    assert watch.observe(epoch(90, ms * MILLISECOND_M, doppler=doppler)).reset_ms == 0


def test_a_single_jump_is_named_and_is_no_reset():
    watch = ClockWatch()
    watch.observe(epoch(0))
    report = watch.observe(epoch(1, one=MILLISECOND_M))
    assert report.reset_ms == 0
    assert report.jumped == (("G", 1),)
    assert report.sentences == ("The pseudorange of G01 jumped by 1 ms; leave it out.",)


def test_without_a_way_to_tell_nothing_is_claimed():
    watch = ClockWatch()
    watch.observe(epoch(0, doppler=False))
    assert watch.observe(epoch(200, MILLISECOND_M, doppler=False)).reset_ms == 0
    watch = ClockWatch()
    watch.observe(epoch(0))
    assert watch.observe(epoch(1, sats=(11, 12, 13))).sentences == ()
    alone = ClockWatch()
    alone.observe(epoch(0, sats=(1,)))
    assert alone.observe(epoch(1, MILLISECOND_M, sats=(1,))).jumped == (("G", 1),)


def test_a_clock_that_runs_away_is_named_and_a_reset_is_not_taken_for_it():
    watch = ClockWatch()
    watch.observe(epoch(0))
    assert watch.solved(0, 1000.0) == ""
    watch.observe(epoch(1, -MILLISECOND_M))
    assert watch.solved(SECOND, 1200.0 - MILLISECOND_M) == ""
    assert "runs away at 5000 m/s (16.7 ppm)" in watch.solved(2 * SECOND, 6200.0 - MILLISECOND_M)
