"""Geodesy against pymap3d, printed vectors and numerical derivatives."""

import math

import numpy as np
import pymap3d
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.physics import earth

LAT = st.floats(-math.pi / 2, math.pi / 2)
LON = st.floats(-math.pi, math.pi)
HEIGHT = st.floats(-500.0, 30_000.0)
FLYABLE_LAT = st.floats(-1.4, 1.4)
SITE = (math.radians(38.7), math.radians(-9.1), 500.0)


def test_golden_position_and_radii():
    np.testing.assert_allclose(earth.geodetic_to_ecef(*SITE), [4921871.207, -788356.039, 3966692.990], atol=6e-4)
    np.testing.assert_allclose(earth.radii(SITE[0]), [6360390.920, 6386499.283], atol=6e-4)


@pytest.mark.parametrize(
    ("lat_deg", "height", "expected"),
    [(0, 0, 9.7803267715), (45, 0, 9.8061990479), (90, 0, 9.8321851272)]
    + [(38.7, 0, 9.8005454808), (38.7, 500, 9.7990026751), (38.7, 1000, 9.7974602300)],
)
def test_golden_gravity(lat_deg, height, expected):
    assert earth.gravity(math.radians(lat_deg), float(height)) == pytest.approx(expected, abs=6e-11)


@given(LAT)
def test_gravity_series_stays_near_the_closed_somigliana_formula(lat):
    """WGS-84 Somigliana: 9.7803253359 (1 + 0.00193185265241 s^2)/sqrt(1 - e^2 s^2); the older series differs by 0.15 mgal."""
    s2 = math.sin(lat) ** 2
    closed = 9.7803253359 * (1 + 0.00193185265241 * s2) / math.sqrt(1 - earth.WGS84_E2 * s2)
    assert earth.gravity(lat, 0.0) == pytest.approx(closed, abs=2e-6)


@given(FLYABLE_LAT)
def test_gravity_falls_with_height_as_inverse_square(lat):
    lost = earth.gravity(lat, 0.0) - earth.gravity(lat, 10_000.0)
    assert lost == pytest.approx(9.806 * (1 - (6371e3 / 6381e3) ** 2), rel=5e-3)


@given(LAT, LON, HEIGHT)
def test_to_ecef_agrees_with_pymap3d(lat, lon, height):
    expected = pymap3d.geodetic2ecef(lat, lon, height, deg=False)
    np.testing.assert_allclose(earth.geodetic_to_ecef(lat, lon, height), expected, atol=5e-9)


@given(LAT, LON, st.floats(-5000.0, 3.0e7))
def test_from_ecef_undoes_to_ecef(lat, lon, height):
    point = earth.geodetic_to_ecef(lat, lon, height)
    np.testing.assert_allclose(earth.geodetic_to_ecef(*earth.ecef_to_geodetic(point)), point, atol=3e-8)
    assert earth.ecef_to_geodetic(point)[2] == pytest.approx(height, abs=2e-8)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_poles_and_their_neighbourhood(sign):
    lat, lon, height = earth.ecef_to_geodetic(np.array([0.0, 0.0, sign * (earth.WGS84_B + 1234.5)]))
    assert (lat, lon) == (sign * math.pi / 2, 0.0)
    assert height == pytest.approx(1234.5, abs=2e-9)
    near = sign * (math.pi / 2 - 1e-10)
    assert earth.ecef_to_geodetic(earth.geodetic_to_ecef(near, 1.0, 9000.0))[0] == pytest.approx(near, abs=1e-14)


@given(st.floats(-6e4, 6e4), st.floats(-6e4, 6e4), st.floats(-6e4, 6e4))
def test_the_earths_core_gives_numbers(x, y, z):
    assert np.all(np.isfinite(earth.ecef_to_geodetic(np.array([x, y, z]))))


@given(FLYABLE_LAT, LON)
def test_local_level_axes_are_the_derivatives_of_position(lat, lon):
    step = 1e-6
    north = earth.geodetic_to_ecef(lat + step, lon, 0.0) - earth.geodetic_to_ecef(lat - step, lon, 0.0)
    east = earth.geodetic_to_ecef(lat, lon + step, 0.0) - earth.geodetic_to_ecef(lat, lon - step, 0.0)
    down = earth.geodetic_to_ecef(lat, lon, 0.0) - earth.geodetic_to_ecef(lat, lon, 1.0)
    meridian, normal = earth.radii(lat)
    rows = np.array([north / (2 * step * meridian), east / (2 * step * normal * math.cos(lat)), down])
    np.testing.assert_allclose(earth.dcm_ne(lat, lon), rows, atol=3e-8)


@given(FLYABLE_LAT, HEIGHT, st.floats(-250, 250), st.floats(-250, 250))
def test_transport_rate_is_the_turn_of_the_level_frame(lat, height, north, east):
    """[omega x] = -dC_ne/dt C_ne' along the path, differentiated numerically."""
    vel, dt = np.array([north, east, 0.0]), 1.0
    meridian, normal = earth.radii(lat)
    d_lat, d_lon = dt * north / (meridian + height), dt * east / ((normal + height) * math.cos(lat))
    ahead, behind = earth.dcm_ne(lat + d_lat / 2, d_lon / 2), earth.dcm_ne(lat - d_lat / 2, -d_lon / 2)
    spin = -(ahead - behind) @ earth.dcm_ne(lat, 0.0).T / dt
    expected = [spin[2, 1], spin[0, 2], spin[1, 0]]
    np.testing.assert_allclose(earth.transport_rate_n(lat, height, vel), expected, atol=1e-11)


@given(LAT, LON)
def test_earth_rate_is_the_polar_axis_seen_from_here(lat, lon):
    expected = earth.dcm_ne(lat, lon) @ np.array([0.0, 0.0, earth.EARTH_RATE])
    np.testing.assert_allclose(earth.earth_rate_n(lat), expected, atol=1e-19)


@given(FLYABLE_LAT, LON, HEIGHT, st.tuples(*[st.floats(-300, 300)] * 3).map(np.array))
def test_displacement_and_difference_are_inverse_and_near_the_exact_plane(lat, lon, height, d_n):
    moved = earth.displace(lat, lon, height, d_n)
    np.testing.assert_allclose(earth.difference_n(*moved, lat, lon, height), d_n, atol=2e-8)
    exact = earth.LocalFrame(lat, lon, height).to_ned(*moved)
    curvature = 2 * np.dot(d_n, d_n) / 6.3e6 * (1 + abs(math.tan(lat)))
    np.testing.assert_allclose(exact, d_n, atol=curvature + 1e-7)


def test_difference_across_the_date_line_is_short():
    d_n = earth.difference_n(0.0, math.radians(-179.9999), 0.0, 0.0, math.radians(179.9999), 0.0)
    assert d_n[1] == pytest.approx(math.radians(0.0002) * earth.WGS84_A, rel=1e-9)
    lon = earth.displace(0.0, math.radians(179.9999), 0.0, d_n)[1]
    assert lon == pytest.approx(math.radians(-179.9999), abs=1e-12)


@given(FLYABLE_LAT, LON, HEIGHT, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), HEIGHT)
def test_local_frame_agrees_with_pymap3d(lat0, lon0, height0, d_lat, d_lon, height):
    lat, lon = np.clip(lat0 + d_lat, -1.5, 1.5), lon0 + d_lon
    frame = earth.LocalFrame(lat0, lon0, height0)
    ned = frame.to_ned(lat, lon, height)
    np.testing.assert_allclose(ned, pymap3d.geodetic2ned(lat, lon, height, lat0, lon0, height0, deg=False), atol=2e-8)
    back = frame.from_ned(ned)
    assert back[0] == pytest.approx(lat, abs=1e-14)
    assert math.remainder(back[1] - lon, 2 * math.pi) == pytest.approx(0.0, abs=1e-13)
    assert back[2] == pytest.approx(height, abs=2e-8)


def test_local_frame_columns_equal_single_points():
    frame = earth.LocalFrame(*SITE)
    lats, lons, heights = np.radians([38.0, 39.0, 38.7]), np.radians([-9.0, -8.0, -9.1]), np.array([0.0, 3000.0, 500.0])
    ned = frame.to_ned(lats, lons, heights)
    assert ned.shape == (3, 3)
    np.testing.assert_array_equal(ned[1], frame.to_ned(lats[1], lons[1], heights[1]))
    np.testing.assert_allclose(ned[2], 0.0, atol=1e-9)
    back = frame.from_ned(ned)
    np.testing.assert_allclose(back[0], lats, atol=1e-15)
    assert isinstance(frame.from_ned(ned[0])[0], float)


def test_frame_rotation_carries_vectors_between_places():
    """A vector turned by C_ln is the same arrow in space: compare through ECEF with pymap3d's own rotation."""
    frame, lat, lon = earth.LocalFrame(*SITE), math.radians(40.0), math.radians(-3.0)
    v_n = np.array([10.0, -20.0, 3.0])
    v_e = pymap3d.enu2uvw(v_n[1], v_n[0], -v_n[2], math.degrees(lat), math.degrees(lon))
    up_e = pymap3d.uvw2enu(*v_e, math.degrees(SITE[0]), math.degrees(SITE[1]))
    np.testing.assert_allclose(frame.C_ln(lat, lon) @ v_n, [up_e[1], up_e[0], -up_e[2]], atol=1e-12)


def test_local_frame_refuses_degrees():
    with pytest.raises(ValueError, match="rad"):
        earth.LocalFrame(38.7, -9.1, 0.0)


def test_radio_horizon_rule_of_thumb():
    """The navigator's rule: 1.23 nm per square root of a foot."""
    rule = 1.23 * math.sqrt(10_000) * 1852.0
    assert earth.horizon_distance(10_000 * 0.3048) == pytest.approx(rule, rel=5e-3)
    both = earth.horizon_distance(3000.0) + earth.horizon_distance(30.0)
    assert earth.line_of_sight_clear(3000.0, 30.0, both - 1.0)
    assert not earth.line_of_sight_clear(3000.0, 30.0, both + 1.0)
    assert earth.horizon_distance(-5.0) == 0.0
    np.testing.assert_array_equal(earth.line_of_sight_clear(np.array([10.0, 9000.0]), 5.0, 100_000.0), [False, True])
