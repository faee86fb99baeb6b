"""Magnetometer fits against known distortions, their own predicted sigmas, and scipy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.calibration import magnetometer_fit as fits
from lowcostnav_ros.calibration.least_squares import condition_number, solve_least_squares
from lowcostnav_ros.calibration.magnetometer_batch import batch_fit, batch_rows
from lowcostnav_ros.calibration.magnetometer_collection import MagnetometerCollection
from lowcostnav_ros.calibration.magnetometer_full import full_fit
from lowcostnav_ros.calibration.magnetometer_known_strength import CalibrationPrior, known_strength_fit
from lowcostnav_ros.calibration.magnetometer_two_step import level_turn_fit, two_step, two_step_fit
from lowcostnav_ros.calibration.profile_text import calibration_text
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.catalogue.config_files import load_settings
from lowcostnav_ros.navigators.ahrs.navigator import AhrsSettings
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_to_dcm

HARD_IRON = np.array([5.0, -3.0, 8.0])
SCALE = np.array([1.04, 0.97, 1.02])
STRENGTH = 50.0


def strip(strip_deg, n, rng, swept=(-np.pi, np.pi)):
    """Fields of strength 50 in an equatorial strip, shape (n, 3)."""
    azimuth = rng.uniform(*swept, n)
    up = rng.uniform(-1.0, 1.0, n) * math.sin(math.radians(0.5 * strip_deg))
    level = np.sqrt(1.0 - up**2)
    return STRENGTH * np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), up])


def cloud(strip_deg=60.0, n=1000, noise=0.1, seed=0, **options):
    rng = np.random.default_rng(seed)
    return strip(strip_deg, n, rng, **options) * SCALE + HARD_IRON + noise * rng.standard_normal((n, 3))


@given(st.integers(1, 7), st.integers(0, 2000))
@settings(max_examples=40, deadline=None)
def test_householder_solution_is_that_of_lapack(columns, seed):
    rng = np.random.default_rng(seed)
    rows, right = rng.standard_normal((columns + 9, columns)), rng.standard_normal(columns + 9)
    x, upper, squares = solve_least_squares(rows.copy(), right.copy())
    theirs, residual, _, singular = np.linalg.lstsq(rows, right, rcond=None)
    np.testing.assert_allclose(x, theirs, atol=1e-9)
    np.testing.assert_allclose(squares, residual[0], rtol=1e-9)
    np.testing.assert_allclose(np.linalg.svd(upper, compute_uv=False), singular, rtol=1e-9)
    assert condition_number(upper) >= 1.0 - 1e-12


def test_condition_of_a_dependent_column_is_infinite():
    assert condition_number(np.array([[1.0, 0.0], [0.0, 0.0]])) == math.inf


@given(
    st.tuples(*[st.floats(-200.0, 200.0)] * 3), st.tuples(*[st.floats(0.3, 4.0)] * 3), st.floats(1e-5, 1e5), st.integers(0, 50)
)
@settings(max_examples=40, deadline=None)
def test_two_step_is_exact_without_noise_in_any_unit(hard_iron, scale, unit, seed):
    measured = unit * (strip(60.0, 200, np.random.default_rng(seed)) * scale + hard_iron)
    found_iron, found_scale, real = two_step(measured, unit * STRENGTH)
    assert real
    np.testing.assert_allclose(found_iron / unit, hard_iron, atol=1e-6)
    np.testing.assert_allclose(found_scale, scale, rtol=1e-8)


@pytest.mark.parametrize("method", [two_step_fit, batch_fit])
def test_predicted_sigmas_are_those_of_repeated_runs(method):
    iron, scale, predicted = [], [], []
    for seed in range(80):
        fit = method(cloud(n=400, noise=0.2, seed=seed), STRENGTH)
        iron.append(fit.hard_iron - HARD_IRON)
        scale.append(fit.scale - SCALE)
        predicted.append(np.concatenate((fit.hard_iron_sigma, fit.scale_sigma * fit.scale)))
    scatter = np.concatenate((np.sqrt(np.mean(np.square(iron), axis=0)), np.sqrt(np.mean(np.square(scale), axis=0))))
    np.testing.assert_allclose(scatter, np.mean(predicted, axis=0), rtol=0.3)


def test_two_step_residual_coverage_and_correction():
    measured = cloud(noise=0.1)
    fit = two_step_fit(measured, STRENGTH)
    assert fit.residual_rms == pytest.approx(0.1, rel=0.1)
    assert fit.coverage.strip_deg == pytest.approx(60.0, abs=3.0)
    assert fit.coverage.swept_deg == 360.0
    assert fit.condition < 20.0
    assert np.linalg.norm(fit.apply(measured), axis=1).std() < 0.11
    assert fit.samples == 1000


def test_batch_derivatives_are_central_differences():
    measured = cloud(n=60, noise=0.0)
    state = np.concatenate((HARD_IRON + 1.0, SCALE + 0.05))
    rows, _ = batch_rows(measured, np.full(60, STRENGTH), state[:3], state[3:])
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        sides = [batch_rows(measured, np.full(60, STRENGTH), (state + d)[:3], (state + d)[3:])[1] for d in (step, -step)]
        np.testing.assert_allclose(rows[:, k], -(sides[0] - sides[1]) / 2e-5, rtol=1e-5, atol=1e-7)


def test_batch_fit_is_the_minimum_that_scipy_finds():
    measured = cloud(n=300, noise=0.3)
    fit = batch_fit(measured, STRENGTH)
    theirs = least_squares(
        lambda p: np.linalg.norm((measured - p[:3]) / p[3:], axis=1) - STRENGTH, np.concatenate((HARD_IRON, SCALE)), xtol=1e-14, ftol=1e-14
    )
    np.testing.assert_allclose(np.concatenate((fit.hard_iron, fit.scale)), theirs.x, rtol=1e-5)


def test_level_turn_fits_two_axes_and_says_so():
    rng, heading = np.random.default_rng(1), np.linspace(0.0, 2.0 * np.pi, 500)
    level = 23.5 * np.column_stack([np.cos(heading), -np.sin(heading)])
    measured = np.column_stack([level * SCALE[:2] + HARD_IRON[:2], np.full(500, 44.0)]) + 0.05 * rng.standard_normal((500, 3))
    fit = level_turn_fit(measured, 23.5)
    np.testing.assert_allclose(fit.hard_iron[:2], HARD_IRON[:2], atol=5 * fit.hard_iron_sigma[:2].max())
    np.testing.assert_allclose(fit.scale[:2], SCALE[:2], atol=2e-3)
    assert "level flight only" in fit.warnings[0]
    with pytest.raises(CalibrationError, match="level turn"):
        level_turn_fit(measured[:200], 23.5)


def test_known_strength_is_exact_with_a_wide_prior_and_finds_soft_iron():
    rng = np.random.default_rng(2)
    matrix = np.array([[1.03, 0.02, -0.01], [0.02, 0.98, 0.015], [-0.01, 0.015, 1.01]])
    measured = strip(180.0, 800, rng) @ np.linalg.inv(matrix).T + HARD_IRON
    fit = known_strength_fit(measured, STRENGTH, CalibrationPrior(scale_sigma=10.0, cross_sigma=10.0, hard_iron_share=10.0))
    np.testing.assert_allclose(fit.matrix, matrix, atol=1e-6)
    np.testing.assert_allclose(fit.hard_iron, HARD_IRON, atol=1e-4)


def test_known_strength_survives_outliers_that_ruin_a_plain_fit():
    measured = cloud(n=1000, noise=0.1)
    measured[::25] += 20.0
    robust, plain = known_strength_fit(measured, STRENGTH), two_step_fit(measured, STRENGTH)
    assert np.abs(robust.hard_iron - HARD_IRON).max() < 0.1
    assert np.abs(plain.hard_iron - HARD_IRON).max() > 0.5


def test_partial_coverage_calibrates_what_it_saw_and_leaves_the_rest_to_the_prior():
    """Half a turn with little bank: x and y are found, z stays with the prior and is named."""
    measured = cloud(strip_deg=6.0, noise=0.3, n=1000, swept=(-np.pi, 0.2))
    fit = known_strength_fit(measured, STRENGTH, CalibrationPrior(hard_iron_share=0.2, scale_sigma=0.05))
    assert np.abs(fit.hard_iron - HARD_IRON)[:2].max() < 4.0 * fit.hard_iron_sigma[:2].max() < 2.0
    assert fit.scale_sigma[2] > 0.04
    assert any("scale factor of z" in warning for warning in fit.warnings)


def test_known_strength_posterior_is_honest():
    normalised = []
    for seed in range(60):
        rng = np.random.default_rng(1000 + seed)
        iron, inverse_scale = 10.0 * rng.standard_normal(3), 1.0 + 0.03 * rng.standard_normal(3)
        measured = strip(20.0, 300, rng, swept=(-np.pi, 0.5)) / inverse_scale + iron + 0.2 * rng.standard_normal((300, 3))
        fit = known_strength_fit(measured, STRENGTH, CalibrationPrior(hard_iron_share=0.2, scale_sigma=0.03))
        of_scale = (np.diag(fit.matrix) - inverse_scale) / fit.scale_sigma
        normalised.append(np.concatenate(((fit.hard_iron - iron) / fit.hard_iron_sigma, of_scale)))
    rms = np.sqrt(np.mean(np.square(normalised), axis=0))
    assert np.all((rms > 0.7) & (rms < 1.4)), rms


@pytest.mark.parametrize("method", [two_step_fit, batch_fit, known_strength_fit])
@pytest.mark.parametrize(
    ("measured", "word"),
    [
        (np.zeros((0, 3)), "collect at least"),
        (cloud(n=49), "49 samples"),
        (np.where(np.arange(300).reshape(100, 3) == 5, np.nan, cloud(n=100)), "not finite"),
        (cloud(n=100) * [1.0, 1.0, 0.0], "on z never changes"),
        (cloud(n=100).ravel(), "rows of 3"),
    ],
)
def test_unusable_samples_are_refused_with_a_sentence(method, measured, word):
    with pytest.raises(CalibrationError, match=word) as refusal:
        method(measured, STRENGTH)
    assert str(refusal.value).endswith(".")


@pytest.mark.parametrize("method", [two_step_fit, batch_fit])
def test_narrow_coverage_is_refused_in_degrees_unless_the_bar_is_lowered(method):
    measured = cloud(strip_deg=10.0, noise=0.05, n=3000)
    with pytest.raises(CalibrationError, match=r"only 10 deg .*under 15 deg"):
        method(measured, STRENGTH)
    assert method(measured, STRENGTH, minimum_strip_deg=5.0).coverage.strip_deg == pytest.approx(10.0, abs=1.0)


def test_a_plane_of_noise_is_no_ellipsoid_and_a_speck_spans_nothing():
    rng = np.random.default_rng(3)
    with pytest.raises(CalibrationError, match="known"):
        two_step_fit(rng.standard_normal((300, 3)) + [30.0, 30.0, 30.0] + 10.0 * rng.standard_normal((300, 1)), STRENGTH)
    with pytest.raises(CalibrationError, match="turn through all headings"):
        known_strength_fit(np.array([30.0, 0.0, 40.0]) + 0.1 * rng.standard_normal((300, 3)), STRENGTH)
    with pytest.raises(CalibrationError, match="must be positive"):
        two_step_fit(cloud(), 0.0)


@given(st.integers(0, 500), st.floats(20.0, 90.0))
@settings(max_examples=20, deadline=None)
def test_coverage_does_not_depend_on_axes(seed, strip_deg):
    rng = np.random.default_rng(seed)
    directions = strip(strip_deg, 6000, rng)
    turned = directions @ np.linalg.qr(rng.standard_normal((3, 3)))[0].T
    for coverage in (fits.coverage_of(directions), fits.coverage_of(turned)):
        assert coverage.strip_deg == pytest.approx(strip_deg, abs=5.0)
        assert coverage.swept_deg == 360.0
        assert coverage.span_deg > 175.0


def test_coverage_of_a_sphere_a_level_turn_and_one_heading():
    rng = np.random.default_rng(4)
    whole = fits.coverage_of(rng.standard_normal((20_000, 3)))
    assert whole.sphere_percent > 99.0
    heading = np.linspace(0.0, 2.0 * np.pi, 400)
    turn = fits.coverage_of(np.column_stack([np.cos(heading), -np.sin(heading), np.full(400, 1.84)]))
    assert turn.strip_deg == pytest.approx(0.0, abs=0.01)
    assert turn.span_deg == pytest.approx(2.0 * math.degrees(math.atan(1.0 / 1.84)), abs=3.0)
    still = fits.coverage_of(np.array([1.0, 0.0, 1.8]) + 0.001 * rng.standard_normal((400, 3)))
    assert still.span_deg < 3.0
    assert still.sphere_percent < 2.0


@pytest.mark.parametrize(("unit", "strength"), [("T", 5e-5), ("G", 0.48), ("mG", 490.0), ("uT", 48.0), ("nT", 52_000.0)])
@pytest.mark.parametrize("factor", [0.45, 1.0, 2.0])
def test_units_are_told_by_magnitude(unit, strength, factor):
    assert fits.unit_by_magnitude(factor * strength * np.eye(3)) == unit


def test_a_field_of_no_unit_is_refused():
    for strength in (5.0, 1e-9, 0.0):
        with pytest.raises(CalibrationError, match="name the unit"):
            fits.unit_by_magnitude(strength * np.eye(3))


def test_written_calibration_loads_and_does_what_the_fit_did(tmp_path):
    measured = cloud()
    fit = two_step_fit(measured, STRENGTH)
    path = tmp_path / "magnetometer.yaml"
    path.write_text(calibration_text(fits.calibration_of(fit, "uT"), fit, "turn.csv"))
    loaded = load_settings(AhrsSettings, path).magnetometer
    np.testing.assert_allclose(loaded.apply(measured * 1e-6), fit.apply(measured) * 1e-6, atol=1e-10)
    assert "Coverage" in path.read_text()


def test_calibration_of_wrong_length_is_refused():
    with pytest.raises(SettingsError, match="needs 9 numbers, got 3"):
        fits.MagnetometerCalibration(matrix=[1.0, 1.0, 1.0])
    np.testing.assert_array_equal(fits.MagnetometerCalibration().apply(np.array([1e-5, 2e-5, 3e-5])), [1e-5, 2e-5, 3e-5])


FIELD_N = 1e-6 * np.array([23.0, 4.0, 43.0])


def fly(collection, attitudes, seed=0):
    rng = np.random.default_rng(seed)
    progress = None
    for roll, pitch, heading in attitudes:
        q = euler_to_quat(roll, pitch, heading)
        field = quat_to_dcm(q).T @ FIELD_N * SCALE + HARD_IRON * 1e-6 + 5e-8 * rng.standard_normal(3)
        progress = collection.collect(field, q)
    return progress


def test_collection_guides_a_flight_to_a_free_fit():
    collection = MagnetometerCollection(FIELD_N)
    level = [(0.0, 0.03, h) for h in np.linspace(0.0, 2.0 * np.pi, 200)]
    assert "Bank and pitch more" in fly(collection, level).advice
    banked = [(b, p, h) for b in (-0.7, 0.7) for p in (-0.25, 0.25) for h in np.linspace(0.0, 2.0 * np.pi, 200)]
    progress = fly(collection, banked, 1)
    assert progress.share == 1.0
    assert "finish" in progress.advice
    fit = collection.finish()
    assert fit.method == "full"
    np.testing.assert_allclose(fit.hard_iron, HARD_IRON * 1e-6, atol=1e-7)


def test_collection_falls_back_to_known_strength_then_refuses():
    turns = [(b, 0.0, h) for b in (0.0, 0.15) for h in np.linspace(0.0, 2.0 * np.pi, 200)]
    collection = MagnetometerCollection(FIELD_N)
    fly(collection, turns)
    fit = collection.finish()
    assert fit.method == "known-strength"
    np.testing.assert_allclose(fit.hard_iron[:2], HARD_IRON[:2] * 1e-6, atol=4 * fit.hard_iron_sigma[:2].max())
    assert np.all(np.abs(np.diag(fit.matrix) - 1.0 / SCALE) < 3.0 * fit.scale_sigma)
    straight = MagnetometerCollection(FIELD_N)
    assert fly(straight, [(0.0, 0.0, 1.0)] * 500).share == 0.0
    with pytest.raises(CalibrationError, match="collect at least"):
        straight.finish()
    with pytest.raises(CalibrationError, match="collect at least"):
        MagnetometerCollection(FIELD_N).finish()


def test_collection_is_bounded_and_counts_what_it_rejects():
    collection = MagnetometerCollection(FIELD_N)
    progress = fly(collection, [(0.0, 0.0, 0.0)] * 300)
    assert progress.samples == 20
    collection.collect(np.array([np.nan, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    assert collection.rejected == 1
    with pytest.raises(CalibrationError, match="magnetic model"):
        MagnetometerCollection(np.zeros(3))


def swing(tilt_deg, matrix=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), noise=0.2, count=800, seed=5):
    """Samples, uT, of a field of 48 uT seen within ``tilt_deg`` of a plane (90: the whole sphere), iron (12, -8, 20)."""
    rng = np.random.default_rng(seed)
    up, around = np.sin(np.radians(tilt_deg)) * rng.uniform(-1.0, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    level = np.sqrt(1.0 - up**2)
    field = 48.0 * np.column_stack([level * np.cos(around), level * np.sin(around), up])
    return field, field @ np.array(matrix).T + [12.0, -8.0, 20.0] + rng.normal(0.0, noise, (count, 3))


SOFT = ((1.1, 0.12, -0.08), (0.12, 0.95, 0.1), (-0.08, 0.1, 0.9))


def test_soft_iron_with_cross_terms_is_calibrated_whole():
    field, measured = swing(90.0, SOFT)
    fit = full_fit(measured, 48.0)
    np.testing.assert_allclose(fit.matrix, np.linalg.inv(SOFT), atol=4e-3)
    np.testing.assert_allclose(fit.hard_iron, [12.0, -8.0, 20.0], atol=0.1)
    angle = np.degrees(np.arccos(np.sum(fit.apply(measured) * field, axis=1) / np.linalg.norm(fit.apply(measured), axis=1) / 48.0))
    assert np.sqrt(np.mean(angle**2)) < 0.6  # the noise alone is 0.4 degrees


def test_the_quoted_errors_of_a_full_fit_are_those_it_makes():
    errors = []
    for seed in range(40):
        fit = full_fit(swing(90.0, SOFT, count=300, seed=seed)[1], 48.0)
        errors.append((fit.hard_iron - [12.0, -8.0, 20.0]) / fit.hard_iron_sigma)
    assert 0.75 < np.sqrt(np.mean(np.square(errors))) < 1.2


@pytest.mark.parametrize(("tilt_deg", "matrix"), [(20.0, SOFT), (20.0, np.eye(3)), (3.0, np.eye(3)), (35.0, SOFT)])
def test_a_partial_sphere_is_refused_with_what_is_missing_or_is_right(tilt_deg, matrix):
    _, measured = swing(tilt_deg, matrix)
    try:
        fit = full_fit(measured, 48.0)
    except CalibrationError as error:
        assert "do not show" in str(error)
        assert tilt_deg < 30.0
    else:
        assert np.all(np.abs(fit.hard_iron - [12.0, -8.0, 20.0]) < np.maximum(4.0 * fit.hard_iron_sigma, 0.1))


def test_outliers_are_found_and_named():
    _, measured = swing(90.0)
    measured[::100] += 60.0
    fit = full_fit(measured, 48.0)
    np.testing.assert_allclose(fit.hard_iron, [12.0, -8.0, 20.0], atol=0.1)
    np.testing.assert_allclose(fit.scale, 1.0, atol=2e-3)
    assert fit.warnings == ("8 outliers excluded: samples 1, 101, 201, 301, 401, 501, 601, 701.",)
    measured[::5] += np.random.default_rng(0).normal(0.0, 30.0, (160, 3))
    with pytest.raises(CalibrationError, match="look for interference"):
        full_fit(measured, 48.0)
