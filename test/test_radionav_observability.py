"""Rows of sequential ranges against central differences of the ranges themselves, ranks and printed singular values."""

import math

import numpy as np
import pytest

from lowcostnav_ros.base.units import NAUTICAL_MILE as NM
from lowcostnav_ros.radionav.observability import Track, fly, measurement_rows, rank, singular_values

TIME = np.arange(0.0, 600.5, 0.5)
RANGES = 15.0 * np.arange(40)
STATIONS = np.array([[10.0, -20.0], [10.0, 20.0]]) * NM
TURNS = math.radians(60.0) * np.sin(2.0 * np.pi * TIME / 300.0)


def ranges(offset):
    """Ranges of a flight with errors (position, wind, heading, airspeed), integrated apart from the code under test."""
    speed, heading = 46.3 + 5.0 * np.sin(TIME / 50.0) + offset[5], TURNS + offset[4]
    rates = np.column_stack((speed * np.cos(heading) + offset[2], speed * np.sin(heading) + offset[3]))
    middle = 0.5 * (rates[1:] + rates[:-1]) * 0.5
    place = np.array([-50.0 * NM, 0.0]) + offset[0:2] + np.vstack(([0.0, 0.0], np.cumsum(middle, axis=0)))
    at = place[np.searchsorted(TIME, RANGES)]
    return np.hypot(*(at - STATIONS[np.arange(40) % 2]).T)


def test_rows_are_the_derivatives_of_the_ranges():
    track = fly(TIME, (-50.0 * NM, 0.0), TURNS, 46.3 + 5.0 * np.sin(TIME / 50.0))
    rows = measurement_rows(track, STATIONS, RANGES)
    for column, step in enumerate((1.0, 1.0, 1e-3, 1e-3, 1e-5, 1e-3)):
        offset = np.zeros(6)
        offset[column] = step
        numeric = (ranges(offset) - ranges(-offset)) / (2.0 * step)
        assert rows[:, column] == pytest.approx(numeric, rel=1e-5, abs=1e-3)


@pytest.mark.parametrize(
    ("heading", "states", "expected_rank", "printed"),
    [
        (0.0 * TIME, 4, 4, (1.38, 1.35, 0.377, 0.348)),
        (0.0 * TIME, 6, 4, (1.71, 1.65, 0.433, 0.399)),
        (TURNS, 6, 6, (1.77, 1.57, 0.445, 0.410, 0.186, 0.034)),
    ],
)
def test_printed_ranks_and_singular_values(heading, states, expected_rank, printed):
    rows = measurement_rows(fly(TIME, (-50.0 * NM, 0.0), heading, np.full(TIME.size, 46.3)), STATIONS, RANGES, states)
    assert rank(rows) == expected_rank
    assert singular_values(rows)[: len(printed)] == pytest.approx(printed, rel=0.01)


@pytest.mark.parametrize("course_deg", [0.0, 90.0, 37.0])
def test_stations_along_the_track_leave_one_line(course_deg):
    unit = np.array([math.cos(math.radians(course_deg)), math.sin(math.radians(course_deg))])
    flown = np.outer(46.3 * TIME, unit)
    track = Track(TIME, *flown.T, *np.outer(np.full(TIME.size, 46.3), unit).T)
    rows = measurement_rows(track, np.outer((60.0 * NM, 80.0 * NM), unit), RANGES, 2)
    assert rank(rows) == 1
    assert singular_values(rows, normalise=False) == pytest.approx([math.sqrt(40.0), 0.0], abs=1e-6)


def test_other_numbers_of_states_are_refused():
    with pytest.raises(ValueError, match="2, 4 or 6 states"):
        measurement_rows(fly(TIME, (0.0, 0.0), TURNS, np.ones(TIME.size)), STATIONS, RANGES, 5)
