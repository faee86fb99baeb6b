"""Magnetic heading against direct rotation of the earth's field, difference quotients and published model values."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.physics.magnetic_heading import MagneticReference, magnetic_heading, magnetic_innovation
from lowcostnav_ros.physics.rotation import euler_to_dcm, euler_to_quat, quat_apply_phi_n, quat_to_dcm, wrap

LAT, LON = math.radians(37.69), math.radians(-121.82)
FIELD_N = np.array([22.0e-6, 5.0e-6, 42.0e-6])
DECLINATION = math.atan2(5.0, 22.0)
angles = st.floats(-3.1, 3.1)
tilts = st.floats(-1.2, 1.2)


@settings(deadline=None)  # the first call compiles
@given(roll=tilts, pitch=tilts, heading=angles)
def test_true_attitude_leaves_no_innovation(roll, pitch, heading):
    C = euler_to_dcm(roll, pitch, heading)
    y, _, horizontal = magnetic_innovation(C, C.T @ FIELD_N, DECLINATION)
    assert abs(y) < 1e-12
    assert horizontal == pytest.approx(math.hypot(22.0e-6, 5.0e-6))
    assert abs(wrap(magnetic_heading(roll, pitch, C.T @ FIELD_N, DECLINATION) - heading)) < 1e-12


@settings(deadline=None)  # the first call compiles
@given(roll=tilts, pitch=tilts, heading=angles, axis=st.integers(0, 2))
def test_row_is_the_derivative_by_the_attitude_error(roll, pitch, heading, axis):
    q_true = euler_to_quat(roll, pitch, heading)
    field_b = quat_to_dcm(q_true).T @ FIELD_N
    phi = np.zeros(3)
    phi[axis] = 1e-5
    ys = []
    for sign in (1.0, -1.0):  # the estimate is the truth with the error taken out
        q_est = quat_apply_phi_n(q_true, -sign * phi)
        ys.append(magnetic_innovation(quat_to_dcm(q_est), field_b, DECLINATION)[0])
    _, h, _ = magnetic_innovation(quat_to_dcm(q_true), field_b, DECLINATION)
    assert (ys[0] - ys[1]) / 2e-5 == pytest.approx(h[axis], abs=1e-6)


def test_level_locus_of_the_source():
    # B_x = B_H cos(psi), B_y = -B_H sin(psi) (Gebre-Egziabher 2004, 3.40, 3.42); declination 15 deg east is added
    for magnetic_deg in range(0, 360, 15):
        psi = math.radians(magnetic_deg)
        heading = magnetic_heading(0.0, 0.0, np.array([math.cos(psi), -math.sin(psi), 1.8]), math.radians(15.0))
        assert math.degrees(wrap(heading - psi)) == pytest.approx(15.0)


def test_hard_iron_error_of_the_source():
    # residual of 7 mG per axis in a horizontal field of 235 mG: peak of 2.4 deg over all headings (equation 3.48)
    headings = np.radians(np.arange(0, 360, 1.0))
    errors = [wrap(magnetic_heading(0.0, 0.0, np.array([235 * math.cos(h) + 7, -235 * math.sin(h) + 7, 420.0]), 0.0) - h) for h in headings]
    assert math.degrees(max(np.abs(errors))) == pytest.approx(2.41, abs=0.05)


def test_vertical_field_gives_no_heading():
    y, h, horizontal = magnetic_innovation(np.eye(3), np.array([0.0, 0.0, 50e-6]), 0.1)
    assert (y, horizontal) == (0.0, 0.0)
    assert not h.any()


def test_reference_is_the_model_east_positive():
    local = MagneticReference(2026.0, []).at(LAT, LON, 600.0)
    assert math.degrees(local.declination) == pytest.approx(12.8, abs=0.4)  # published charts: 12.8 deg E at Livermore in 2026
    assert 1e6 * local.strength == pytest.approx(47.5, abs=1.0)


def test_declination_of_zero_is_a_value():
    reference = MagneticReference(2026.0, [0.0])
    assert reference.at(LAT, LON, 0.0).declination == 0.0
    assert reference.anywhere().declination == 0.0
    assert MagneticReference(2026.0, []).anywhere() is None


def test_declination_by_hand_needs_no_model():
    reference = MagneticReference(2050.0, [3.0])
    assert math.degrees(reference.at(LAT, LON, 0.0).declination) == pytest.approx(3.0)
    with pytest.raises(ValueError, match="declination by hand"):
        MagneticReference(2050.0, [])


def test_interference_and_wrong_units_are_named():
    local = MagneticReference(2026.0, []).at(LAT, LON, 0.0)
    assert local.refusal(np.array([0.0, 0.0, local.strength])) == ""
    assert "interference: field is 0.70" in local.refusal(np.array([0.0, 0.7 * local.strength, 0.0]))
    assert "wrong unit" in MagneticReference(2026.0, [12.0]).anywhere().refusal(np.array([22.0, 5.0, 42.0]))
    assert "not finite" in local.refusal(np.array([np.nan, 0.0, 0.0]))


def test_two_declinations_are_refused():
    with pytest.raises(ValueError, match="one declination"):
        MagneticReference(2026.0, [1.0, 2.0])
