"""The Kalman algebra against filterpy, scipy and closed forms."""

import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.stats import chi2, multivariate_normal

from lowcostnav_ros.base import chi_square
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.consistency import acceptance_band, error_over_sigma_rms, nees
from lowcostnav_ros.estimation.smoothing import rts_smoother


def random_covariance(rng, n):
    A = rng.standard_normal((n, n))
    return A @ A.T + 0.1 * np.eye(n)


def test_van_loan_reproduces_the_gauss_markov_closed_form():
    sigma, tau, dt = 2.5, 120.0, 15.0
    Phi, Q = kalman.van_loan(np.array([[-1 / tau]]), np.array([[2 * sigma**2 / tau]]), dt)
    assert Phi[0, 0] == pytest.approx(np.exp(-dt / tau), rel=1e-12)
    assert Q[0, 0] == pytest.approx(sigma**2 * (1 - np.exp(-2 * dt / tau)), rel=1e-12)


def test_van_loan_reproduces_the_white_acceleration_closed_form():
    dt, q = 0.7, 3.0
    _, Q = kalman.van_loan(np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([0.0, q]), dt)
    assert np.allclose(Q, q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), rtol=1e-12)


def test_short_step_discretisation_approaches_van_loan():
    rng = np.random.default_rng(3)
    F, GQG, dt = 0.3 * rng.standard_normal((6, 6)), random_covariance(rng, 6), 0.02
    P = random_covariance(rng, 6)
    Phi, Q = kalman.van_loan(F, GQG, dt)
    exact = Phi @ P @ Phi.T + Q
    kalman.predict_covariance(P, kalman.transition(F, dt), GQG, dt)
    assert np.allclose(kalman.transition(F, dt), expm(F * dt), atol=1e-5)
    assert np.allclose(P, exact, rtol=1e-4)


def test_noise_by_simpson_is_that_of_white_acceleration_to_the_last_digits():
    F, GQG, dt = np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([0.0, 3.0]), 0.1
    P = np.zeros((2, 2))
    kalman.predict_covariance_by_simpson(P, kalman.transition(F, dt), kalman.transition(F, 0.5 * dt), GQG, dt)
    assert kalman.van_loan(F, GQG, dt)[1] == pytest.approx(P, rel=1e-12)


def test_update_equals_filterpy():
    rng = np.random.default_rng(1)
    n, m = 7, 3
    P, H, R, y = random_covariance(rng, n), rng.standard_normal((m, n)), random_covariance(rng, m), rng.standard_normal(m)
    oracle = KalmanFilter(dim_x=n, dim_z=m)
    oracle.P, oracle.H, oracle.R = P.copy(), H, R
    oracle.update(y)
    ours = P.copy()
    dx = kalman.update(ours, y, H, R, np.ones(n))
    assert np.allclose(dx, oracle.x.ravel(), rtol=1e-10)
    assert np.allclose(ours, oracle.P, rtol=1e-9)
    S = kalman.innovation_covariance(P, H, R)
    assert kalman.normalised_innovation_squared(y, S) == pytest.approx(oracle.mahalanobis**2, rel=1e-9)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.integers(1, 3), st.floats(-6.0, 6.0))
def test_update_with_a_semidefinite_noise_equals_the_pseudo_inverse(seed, n, rank, power):
    rng = np.random.default_rng(seed)
    P, H, y = random_covariance(rng, n), rng.standard_normal((3, n)), rng.standard_normal(3)
    B = np.linalg.qr(rng.standard_normal((3, 3)))[0][:, :rank]
    R = 10.0**power * B @ B.T
    S = H @ P @ H.T + R
    condition = np.linalg.cond(S)
    assume(condition < 1e8)
    K = P @ H.T @ np.linalg.pinv(S, rcond=1e-14)
    ours = P.copy()
    dx = kalman.update(ours, y, H, R, np.ones(n))
    close = 1e-9 + 10.0 * kalman.SHARPEST * condition  # what is sharper than SHARPEST is not told apart
    assert np.allclose(dx, K @ y, rtol=0.0, atol=close * (np.abs(K) @ np.abs(y)).max())
    assert np.allclose(ours, P - K @ S @ K.T, rtol=0.0, atol=close * (np.abs(K) @ np.abs(S) @ np.abs(K.T) + np.abs(P)).max())


@pytest.mark.parametrize("variance", [0.0, 5e-324, 1e-300, 1e-18, 1e29, 1e300])
@pytest.mark.parametrize("correlation", [0.0, 1.0, -1.0])
def test_no_noise_makes_a_covariance_that_is_none(variance, correlation):
    R = np.full((3, 3), correlation * variance)
    R[0] *= np.sign(correlation)
    R[:, 0] *= np.sign(correlation)
    np.fill_diagonal(R, variance)
    P = random_covariance(np.random.default_rng(3), 6)
    for _ in range(3):
        dx = kalman.update(P, np.array([1.0, -2.0, 0.5]), np.eye(3, 6), R, np.ones(6))
        assert np.isfinite(dx).all()
        assert P.diagonal().min() > 0.0
        assert np.linalg.eigvalsh(P).min() > -1e-14 * np.trace(P)


def test_a_correction_that_is_no_number_leaves_the_covariance_alone():
    P = random_covariance(np.random.default_rng(3), 4)
    before = P.copy()
    assert np.isnan(kalman.update(P, np.array([1e300]), np.full((1, 4), 1e200), np.eye(1), np.ones(4))).all()
    assert np.array_equal(P, before)


def test_filter_run_equals_filterpy():
    rng = np.random.default_rng(2)
    dt = 1.0
    oracle = KalmanFilter(dim_x=2, dim_z=1)
    oracle.F, oracle.H = np.array([[1, dt], [0, 1]]), np.array([[1.0, 0.0]])
    oracle.Q, oracle.R, oracle.P = Q_discrete_white_noise(2, dt, 0.1), np.array([[4.0]]), np.diag([100.0, 10.0])
    x, P = np.zeros(2), oracle.P.copy()
    for z in np.cumsum(rng.standard_normal(50)):
        oracle.predict()
        oracle.update(z)
        x, P = oracle.F @ x, oracle.F @ P @ oracle.F.T + oracle.Q
        x = x + kalman.update(P, np.array([z - x[0]]), oracle.H, oracle.R, np.ones(2))
    assert np.allclose(x, oracle.x.ravel(), rtol=1e-9)
    assert np.allclose(P, oracle.P, rtol=1e-9)


def test_a_considered_state_keeps_its_estimate_and_variance():
    rng = np.random.default_rng(4)
    P = random_covariance(rng, 4)
    before = P.copy()
    dx = kalman.update(P, np.array([2.0]), np.array([[1.0, 0.5, 0.2, 1.0]]), np.array([[0.5]]), np.array([1.0, 1.0, 1.0, 0.0]))
    assert dx[3] == 0.0
    assert P[3, 3] == pytest.approx(before[3, 3], rel=1e-12)
    assert np.linalg.eigvalsh(P).min() > 0.0
    assert P[0, 0] < before[0, 0]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.integers(1, 3))
def test_covariance_stays_symmetric_positive_and_never_grows_in_an_update(seed, n, m):
    rng = np.random.default_rng(seed)
    P, R = random_covariance(rng, n), random_covariance(rng, m)
    before = P.copy()
    kalman.update(P, rng.standard_normal(m), rng.standard_normal((m, n)), R, np.ones(n))
    assert np.array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > 0.0
    assert np.linalg.eigvalsh(before - P).min() > -1e-9 * np.trace(before)


def test_guard_repairs_what_is_broken_and_leaves_the_rest():
    P = np.diag([1.0, -1e-9, 4.0])
    P[0, 2] = P[2, 0] = 3.0  # correlation 1.5
    P[0, 1] = P[1, 0] = np.nan
    assert kalman.guard_covariance(P, np.full(3, 1e-6), np.full(3, 1e6)) >= 2
    assert np.isfinite(P).all()
    assert abs(P[0, 2]) <= np.sqrt(P[0, 0] * P[2, 2])
    healthy = random_covariance(np.random.default_rng(0), 3)
    copy = healthy.copy()
    assert kalman.guard_covariance(healthy, np.full(3, 1e-12), np.full(3, 1e12)) == 0
    assert np.array_equal(healthy, copy)


def test_steady_state_gain_is_what_the_filter_settles_to():
    Phi, Q = np.array([[1.0, 0.5], [0.0, 1.0]]), np.diag([0.01, 0.02])
    H, R = np.array([[1.0, 0.0]]), np.array([[0.25]])
    K, P_after = kalman.steady_state_gain(Phi, Q, H, R)
    P = np.eye(2)
    for _ in range(300):
        P = Phi @ P @ Phi.T + Q
        gain = P @ H.T / (H @ P @ H.T + R)
        kalman.update(P, np.zeros(1), H, R, np.ones(2))
    assert np.allclose(K, gain, rtol=1e-8)
    assert np.allclose(P_after, P, rtol=1e-8)


def test_steady_state_gain_refuses_an_unobservable_constant():
    with pytest.raises(ValueError, match="neither measured nor decaying"):
        kalman.steady_state_gain(np.diag([1.0, 1.1]), np.diag([1.0, 1.0]), np.array([[1.0, 0.0]]), np.eye(1))


def test_smoother_equals_filterpy():
    rng = np.random.default_rng(5)
    f = KalmanFilter(dim_x=2, dim_z=1)
    f.F, f.H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    f.Q, f.R, f.P = 0.05 * np.eye(2), np.eye(1) * 2.0, np.eye(2) * 50.0
    xs, covs, _, _ = f.batch_filter(np.cumsum(rng.standard_normal(30)))
    x, P = xs.reshape(30, 2), covs
    ours_x, ours_P, _ = rts_smoother(x, P, np.repeat(f.F[None], 29, 0), np.repeat(f.Q[None], 29, 0))
    oracle_x, oracle_P, _, _ = f.rts_smoother(xs, covs)
    assert np.allclose(ours_x, oracle_x.reshape(30, 2), rtol=1e-8)
    assert np.allclose(ours_P, oracle_P, rtol=1e-8)


def test_gate_and_band_come_from_chi_square():
    assert chi_square.threshold(0.999, 1) == pytest.approx(10.828, abs=1e-3)
    low, high = acceptance_band(3, 20)
    assert (low, high) == pytest.approx(tuple(chi2.ppf([0.025, 0.975], 60) / 20))


def test_nees_of_matched_errors_falls_inside_its_band():
    rng = np.random.default_rng(6)
    P = random_covariance(rng, 4)
    errors = rng.multivariate_normal(np.zeros(4), P, size=4000)
    low, high = acceptance_band(4, 4000, 0.999)
    assert low < nees(errors, np.broadcast_to(P, (4000, 4, 4))).mean() < high
    assert error_over_sigma_rms(errors[:, 0], np.sqrt(P[0, 0])) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("dof", range(1, 13))
def test_gate_equals_the_chi_square_quantile(dof):
    for probability in (0.5, 0.95, 0.9995, 0.9999999):
        assert chi_square.threshold(probability, dof) == pytest.approx(chi2.ppf(probability, dof), rel=1e-7)


def test_what_a_parameter_does_to_the_error_after_an_update_is_the_difference_that_it_makes():
    rng = np.random.default_rng(4)
    root, H, D, V = (rng.standard_normal(shape) for shape in ((4, 4), (2, 4), (2, 1), (4, 1)))
    P, y, R, p = root @ root.T, rng.standard_normal(2), np.diag([0.5, 0.2]), 0.7
    moved = V.copy()
    without = kalman.update_with_parameters(P.copy(), y, H, R, np.ones(4), D, moved, np.zeros((1, 2)))
    shifted = kalman.update(P.copy(), y + ((H @ V + D) * p)[:, 0], H, R, np.ones(4))
    assert moved[:, 0] * p == pytest.approx(V[:, 0] * p - (shifted - without), abs=1e-12)


def test_raised_sigmas_are_told_only_where_there_are_any():
    told = []
    history = type("History", (), {"begin": lambda self, P: told.append(P.copy()), "end": lambda self, P: told.append(P.copy())})()
    P = np.array([[4.0, 1.0], [1.0, 9.0]])
    kalman.raise_sigmas(P, np.array([1.0, 3.0]), history)
    assert not told
    kalman.raise_sigmas(P, np.array([0.0, 5.0]), history)
    assert P.tolist() == told[1].tolist() == [[4.0, 1.0], [1.0, 25.0]] and told[0][1, 1] == 9.0


def test_a_variance_above_its_ceiling_comes_down_to_it_and_correlations_stay():
    P = np.array([[400.0, 10.0], [10.0, 1.0]])
    assert kalman.guard_covariance(P, np.full(2, 1e-12), np.array([100.0, 100.0])) == 1
    assert pytest.approx(np.array([[100.0, 5.0], [5.0, 1.0]])) == P


def test_what_innovations_teach_of_a_parameter_is_its_regression():
    """Two uncorrelated measurements of one state: score and information are sums of u z/s and u^2/s over the innovations."""
    P, V, learned = np.array([[4.0]]), np.array([[0.5]]), np.zeros((1, 2))
    H, D, y, R = np.array([[1.0], [2.0]]), np.array([[3.0], [0.0]]), np.array([2.0, -1.0]), np.diag([5.0, 1.0])
    kalman.update_with_parameters(P, y, H, R, np.ones(1), D, V, learned)
    s1, u1, z1 = 9.0, 3.0 + 0.5, 2.0
    gain = 4.0 / s1
    left, moved = 4.0 * (1.0 - gain), 0.5 - gain * u1
    s2, u2, z2 = 4.0 * left + 1.0, 2.0 * moved, -1.0 - 2.0 * gain * z1
    assert learned == pytest.approx(np.array([[u1**2 / s1 + u2**2 / s2, u1 * z1 / s1 + u2 * z2 / s2]]))


def test_likelihood_of_an_innovation_is_that_of_the_normal_distribution():
    P, H, R, y = np.diag([4.0, 9.0]), np.array([[1.0, 0.5], [0.0, 1.0]]), np.diag([1.0, 2.0]), np.array([1.5, -2.0])
    others = np.array([0.2, 0.1])
    ratio = kalman.log_likelihood(P, y, H, R)[0] - kalman.log_likelihood(P, others, H, R)[0]
    wider = kalman.log_likelihood(4.0 * P, y, H, 4.0 * R)[0] - kalman.log_likelihood(P, y, H, R)[0]
    normal = [multivariate_normal(cov=scale * (H @ P @ H.T + R)) for scale in (1.0, 4.0)]
    assert ratio == pytest.approx(normal[0].logpdf(y) - normal[0].logpdf(others))
    assert wider == pytest.approx(normal[1].logpdf(y) - normal[0].logpdf(y))
