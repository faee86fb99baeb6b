"""Offsets of stamps: the algebra against a filter that has them as states, the way back against closed forms, flights with late GPS."""

from dataclasses import replace

import numpy as np
import pytest
from test_ins_gps import GPS_ONLY, errors, measurements

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, ImuBlock
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.time_offsets import TimeOffset, Way, direct
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.trajectory import build
from lowcostnav_ros.trajectory.missions import standard

LATE_S = 0.35


def test_parameters_beside_a_filter_are_those_of_a_filter_that_has_them_as_states():
    rng = np.random.default_rng(4)
    n, k, m = 4, 2, 3
    A, prior = rng.normal(size=(n + k, n + k)), np.diag([0.5**-2, 2.0**-2])
    P, V, learned, x = A[:n] @ A[:n].T, np.zeros((n, k)), np.zeros((k, k + 1)), np.zeros(n)
    whole_P, whole_x = np.zeros((n + k, n + k)), np.zeros(n + k)
    whole_P[:n, :n], whole_P[n:, n:] = P, np.linalg.inv(prior)
    for _ in range(30):
        Phi, Q = np.eye(n) + 0.2 * rng.normal(size=(n, n)), np.diag(rng.uniform(0.1, 0.3, n))
        H, D, root = rng.normal(size=(m, n)), rng.normal(size=(m, k)), rng.normal(size=(m, m))
        z, R = rng.normal(size=m), root @ root.T
        x, P, V = Phi @ x, Phi @ P @ Phi.T + Q, Phi @ V
        plain = P.copy()
        x = x + kalman.update_with_parameters(P, z - H @ x, H, R, np.ones(n), D, V, learned)
        kalman.update(plain, z - H @ x, H, R, np.ones(n))
        assert np.array_equal(plain, P)  # the parameters change no bit of the covariance
        F = np.eye(n + k)
        F[:n, :n] = Phi
        whole_x, whole_P = F @ whole_x, F @ whole_P @ F.T
        whole_P[:n, :n] += Q
        J = np.hstack((H, D))
        K = whole_P @ J.T @ np.linalg.inv(J @ whole_P @ J.T + R)
        whole_x, whole_P = whole_x + K @ (z - J @ whole_x), whole_P - K @ J @ whole_P
    information = prior + learned[:, :k]
    p = np.linalg.solve(information, learned[:, k])
    np.testing.assert_allclose(p, whole_x[n:], rtol=1e-7)
    np.testing.assert_allclose(np.linalg.inv(information), whole_P[n:, n:], rtol=1e-7)
    np.testing.assert_allclose(x + V @ p, whole_x[:n], rtol=1e-7)  # what the parameters have done to the state


@pytest.mark.parametrize("late_s", [0.35, 0.12, -0.05])
def test_the_way_back_is_that_of_a_turn(late_s):
    def velocity(t):
        return 60.0 * np.array([np.cos(0.3 * t), np.sin(0.3 * t), 0.0])

    def place(t):
        return 200.0 * np.array([np.sin(0.3 * t), -np.cos(0.3 * t), 0.0])

    way, bias = Way(), np.array([1.0, -2.0, 0.5])
    for t in np.arange(0.0, 2.05, 0.1):
        way.note(float(t), velocity(t) + bias)  # a course may be off by a constant
    moved, faster = way.back(2.0, velocity(2.0), late_s)
    np.testing.assert_allclose(moved, place(2.0) - place(2.0 - late_s), atol=0.02)
    np.testing.assert_allclose(faster, velocity(2.0) - velocity(2.0 - late_s), atol=0.03)
    H, motion = np.array([[1.0, 0.0, 2.0, 0.5, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0, 0.0]]), np.arange(6.0)
    D, slope = direct(*way.points(), 1.5, 2.0, H, motion, 3, 1, 2)
    np.testing.assert_allclose(D, np.column_stack((np.zeros(2), -H @ np.array([0.0, 1.0, 2.0, *slope]))), rtol=1e-14)
    np.testing.assert_allclose(slope, 18.0 * np.array([-np.sin(0.45), np.cos(0.45), 0.0]), atol=0.05)


def test_what_is_not_sure_is_not_corrected():
    assert TimeOffset("gps", rest_s=0.3, sigma_s=0.05, spans=3.0).judge() == 0.3
    assert TimeOffset("gps", rest_s=0.3, sigma_s=0.07, spans=3.0).judge() == 0.0  # not sure
    assert TimeOffset("gps", rest_s=0.3, sigma_s=0.01, spans=1.5).judge() == 0.0  # of one manoeuvre
    assert TimeOffset("gps", rest_s=0.03, sigma_s=0.001, spans=9.0).judge() == 0.0  # of no importance
    assert TimeOffset("gps", rest_s=1.2, sigma_s=0.01, spans=9.0).judge() == 0.0  # a clock, not latency
    assert TimeOffset("gps", late_s=0.3, rest_s=0.03, sigma_s=0.01, spans=3.0).judge() == 0.03


def test_what_may_be_chance_widens_nothing_and_what_is_not_does_so_bit_by_bit():
    assert TimeOffset("gps", rest_s=0.1, sigma_s=0.05).doubt == pytest.approx(0.0)  # two sigmas
    assert TimeOffset("gps", rest_s=0.101, sigma_s=0.05).doubt < 0.015**2
    assert TimeOffset("gps", rest_s=0.5, sigma_s=0.1).doubt == pytest.approx(0.21)
    assert TimeOffset("gps", late_s=0.5, rest_s=0.03, sigma_s=0.04).doubt == pytest.approx(0.05**2)  # corrected: all of it counts


@pytest.fixture(scope="module")
def turning():
    mission = ["straight duration_s=10", "turn by_deg=120 bank_deg=25", "straight duration_s=10", "turn by_deg=-120 bank_deg=25"]
    return build(standard("demo", kind="segments", mission=mission * 3, duration_s=140.0)).table()


def late(stream, seconds):
    """The same with GPS stamped, and arriving, so much later."""
    shifted = []
    for m in stream:
        shifted.append(replace(m, stamp_ns=m.stamp_ns + round(1e9 * seconds)) if isinstance(m, GpsPosition | GpsVelocity) else m)
    return sorted(shifted, key=lambda m: m.stamp_ns)


def flown(stream, stamps="correct"):
    navigator = InsGps(replace(GPS_ONLY, horizon=replace(GPS_ONLY.horizon, stamps=stamps)))
    return navigator, navigator.feed_all(stream)


@pytest.mark.parametrize("seconds", [LATE_S, 0.15, -0.1])
def test_late_gps_is_found_in_turns_and_its_errors_are_taken_back(turning, seconds):
    stream = late(measurements(turning, 2, rate_hz=5.0), seconds)
    navigator, solutions = flown(stream)
    e, scores = errors(turning, solutions)
    plain, _ = errors(turning, flown(stream, "trust")[1])
    settled = e[:, 0] > 90.0
    gps = navigator.offsets.known["gps"]
    assert abs(gps.late_s + gps.rest_s - seconds) < max(4.0 * gps.sigma_s, 0.005)
    assert gps.sigma_s < 0.02
    assert gps.late_s == pytest.approx(seconds, abs=0.03)
    assert np.hypot(*e[settled, 1:3].T).max() < 2.5
    assert np.median(scores[settled, 0]) / 3.0 < 2.0  # sigmas honest again
    assert np.hypot(*plain[plain[:, 0] > 90.0, 1:3].T).mean() > 40.0 * abs(seconds)
    assert "corrected" in navigator.status().details["stamps of gps"]


def test_sound_stamps_are_left_alone_bit_by_bit_and_their_sigma_is_honest(turning):
    ratios = []
    for seed in range(4):
        stream = measurements(turning, seed, rate_hz=5.0)
        navigator, solutions = flown(stream)
        gps = navigator.offsets.known["gps"]
        assert gps.late_s == 0.0
        ratios.append(gps.rest_s / gps.sigma_s)
        if seed == 0:
            expected = flown(stream, "trust")[1]
            assert [s.place + tuple(s.cov_pos.ravel()) for s in solutions] == [s.place + tuple(s.cov_pos.ravel()) for s in expected]
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.8


def test_an_offset_that_is_declared_is_corrected_from_the_start(turning):
    gps = replace(GPS_ONLY.gps, late_s=0.3)
    navigator = InsGps(replace(GPS_ONLY, gps=gps))
    e, _ = errors(turning, navigator.feed_all(late(measurements(turning[:6000], 2, rate_hz=5.0), LATE_S)))
    assert np.hypot(*e[e[:, 0] > 12.0, 1:3].T).max() < 6.0  # what is not declared is 2.5 m at 50 m/s
    found = navigator.offsets.known["gps"]
    assert abs(found.late_s + found.rest_s - LATE_S) < 4.0 * found.sigma_s
    assert not any(aid.status.rejected for aid in navigator.aids)


def test_what_an_offset_cannot_do_to_an_aircraft_teaches_nothing(turning):
    stream = measurements(turning, 1)
    navigator, _ = flown(stream[: len(stream) // 2])
    navigator.offsets.V[:] = 1e80
    solutions = navigator.feed_all(stream[len(stream) // 2 :])
    (gps,) = navigator.offsets.known.values()
    assert gps.late_s == 0.0 and abs(gps.rest_s) < 4.0 * gps.sigma_s and np.abs(navigator.offsets.V).max() < 1e3
    assert all(np.isfinite(s.cov_pos).all() for s in solutions)


def test_straight_flight_tells_nothing():
    truth = build(standard("demo", kind="segments", mission=["straight duration_s=90"], duration_s=90.0)).table()
    navigator, _ = flown(late(measurements(truth, 1, rate_hz=5.0), LATE_S))
    gps = navigator.offsets.known["gps"]
    assert gps.late_s == 0.0
    assert not gps.is_observed
    assert "not observable" in navigator.status().details["stamps of gps"]


def test_a_correction_repeats_to_the_bit_however_blocks_are_cut(turning):
    stream = late(measurements(turning[:9000], 2, rate_hz=5.0), LATE_S)

    def cut(size):
        out = []
        for m in stream:
            out += [m[a : a + size] for a in range(0, len(m), size)] if isinstance(m, ImuBlock) else [m]
        navigator, solutions = flown(out)
        assert navigator.offsets.known["gps"].late_s
        return [(s.stamp_ns, *s.place, *s.cov_pos.ravel()) for s in solutions]

    assert cut(1) == cut(1000)
