"""What the ground sends up: radar fixes and the wind, from their messages to the error they take out."""

import math

import numpy as np
import pytest
from dead_reckoning_flight import ORIGIN, START_NS, in_order, straight, turning

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.decode import decode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning, DeadReckoningSettings
from lowcostnav_ros.reproduce.gebre.flights import fly
from lowcostnav_ros.reproduce.gebre.navigator_montecarlo import live_track, statistics
from lowcostnav_ros.reproduce.gebre.update_methods import Case

RADAR, WIND = "radar/fix", "uplink/wind"


def navigator(**changes):
    values = {"radar.topic": RADAR, "wind_uplink.topic": WIND, **{k.replace("__", "."): v for k, v in changes.items()}}
    return DeadReckoning(from_mapping(DeadReckoningSettings, values))


def started(flight, **changes):
    nav = navigator(**changes)
    nav.start_at(START_NS, ORIGIN.lat, ORIGIN.lon, ORIGIN.height, 10.0)
    return nav


def radar_fixes(flight, every, rng, sigma=200.0):
    """As the live decoder hands them over, after the trip through their message."""
    for k in range(every, len(flight), every):
        where = ORIGIN.from_ned(flight.ned[k] + np.append(rng.normal(0.0, sigma, 2), 500.0))  # a radar knows no height
        said = NavSolution(int(flight.stamps_ns[k]), RADAR, *(float(x) for x in where), cov_pos=np.diag([sigma**2, sigma**2, 1e4]))
        yield decode(RADAR, topics.NAV_SAT_FIX, to_cdr(encode.fix_from_solution(said)))


def winds(flight, every, error=(0.0, 0.0), sigma=2.0):
    for k in range(every, len(flight), every):
        said = NavSolution(int(flight.stamps_ns[k]), WIND, wind_n=flight.wind[k] + error, cov_wind=sigma**2 * np.eye(2))
        yield decode(WIND, topics.TWIST, to_cdr(encode.wind_from_solution(said)))


def horizontal_error(flight, solution):
    k = int(np.searchsorted(flight.stamps_ns, solution.stamp_ns))
    return math.hypot(*(flight.ned[k] - ORIGIN.to_ned(solution.lat, solution.lon, solution.height))[0:2])


def test_off_until_a_topic_is_set():
    nav = DeadReckoning(DeadReckoningSettings())
    assert RADAR not in nav.inputs
    assert [aid.status.name for aid in nav.aids] == ["gps_position", "gps_velocity", "dme", "baro_height"]
    assert [aid.status.name for aid in navigator().aids][4:] == ["radar_fix", "wind_uplink"]


def test_one_fix_moves_position_by_the_scalar_gain_and_leaves_height():
    """Position known to 300 m per axis and a fix good to 400 m: gain 0.36, sigma 240 m."""
    nav = started(straight(1.0), radar__floor_m=1.0)
    nav.core.P[:] = np.diag(np.full(nav.layout.size, 1e-12))
    nav.core.P[0, 0] = nav.core.P[1, 1] = 300.0**2
    nav.core.P[2, 2] = 50.0**2
    lat, lon, height = ORIGIN.from_ned(np.array([100.0, -50.0, -900.0]))
    aid = nav.aid("radar_fix")
    assert aid.process(NavSolution(START_NS, RADAR, float(lat), float(lon), float(height), cov_pos=np.diag([400.0**2, 400.0**2, 1.0])), nav)
    moved = ORIGIN.to_ned(*nav.core.nav)
    np.testing.assert_allclose(moved[0:2], [36.0, -18.0], atol=0.01)
    assert math.sqrt(nav.core.P[0, 0]) == pytest.approx(240.0)
    assert nav.core.nav[2] == pytest.approx(ORIGIN.height, abs=1e-3)
    assert nav.core.P[2, 2] == pytest.approx(2500.0)


def test_fixes_bound_what_dead_reckoning_alone_would_lose():
    flight = turning(900.0, wind=(12.0, -9.0))
    heard = in_order(flight.attitudes(math.radians(2.0)), flight.airspeeds(0.02), radar_fixes(flight, 120, np.random.default_rng(4)))
    with_radar = started(flight)
    last = with_radar.feed_all(heard)[-1]
    alone = started(flight).feed_all([m for m in heard if m.source != RADAR])[-1]
    assert horizontal_error(flight, alone) > 3000.0
    assert horizontal_error(flight, last) < 300.0
    assert math.sqrt(last.cov_pos[0, 0] + last.cov_pos[1, 1]) < 250.0
    assert "radar fix" in with_radar.status().reason
    np.testing.assert_allclose(last.wind_n, [12.0, -9.0], atol=3.0)  # the fixes teach the wind


def test_a_fix_far_off_is_rejected_by_name():
    flight = straight(60.0)
    fixes = list(radar_fixes(flight, 100, np.random.default_rng(1)))
    wrong = fixes[3]
    fixes[3] = NavSolution(wrong.stamp_ns, RADAR, wrong.lat + 0.01, wrong.lon, wrong.height, cov_pos=wrong.cov_pos)
    nav = started(flight)
    nav.core.know_wind(np.array([5.0, -3.0]), 1.0)
    nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), fixes))
    assert dict(nav.aid("radar_fix").status.rejected) == {"innovation beyond gate": 1}


def test_wind_from_the_ground_is_believed_once_not_every_minute():
    """Sixty reports in ten minutes share one error of 2 m/s: a mean of independent ones would claim 0.26 m/s."""
    flight = straight(600.0, wind=(14.0, 4.0))
    nav = started(flight)
    last = nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), winds(flight, 100, error=(1.5, -1.5))))[-1]
    sigma = np.sqrt(np.diag(last.cov_wind))
    assert np.all(sigma > 1.0)
    assert np.all(np.abs(last.wind_n - [14.0, 4.0]) < 2.5 * sigma)
    assert "wind from the ground" in nav.status().reason
    without = started(flight).feed_all(in_order(flight.attitudes(), flight.airspeeds()))[-1]
    assert horizontal_error(flight, last) < 0.25 * horizontal_error(flight, without)


def test_what_lacks_its_covariance_is_refused_by_name():
    nav = started(straight(1.0))
    assert not nav.aid("radar_fix").process(NavSolution(START_NS, RADAR, ORIGIN.lat, ORIGIN.lon, 0.0), nav)
    assert not nav.aid("wind_uplink").process(NavSolution(START_NS, WIND), nav)
    assert nav.aid("radar_fix").status.reason == "position or its covariance is missing"
    assert nav.aid("wind_uplink").status.reason == "wind or its covariance is missing"


@pytest.mark.parametrize("scheme", ["one", "scanning"])
def test_the_reduced_model_stays_honest_however_fast_the_ranges_come(scheme):
    """Ranges a second apart repeat one bias draw; counted as independent they gave a NEES of 36 for 2 on such flights."""
    tracks = [live_track(fly(seed), Case(scheme), "reduced") for seed in range(4)]
    result = statistics(tracks)
    assert 1.0 < result.nees < 4.0
    assert result.within > 0.95
