"""Stochastic processes against closed forms, printed values and sample statistics."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm

from lowcostnav_ros.physics import stochastic as sto

PROCESSES = [sto.GaussMarkov(2.0, 30.0), sto.RandomConstant(1.5)]


def test_printed_gauss_markov_numbers():
    """sigma 0.007, T 227 s at 200 Hz."""
    process = sto.GaussMarkov(0.007, 227.0)
    assert process.transition(0.005) == pytest.approx(0.999977973811, abs=6e-13)
    assert math.sqrt(process.variance_increment(0.005)) == pytest.approx(4.646012e-5, rel=2e-7)
    assert process.driving_psd() == pytest.approx(4.317181e-7, rel=2e-7)


@given(st.floats(0.01, 10.0), st.floats(0.1, 1e4), st.floats(1e-3, 10.0))
def test_gauss_markov_step_against_van_loan(sigma, tau, dt):
    process = sto.GaussMarkov(sigma, tau)
    block = expm(np.array([[1 / tau, process.driving_psd()], [0.0, -1 / tau]]) * dt)
    assert process.transition(dt) == pytest.approx(block[1, 1], rel=1e-10)
    assert process.variance_increment(dt) == pytest.approx(block[1, 1] * block[0, 1], rel=1e-8)


@pytest.mark.parametrize("process", PROCESSES, ids=lambda p: type(p).__name__)
@given(dt=st.floats(1e-3, 100.0), parts=st.integers(2, 50))
def test_many_short_steps_equal_one_long_step(process, dt, parts):
    a, q = process.transition(dt / parts), process.variance_increment(dt / parts)
    variance = 0.0
    for _ in range(parts):
        variance = a * a * variance + q
    assert variance == pytest.approx(process.variance_increment(dt), rel=1e-10)
    assert a**parts == pytest.approx(process.transition(dt), rel=1e-10)


def test_gauss_markov_spectrum_integrates_to_its_variance_and_transforms_to_its_autocorrelation():
    process = sto.GaussMarkov(2.0, 30.0)
    assert 2 * quad(process.psd, 0, np.inf)[0] == pytest.approx(4.0, rel=1e-6)
    assert process.psd(0.0) == pytest.approx(2 * quad(process.autocorrelation, 0, 1000)[0], rel=1e-6)
    assert process.autocorrelation(30.0) == pytest.approx(4.0 / math.e)
    assert process.sigma_from_known(1e6) == pytest.approx(2.0)
    assert process.sigma_from_known(10.0) ** 2 == pytest.approx(process.variance_increment(10.0))


@pytest.mark.parametrize("process", PROCESSES, ids=lambda p: type(p).__name__)
@given(cuts=st.lists(st.integers(0, 200), max_size=5))
def test_cutting_a_run_into_blocks_changes_no_bit(process, cuts):
    state = sto.initial_state(process, np.random.default_rng(5), axes=3)
    whole, last = sto.simulate(process, 0.01, 200, np.random.default_rng(7), state)
    rng, pieces, edges = np.random.default_rng(7), [], [0, *sorted(cuts), 200]
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        values, state = sto.simulate(process, 0.01, b - a, rng, state)
        pieces.append(values)
    np.testing.assert_array_equal(np.concatenate(pieces), whole)
    np.testing.assert_array_equal(state, last)


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_simulated_gauss_markov_has_its_sigma_and_correlation_time_at_any_rate(rate_hz):
    process, dt = sto.GaussMarkov(2.0, 10.0), 1.0 / rate_hz
    rng = np.random.default_rng(11)
    values, _ = sto.simulate(process, dt, int(400 * rate_hz), rng, sto.initial_state(process, rng, axes=500))
    assert values.var() == pytest.approx(4.0, rel=0.03)  # 500 runs of 40 correlation times: 1.2 % sigma
    assert values[0].var() == pytest.approx(4.0, rel=0.25)  # stationary from the first sample
    lag = int(10 * rate_hz)
    assert np.mean(values[lag:] * values[:-lag]) == pytest.approx(4.0 / math.e, rel=0.05)


def test_a_simulated_constant_is_drawn_once():
    rng = np.random.default_rng(3)
    constant, _ = sto.simulate(sto.RandomConstant(1.5), 0.1, 5, rng, sto.initial_state(sto.RandomConstant(1.5), rng, 4000))
    assert np.ptp(constant, axis=0).max() == 0.0
    assert constant[0].std() == pytest.approx(1.5, rel=0.05)


def test_angle_random_walk_is_the_integral_of_the_noise_it_describes():
    """0.05 deg/s per sample at 20 Hz for 600 s: 0.05 sqrt(600/20) = 0.274 deg; the same through the density."""
    assert sto.angle_random_walk(0.05, 20.0, 600.0) == pytest.approx(0.273861, abs=1e-6)
    density = sto.white_density(0.05, 20.0, "per_sample")
    assert density * math.sqrt(600.0) == pytest.approx(0.273861, abs=1e-6)
    assert sto.white_density(0.05, 20.0, "one_hz") == 0.05


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: sto.GaussMarkov(1.0, 0.0), "tau"),
        (lambda: sto.RandomConstant(-1.0), "sigma"),
        (lambda: sto.RandomConstant(math.nan), "sigma"),
        (lambda: sto.white_density(1.0, 1.0, "peak"), "per_sample"),
        (lambda: sto.simulate(sto.RandomConstant(1.0), 0.0, 1, np.random.default_rng(), np.zeros(1)), "sample interval"),
    ],
)
def test_nonsense_is_refused_by_name(make, words):
    with pytest.raises(ValueError, match=words):
        make()
