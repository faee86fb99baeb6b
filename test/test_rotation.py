"""Rotations against scipy, closed forms and differences."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lowcostnav_ros.physics import rotation as rot

ANGLE = st.floats(-50.0, 50.0)
COMPONENT = st.floats(-1.0, 1.0)


def unit_quat(components):
    q = np.array(components)
    norm = np.linalg.norm(q)
    return q / norm if norm > 1e-3 else np.array([1.0, 0.0, 0.0, 0.0])


QUAT = st.tuples(COMPONENT, COMPONENT, COMPONENT, COMPONENT).map(unit_quat)
VECTOR = st.tuples(ANGLE, ANGLE, ANGLE).map(np.array)


def scipy_of(q):
    return Rotation.from_quat(q, scalar_first=True)


def angle_between(p, q):
    """Rotation angle from p to q; by the vector part, because arccos near one loses half the digits."""
    return 2.0 * np.linalg.norm(rot.quat_multiply(rot.quat_conjugate(p), q)[1:])


@given(QUAT, QUAT)
def test_product_and_matrix_agree_with_scipy(p, q):
    np.testing.assert_allclose(rot.quat_to_dcm(rot.quat_multiply(p, q)), (scipy_of(p) * scipy_of(q)).as_matrix(), atol=1e-14)


@given(QUAT, VECTOR)
def test_rotating_a_vector_agrees_with_scipy(q, v):
    np.testing.assert_allclose(rot.quat_rotate(q, v), scipy_of(q).apply(v), atol=1e-13 * (1.0 + np.abs(v).max()))
    back = rot.quat_rotate(rot.quat_conjugate(q), rot.quat_rotate(q, v))
    np.testing.assert_allclose(back, v, atol=1e-13 * (1.0 + np.abs(v).max()))


@given(VECTOR, st.floats(-12.0, 0.0))
def test_exponential_agrees_with_scipy_at_every_size(direction, exponent):
    rotvec = direction * 10.0**exponent
    ours = rot.quat_from_rotvec(rotvec)
    assert abs(np.linalg.norm(ours) - 1.0) < 1e-14
    assert angle_between(ours, Rotation.from_rotvec(rotvec).as_quat(scalar_first=True)) < 2e-14


@given(VECTOR, st.floats(-12.0, 0.0))
def test_logarithm_undoes_the_exponential(direction, exponent):
    norm = np.linalg.norm(direction)
    rotvec = direction * 10.0**exponent * (3.14 / norm if norm > 3.14 else 1.0)
    np.testing.assert_allclose(rot.rotvec_from_quat(rot.quat_from_rotvec(rotvec)), rotvec, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(rot.rotvec_from_quat(-rot.quat_from_rotvec(rotvec)), rotvec, rtol=1e-12, atol=1e-15)


def test_series_and_closed_form_meet_at_the_switch():
    for size in (rot.SMALL_ANGLE * (1.0 - 1e-9), rot.SMALL_ANGLE * (1.0 + 1e-9)):
        rotvec = size * np.array([0.6, 0.0, 0.8])
        np.testing.assert_allclose(rot.quat_from_rotvec(rotvec)[1:], math.sin(size / 2) / size * rotvec, rtol=2e-15)
        np.testing.assert_allclose(rot.rotvec_from_quat(rot.quat_from_rotvec(2 * rotvec)), 2 * rotvec, rtol=1e-13)


@given(QUAT)
def test_matrix_to_quaternion_round_trip(q):
    back = rot.dcm_to_quat(rot.quat_to_dcm(q))
    assert back[0] >= 0.0
    assert angle_between(q, back) < 1e-14


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0.8, 0), (0, 0.6, -0.8), (-0.48, 0.6, 0.64)])
def test_half_turns_convert_though_the_trace_formula_is_singular(axis):
    half_turn = 2.0 * np.outer(axis, axis) - np.eye(3)
    q = rot.dcm_to_quat(half_turn)
    np.testing.assert_allclose(rot.quat_to_dcm(q), half_turn, atol=1e-15)
    assert abs(q[0]) < 1e-15


def test_euler_golden_vector():
    """10, -5, 135 deg: quaternion and matrix worked out independently of this package."""
    angles = np.radians([10.0, -5.0, 135.0])
    np.testing.assert_allclose(rot.euler_to_quat(*angles), [0.377352, 0.073467, 0.063816, 0.920943], atol=5e-7)
    rows = [[-0.704416, -0.685663, 0.183480], [0.704416, -0.707066, 0.062096], [0.087156, 0.172987, 0.981060]]
    np.testing.assert_allclose(rot.euler_to_dcm(*angles), rows, atol=5e-7)


@given(ANGLE, ANGLE, ANGLE)
def test_euler_to_rotation_agrees_with_scipy(roll, pitch, heading):
    expected = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    np.testing.assert_allclose(rot.euler_to_dcm(roll, pitch, heading), expected, atol=1e-14)
    np.testing.assert_allclose(rot.quat_to_dcm(rot.euler_to_quat(roll, pitch, heading)), expected, atol=1e-14)


@given(st.floats(-3.14, 3.14), st.floats(-1.57, 1.57), st.floats(0.0, 6.28))
def test_euler_angles_come_back(roll, pitch, heading):
    back = rot.quat_to_euler(rot.euler_to_quat(roll, pitch, heading))
    tolerance = 1e-14 / math.cos(pitch) + 1e-14
    assert abs(rot.wrap(back[0] - roll)) < tolerance
    assert abs(back[1] - pitch) < tolerance
    assert abs(rot.wrap(back[2] - heading)) < tolerance
    assert 0.0 <= back[2] < rot.TWO_PI


@pytest.mark.parametrize("pitch_deg", [90.0, -90.0])
def test_nose_vertical_gives_one_angle_as_heading(pitch_deg):
    q = rot.euler_to_quat(0.0, math.radians(pitch_deg), 1.2)
    roll, pitch, heading = rot.quat_to_euler(q)
    assert roll == 0.0
    assert pitch == pytest.approx(math.radians(pitch_deg), abs=1e-9)
    assert heading == pytest.approx(1.2, abs=1e-9)


def test_signs_a_pilot_would_check():
    """Heading east puts the nose on +east; nose up lifts it (down negative); right bank lowers the right wing (down positive)."""
    np.testing.assert_allclose(rot.euler_to_dcm(0.0, 0.0, math.pi / 2)[:, 0], [0, 1, 0], atol=1e-15)
    assert rot.euler_to_dcm(0.0, math.radians(20), 0.0)[2, 0] < -0.3
    assert rot.euler_to_dcm(math.radians(30), 0.0, 0.0)[2, 1] == pytest.approx(0.5)


@given(st.floats(-3.0, 3.0), st.floats(-1.3, 1.3), st.floats(0.1, 6.2))
def test_euler_jacobian_against_central_differences(roll, pitch, heading):
    """Attitude error per the glossary, C_true = (I + [phi x]) C_est, built here with plain matrices."""
    step, base = 1e-6, rot.euler_to_dcm(roll, pitch, heading)
    numeric = np.empty((3, 3))
    for j in range(3):
        sides = [np.array(rot.dcm_to_euler((Rotation.from_rotvec(s * step * np.eye(3)[j]).as_matrix()) @ base)) for s in (1, -1)]
        numeric[:, j] = rot.wrap(sides[0] - sides[1]) / (2 * step)
    np.testing.assert_allclose(rot.euler_jacobian_n(roll, pitch, heading), numeric, rtol=1e-6, atol=2e-7)


@given(QUAT, st.tuples(COMPONENT, COMPONENT, COMPONENT).map(np.array))
def test_applying_the_attitude_error_rotates_from_the_left(q, phi):
    expected = Rotation.from_rotvec(phi).as_matrix() @ rot.quat_to_dcm(q)
    np.testing.assert_allclose(rot.quat_to_dcm(rot.quat_apply_phi_n(q, phi)), expected, atol=1e-14)
    small = 1e-6 * phi
    first_order = (np.eye(3) + rot.skew(small)) @ rot.quat_to_dcm(q)
    np.testing.assert_allclose(rot.quat_to_dcm(rot.quat_apply_phi_n(q, small)), first_order, atol=5e-12)


@given(st.floats(-1e4, 1e4))
def test_wrap_keeps_the_angle_and_the_range(angle):
    assert -math.pi < rot.wrap(angle) <= math.pi
    assert 0.0 <= rot.wrap_2pi(angle) < rot.TWO_PI
    for wrapped in (rot.wrap(angle), rot.wrap_2pi(angle)):
        turns = (angle - wrapped) / rot.TWO_PI
        assert abs(turns - round(turns)) < 1e-12 * (1 + abs(angle))


def test_wrap_at_the_edges_and_on_arrays():
    assert rot.wrap(math.pi) == math.pi
    assert rot.wrap(-math.pi) == math.pi
    assert rot.wrap_2pi(-1e-20) == 0.0
    assert rot.wrap_2pi(rot.TWO_PI) == 0.0
    np.testing.assert_allclose(rot.wrap(np.array([0.1, 3.5, -3.5])), [0.1, 3.5 - rot.TWO_PI, rot.TWO_PI - 3.5], atol=1e-15)


@given(VECTOR, VECTOR)
def test_skew_is_the_cross_product(v, w):
    np.testing.assert_allclose(rot.skew(v) @ w, np.cross(v, w), atol=1e-10)


def test_columns_agree_with_single_conversions():
    rng = np.random.default_rng(1)
    eulers = np.column_stack((rng.uniform(-3, 3, 50), rng.uniform(-1.5, 1.5, 50), rng.uniform(0, 6.2, 50)))
    quats = rot.eulers_to_quat(eulers)
    np.testing.assert_array_equal(quats[7], rot.euler_to_quat(*eulers[7]))
    np.testing.assert_allclose(rot.quats_to_euler(quats), eulers, atol=1e-12)
