"""Parity of redundant observations against pseudo-inverses, and the means of residuals over time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.base.chi_square import exceeded_with
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.parity_windows import GAP_NS, ParityWindows, covariance_of_means
from lowcostnav_ros.gnss import parity

LIMITS = np.array([np.inf, *(exceeded_with(1e-6, dof) for dof in range(1, 128))])


def geometry(n, seed=0):
    rng = np.random.default_rng(seed)
    up = rng.normal(size=(n, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    up[:, 2] = -np.abs(up[:, 2])
    return np.hstack((-up, np.ones((n, 1))))


@given(st.integers(5, 14), st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_parity_equals_the_pseudo_inverse_and_forgets_the_unknowns(n, seed):
    rng = np.random.default_rng(seed)
    A, b = geometry(n, seed), rng.normal(size=n)
    solved, x, gain, w, S = parity.parity(A, b)
    if np.linalg.cond(A) > 1e4:
        return
    assert solved
    assert gain == pytest.approx(np.linalg.pinv(A), abs=1e-7)
    assert x == pytest.approx(np.linalg.pinv(A) @ b, abs=1e-7)
    assert pytest.approx(np.eye(n) - A @ np.linalg.pinv(A), abs=1e-7) == S
    _, _, _, moved, _ = parity.parity(A, b + A @ np.array([50.0, -30.0, 10.0, 1000.0]))
    assert moved == pytest.approx(w, abs=1e-6)


def test_too_few_and_flat_geometries_are_not_solved():
    assert not parity.parity(geometry(3), np.zeros(3))[0]
    flat = geometry(6)
    flat[:, 2] = 0.0
    assert not parity.parity(flat, np.zeros(6))[0]
    assert parity.judge(geometry(4), np.zeros(4), LIMITS)[0] == parity.UNTESTED


def test_judgement_names_the_one_that_is_wrong_or_says_why_it_cannot():
    A = geometry(8, 3)
    assert parity.judge(A, np.zeros(8), LIMITS)[0] == parity.HEALTHY
    for k in range(8):
        b = np.zeros(8)
        b[k] = 60.0
        verdict, row, horizontal, vertical, redundancy = parity.judge(A, b, LIMITS)
        assert (verdict, row, redundancy) == (parity.FOUND, k, 3)
        assert 0.0 < horizontal < np.inf and 0.0 < vertical < np.inf
    two = np.zeros(8)
    two[[1, 4]] = 60.0, -45.0
    assert parity.judge(A, two, LIMITS)[0] in (parity.SEVERAL, parity.AMBIGUOUS)
    b = np.zeros(5)
    b[2] = 100.0
    assert parity.judge(geometry(5, 3), b, LIMITS)[0] == parity.TOO_FEW


def test_slopes_are_the_error_a_fault_causes_over_the_statistic_it_shows():
    A = geometry(7, 5)
    _, _, gain, _, S = parity.parity(A, np.zeros(7))
    worst = np.zeros(2)
    for k in range(7):
        b = np.zeros(7)
        b[k] = 1.0
        _, x, _, w, _ = parity.parity(A, b)
        worst = np.maximum(worst, [np.hypot(x[0], x[1]) / np.linalg.norm(w), abs(x[2]) / np.linalg.norm(w)])
    assert parity.slopes(gain, S) == pytest.approx(worst)


def fed(windows, epochs, n=8, error=None, state=None, dt_s=0.1, seed=1, sigma=5.0):
    """Feed epochs of white noise, with an error of the satellites and a wandering state error."""
    rng, G = np.random.default_rng(seed), geometry(n, 3)
    R, slots = np.eye(n) * sigma**2, np.arange(n)
    for k in range(epochs):
        y = sigma * rng.normal(size=n) + (0.0 if error is None else error(k * dt_s)) + G @ (np.zeros(4) if state is None else state(k))
        assert windows.take(round(k * dt_s * 1e9), slots, y, G, R, np.ones(n, bool), np.ones(n, bool)) is not None
    return slots, np.ones(n, bool), G, R


def test_means_have_the_covariance_they_claim_and_hold_nothing_of_the_state():
    ends = []
    for seed in range(300):
        windows = ParityWindows([2.0, 5.0], 0.0, LIMITS)
        slots, _, G, R = fed(windows, 60, state=lambda k: 100.0 * np.sin(k / 7.0) * np.ones(4), seed=seed)
        ends.append(windows.mean[:, :8])
    ends = np.array(ends)
    _, _, _, _, S = parity.parity(*reversed(kalman.whiten(np.zeros(8), G, R)))
    for i in range(3):
        claimed = covariance_of_means(windows.factor[i], slots, R, 0.0)
        expected = np.diag(S) * np.diag(claimed)  # the fit takes its share of the noise
        assert np.mean(ends[:, i] ** 2, axis=0) == pytest.approx(expected, rel=0.35)


def test_a_slow_error_is_found_in_the_means_long_before_an_epoch_shows_it():
    ramp = np.zeros(8)
    ramp[2] = 0.5
    windows = ParityWindows([10.0, 60.0], 0.5, LIMITS)
    geometry_of = fed(windows, 300, error=lambda t: ramp * t)
    window, verdict, row, *_ = windows.judge(*geometry_of)
    assert (verdict, row) == (parity.FOUND, 2) and window > 0
    single = ParityWindows([], 0.5, LIMITS)
    geometry_of = fed(single, 300, error=lambda t: ramp * t)
    assert single.judge(*geometry_of)[1] == parity.HEALTHY


def test_an_error_within_the_slow_allowance_is_healthy():
    best = int(np.argmax(np.diag(parity.parity(geometry(8, 3), np.zeros(8))[4])))  # the one whose own error shows most
    slow = np.zeros(8)
    slow[best] = 2.5
    windows = ParityWindows([10.0, 60.0], 2.0, LIMITS)
    assert windows.judge(*fed(windows, 600, error=lambda t: slow))[1] == parity.HEALTHY
    strict = ParityWindows([10.0, 60.0], 0.0, LIMITS)
    assert strict.judge(*fed(strict, 600, error=lambda t: slow))[1:3] == (parity.FOUND, best)


def test_a_silent_satellite_starts_anew():
    windows = ParityWindows([10.0], 0.0, LIMITS)
    slots, trusted, G, R = fed(windows, 50)
    assert windows.count[0] == 50
    found = windows.take(round(4.9e9) + 2 * GAP_NS, slots, np.zeros(8), G, R, trusted, trusted)
    assert windows.count[0] == 1
    assert not found[-1]
