"""Geometry of ranges against closed forms and an independent geodesy library."""

import math

import numpy as np
import pymap3d
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.radionav import geometry

LAT, LON = math.radians(37.69), math.radians(-121.82)
angles = st.floats(0.0, 2.0 * math.pi)
metres = st.floats(-60_000.0, 60_000.0)


def direction(bearing):
    return np.array([math.cos(bearing), math.sin(bearing), 0.0])


def test_slant_range_and_direction_match_pymap3d():
    lat, lon, height = math.radians(37.9), math.radians(-121.5), 1500.0
    range_m, direction_n = geometry.range_and_direction(lat, lon, height, LAT, LON, 100.0)
    azimuth, elevation, slant = pymap3d.geodetic2aer(37.69, -121.82, 100.0, 37.9, -121.5, 1500.0)  # from the aircraft to the station
    assert range_m == pytest.approx(slant, abs=1e-6)
    to_station = np.array(
        [math.cos(np.radians(elevation)) * math.cos(np.radians(azimuth)), math.cos(np.radians(elevation)) * math.sin(np.radians(azimuth))]
    )
    assert direction_n[:2] == pytest.approx(-to_station, abs=1e-9)
    assert direction_n[2] == pytest.approx(math.sin(np.radians(elevation)), abs=1e-9)


@given(metres, metres, st.floats(100.0, 10_000.0))
def test_direction_is_the_derivative_of_range(north, east, up):
    assume(math.hypot(north, east) > 100.0)
    frame = LocalFrame(LAT, LON, 0.0)
    place = frame.from_ned(np.array([north, east, -up]))
    here = LocalFrame(*place)
    _, direction_n = geometry.range_and_direction(*place, LAT, LON, 0.0)
    for axis in range(3):
        step = np.eye(3)[axis] * 0.5
        ahead = geometry.range_and_direction(*here.from_ned(step), LAT, LON, 0.0)[0]
        behind = geometry.range_and_direction(*here.from_ned(-step), LAT, LON, 0.0)[0]
        assert ahead - behind == pytest.approx(direction_n[axis], abs=1e-5)


@given(angles, angles)
def test_hdop_of_two_stations_is_root_two_over_sine(a, b):
    gamma = a - b
    assume(abs(math.sin(gamma)) > 1e-3)
    assert geometry.hdop(np.array([direction(a), direction(b)])) == pytest.approx(math.sqrt(2.0) / abs(math.sin(gamma)), rel=1e-6)


def test_hdop_on_the_baseline_is_infinite():
    assert geometry.hdop(np.array([direction(0.3), direction(0.3 + math.pi)])) == math.inf


def test_hdop_at_the_centre_of_three_stations_is_published_1_155():
    rows = np.array([direction(math.radians(b)) for b in (0.0, 120.0, 240.0)])
    assert geometry.hdop(rows) == pytest.approx(1.155, abs=5e-4)


def test_hdop_inside_the_20_mile_triangle_is_worst_at_a_corner():
    stations = 20.0 * np.array([[math.cos(b), math.sin(b)] for b in np.radians([0.0, 120.0, 240.0])])
    inside = [geometry.hdop(np.array([north, 0.0]) - stations) for north in np.linspace(-9.99, 19.9, 50)]  # along a bisector
    assert max(inside) == inside[-1] == pytest.approx(1.54, rel=0.01)  # published: 1.54 at most


@given(st.floats(0.0, math.pi), angles)
def test_angle_between_lines_of_sight(gamma, bearing):
    assert geometry.angle_between(direction(bearing), direction(bearing - gamma)) == pytest.approx(gamma, abs=1e-9)


def test_stations_ahead_and_behind_are_collinear_with_the_track():
    ahead, behind, abeam = direction(0.05), direction(math.pi - 0.05), direction(math.pi / 2)
    assert geometry.collinear_with_track(0.0, [ahead, behind])
    assert not geometry.collinear_with_track(0.0, [ahead, abeam])


def test_two_range_fix_of_the_published_example():
    a, b = np.array([8.6, -1.5]), np.array([7.6, 14.9])  # north, east, NM; ranges 13.9 and 24.7 NM
    south = min(geometry.two_range_fixes(a, b, 13.9, 24.7), key=lambda fix: fix[0])
    assert south == pytest.approx([-4.265, -6.764], abs=5e-4)


@given(metres, metres, metres, metres)
def test_both_fixes_have_the_ranges_and_mirror_each_other(north, east, north_b, east_b):
    a, b, place = np.zeros(2), np.array([north_b, east_b]), np.array([north, east])
    baseline = math.hypot(north_b, east_b)
    assume(baseline > 1000.0 and abs(north * east_b - east * north_b) / baseline > 100.0)
    fixes = geometry.two_range_fixes(a, b, np.linalg.norm(place), np.linalg.norm(place - b))
    assert min(np.linalg.norm(fixes - place, axis=1)) < 1e-3
    assert geometry.mirror_point(fixes[0], a, b) == pytest.approx(fixes[1], abs=1e-3)


def test_first_fix_lies_left_of_the_baseline():
    left, right = geometry.two_range_fixes(np.zeros(2), np.array([10.0, 0.0]), 8.0, 8.0)
    assert left[1] < 0.0 < right[1]  # baseline to the north: left is west


def test_refusals():
    with pytest.raises(geometry.GeometryError, match="do not meet over a baseline"):
        geometry.two_range_fixes(np.zeros(2), np.array([100.0, 0.0]), 10.0, 10.0)
    with pytest.raises(geometry.GeometryError, match="two different stations"):
        geometry.two_range_fixes(np.zeros(2), np.zeros(2), 10.0, 10.0)


def test_slant_range_shorter_than_the_height_difference_gives_zero():
    assert geometry.horizontal_range(5.0, 3.0) == pytest.approx(4.0)
    assert geometry.horizontal_range(2.0, 3.0) == 0.0
