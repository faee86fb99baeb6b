"""Radials: prediction against an independent geodesy, derivative against differences, where a VOR can be used."""

import math
from pathlib import Path

import numpy as np
import pymap3d
import pymap3d.vincenty
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.physics.earth import LocalFrame, displace
from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.radionav.stations import stations_from_text
from lowcostnav_ros.radionav.vor import bearing_view, nearest_vors, out_of_service, radial_of

STATIONS = stations_from_text((Path(__file__).parents[1] / "config" / "dme_stations_bay_area.csv").read_text())
OAK = STATIONS["OAK"]


def around(bearing_deg, distance_m, above_m=1000.0, station=OAK):
    north, east = distance_m * math.cos(math.radians(bearing_deg)), distance_m * math.sin(math.radians(bearing_deg))
    return LocalFrame(station.lat, station.lon, station.height).from_ned(np.array([north, east, -above_m]))


@pytest.mark.parametrize("bearing_deg", [0.0, 37.0, 90.0, 135.0, 179.999, 180.001, 250.0, 359.0])
@pytest.mark.parametrize("distance_m", [2_000.0, 40_000.0, 200_000.0])
def test_bearing_distance_and_elevation_agree_with_an_independent_geodesy(bearing_deg, distance_m):
    place = around(bearing_deg, distance_m)
    seen = bearing_view(OAK, *place)
    azimuth, elevation, slant = pymap3d.geodetic2aer(*place, OAK.lat, OAK.lon, OAK.height, deg=False)
    assert wrap(seen.bearing - azimuth) == pytest.approx(0.0, abs=1e-9)
    assert seen.elevation == pytest.approx(elevation, abs=1e-9)
    assert seen.distance_m == pytest.approx(slant * math.cos(elevation), rel=1e-9)
    _, geodesic_deg = pymap3d.vincenty.vdist(
        math.degrees(OAK.lat), math.degrees(OAK.lon), math.degrees(place[0]), math.degrees(place[1])
    )
    assert abs(math.degrees(wrap(seen.bearing - math.radians(float(geodesic_deg))))) < 1e-3


@given(st.floats(0.0, 360.0), st.floats(500.0, 200_000.0), st.floats(-500.0, 10_000.0))
def test_gradient_equals_differences(bearing_deg, distance_m, above_m):
    place = around(bearing_deg, distance_m, above_m)
    gradient = bearing_view(OAK, *place).gradient_n
    step = 1e-3 * distance_m
    for axis in range(3):
        moved = [bearing_view(OAK, *displace(*place, sign * step * np.eye(3)[axis])).bearing for sign in (1.0, -1.0)]
        assert wrap(moved[0] - moved[1]) / (2.0 * step) == pytest.approx(gradient[axis], rel=1e-5, abs=1e-5 / distance_m)


def test_right_over_the_station_there_is_no_derivative():
    seen = bearing_view(OAK, OAK.lat, OAK.lon, OAK.height)
    assert np.array_equal(seen.gradient_n, np.zeros(3))
    assert np.isfinite([seen.bearing, seen.elevation]).all()


def test_the_radial_counts_from_the_stations_own_north():
    assert math.degrees(radial_of(math.radians(90.0), OAK.declination)) == pytest.approx(73.0)  # 17 east: magnetic is the smaller number
    assert math.degrees(radial_of(math.radians(10.0), OAK.declination)) == pytest.approx(353.0)


@given(st.floats(-20.0, 20.0), st.floats(-4.0, 4.0))
def test_a_radial_is_a_number_of_the_compass_rose_and_declination_gives_the_bearing_back(bearing, declination):
    radial = radial_of(bearing, declination)
    assert 0.0 <= radial < 2.0 * math.pi
    assert math.cos(radial + declination - bearing) == pytest.approx(1.0, abs=1e-12)


def test_where_a_vor_cannot_be_used_is_named():
    assert out_of_service(OAK, *around(30.0, 30_000.0)) == ""
    assert out_of_service(OAK, *around(30.0, 500.0, 1000.0)) == "in the cone of confusion"  # 63 degrees up
    assert out_of_service(OAK, *around(30.0, 620.0, 1000.0)) == ""  # 58 degrees
    assert out_of_service(OAK, *around(30.0, 80_000.0)) == "outside the service volume"  # 43 NM
    assert out_of_service(OAK, *around(90.0, 60_000.0, -250.0)) == "outside the service volume"  # 30 m high: below the horizon
    assert out_of_service(STATIONS["NUQ"], *around(30.0, 3000.0)) == "station has no VOR"  # a TACAN


def test_the_nearest_usable_stations_are_chosen():
    place = around(90.0, 2_000.0, 1_000.0)
    chosen = nearest_vors(STATIONS, *place, 3)
    distances = [bearing_view(s, *place).distance_m for s in chosen]
    assert chosen[0] is OAK
    assert distances == sorted(distances)
    assert all(s.has_vor for s in chosen)
    assert nearest_vors(STATIONS, 0.1, 0.1, 1000.0, 2) == []
