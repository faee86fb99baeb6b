"""Identification of sensors at rest, warm-up, scale factor and wind change against known truths and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import correlate

from lowcostnav_ros.calibration.identification import autocorrelation, identify_static, white_scatter
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.calibration.temperature import WarmUp, fit_scale_factor, fit_warm_up
from lowcostnav_ros.physics.stochastic import GaussMarkov, initial_state, simulate
from lowcostnav_ros.studies.wind_change import travelling_time, wind_change_sigma


def record(sigma, tau_s, white, rate_hz, seconds, seed):
    rng, process = np.random.default_rng(seed), GaussMarkov(sigma, tau_s)
    n = int(seconds * rate_hz)
    drift = simulate(process, 1.0 / rate_hz, n, rng, initial_state(process, rng))[0][:, 0]
    return 0.3 + drift + white * rng.standard_normal(n)


def test_recipe_finds_what_was_put_in():
    found = identify_static(record(0.05, 100.0, 0.1, 20.0, 20_000.0, 1), 20.0)
    assert found.white_sigma == pytest.approx(0.1, rel=0.01)
    assert found.white_density == pytest.approx(0.1 / math.sqrt(20.0), rel=0.01)
    assert found.drift_sigma == pytest.approx(0.05, rel=0.15)
    assert found.correlation_time_s == pytest.approx(100.0, rel=0.3)
    assert found.correlation_time_sure
    assert abs(found.mean - 0.3) < 3.0 * found.mean_sigma
    assert found.long_term_sigma == pytest.approx(0.05 * math.sqrt(2 / 0.6 * (1 - (1 - math.exp(-0.6)) / 0.6)), rel=0.2)


def test_standard_error_of_the_mean_is_honest():
    errors = []
    for seed in range(60):
        found = identify_static(record(0.05, 100.0, 0.02, 1.0, 5_000.0, seed), 1.0)
        errors.append((found.mean - 0.3) / found.mean_sigma)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.3)


def test_white_noise_has_no_correlation_time():
    found = identify_static(np.random.default_rng(2).standard_normal(20_000), 10.0)
    assert (found.drift_sigma, found.correlation_time_s) == (0.0, None)
    assert found.mean_sigma == pytest.approx(1.0 / math.sqrt(20_000), rel=0.02)


def test_a_short_record_says_that_its_correlation_time_is_not_sure():
    found = identify_static(record(0.5, 300.0, 0.02, 1.0, 3_000.0, 3), 1.0)
    assert found.correlation_time_s is not None
    assert not found.correlation_time_sure


def test_scatter_about_local_lines_ignores_a_trend():
    noise = np.random.default_rng(4).standard_normal(10_000)
    assert white_scatter(noise + 0.01 * np.arange(10_000), 100.0) == pytest.approx(white_scatter(noise, 100.0), rel=1e-9)


def test_autocorrelation_is_that_of_scipy():
    values = np.random.default_rng(5).standard_normal(700)
    centred = values - values.mean()
    theirs = correlate(centred, centred, mode="full")[699 : 699 + 101] / (700 - np.arange(101))
    np.testing.assert_allclose(autocorrelation(values, 100), theirs, atol=1e-12)
    with pytest.raises(CalibrationError, match="longer record"):
        autocorrelation(values, 700)


@given(settled=st.floats(-1.0, 1.0), transient=st.floats(0.1, 2.0), tau_s=st.floats(200.0, 4000.0))
def test_warm_up_fit_inverts_the_model(settled, transient, tau_s):
    t = np.arange(0.0, 18_000.0, 60.0)
    found = fit_warm_up(t, WarmUp(settled, transient, tau_s).at(t))
    assert found.settled == pytest.approx(settled, abs=2e-3 * transient)
    assert found.transient == pytest.approx(transient, rel=1e-2)
    assert found.tau_s == pytest.approx(tau_s, rel=1e-2)


def test_warm_up_settles_when_it_says_and_no_transient_is_refused():
    warm = WarmUp(0.0, 1.0, 3600.0)
    assert warm.at(3 * 3600.0) == pytest.approx(0.05, rel=0.01)  # the three hours of the source
    with pytest.raises(CalibrationError, match="No warm-up"):
        fit_warm_up(np.arange(100.0), 2.0 * np.arange(100.0))


def test_scale_factor_slope_and_its_sigma():
    rng, temperature, misses = np.random.default_rng(6), np.linspace(0.0, 60.0, 13), []
    for _ in range(200):
        output = 5.0 * (1.0 + 4e-4 * (temperature - 30.0)) + 0.01 * rng.standard_normal(13)
        found = fit_scale_factor(temperature, output, 5.0)
        misses.append((found.slope_per_k - 4e-4) / found.slope_sigma_per_k)
    assert found.change(0.0, 60.0) == pytest.approx(0.024, rel=0.2)
    assert np.sqrt(np.mean(np.square(misses))) == pytest.approx(1.1, abs=0.2)  # Student, 11 degrees of freedom
    with pytest.raises(CalibrationError, match="at least three runs"):
        fit_scale_factor(np.full(5, 20.0), np.ones(5), 5.0)


def test_travelling_time_of_the_source_and_its_odd_double_counting():
    assert travelling_time(np.zeros(3), np.array([50.0, 0.0, 0.0]), 100.0) == 100.0
    straight = travelling_time(np.array([5000.0, 0.0, 0.0]), np.array([50.0, 0.0, 0.0]), 100.0)
    assert straight == pytest.approx(math.sqrt(2.0) * 100.0)  # steady flight counts twice, as printed
    assert travelling_time(np.array([0.0, 0.0, 300.0]), np.array([0.0, 0.0, 0.0]), 10.0) == 10.0
    assert wind_change_sigma(0.0) == 0.0
    assert wind_change_sigma(1e9) == pytest.approx(5.0)
    assert wind_change_sigma(400.0) == pytest.approx(5.0 * math.sqrt(1.0 - math.exp(-2.0)))
    assert wind_change_sigma(4.0) == pytest.approx(5.0 * math.sqrt(2.0 * 4.0 / 400.0), rel=0.01)


def test_noise_that_is_not_white_is_told_from_noise_that_is():
    """A moving average of four samples at 100 Hz: single samples foretell means four times too small, in variance."""
    white = np.random.default_rng(3).standard_normal(60_000)
    smoothed = np.convolve(white, np.full(4, 0.25), "valid")
    assert identify_static(white, 100.0).coloured[0] < 1.2
    assert identify_static(smoothed, 100.0).coloured[0] > 1.5
