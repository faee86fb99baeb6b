"""Heading swing and heading errors against exact geometry and the printed test vector."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.calibration import heading_error as he
from lowcostnav_ros.calibration.magnetometer_swing import coefficients_of, level_field, swing_fit
from lowcostnav_ros.calibration.record import CalibrationError
from lowcostnav_ros.physics.rotation import wrap

ALPHA = np.array([[0.02, 0.005], [-0.003, -0.01]])
IRON = (0.010, -0.005)
ROSE = np.radians(np.arange(0.0, 360.0, 15.0))


def measured_at(heading):
    field = level_field(heading, IRON, ALPHA, 0.235)
    return np.arctan2(-field[:, 1], field[:, 0])


def test_printed_vector():
    np.testing.assert_allclose(np.degrees(coefficients_of(IRON, ALPHA, 0.235)), [0.229, -2.438, 1.219, -0.859, -0.057], atol=6e-4)
    swing = swing_fit(ROSE, measured_at(ROSE))
    np.testing.assert_allclose(np.degrees(swing.coefficients), [0.228, -2.431, 1.203, -0.816, -0.112], atol=6e-4)
    assert math.degrees(swing.residual_rms) == pytest.approx(0.028, abs=1e-3)
    assert math.degrees(np.abs(wrap(measured_at(ROSE) - ROSE)).max()) == pytest.approx(3.7, abs=0.05)


def test_first_order_is_the_limit_of_little_iron():
    small = [0.001 * v for v in IRON], 0.001 * ALPHA
    field = level_field(ROSE, *small, 0.235)
    swing = swing_fit(ROSE, np.arctan2(-field[:, 1], field[:, 0]))
    np.testing.assert_allclose(swing.coefficients, coefficients_of(*small, 0.235), atol=1e-9)


@given(st.floats(-math.pi, math.pi))
def test_correction_undoes_the_curve(heading):
    swing = swing_fit(ROSE, measured_at(ROSE))
    assert wrap(swing.correct(heading + swing.error(heading)) - heading) == pytest.approx(0.0, abs=1e-9)


def test_sigma_of_the_coefficients_is_honest():
    rng, normalised = np.random.default_rng(1), []
    truth = np.radians([0.2, -2.4, 1.2, -0.8, -0.1])
    curve = np.column_stack([np.ones(24), np.sin(ROSE), np.cos(ROSE), np.sin(2 * ROSE), np.cos(2 * ROSE)]) @ truth
    for _ in range(200):
        swing = swing_fit(ROSE, ROSE + curve + 0.01 * rng.standard_normal(24))
        normalised.append((swing.coefficients - truth) / swing.sigma)
    assert np.sqrt(np.mean(np.square(normalised))) == pytest.approx(1.05, abs=0.1)


def test_bad_swings_are_refused():
    with pytest.raises(CalibrationError, match="at least 5"):
        swing_fit(ROSE[:4], ROSE[:4])
    with pytest.raises(CalibrationError, match="gap of 195 deg"):
        swing_fit(ROSE[:12], ROSE[:12])
    with pytest.raises(CalibrationError, match="not finite"):
        swing_fit(ROSE, np.where(ROSE > 6.0, np.nan, ROSE))
    with pytest.raises(CalibrationError, match="one measured heading"):
        swing_fit(ROSE, ROSE[:-1])
    assert np.all(np.isnan(swing_fit(ROSE[::5], ROSE[::5]).sigma))  # five headings leave nothing to judge by


@pytest.mark.parametrize(("tilt", "error"), [(5.0, 7.4), (10.0, 17.0), (20.0, 42.2), (30.0, 68.6)])
def test_two_axis_tilt_error(tilt, error):
    dip, heading, tilt = math.radians(61.5), math.radians(45.0), math.radians(tilt)
    assert math.degrees(he.two_axis_tilt_error(heading, tilt, 0.0, dip)) == pytest.approx(-error, abs=0.1)
    assert math.degrees(he.two_axis_tilt_error(heading, 0.0, tilt, dip)) == pytest.approx(error, abs=0.1)
    assert he.two_axis_tilt_error(heading, 0.0, 0.0, dip) == pytest.approx(0.0, abs=1e-15)


@given(st.floats(-3.1, 3.1), st.floats(-1e-4, 1e-4), st.floats(-1e-4, 1e-4))
def test_first_order_heading_error_is_the_exact_one_for_small_fields(heading, error_x, error_y):
    exact = wrap(math.atan2(math.sin(heading) * 0.235 - error_y, 0.235 * math.cos(heading) + error_x) - heading)
    assert he.level_heading_error(heading, error_x, error_y, 0.235) == pytest.approx(exact, abs=1e-6)


def test_peak_and_averaged_noise_of_the_thesis():
    heading = np.radians(np.arange(0.0, 360.0, 0.1))
    curve = he.level_heading_error(heading, 7.0, 7.0, 235.0)
    assert he.peak_heading_error(7.0, 7.0, 235.0) == pytest.approx(curve.max(), rel=1e-5)
    assert math.degrees(curve.max()) == pytest.approx(2.5, rel=0.1)
    assert he.averaged_sigma(3.5, 20) == pytest.approx(0.8, rel=0.05)
    assert he.HeadingErrorModel().slow.initial_sigma() == math.radians(2.5)
