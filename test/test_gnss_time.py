"""GPS time against the standard library's calendar and the published leap seconds; rollovers and inserted seconds."""

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss import gps_time as gt

S = gt.SECOND
TIMES = st.integers(min_value=0, max_value=3000 * gt.WEEK_NS)


@pytest.mark.parametrize(
    ("date", "leaps"),
    [((1980, 1, 6), 0), ((1999, 8, 22), 13), ((2005, 4, 2), 13), ((2016, 12, 31), 17), ((2017, 1, 2), 18), ((2024, 6, 1), 18)],
)
def test_calendar_and_leap_seconds_by_the_standard_library(date, leaps):
    gps = gt.from_calendar(*date)
    assert gps == (datetime(*date, tzinfo=UTC) - datetime(1980, 1, 6, tzinfo=UTC)) // timedelta(microseconds=1) * 1000
    assert gt.leap_seconds(gps) == leaps
    assert gt.unix_ns(gps) == int(datetime(*date, tzinfo=UTC).timestamp() - leaps) * S


@given(TIMES)
def test_there_and_back_but_for_inserted_seconds(gps):
    back = gt.gps_ns(gt.unix_ns(gps))
    assert back == gps or (gps - back == S and gt.leap_seconds(gps) > gt.leap_seconds(gps - S))


def test_through_an_inserted_second_stamps_never_run_backwards_by_more_than_it():
    before = gt.gps_ns(int(datetime(2016, 12, 31, 23, 59, 59, tzinfo=UTC).timestamp()) * S)
    stamps = [gt.unix_ns(before + k * S) - gt.unix_ns(before) for k in range(4)]
    assert stamps == [0, 0, S, 2 * S]  # 23:59:59, 23:59:60, 00:00:00, 00:00:01


@given(TIMES, st.integers(min_value=-500, max_value=500))
def test_a_week_modulo_1024_is_completed_near_a_known_time(gps, off):
    week = max(gps // gt.WEEK_NS + off, 0)
    assert gt.full_week(week % 1024, gps) == week or abs(off) > 511
    assert gt.full_week(week, gps) == week


@given(TIMES, st.floats(min_value=-302399.0, max_value=302399.0))
def test_a_time_of_week_belongs_to_the_nearest_week(gps, off):
    target = max(gps + round(off * S), 0)
    assert abs(gt.nearest_tow(gt.week_and_tow(target)[1], gps) - target) <= 200  # a double holds a time of week to 0.1 ns


def test_rollover_of_2019():
    after = gt.from_calendar(2019, 4, 7, 0, 0, 0.0)
    assert gt.week_and_tow(after) == (2048, 0.0)
    assert gt.full_week(0, after) == 2048
    assert gt.full_week(1023, after) == 2047
    assert gt.nearest_tow(604784.0, after) == after - 16 * S


def test_two_digit_years():
    assert gt.from_calendar(5, 4, 2) == gt.from_calendar(2005, 4, 2)
    assert gt.from_calendar(93, 7, 1) == gt.from_calendar(1993, 7, 1)


@pytest.mark.parametrize("date", [(2005, 2, 30), (2005, 13, 1), (2005, 1, 1, 25), (1979, 1, 1), (2005, 1, 1, 0, 0, float("nan"))])
def test_impossible_dates_are_refused(date):
    with pytest.raises(GnssError, match="correct it"):
        gt.from_calendar(*date)


def test_bad_times_are_refused_with_what_to_do():
    with pytest.raises(GnssError, match="check the unit"):
        gt.from_week(1316, 604801.0)
    with pytest.raises(GnssError, match="set the clock"):
        gt.gps_ns(0)


def test_an_unknown_leap_second_is_named():
    gps = gt.from_calendar(2024, 1, 1)
    assert gt.leap_second_conflict(18, gps) == ""
    assert "19 leap seconds where the table of this program has 18" in gt.leap_second_conflict(19, gps)
