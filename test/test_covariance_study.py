"""The study engine against closed forms and the live navigators' own algebra."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.studies.covariance_study import (
    MEASUREMENTS,
    Step,
    Update,
    discretise,
    error_budget,
    first_crossing,
    growth_exponent,
    run,
)

RATE = np.array([[0.0, 1.0], [0.0, 0.0]])


def double_integrator(density=0.3, dt_s=1.0):
    return discretise(RATE, {"drive": np.diag([0.0, density])}, dt_s)


def ranges(every, variance=4.0):
    return lambda k: [Update(np.array([[1.0, 0.0]]), np.array([[variance]]))] if k % every == 0 else []


@pytest.mark.parametrize("dt_s", [0.1, 1.0, 10.0])
def test_a_driven_double_integrator_grows_as_its_closed_form(dt_s):
    history = run(np.zeros((2, 2)), double_integrator(0.3, dt_s), 50)
    t = history.t_s
    np.testing.assert_allclose(t, dt_s * np.arange(51))
    np.testing.assert_allclose(history.sigma(0), np.sqrt(0.3 * t**3 / 3.0), rtol=1e-9)
    np.testing.assert_allclose(history.sigma(1), np.sqrt(0.3 * t), rtol=1e-9)


def test_one_dimensional_ins_growth():
    """Equations (5.33) to (5.35): gyro drift g t^3 / 6, accelerometer bias t^2 / 2, white noise g N sqrt(t^5 / 20) and N sqrt(t^3 / 3)."""
    g, t = 9.8, 100.0
    F = np.zeros((5, 5))  # position, velocity, tilt, accelerometer bias, gyro drift
    F[0, 1], F[1, 2], F[1, 3], F[2, 4] = 1.0, g, 1.0, 1.0
    rate_noise, force_noise = np.diag([0.0, 0.0, 1e-8, 0.0, 0.0]), np.diag([0.0, 1e-4, 0.0, 0.0, 0.0])
    starts = {"bias": np.diag([0.0, 0.0, 0.0, 1e-4, 0.0]), "drift": np.diag([0.0, 0.0, 0.0, 0.0, 1e-8])}
    _, parts = error_budget(starts, discretise(F, {"rate": rate_noise, "force": force_noise}, 1.0), 100)
    ours = {name: history.sigma(0)[-1] for name, history in parts.items()}
    expected = {"bias": 1e-2 * t**2 / 2, "drift": 1e-4 * g * t**3 / 6, "rate": 1e-4 * g * math.sqrt(t**5 / 20)}
    expected["force"] = 1e-2 * math.sqrt(t**3 / 3)
    assert ours == pytest.approx(expected, rel=1e-9)


def test_updates_equal_those_of_the_navigators():
    step, every = double_integrator(), ranges(3)
    P = np.diag([100.0, 4.0])
    history = run(P, step, 30, every)
    for k in range(1, 31):
        P = step.Phi @ P @ step.Phi.T + step.total()
        np.testing.assert_allclose(history.before[k], P, rtol=1e-10)
        for update in every(k):
            kalman.update(P, np.zeros(1), update.H, update.R, np.ones(2))
        np.testing.assert_allclose(history.P[k], P, rtol=1e-9)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**31), every=st.integers(1, 7))
def test_squares_of_a_budget_add_up_to_the_whole(seed, every):
    rng = np.random.default_rng(seed)
    F = 0.2 * rng.normal(size=(3, 3)) - 0.3 * np.eye(3)
    roots = rng.normal(size=(3, 3, 3))
    step = discretise(F, {"one": roots[0] @ roots[0].T, "two": np.diag([0.0, 1.0, 0.0])}, 0.5)
    updates = {k: [Update(rng.normal(size=(2, 3)), np.diag([1.0, 3.0]))] for k in range(every, 21, every)}
    whole, parts = error_budget({"start": roots[1] @ roots[1].T}, step, 20, lambda k: updates.get(k, ()))
    assert set(parts) == {"start", "one", "two", MEASUREMENTS}
    np.testing.assert_allclose(sum(h.P for h in parts.values()), whole.P, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(sum(h.before for h in parts.values()), whole.before, rtol=1e-7, atol=1e-9)


def test_a_step_may_change_with_time():
    slow, fast = double_integrator(dt_s=1.0), double_integrator(dt_s=2.0)
    history = run(np.zeros((2, 2)), lambda k: slow if k <= 4 else fast, 6)
    assert history.t_s[-1] == 8.0
    assert history.sigma(0)[-1] == pytest.approx(math.sqrt(0.3 * 8.0**3 / 3.0))
    assert history.at(5.9) == 5


def test_crossings_and_exponents_of_a_known_curve():
    t = np.arange(0.0, 101.0)
    assert first_crossing(t, 2.0 * t, 31.0) == pytest.approx(15.5)
    assert first_crossing(t, t, 1e9) == math.inf
    assert first_crossing(t, t + 5.0, 3.0) == 0.0
    assert growth_exponent(t, 7.0 * t**1.5, 10.0, 80.0) == pytest.approx(1.5)


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="does not fit"):
        Step(np.eye(2), {"wind": np.eye(3)})
    with pytest.raises(ValueError, match="longer than nothing"):
        Step(np.eye(2), {}, 0.0)
    with pytest.raises(ValueError, match="run it for longer"):
        run(np.eye(2), double_integrator(), 5).at(6.0)
