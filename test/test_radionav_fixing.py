"""Position fixes against closed forms, scipy's least squares and an independent geodesy library."""

import math

import numpy as np
import pymap3d
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from lowcostnav_ros.radionav.fixing import Bearing, Range, covariance, fix, rho_rho
from lowcostnav_ros.radionav.geometry import GeometryError
from lowcostnav_ros.radionav.stations import stations_from_text
from lowcostnav_ros.studies.slant_fixing import slant_fix

A, B, C = np.array([8600.0, -1500.0]), np.array([7600.0, 14900.0]), np.array([-9000.0, 4000.0])
DEG = math.radians(1.0)
metres = st.floats(-40_000.0, 40_000.0)


def ranges(place, *stations, sigma=10.0, offsets=(0.0, 0.0, 0.0, 0.0)):
    return [Range(s, math.dist(s, place) + o, sigma) for s, o in zip(stations, offsets, strict=False)]


def bearings(place, *stations, sigma=DEG):
    return [Bearing(s, math.atan2(place[1] - s[1], place[0] - s[0]), sigma) for s in stations]


@given(metres, metres)
def test_every_kind_of_fix_returns_the_place_it_was_made_from(north, east):
    place = np.array([north, east])
    gamma = math.atan2(*(place - A)) - math.atan2(*(place - B))
    assume(abs(math.sin(2.0 * gamma)) > 0.04 and min(math.dist(place, s) for s in (A, B, C)) > 500.0)
    near = place + (30.0, -20.0)
    for sights in (
        ranges(place, A, B),
        bearings(place, A, B),
        ranges(place, A) + bearings(place, A),
        ranges(place, A) + bearings(place, B),
        ranges(place, A, B, C) + bearings(place, A, B),
    ):
        assert fix(sights, near).position == pytest.approx(place, abs=1e-2)


@given(metres, metres)
def test_fixes_that_decide_need_no_prediction(north, east):
    place = np.array([north, east])
    assume(min(math.dist(place, s) for s in (A, B, C)) > 500.0)
    assume(abs(math.sin(math.atan2(*(place - A)) - math.atan2(*(place - B)))) > 0.1)
    for sights in (bearings(place, A, B), ranges(place, A) + bearings(place, A), ranges(place, A, B, C)):
        found = fix(sights)
        assert found.position == pytest.approx(place, abs=1e-2)
        assert found.mirror is None


def test_weighted_fix_of_contradicting_sights_equals_scipy():
    place = np.array([-4265.0, -6764.0])
    sights = ranges(place, A, B, C, sigma=50.0, offsets=(80.0, -60.0, 40.0)) + bearings(place + (200.0, 100.0), A, B)

    def residuals(p):
        distances = [(math.dist(s.station, p) - s.measured) / 50.0 for s in sights[:3]]
        angles = [(math.atan2(p[1] - s.station[1], p[0] - s.station[0]) - s.measured) / DEG for s in sights[3:]]
        return distances + angles

    oracle = least_squares(residuals, place, xtol=1e-14, ftol=1e-14)
    found = fix(sights, place + (500.0, 500.0))
    assert found.position == pytest.approx(oracle.x, abs=1e-3)
    assert found.covariance == pytest.approx(np.linalg.inv(oracle.jac.T @ oracle.jac), rel=1e-4)
    assert found.misfit == pytest.approx(math.sqrt(2.0 * oracle.cost / 5.0), rel=1e-6)


def test_covariance_is_that_of_many_noisy_fixes():
    rng, place = np.random.default_rng(3), np.array([-20_000.0, 3000.0])
    found = []
    for _ in range(800):
        noise = rng.normal(0.0, 30.0, 2)
        sights = ranges(place, A, B, sigma=30.0, offsets=noise)
        found.append(rho_rho(*sights, place).position)
    expected = covariance(ranges(place, A, B, sigma=30.0), place)
    assert np.cov(np.array(found).T) == pytest.approx(expected, rel=0.15, abs=60.0)


def test_unweighted_covariance_is_never_smaller():
    place = np.array([-4265.0, -6764.0])
    sights = ranges(place, A, B, sigma=185.0) + bearings(place, A, B)
    worse = covariance(sights, place, weighted=False) - covariance(sights, place)
    assert np.linalg.eigvalsh(worse).min() > -1e-6


def test_small_step_gain_arrives_at_the_same_place_in_more_steps():
    sights = ranges(np.array([-20_000.0, 3000.0]), A, B, C)
    full, slow = fix(sights, C + (100.0, 0.0)), fix(sights, C + (100.0, 0.0), step_gain=0.3)
    assert slow.position == pytest.approx(full.position, abs=1e-4)
    assert slow.iterations > full.iterations


def test_two_ranges_name_their_mirror_and_three_do_not():
    place = np.array([-20_000.0, 3000.0])
    found = fix(ranges(place, A, B), place + 500.0)
    for station in (A, B):
        assert math.dist(found.mirror, station) == pytest.approx(math.dist(place, station), abs=1e-4)
    assert math.dist(found.mirror, place) > 20_000.0
    assert fix(ranges(place, A, B, C), place + 500.0).mirror is None
    on_line = [A, A + 0.3 * (B - A), B]
    assert fix(ranges(place, *on_line), place + 500.0).mirror == pytest.approx(found.mirror, abs=1e-3)


@pytest.mark.parametrize(
    ("sights", "sentence"),
    [
        (ranges(C, A), "needs two ranges or bearings"),
        (ranges(C, A, A), "same place; use a second station"),
        (ranges(C, A, B), "fit two mirror positions; give a position by dead reckoning"),
        ([Range(A, 1000.0, 10.0), Range(B, 2000.0, 10.0)], "miss each other by 1.34e+04"),
        ([Range(A, 40_000.0, 10.0), Range(B, 2000.0, 10.0)], "miss each other"),
        ([Range(A, -5.0, 10.0), Range(B, 2000.0, 10.0)], "A range of -5 is not positive"),
        ([Range(A, math.nan, 10.0), Range(B, 2000.0, 10.0)], "finite measurement"),
        ([Bearing(A, 0.3, DEG), Bearing(B, 0.3, DEG)], "parallel and do not meet"),
        ([Bearing(A, -0.5 * math.pi, DEG), Bearing(B, 0.0, DEG)], "meet behind a station"),
        ([Range(A, 1000.0, 10.0), Bearing(B, 0.0, DEG)], "No range circle meets a bearing line; check the sights, magnetic variation"),
        (bearings(0.5 * (A + B), A, B), "parallel"),
    ],
)
def test_refusals_say_what_to_do(sights, sentence):
    with pytest.raises(GeometryError) as refusal:
        fix(sights)
    assert sentence in str(refusal.value)


def test_collinear_with_the_stations_is_refused():
    place = A + 0.4 * (B - A)
    with pytest.raises(GeometryError, match="one line"):
        covariance(ranges(place, A, B), place)
    with pytest.raises(GeometryError, match="step gain must lie in"):
        fix(ranges(place, A, C), place, step_gain=0.0)


TABLE = stations_from_text(
    "ident,name,lat_deg,lon_deg,elevation_ft,undulation_m,channel,service_volume\n"
    "OSI,Woodside,37.3927,-122.2820,2270,-32.5,86X,L\nECA,Manteca,37.8336,-121.1710,48,-32.5,107X,H\nSAC,Sacramento,38.4436,-121.5520,10,-32.5,99X,H\n"
)


def slant(station, lat_deg, lon_deg, height):
    place = (math.degrees(station.lat), math.degrees(station.lon), station.height)
    return pymap3d.geodetic2aer(lat_deg, lon_deg, height, *place)[2]


@pytest.mark.parametrize("height", [300.0, 1500.0, 5000.0])
def test_slant_ranges_from_pymap3d_give_the_place_back(height):
    stations = [TABLE["OSI"], TABLE["ECA"]]
    found = slant_fix(stations, [slant(s, 37.7, -121.8, height) for s in stations], height, (math.radians(37.72), math.radians(-121.83)))
    assert math.degrees(found.lat) == pytest.approx(37.7, abs=1e-8)
    assert math.degrees(found.lon) == pytest.approx(-121.8, abs=1e-8)
    mirror = [math.degrees(x) for x in found.mirror]
    assert [slant(s, *mirror, height) for s in stations] == pytest.approx([slant(s, 37.7, -121.8, height) for s in stations], abs=1e-3)
    three = [*stations, TABLE["SAC"]]
    sure = slant_fix(three, [slant(s, 37.7, -121.8, height) for s in three], height, (math.radians(37.72), math.radians(-121.83)))
    assert sure.mirror is None
    assert np.linalg.eigvalsh(found.covariance - sure.covariance).min() > 0.0  # a third station only helps


@pytest.mark.parametrize(
    ("ranges_m", "height", "sentence"),
    [
        ((50_000.0, 60_000.0), -3000.0, "is not that of an aircraft"),
        ((50_000.0, 2.0e6), 1500.0, "far beyond the radio horizon ("),
        ((50_000.0, 900.0), 1500.0, "shorter than the 1518 m between their heights"),
        ((50_000.0, math.nan), 1500.0, "is not a positive number; drop it"),
        ((20_000.0, 20_000.0), 1500.0, "miss each other by"),
        ((50_000.0,), 1500.0, "give one range per station"),
    ],
)
def test_impossible_slant_ranges_are_refused(ranges_m, height, sentence):
    with pytest.raises(GeometryError) as refusal:
        slant_fix([TABLE["OSI"], TABLE["ECA"]], ranges_m, height, (math.radians(37.7), math.radians(-121.8)))
    assert sentence in str(refusal.value)
