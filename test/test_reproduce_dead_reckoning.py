"""Dead-reckoning studies against the live navigator's own propagation, closed forms and plain re-implementations."""

import math

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import SlantRange
from lowcostnav_ros.cores.imu_errors import ImuSettings
from lowcostnav_ros.cores.reckoning import HeldInputs
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning
from lowcostnav_ros.physics.earth import LocalFrame, difference_n
from lowcostnav_ros.physics.rotation import euler_to_quat, wrap
from lowcostnav_ros.reproduce.gebre import dead_reckoning as reckoning
from lowcostnav_ros.reproduce.gebre import flights
from lowcostnav_ros.reproduce.gebre import ins_grades as grades
from lowcostnav_ros.reproduce.gebre import navigator_montecarlo as montecarlo
from lowcostnav_ros.reproduce.gebre import update_methods as methods
from lowcostnav_ros.reproduce.registry import DIFFERS, NOT_IN_NUMBERS, REPRODUCED, Context, all_results
from lowcostnav_ros.studies.covariance_study import error_budget, run

OURS = ["GR33", "GR34", "GR35", "GR36", "GR40", "GR41", "GR42", "GR43", "GR44", "GR45", "GR46", "GR47", "GR48", "GR48a", "GR48b", "GR53"]
COVARIANCE = [name for name in OURS if not name.startswith(("GR47", "GR48"))]


@pytest.fixture(scope="module")
def context():
    return Context(quick=True, seed=1)


@pytest.fixture(scope="module")
def entries():
    return {entry.id: entry for entry in all_results()}


WITH_READINGS = ("GR40", "GR41", "GR42", "GR43", "GR44", "GR46")
"""Results on which the correlation distance of the range biases bears, of which the thesis has two."""


@pytest.mark.parametrize("name", COVARIANCE)
def test_covariance_results_keep_their_verdict(name, entries, context):
    outcome = entries[name].function(context)
    assert outcome.verdict == REPRODUCED, outcome.ours
    assert len(outcome.readings) == (2 if name in WITH_READINGS else 0)


@pytest.mark.parametrize("heading_deg", [0.0, 130.0])
def test_the_studied_step_is_the_one_the_live_navigator_takes(heading_deg):
    """The navigator itself, flown through its own propagation of mean and covariance and its own range update."""
    settings = reckoning.thesis_settings()
    heading = math.radians(heading_deg)
    navigator = DeadReckoning(settings)
    state = navigator.core
    held = state.held = HeldInputs(q_nb=euler_to_quat(0.0, 0.0, heading), cov_att=np.zeros((3, 3)), vel_b=np.array([46.3, 0.0, 0.0]))
    held.airborne, held.attitude_ns, held.air_ns, held.speed = True, 0, 0, 46.3
    state.start(0, np.array([0.6, -2.1, 0.0]), np.diag([4.0, 4.0, 100.0]))
    layout, step = reckoning.dead_reckoning_step(settings, heading=heading)
    assert layout.labels == state.layout.labels
    history = run(state.P, step, 240)
    for k in range(1, 241):
        held.attitude_ns = held.air_ns = k * 10**9
        state.move(k * 10**9)
        state.settle()
    np.testing.assert_allclose(history.P[-1], state.P, rtol=1e-9, atol=1e-9)


def test_the_measurement_row_is_that_of_the_live_aid():
    case = methods.Case("one")
    study = methods.study(case)
    update = study.updates(15)[0]
    table = methods_stations()
    navigator = DeadReckoning(reckoning.thesis_settings(), table)
    here = methods.AIRPORT.from_ned(np.array([methods.START_NORTH_M + 15 * reckoning.SPEED_MPS, 0.0, 0.0]))
    navigator.start_at(0, float(here[0]), float(here[1]), 0.0)
    navigator.aid("dme").slots.take("ONE", 0, navigator.P, navigator.core.estimate)
    answer = navigator.aid("dme").innovation(SlantRange(0, "dme/range", "ONE", 1e5, 0.0), navigator)
    np.testing.assert_allclose(answer.H[0, [0, 1]], update.H[0, [0, 1]], atol=1e-9)
    bias = navigator.layout["dme_bias"]
    np.testing.assert_array_equal(answer.H[0, bias], update.H[0, bias])


def methods_stations():
    from lowcostnav_ros.radionav.stations import Station, StationTable

    places = [methods._place(*(1852.0 * np.array(s))) for s in methods.STATIONS_NM]
    return StationTable([Station(n, n, p[0], p[1], 0.0, 0.0, "86X", "H") for n, p in zip(("ONE", "TWO"), places, strict=True)])


def test_leaving_the_row_of_the_biases_out_equals_a_filter_without_them():
    literal = run(*methods.study(methods.Case("one", model="L")))
    P0, step, steps, updates = methods.study(methods.Case("one", model="L"))
    kept = np.array([0, 1, 4, 5, 6, 7])  # position, wind, heading, airspeed: no range bias, no height
    square = np.ix_(kept, kept)
    P, Qd = P0[square], step.total()[square]
    for k in range(1, 601):
        P = step.Phi[square] @ P @ step.Phi[square].T + Qd
        for update in updates(k):
            H = update.H[:, kept]
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + update.R)
            P = (np.eye(6) - K @ H) @ P
    np.testing.assert_allclose(P[:2, :2], literal.P[600, :2, :2], rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "two_m", "one_m"),
    [
        ({"stations_nm": ((5.0, -20.0), (5.0, 20.0))}, 24.3, 59.6),
        ({"stations_nm": ((10.0, -10.0), (10.0, 10.0))}, 27.6, 69.8),
        ({"white_heading": "psi"}, 29.5, 71.0),
        ({"bias_distance_nm": 5.0}, 11.9, 27.3),
    ],
    ids=["stations nearer", "stations closer", "noise on heading", "5 NM"],
)
def test_sensitivities_of_the_update_methods(context, changes, two_m, one_m):
    assert methods.excess(context, methods.Case("two", **changes)) == pytest.approx(two_m, rel=0.02)
    assert methods.excess(context, methods.Case("one", **changes)) == pytest.approx(one_m, rel=0.02)


def test_unobservable_states_stay_unknown(context):
    """Heading, airspeed and range biases are hardly learned from two stations (section 7.2); wind is."""
    history = methods.studied(context, methods.Case("one"))
    sigma = np.sqrt(np.diag(history.P[1800]))
    assert sigma[4:6] == pytest.approx([3.6, 3.3], abs=0.06)
    assert math.degrees(sigma[6]) == pytest.approx(2.44, abs=0.02)
    assert sigma[7] == pytest.approx(2.43, abs=0.02)
    assert sigma[8] == pytest.approx(300.0, rel=0.02)


def test_ins_errors_begin_as_the_one_dimensional_closed_forms():
    """Equations (5.33) to (5.35): rate noise g N sqrt(t^5 / 20) and force noise N sqrt(t^3 / 3), per axis, Schuler coupling cut."""
    imu = ImuSettings(
        gyro_noise_dps_rthz=0.05,
        gyro_bias_dps=1e-9,
        gyro_turn_on_dps=0.0,
        accel_noise_mg_rthz=1.0,
        accel_bias_mg=1e-9,
        accel_turn_on_mg=0.0,
    )
    labels, step = grades.inertial_step(imu, schuler=False)
    assert len(labels) == 13
    _, parts = error_budget({}, step, 60)
    t, g = 60.0, 9.8
    gyro = g * math.radians(0.05) * math.sqrt(t**5 / 20.0)
    accel = 9.80665e-3 * math.sqrt(t**3 / 3.0)
    for axis in (0, 1):
        assert parts["gyros"].sigma(axis)[-1] == pytest.approx(gyro, rel=0.003)
        assert parts["accelerometers"].sigma(axis)[-1] == pytest.approx(accel, rel=0.003)


def test_sparse_ranges_do_not_hold_a_low_grade_ins(entries, context):
    """Section 8.2.1: judged unsatisfactory; heading drifts on, half a mile is passed, though the ranges do bound the error."""
    outcome = entries["GR59"].function(context)
    assert outcome.verdict == NOT_IN_NUMBERS
    labels, aided = grades.dme_aided("automotive")
    heading = aided.sigma(labels.index("attitude_down_rad"))
    free = math.hypot(0.25, 0.05 * math.sqrt(60.0))  # white rate noise alone, one minute
    assert math.degrees(heading[60]) > free
    assert np.max(aided.sigma(0, 1)) > reckoning.LIMIT_M
    assert aided.sigma(0, 1)[-1] < 0.01 * grades.unaided("automotive").sigma(0, 1)[-1]  # bounded all the same


def test_flights_move_with_the_air_and_end_on_the_way_to_the_airport():
    flight = flights.fly(7)
    frame = LocalFrame(flights.AIRPORT.lat, flights.AIRPORT.lon)
    ned = frame.to_ned(*flight.place.T)
    steps = np.array([difference_n(*b, *a)[:2] for a, b in zip(flight.place[:-1], flight.place[1:], strict=True)])
    speed = np.hypot(*(steps - flight.wind_n).T)
    np.testing.assert_allclose(speed, flights.AIRSPEED_MPS, atol=0.01)
    from_centre = np.hypot(*(ned[120 : flights.TURNS_S, :2] - flights.CENTRE_M).T)
    np.testing.assert_allclose(from_centre, flights.RADIUS_M, rtol=0.1)
    distance = np.hypot(*ned[:, :2].T)
    assert distance[-1] < 0.35 * distance[flights.TURNS_S]


def test_range_errors_are_the_same_for_every_method_and_have_the_model_s_size():
    table = flights.stations()
    residuals, shared = [], []
    for seed in range(12):
        flight = flights.fly(seed)
        scanning = {(m.stamp_ns, m.station): m.range_m for m in flights.ranges(flight, methods.Case("scanning"), table)}
        one = flights.ranges(flight, methods.Case("one"), table)
        shared += [m.range_m == scanning[m.stamp_ns, m.station] for m in one]
        for (stamp_ns, ident), range_m in scanning.items():
            if stamp_ns % (60 * flights.SECOND_NS) == 0:
                station = table[ident]
                place = LocalFrame(station.lat, station.lon, station.height).to_ned(
                    *flight.place[(stamp_ns - flights.START_NS) // flights.SECOND_NS]
                )
                residuals.append(range_m - np.linalg.norm(place))
    assert all(shared)
    assert len(one) == 120
    assert np.std(residuals) == pytest.approx(methods.NOISE_M * 42.5, rel=0.1)  # 0.17 NM


def test_the_compiled_reduced_filter_is_the_four_state_filter_of_the_thesis():
    """Section 6.5 written down again on a flat earth with horizontal ranges: the same wind, position and covariance."""
    flight, case = flights.fly(3), methods.Case("one")
    track = montecarlo.reduced_track(flight, case, montecarlo.WHOLE_M)
    frame = LocalFrame(flights.AIRPORT.lat, flights.AIRPORT.lon, flights.HEIGHT_M)
    table = flights.stations()
    towers = {s.ident: frame.to_ned(s.lat, s.lon, s.height) for s in table}
    heard = {(m.stamp_ns - flights.START_NS) // flights.SECOND_NS: m for m in flights.ranges(flight, case, table)}
    decay = math.exp(-1.0 / 400.0)
    F = np.array([[0.0, 0, 1, 0], [0, 0, 0, 1], [0, 0, -1 / 400, 0], [0, 0, 0, -1 / 400]])
    Phi, Qd = kalman.van_loan(F, np.diag([0.5, 0.5, 0.125, 0.125]), 1.0)
    assert Phi[2, 2] == pytest.approx(decay)
    x = np.array([*frame.to_ned(*montecarlo.displaced_start(flight))[:2], *flight.wind_n[0]])
    P = np.diag([4.0, 4.0, 1.0, 1.0])
    for k in range(1, flights.FLIGHT_S + 1):
        x[:2] += flight.air_n()[k - 1, :2] + x[2:]
        P = Phi @ P @ Phi.T + Qd
        if k in heard:
            tower, reply = towers[heard[k].station], heard[k].range_m
            d = x[:2] - tower[:2]
            level = math.sqrt(reply**2 - flights.HEIGHT_M**2)
            H = np.append(d / np.hypot(*d), [0.0, 0.0])[None]
            K = P @ H.T / (H @ P @ H.T + montecarlo.WHOLE_M**2)
            x += K[:, 0] * (level - np.hypot(*d))
            P = (np.eye(4) - K @ H) @ P
    truth = frame.to_ned(*flight.place[-1])[:2]
    np.testing.assert_allclose(truth - x[:2], track.error_m[-1], atol=15.0)  # 50 km of flat earth
    np.testing.assert_allclose(P[:2, :2], track.covariance[-1], rtol=0.01, atol=50.0)


def test_flight_like_runs(entries, context):
    """Open loop loses half a mile within minutes; counted whole, range biases leave 95 % of the time inside it; as printed they do not."""
    verdicts = {name: entries[name].function(context).verdict for name in ("GR47", "GR48", "GR48a")}
    assert verdicts == {"GR47": REPRODUCED, "GR48": REPRODUCED, "GR48a": DIFFERS}


def test_the_live_navigator_stays_inside_half_a_mile_and_its_sigma():
    for seed in (11, 12):
        track = montecarlo.live_track(flights.fly(seed), methods.Case("one"))
        assert np.mean(track.horizontal()[120:] < reckoning.LIMIT_M) > 0.9
        assert 0.3 < montecarlo.statistics([track]).nees < 6.0


def test_every_figure_draws(entries, context, tmp_path):
    from lowcostnav_ros.reproduce.run import save_figure

    for name in ("GR33", "GR35", "GR40", "GR45", "GR47"):
        draw = entries[name].function(context).figure
        path = save_figure(draw, tmp_path, name)
        assert (tmp_path / path).stat().st_size > 5000


def test_courses_turn_no_faster_than_they_may():
    flight = flights.fly(5)
    course = np.unwrap(np.arctan2(*np.diff(flight.place[:, :2] * [1.0, math.cos(flights.AIRPORT.lat)], axis=0).T[::-1]))
    assert np.max(np.abs(np.diff(course))) < flights.STEEPEST_TURN * 1.05
    assert abs(wrap(course[-1] - math.radians(250.0))) < math.radians(10.0)
