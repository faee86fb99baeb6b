"""Allan deviation against the printed standard series, allantools, and closed forms."""

import allantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from lowcostnav_ros.calibration import allan_models as model
from lowcostnav_ros.calibration.allan import allan_chart, cluster_sizes, equivalent_degrees, local_slopes
from lowcostnav_ros.calibration.allan_fit import first_minimum, fit_chart
from lowcostnav_ros.calibration.record import CalibrationError, regular_rate
from lowcostnav_ros.physics.stochastic import GaussMarkov, initial_state, simulate


@pytest.fixture(scope="module")
def standard_series():
    """The 1000-point linear-congruential series of NIST SP 1065, section 12.4 (frequency data)."""
    state, series = 1234567890, []
    for _ in range(1000):
        series.append(state / 2147483647.0)
        state = 16807 * state % 2147483647
    return np.array(series)


@pytest.mark.parametrize(
    ("overlapping", "printed"),
    [(False, (2.922319e-01, 9.965736e-02, 3.897804e-02)), (True, (2.922319e-01, 9.159953e-02, 3.241343e-02))],
)
def test_standard_series_to_all_printed_digits(standard_series, overlapping, printed):
    chart = allan_chart(standard_series, 1.0, np.array([1.0, 10.0, 100.0]), overlapping)
    for ours, theirs in zip(chart.deviation, printed, strict=True):
        assert f"{ours:.6e}" == f"{theirs:.6e}"


@pytest.mark.parametrize("overlapping", [True, False])
def test_same_as_allantools_at_any_rate(standard_series, overlapping):
    chart = allan_chart(standard_series, 20.0, overlapping=overlapping)
    theirs = (allantools.oadev if overlapping else allantools.adev)(standard_series, 20.0, "freq", chart.tau_s)
    assert len(theirs[0]) >= len(chart.tau_s) - 3  # allantools leaves out points of one or two pairs
    np.testing.assert_allclose(chart.deviation[: len(theirs[1])], theirs[1], rtol=1e-9)


@pytest.mark.parametrize(("slope", "alpha"), [(-1.0, 2), (-0.5, 0), (0.0, -1), (0.5, -2)])
@pytest.mark.parametrize("size", [1, 7, 60])
def test_degrees_of_freedom_are_those_of_the_simple_table(slope, alpha, size):
    theirs = allantools.edf_simple(1001, size, alpha)
    if (size, alpha) == (1, -1):
        theirs *= 999.0  # the table has (N - 2)^2 here; allantools drops the square and finds less than one degree in 1000 samples
    assert equivalent_degrees(slope, 1001, size) == pytest.approx(theirs, rel=1e-12)


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng, inside, total = np.random.default_rng(1), 0, 0
    for _ in range(200):
        chart = allan_chart(rng.standard_normal(2000), 1.0, np.array([1.0, 10.0, 100.0]))
        truth = np.sqrt(model.white(chart.tau_s))
        inside += np.count_nonzero((chart.low < truth) & (truth < chart.high))
        total += 3
    assert inside / total == pytest.approx(0.683, abs=0.06)


def spectral_integral(psd, tau_s):
    """Equation C.5, in the frequency variable, on a fine grid up to where sin^4/x^2 is negligible."""
    value = quad(lambda f: 4.0 * psd(f) * np.sin(np.pi * f * tau_s) ** 4 / (np.pi * f * tau_s) ** 2, 1e-12, 30.0 / tau_s, limit=2000)
    return value[0]


@pytest.mark.parametrize("tau_s", [1.0, 10.0, 189.0, 2000.0])
def test_gauss_markov_variance_is_the_spectral_integral(tau_s):
    process = GaussMarkov(0.3, 100.0)
    assert model.gauss_markov(tau_s, 0.3, 100.0) == pytest.approx(spectral_integral(process.psd, tau_s), rel=2e-2)


def test_gauss_markov_peak_series_and_limits():
    x = np.geomspace(1e-5, 100.0, 200_001)
    deviation = np.sqrt(model.gauss_markov(x, 1.0, 1.0))
    assert deviation.max() == pytest.approx(0.6173, abs=1e-4)
    assert x[np.argmax(deviation)] == pytest.approx(1.892, rel=1e-2)
    ahead, behind = model.gauss_markov(np.array([0.9999e-3, 1.0001e-3]), 1.0, 1.0)
    assert behind / ahead == pytest.approx(1.0002, abs=1e-6)  # the series joins the closed form
    assert model.gauss_markov(1e-4, 1.0, 1.0) == pytest.approx(model.random_walk(1e-4, np.sqrt(2.0)), rel=1e-4)
    assert model.gauss_markov(1e5, 1.0, 1.0) == pytest.approx(2e-5, rel=1e-4)


@pytest.mark.parametrize(
    ("density", "sigma", "tau_s", "time", "low"),
    [
        (0.05, 0.01, 1000.0, 231.0, 0.0049),
        (0.05, 0.05, 1000.0, 40.0, 0.0113),
        (0.05, 0.05, 300.0, 22.0, 0.0151),
        (1.0, 1.2, 100.0, 11.0, 0.43),
    ],
)
def test_minimum_of_the_thesis_sensors(density, sigma, tau_s, time, low):
    averaging_s = tau_s * np.geomspace(1e-6, 1.892, 20_001)  # before the drift's own peak
    deviation = np.sqrt(model.white(averaging_s, density) + model.gauss_markov(averaging_s, sigma, tau_s))
    assert averaging_s[np.argmin(deviation)] == pytest.approx(time, rel=0.03)
    assert deviation.min() == pytest.approx(low, rel=0.02)


@given(rate=st.floats(1e-4, 1e3), offset=st.floats(-1e3, 1e3))
@settings(max_examples=30, deadline=None)
def test_a_ramp_has_its_closed_form_and_an_offset_does_not_matter(rate, offset):
    t = np.arange(1000) * 0.1
    chart = allan_chart(offset + rate * t, 10.0)
    np.testing.assert_allclose(chart.deviation, np.sqrt(model.ramp(chart.tau_s, rate)), rtol=1e-6 + 1e-11 * abs(offset) / rate)
    assert local_slopes(chart) == pytest.approx(1.0, abs=1e-3)


@given(scale=st.floats(1e-6, 1e6), seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_deviation_scales_with_the_samples(scale, seed):
    values = np.random.default_rng(seed).standard_normal(500)
    np.testing.assert_allclose(allan_chart(scale * values, 1.0).deviation, scale * allan_chart(values, 1.0).deviation, rtol=1e-9)


def test_density_does_not_depend_on_the_sampling_rate():
    values = np.random.default_rng(2).standard_normal(400_000)
    fast, slow = allan_chart(values, 100.0), allan_chart(values.reshape(-1, 4).mean(axis=1), 25.0)
    assert fit_chart(fast).white_density == pytest.approx(0.1, rel=0.01)
    assert fit_chart(slow).white_density == pytest.approx(0.1, rel=0.01)


def test_fit_finds_white_noise_and_drift_of_a_long_record():
    rng, process = np.random.default_rng(3), GaussMarkov(0.05, 300.0)
    values = simulate(process, 1.0, 200_000, rng, initial_state(process, rng))[0][:, 0] + 0.05 * rng.standard_normal(200_000)
    chart = allan_chart(values, 1.0)
    fit = fit_chart(chart)
    assert fit.white_density == pytest.approx(0.05, rel=0.02)
    assert fit.drift_sigma == pytest.approx(0.05, rel=0.1)
    assert fit.drift_tau_s == pytest.approx(300.0, rel=0.2)
    assert fit.drift_tau_observed
    assert fit.minimum_s == pytest.approx(22.0, rel=0.5)
    assert fit.bias_instability == pytest.approx(0.0151 / 0.664, rel=0.05)
    assert chart.tau_s[first_minimum(chart)] == fit.minimum_s
    names = [name for name, _, _ in fit.slopes]
    assert names[0] == "white"
    assert "flicker" in names  # the flat bottom


def test_white_noise_alone_shows_no_drift_and_a_random_walk_shows_no_correlation_time():
    rng = np.random.default_rng(4)
    white = fit_chart(allan_chart(rng.standard_normal(50_000), 10.0))
    assert (white.drift_sigma, white.drift_tau_s) == (0.0, 0.0)
    assert white.white == pytest.approx(np.sqrt(0.1), rel=0.02)
    walk = fit_chart(allan_chart(np.cumsum(0.01 * rng.standard_normal(50_000)) + rng.standard_normal(50_000), 1.0))
    assert walk.random_walk == pytest.approx(0.01, rel=0.1)
    assert not walk.drift_tau_observed or walk.drift_tau_s > 5_000.0


def test_of_a_record_too_short_to_know_anything_well_what_is_known_best_is_compared():
    chart = allan_chart(np.random.default_rng(5).standard_normal(50), 10.0)
    factor, at_s = fit_chart(chart).misses(chart)
    assert 1.0 <= factor < 10.0 and at_s >= 0.1


def test_cluster_sizes_grow_to_half_the_record():
    sizes = cluster_sizes(1001)
    assert (sizes[0], sizes[-1]) == (1, 500)
    assert np.all(np.diff(sizes) > 0)
    assert len(cluster_sizes(10_001, per_decade=3)) == 12  # 3.7 decades


def test_averaging_times_beyond_half_the_record_are_named_in_seconds():
    with pytest.raises(CalibrationError, match=r"one sample \(0.1 s\) and half the record \(5 s\)"):
        allan_chart(np.random.default_rng(1).standard_normal(100), 10.0, tau_s=np.array([6.0]))


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ([], "no samples"),
        (np.arange(10.0), "only 10 samples"),
        (np.full(100, 2.5), "frozen"),
        (np.where(np.arange(100) == 7, np.nan, np.arange(100.0)), "1 of 100 samples"),
        (np.zeros((100, 3)), "one column"),
    ],
)
def test_unusable_records_are_refused_with_a_sentence(values, word):
    with pytest.raises(CalibrationError, match=word) as refusal:
        allan_chart(np.asarray(values), 1.0)
    assert str(refusal.value).endswith(".")


def test_averaging_times_beyond_the_record_are_refused():
    with pytest.raises(CalibrationError, match="half the record"):
        allan_chart(np.arange(100.0), 1.0, np.array([51.0]))
    with pytest.raises(CalibrationError, match="positive number of hertz"):
        allan_chart(np.arange(100.0), 0.0)


def test_rate_of_stamps_tolerates_jitter_and_refuses_gaps_and_steps_back():
    t = np.arange(5000) * 0.01
    jitter = np.random.default_rng(5).uniform(-0.002, 0.002, 5000)
    assert regular_rate(t + jitter) == pytest.approx(100.0, rel=1e-3)
    with pytest.raises(CalibrationError, match="not the usual"):
        regular_rate(np.delete(t, np.arange(0, 5000, 100)))
    with pytest.raises(CalibrationError, match="backwards"):
        regular_rate(t[::-1])
    with pytest.raises(CalibrationError, match="not finite"):
        regular_rate(np.array([0.0, np.nan, 1.0]))
