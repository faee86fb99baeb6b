"""Routes, stations along them and the error to expect, against geodesy, printed numbers and a Monte Carlo of the same filter."""

import math
from pathlib import Path

import numpy as np
import pymap3d.vincenty
import pytest

from lowcostnav_ros.radionav.interrogation import InterrogationSchedule
from lowcostnav_ros.radionav.plan import (
    PlanError,
    Reply,
    Route,
    pair_changes,
    replies_along,
    route_over,
    stations_along,
    what_is_wrong,
)
from lowcostnav_ros.radionav.stations import StationTable, stations_from_text
from lowcostnav_ros.studies.reduced_covariance import ErrorModel, aided_sigma

TABLE = stations_from_text((Path(__file__).parents[1] / "config" / "dme_stations_bay_area.csv").read_text())
SALINAS, GILROY, LIVERMORE = ((math.radians(a), math.radians(b)) for a, b in ((36.6, -121.9), (37.0, -121.5), (37.69, -121.82)))
QUIET = {"heading": 1e-9, "heading_noise": 0.0, "airspeed_mps": 1e-9, "start_position_m": 1e-6, "start_wind_mps": 1e-9}


def straight(seconds, step_s=1.0, course=0.0):
    time_s = np.arange(0.0, seconds + 0.5 * step_s, step_s)
    return Route(time_s, np.zeros_like(time_s), np.zeros_like(time_s), np.full(time_s.size, course), 46.3)


def test_route_has_the_length_and_courses_of_vincenty():
    route = route_over([SALINAS, GILROY, LIVERMORE], 46.3)
    legs = [pymap3d.vincenty.vdist(*np.degrees(a), *np.degrees(b)) for a, b in ((SALINAS, GILROY), (GILROY, LIVERMORE))]
    assert route.time_s[-1] * 46.3 == pytest.approx(sum(float(d) for d, _ in legs), rel=1e-5)
    assert np.degrees(route.course[1]) == pytest.approx(float(legs[0][1]), abs=0.05)
    assert (route.lat[-1], route.lon[-1]) == pytest.approx(LIVERMORE, abs=1e-9)
    assert np.diff(route.time_s).max() <= 5.0 + 1e-9


@pytest.mark.parametrize(
    ("waypoints", "speed", "sentence"),
    [
        ([SALINAS], 46.3, "needs two waypoints"),
        ([SALINAS, SALINAS], 46.3, "Leg 1 of the route has no length; remove"),
        ([SALINAS, (0.0, 0.0)], 46.3, "km long; check its waypoints"),
        ([SALINAS, GILROY], 0.0, "speed must be positive"),
    ],
)
def test_routes_that_cannot_be_flown(waypoints, speed, sentence):
    with pytest.raises(PlanError, match=sentence):
        route_over(waypoints, speed)


def test_what_is_wrong_is_said_in_sentences():
    route = route_over([SALINAS, GILROY], 46.3)
    assert "single station only (SNS)" in what_is_wrong(stations_along(TABLE, route, 300.0))[0]
    far = route_over([(0.1, 0.1), (0.11, 0.1)], 46.3)
    assert what_is_wrong(stations_along(TABLE, far, 300.0))[0].endswith("climb or bring another station.")
    in_line = StationTable([TABLE["LIN"], TABLE["MOD"]])  # nearly north and south of each other
    north = route_over([(math.radians(36.9), TABLE["MOD"].lon), (math.radians(37.5), TABLE["MOD"].lon)], 46.3)
    said = " ".join(what_is_wrong(stations_along(in_line, north, 3000.0)))
    assert "pair LIN-MOD is collinear with the route leg" in said
    assert what_is_wrong(stations_along(TABLE, route_over([GILROY, LIVERMORE], 46.3), 1500.0)[12:]) == []


def test_replies_keep_the_schedule_and_alternate():
    route = route_over([GILROY, LIVERMORE], 46.3)
    points = stations_along(TABLE, route, 1500.0)
    replies = replies_along(TABLE, route, 1500.0, points, InterrogationSchedule())
    assert np.diff([r.time_s for r in replies]) == pytest.approx(15.0)
    first = points[0].pair
    assert [r.station for r in replies[:4]] == [first[0], first[1]] * 2
    assert [set(p) for _, _, p in pair_changes(points)][0] == set(first)
    single = StationTable([TABLE["SJC"]])
    alone = replies_along(single, route, 1500.0, stations_along(single, route, 1500.0), InterrogationSchedule())
    assert np.diff([r.time_s for r in alone]) == pytest.approx(30.0)  # twice a minute is all a station may be asked
    assert replies_along(StationTable([TABLE["SAC"]]), route, 100.0, stations_along(StationTable([TABLE["SAC"]]), route, 100.0),
                         InterrogationSchedule()) == []  # fmt: skip


def test_dead_reckoning_grows_as_the_printed_error_budget():
    times = [300, 600, 900, 1200, 1800]
    wind = aided_sigma(straight(1800.0), [], ErrorModel(**QUIET)).horizontal()
    assert wind[times] == pytest.approx([1154, 2597, 3909, 5057, 6954], rel=0.002)
    airspeed = aided_sigma(straight(1800.0), [], ErrorModel(**QUIET | {"airspeed_mps": 2.6, "wind_mps": 1e-9})).horizontal()
    # the budget starts from perfect sensors, this study from steady sensor errors: compare with the integral of a stationary process
    t = np.array(times, float)
    assert airspeed[times] == pytest.approx(2.6 * 400.0 * np.sqrt(2.0 * (t / 400.0 - 1.0 + np.exp(-t / 400.0))), rel=1e-6)


def test_expected_error_is_that_of_flown_filters():
    """400 flights of the four-state filter, written apart, through the same errors."""
    model, route = ErrorModel(), straight(600.0)
    turn = np.arange(1, 40)
    directions = [np.array([math.cos(b), math.sin(b)]) for b in (0.4, 2.2)]
    replies = [Reply(15.0 * k, "AB"[k % 2], directions[k % 2]) for k in turn]
    sigma = aided_sigma(route, replies, model)
    error, believed = fly_filters(400, 601, {15 * k: (k % 2, directions[k % 2]) for k in turn}, model)
    for at in (60, 299, 450, 600):
        spread = math.sqrt(np.mean(np.sum(error[at] ** 2, axis=1)))
        assert sigma.horizontal()[at] == pytest.approx(spread, rel=0.1)
        assert np.trace(sigma.estimated[at]) == pytest.approx(believed[at], rel=0.02)


def fly_filters(flights, seconds, ranges, model):
    """Errors (seconds, flights, 2) and believed variance before each fusion; one-second Euler steps, heading north at 46.3 m/s."""
    rng = np.random.default_rng(5)
    wind = model.start_wind_mps * rng.standard_normal((flights, 2))
    slow = rng.standard_normal((flights, 4)) * (model.heading, model.airspeed_mps, model.bias_m, model.bias_m)
    scale = np.array([model.heading, model.airspeed_mps, model.bias_m, model.bias_m])
    decay = np.exp(-1.0 / np.array([model.heading_tau_s, model.airspeed_tau_s, 20.0, 20.0]))
    wind_decay = math.exp(-1.0 / model.wind_tau_s)
    true = model.start_position_m * rng.standard_normal((flights, 2))
    guess, guess_wind = np.zeros((flights, 2)), np.zeros((flights, 2))
    P = np.diag([model.start_position_m**2] * 2 + [model.start_wind_mps**2] * 2)
    Phi = np.block([[np.eye(2), np.eye(2)], [np.zeros((2, 2)), wind_decay * np.eye(2)]])
    Q = np.diag([0.5, 0.5] + [model.wind_mps**2 * (1.0 - wind_decay**2)] * 2)
    errors, believed = [], []
    for second in range(seconds):
        if second:
            white = 46.3 * model.heading_noise * rng.standard_normal(flights)
            true += wind + np.column_stack((slow[:, 1], 46.3 * slow[:, 0] + white))
            guess += guess_wind
            wind = wind_decay * wind + model.wind_mps * math.sqrt(1.0 - wind_decay**2) * rng.standard_normal((flights, 2))
            guess_wind = wind_decay * guess_wind
            slow = decay * slow + scale * np.sqrt(1.0 - decay**2) * rng.standard_normal((flights, 4))
            P = Phi @ P @ Phi.T + Q
        errors.append(true - guess)
        believed.append(P[0, 0] + P[1, 1])
        if second in ranges:
            which, h = ranges[second]
            row = np.append(h, (0.0, 0.0))
            K = P @ row / (row @ P @ row + model.filter_range_m**2)
            innovation = (true - guess) @ h + slow[:, 2 + which] + model.noise_m * rng.standard_normal(flights)
            guess, guess_wind = guess + np.outer(innovation, K[:2]), guess_wind + np.outer(innovation, K[2:])
            P = P - np.outer(K, row @ P)
    return np.array(errors), believed


def test_flight_of_turns_and_an_approach_comes_near_the_recomputed_391_m():
    """Thesis-like flight: 180 s circles, then 640 s straight to the origin; stations 20 NM beyond; RMS of a Monte Carlo 391 m."""
    t, course = np.arange(0.0, 1801.0), math.radians(250.0)
    heading = np.where(t < 1160.0, 2.0 * np.pi * t / 180.0, course) % (2.0 * np.pi)
    to_go = 50.0 * np.minimum(1800.0 - t, 640.0)
    place = -np.outer(to_go, (math.cos(course), math.sin(course)))
    stations = {"A": (16.0 * 1852.0, -12.0 * 1852.0), "B": (-16.0 * 1852.0, -12.0 * 1852.0)}
    replies = []
    for k in range(1, 120):
        d = place[15 * k] - stations["AB"[k % 2]]
        replies.append(Reply(15.0 * k, "AB"[k % 2], d / np.hypot(*d)))
    sigma = aided_sigma(Route(t, 0.0 * t, 0.0 * t, heading, 50.0), replies, ErrorModel(start_wind_mps=1.0))
    assert math.sqrt(np.mean(sigma.horizontal()[120:] ** 2)) == pytest.approx(391.0, rel=0.06)
