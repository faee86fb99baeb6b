"""ENU/FLU against NED/FRD: a table written by hand, scipy's rotations, and round trips."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lowcostnav_ros.messages import conversions as conv
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.physics.rotation import euler_to_quat

S = math.sqrt(0.5)
ENU_OF_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FLU_OF_FRD = np.diag([1.0, -1.0, -1.0])

# roll, pitch, heading in degrees; where the nose and the left wing point in ENU, worked out by hand
WRITTEN = [
    ("nose north", 0, 0, 0, (0, 1, 0), (-1, 0, 0)),
    ("nose east", 0, 0, 90, (1, 0, 0), (0, 1, 0)),
    ("nose south", 0, 0, 180, (0, -1, 0), (1, 0, 0)),
    ("nose west", 0, 0, 270, (-1, 0, 0), (0, -1, 0)),
    ("right bank 30 north", 30, 0, 0, (0, 1, 0), (-math.cos(math.pi / 6), 0, 0.5)),
    ("nose up 20 north", 0, 20, 0, (0, math.cos(math.radians(20)), math.sin(math.radians(20))), (-1, 0, 0)),
]


@pytest.mark.parametrize(("name", "roll", "pitch", "heading", "nose", "left"), WRITTEN, ids=[w[0] for w in WRITTEN])
def test_attitudes_of_the_written_table(name, roll, pitch, heading, nose, left):
    q_nb = euler_to_quat(*np.radians([roll, pitch, heading]))
    C_enu_flu = Rotation.from_quat(conv.quat_to_ros(q_nb)).as_matrix()
    np.testing.assert_allclose(C_enu_flu[:, 0], nose, atol=1e-15)
    np.testing.assert_allclose(C_enu_flu[:, 1], left, atol=1e-15)


@pytest.mark.parametrize(("heading_deg", "yaw_deg"), [(0, 90), (90, 0), (180, -90), (270, 180), (359, 91), (45, 45)])
def test_heading_and_yaw(heading_deg, yaw_deg):
    assert math.degrees(conv.yaw_of_heading(math.radians(heading_deg))) == pytest.approx(yaw_deg, abs=1e-12)
    assert math.degrees(conv.heading_of_yaw(math.radians(yaw_deg))) == pytest.approx(heading_deg, abs=1e-12)


quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.1).map(lambda q: np.array(q) / np.linalg.norm(q))
vectors = st.tuples(*[st.floats(-1e6, 1e6)] * 3).map(np.array)


@given(quaternions, vectors)
def test_attitude_is_rotated_on_both_sides(q_nb, vector_b):
    C_nb = Rotation.from_quat(q_nb[[1, 2, 3, 0]]).as_matrix()
    x, y, z, w = conv.quat_to_ros(q_nb)
    expected = ENU_OF_NED @ C_nb @ FLU_OF_FRD
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), expected, atol=1e-14)
    back = conv.quat_from_ros(x, y, z, w)
    np.testing.assert_allclose(back, q_nb, atol=1e-15)
    turned = conv.swap_world(C_nb @ vector_b)
    np.testing.assert_allclose(turned, expected @ conv.swap_body(vector_b), atol=1e-8)


@given(st.lists(st.floats(-3, 3), min_size=9, max_size=9))
def test_covariances_turn_with_their_cross_terms(numbers):
    root = np.array(numbers).reshape(3, 3)
    cov = root @ root.T
    np.testing.assert_array_equal(conv.swap_world_cov(cov), ENU_OF_NED @ cov @ ENU_OF_NED.T)
    np.testing.assert_array_equal(conv.swap_body_cov(cov), FLU_OF_FRD @ cov @ FLU_OF_FRD.T)
    np.testing.assert_array_equal(conv.swap_world_cov(conv.swap_world_cov(cov)), cov)
    np.testing.assert_array_equal(conv.swap_body_cov(conv.swap_body_cov(cov)), cov)


@given(st.floats(-1.2, 1.2), st.floats(-3, 3), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), quaternions)
def test_map_frame_round_trip_and_agreement_with_the_local_frame(lat, lon, dlat, dlon, q_nb):
    origin = LocalFrame(lat, lon, 120.0)
    there = (lat + 0.02 * dlat, lon + 0.02 * dlon, 1500.0)
    root = np.array([[2.0, 0.3, 0.1], [0.0, 1.0, -0.4], [0.0, 0.0, 3.0]])
    cov = root @ root.T
    position, q_map, cov_pos, cov_att = conv.map_from_local(*there, q_nb, cov, 1e-4 * cov, origin.origin_e, origin.C_le)
    np.testing.assert_allclose(conv.swap_world(position), origin.to_ned(*there), atol=1e-8)
    turn = origin.C_ln(there[0], there[1])
    C_map = Rotation.from_quat(q_map[[1, 2, 3, 0]]).as_matrix()
    np.testing.assert_allclose(C_map, turn @ Rotation.from_quat(q_nb[[1, 2, 3, 0]]).as_matrix(), atol=1e-13)
    np.testing.assert_allclose(conv.swap_world_cov(cov_pos), turn @ cov @ turn.T, atol=1e-12)
    place, q_back, cov_pos, cov_att = conv.local_from_map(position, q_map, cov_pos, cov_att, origin.origin_e, origin.C_le)
    np.testing.assert_allclose(place[:2], there[:2], rtol=0, atol=1e-14)
    assert place[2] == pytest.approx(1500.0, abs=1e-7)
    assert abs(q_back @ q_nb) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(cov_pos, cov, atol=1e-12)
    np.testing.assert_allclose(cov_att, 1e-4 * cov, atol=1e-16)


def test_velocity_in_body_axes_of_a_right_bank_heading_east():
    # heading east, banked 90 deg right: body right points down and the belly north, so a descent of 3 m/s is -3 on the left axis
    # and 1 m/s northward is -1 on the up axis
    q_nb = euler_to_quat(math.pi / 2, 0.0, math.pi / 2)
    velocity, cov = conv.body_velocity(np.array([1.0, 50.0, 3.0]), np.diag([1.0, 4.0, 9.0]), q_nb)
    np.testing.assert_allclose(velocity, [50.0, -3.0, -1.0], atol=1e-13)
    np.testing.assert_allclose(np.diag(cov), [4.0, 9.0, 1.0], atol=1e-13)
    back, cov_back = conv.local_velocity(velocity, cov, q_nb)
    np.testing.assert_allclose(back, [1.0, 50.0, 3.0], atol=1e-13)
    np.testing.assert_allclose(cov_back, np.diag([1.0, 4.0, 9.0]), atol=1e-13)
