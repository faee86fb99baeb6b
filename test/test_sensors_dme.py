"""DME simulator: schedule, error statistics, horizon, choice of stations."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from sensors_truth import START_NS, steady_truth

from lowcostnav_ros.radionav.interrogation import ScheduleError
from lowcostnav_ros.radionav.selection import STEEPEST, audible, best_pair, usable, view
from lowcostnav_ros.radionav.stations import StationError, StationTable, stations_from_text
from lowcostnav_ros.sensors.dme import DmeSimulator, DmeSimulatorSettings, range_error

STATIONS = stations_from_text((Path(__file__).parents[1] / "config/dme_stations_bay_area.csv").read_text())
QUIET = {"drift_m": 0.0, "noise_m": 0.1}
LIVERMORE = math.radians(37.69), math.radians(-121.82)


def ranges(seconds=61.0, rate_hz=10, height=1000.0, **settings):
    truth = steady_truth(seconds, rate_hz, height=height)
    return DmeSimulator(DmeSimulatorSettings(**settings), STATIONS).simulate(truth), truth


def elapsed_s(measurement):
    return (measurement.stamp_ns - START_NS) * 1e-9 - 0.1


def test_one_receiver_alternates_a_range_every_15_s_after_search_and_reply():
    replies, _ = ranges(stations="OAK, sjc")
    assert [r.station for r in replies] == ["OAK", "SJC", "OAK", "SJC"]
    assert [elapsed_s(r) for r in replies] == pytest.approx([5.0, 20.0, 35.0, 50.0])


def test_scanning_receiver_ranges_every_station_once_a_second():
    replies, _ = ranges(20.0, scheme="scanning", interval_s=1.0, stations="OAK,SJC,CCR")
    assert [r.station for r in replies[:6]] == ["OAK", "SJC", "CCR"] * 2
    assert elapsed_s(replies[0]) == pytest.approx(5.0) and elapsed_s(replies[3]) == pytest.approx(6.0)


def test_two_receivers_reply_together_every_30_s():
    replies, _ = ranges(61.0, scheme="two_receivers", interval_s=30.0, stations="OAK,SJC")
    assert [(elapsed_s(r), r.station) for r in replies] == [(pytest.approx(t), s) for t in (5.0, 35.0) for s in ("OAK", "SJC")]


def test_over_budget_and_unknown_stations_are_refused():
    with pytest.raises(ScheduleError, match="use 15 s or longer"):
        DmeSimulator(DmeSimulatorSettings(interval_s=10.0), STATIONS)
    with pytest.raises(StationError, match="LAX is not in the table"):
        DmeSimulator(DmeSimulatorSettings(stations="OAK,LAX"), STATIONS)
    lone = StationTable([replace(STATIONS["OAK"], kind="VOR"), STATIONS["SJC"]])
    with pytest.raises(StationError, match="OAK is a VOR; name one of kind DME"):
        DmeSimulator(DmeSimulatorSettings(stations="OAK"), lone)
    assert {v.station.ident for v in usable(lone, *LIVERMORE, 1000.0)} == {"SJC"}


def test_other_traffic_leaves_a_share_of_the_questions_unanswered():
    quiet, _ = ranges(1200.0, scheme="scanning", interval_s=1.0, stations="OAK,SJC", rate_hz=2)
    settings = {"scheme": "scanning", "interval_s": 1.0, "stations": "OAK,SJC", "tracking_aircraft": 95, "searching_aircraft": 12}
    crowded, _ = ranges(1200.0, rate_hz=2, **settings)
    share = 3000.0 / (95 * 25 + 12 * 135 + 25)
    assert len(crowded) / len(quiet) == pytest.approx(share, abs=4.0 * math.sqrt(share * (1.0 - share) / len(quiet)))
    (note,) = DmeSimulator(DmeSimulatorSettings(**settings), STATIONS).notes
    assert note == "DME: stations answer 75 % of the questions under 4020 pulses/s."


def test_two_receivers_at_15_s_fly_when_asked_to_and_say_what_it_costs():
    settings = {"scheme": "two_receivers", "interval_s": 15.0, "over_budget": True}
    replies, _ = ranges(61.0, stations="OAK,SJC", **settings)
    assert len(replies) == 8
    assert "79 such aircraft saturate it" in DmeSimulator(DmeSimulatorSettings(**settings), STATIONS).notes[0]


def test_ranges_are_straight_lines_on_the_ellipsoid():
    replies, truth = ranges(stations="OAK,SJC", **QUIET)
    for reply in replies:
        row = int(np.searchsorted(truth.stamps_ns, reply.stamp_ns))
        s = STATIONS[reply.station]
        _, _, slant = pymap3d.geodetic2aer(s.lat, s.lon, s.height, truth.lat[row], truth.lon[row], truth.height[row], deg=False)
        assert reply.range_m == pytest.approx(slant, abs=0.5)


def test_error_variance_and_correlation_distance():
    errors = [range_error(DmeSimulatorSettings(seed=seed), "OAK") for seed in range(1500)]
    first, near, far = np.array([[e.draw(distance_m) for distance_m in (0.0, 926.0, 9260.0)] for e in errors]).T
    total = math.hypot(314.84, 7.4)
    tolerance = 4.0 / math.sqrt(1500)
    assert [first.std(), near.std(), far.std()] == pytest.approx([total] * 3, rel=tolerance)
    assert np.corrcoef(first, near)[0, 1] == pytest.approx(math.exp(-1.0), abs=tolerance)  # one correlation distance of 0.5 NM
    assert np.corrcoef(near, far)[0, 1] == pytest.approx(0.0, abs=tolerance)


def test_stations_have_independent_errors_and_the_white_part_alone_changes_on_the_spot():
    settings = DmeSimulatorSettings()
    errors = range_error(settings, "OAK"), range_error(settings, "SJC")
    assert errors[0].draw(0.0) != errors[1].draw(0.0)
    spot = np.array([errors[0].draw(0.0) for _ in range(2000)])
    assert spot.std() == pytest.approx(7.4, rel=4.0 / math.sqrt(4000))


def test_stated_variance_is_that_of_the_whole_error():
    replies, _ = ranges(6.0, stations="OAK,SJC", bias_m=50.0)
    assert replies[0].variance == pytest.approx(314.84**2 + 7.4**2 + 50.0**2)


def test_below_the_horizon_nothing_replies():
    assert not audible(STATIONS["SNS"], *LIVERMORE, 100.0)  # 116 km away; 100 m of height reach about 41 km with 4/3 earth
    replies, _ = ranges(height=20.0, stations="PYE,SNS")
    assert replies == []


def test_chosen_stations_see_each_other_near_a_right_angle():
    pair = best_pair(STATIONS, *LIVERMORE, 1000.0)
    a, b = (view(s, *LIVERMORE, 1000.0) for s in pair)
    cosine = a.direction_n[:2] @ b.direction_n[:2] / np.linalg.norm(a.direction_n[:2]) / np.linalg.norm(b.direction_n[:2])
    assert abs(cosine) < math.cos(math.radians(60.0))


def test_a_station_overhead_is_not_used_and_none_is_chosen_where_none_hears():
    oakland = STATIONS["OAK"]
    overhead = oakland.lat, oakland.lon + 1e-4, 3000.0
    assert view(oakland, *overhead).elevation > STEEPEST
    assert "OAK" not in {v.station.ident for v in usable(STATIONS, *overhead)}
    assert best_pair(STATIONS, math.radians(10.0), math.radians(-121.0), 1000.0) is None


def test_a_pair_is_kept_until_another_is_much_better():
    best = best_pair(STATIONS, *LIVERMORE, 1000.0)
    others = [v.station for v in usable(STATIONS, *LIVERMORE, 1000.0)]
    kept = next(
        pair
        for pair in ((a, b) for a in others for b in others if a.ident < b.ident and (a, b) != best)
        if best_pair(STATIONS, *LIVERMORE, 1000.0, keep=pair) == pair
    )
    assert kept != best
