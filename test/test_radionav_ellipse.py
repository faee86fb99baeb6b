"""Error ellipses against the covariance they come from, scipy and drawn samples."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.radionav.ellipse import Ellipse, ellipse_of

axis = st.floats(0.1, 1000.0)
angle = st.floats(0.0, math.pi, exclude_max=True)


@given(axis, axis, angle)
def test_ellipse_turns_back_into_its_covariance(a, b, turn):
    c, s = math.cos(turn), math.sin(turn)
    R = np.array([[c, -s], [s, c]])
    P = R @ np.diag([a * a, b * b]) @ R.T
    P = 0.5 * (P + P.T)
    ellipse = ellipse_of(P)
    assert (ellipse.major, ellipse.minor) == pytest.approx((max(a, b), min(a, b)), rel=1e-6)
    points = ellipse.outline(np.array([5.0, -3.0]), 2.0) - (5.0, -3.0)
    assert np.einsum("ij,jk,ik->i", points, np.linalg.inv(P), points) == pytest.approx(np.full(90, 4.0), rel=1e-5)


def test_orientation_is_a_bearing_from_north():
    assert ellipse_of(np.diag([9.0, 4.0])) == Ellipse(3.0, 2.0, 0.0)
    assert ellipse_of(np.diag([4.0, 9.0])).orientation == pytest.approx(math.pi / 2.0)
    assert ellipse_of(np.array([[5.0, 4.0], [4.0, 5.0]])).orientation == pytest.approx(math.pi / 4.0)  # north-east


@pytest.mark.parametrize("bad", [np.diag([1.0, -1.0]), np.array([[1.0, 0.5], [0.1, 1.0]]), np.full((2, 2), np.nan), np.eye(3)])
def test_what_is_no_covariance_is_refused(bad):
    with pytest.raises(ValueError, match="ovariance"):
        ellipse_of(bad)
