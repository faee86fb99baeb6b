"""Layouts, coverage maps, networks and benchmarks against closed forms, the scalar rules and printed numbers."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.base.units import NAUTICAL_MILE as NM
from lowcostnav_ros.radionav import layouts
from lowcostnav_ros.radionav.benchmarks_vor import vor_cross_track
from lowcostnav_ros.radionav.coverage import coverage, grid_about, near
from lowcostnav_ros.radionav.geometry import hdop
from lowcostnav_ros.radionav.selection import usable
from lowcostnav_ros.radionav.stations import stations_from_text
from lowcostnav_ros.studies import network

TABLE = stations_from_text((Path(__file__).parents[1] / "config" / "dme_stations_bay_area.csv").read_text())
metres = st.floats(-60_000.0, 60_000.0)


def test_three_stations_are_best_at_the_centre_and_nowhere_better():
    axis = np.linspace(-30.0, 30.0, 61) * NM
    values = layouts.hdop_map(layouts.triple(), axis[:, None], axis[None, :])
    assert values[30, 30] == pytest.approx(1.1547, abs=1e-4) == pytest.approx(2.0 / math.sqrt(3.0), abs=1e-4)
    assert values.min() >= 2.0 / math.sqrt(3.0) - 1e-12
    assert values.max() == pytest.approx(2.1, rel=0.03)


@given(metres, metres)
def test_map_equals_the_scalar_hdop(north, east):
    stations = layouts.double(beyond_m=5000.0, approach_course=1.0)
    rows = np.array([north, east]) - stations
    expected = hdop(rows) if (np.hypot(*rows.T) > 0.0).all() else math.inf
    assert float(layouts.hdop_map(stations, north, east)) == pytest.approx(expected, rel=1e-9)


def test_offset_stations_lie_beyond_the_airport_on_both_sides():
    stations = layouts.double(20_000.0, 8000.0, math.radians(90.0))  # flying east
    assert stations == pytest.approx(np.array([[20_000.0, 8000.0], [-20_000.0, 8000.0]]))
    assert layouts.hdop_map(stations, 3000.0, 8000.0) == math.inf


def test_in_track_error_grows_towards_the_line_of_the_stations():
    in_track, cross_track = layouts.track_errors(layouts.double(20_000.0), (-20_000.0, 0.0), 0.0, 10.0)
    assert (in_track, cross_track) == pytest.approx((10.0, 10.0))  # lines of sight 45 deg to both sides
    nearer = layouts.track_errors(layouts.double(20_000.0), (-5000.0, 0.0), 0.0, 10.0)
    sine = 5000.0 / math.hypot(5000.0, 20_000.0)
    assert nearer == pytest.approx((10.0 / (math.sqrt(2.0) * sine), 10.0 / math.sqrt(2.0 * (1.0 - sine**2))))
    assert layouts.track_errors(layouts.double(20_000.0), (0.0, 0.0), 0.0) == (math.inf, math.inf)


@pytest.mark.parametrize("height", [150.0, 1500.0, 6000.0])
def test_maps_follow_the_rules_of_the_scalar_selection(height):
    _, lat, lon = grid_about(math.radians(37.2), math.radians(-121.4), 120e3, 7)
    seen = coverage(list(TABLE), lat, lon, height)
    for i, j in np.ndindex(lat.shape):
        one_by_one = usable(TABLE, lat[i, j], lon[i, j], height)
        assert seen.audible[i, j] == len(one_by_one)
        directions = [v.direction_n for v in one_by_one]
        assert seen.hdop_all[i, j] == pytest.approx(hdop(np.array(directions)) if len(directions) > 1 else math.inf, rel=1e-9)
        pairs = [hdop(np.array([a, b])) for k, a in enumerate(directions) for b in directions[k + 1 :]]
        assert seen.hdop_pair[i, j] == pytest.approx(min(pairs, default=math.inf), rel=1e-9)
        if pairs:
            chosen = {list(TABLE)[k].ident for k in seen.pair[i, j]}
            assert chosen <= {v.station.ident for v in one_by_one}
    assert seen.share(3) > 0.0 and seen.share(3) <= seen.share(2) <= seen.share(1)


def test_no_station_is_no_coverage():
    seen = coverage([], np.zeros((2, 2)), np.zeros((2, 2)), 1000.0)
    assert seen.share(1) == 0.0 and np.isinf(seen.hdop_pair).all()


def test_near_lists_the_nearest_first():
    found = near(list(TABLE), math.radians(37.39), math.radians(-122.28), 30e3)
    assert [s.ident for s in found][:2] == ["OSI", "NUQ"]


def test_grid_rows_lie_north_and_columns_east():
    offsets, lat, lon = grid_about(math.radians(37.0), math.radians(-122.0), 10e3, 3)
    assert offsets == pytest.approx([-10e3, 0.0, 10e3])
    assert lat[2, 1] > lat[1, 1] > lat[0, 1] and lon[1, 2] > lon[1, 1] > lon[1, 0]


def test_printed_site_counts_and_what_does_not_add_up():
    assert [o.total for o in network.OPTIONS] == [318, 356, 442, 512]
    assert [o.gap for o in network.OPTIONS] == [20, -32, 0, 0]
    assert network.OPTIONS[0].remark == "option I: 273 + 25 = 298, not 318; 293 existing or 45 additional would"
    assert (network.total_cost().sensor_usd, network.total_cost().consumer_usd) == (2000.0, 13_000.0)


def test_vor_error_as_printed():
    assert vor_cross_track(20.0, np.radians([1.0, 5.0])) == pytest.approx([0.35, 1.75], rel=0.003)
    with pytest.raises(ValueError, match="below 90 degrees"):
        vor_cross_track(20.0, math.pi)
