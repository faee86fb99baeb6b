"""Small matrix loops against numpy."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.base import small_matrices as sm


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 9), st.integers(1, 9))
def test_products_equal_numpy(seed, n, m, p):
    rng = np.random.default_rng(seed)
    A, B, x = rng.standard_normal((n, m)), rng.standard_normal((m, p)), rng.standard_normal(m)
    A[rng.random((n, m)) < 0.4] = 0.0
    assert np.allclose(sm.matmul(A, B), A @ B, rtol=1e-12, atol=1e-12)
    assert np.allclose(sm.matmul_transposed(A, B.T.copy()), A @ B, rtol=1e-12, atol=1e-12)
    assert np.allclose(sm.matvec(A, x), A @ x, rtol=1e-12, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 7))
def test_factor_and_solve_equal_numpy(seed, n):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((n, n))
    A, b = root @ root.T + np.eye(n), rng.standard_normal(n)
    L = sm.cholesky(A)
    assert np.allclose(L, np.linalg.cholesky(A), rtol=1e-10)
    assert np.allclose(L @ sm.forward_solve(L, b), b, rtol=1e-10)


def test_what_is_not_positive_definite_has_no_factor():
    assert np.isnan(sm.cholesky(np.array([[1.0, 2.0], [2.0, 1.0]]))).any()


def test_no_direction_is_known_better_than_the_least_sigma():
    rng = np.random.default_rng(0)
    turned = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    for variances in ([9.0, 4.0, 1e-18], [1e29, 1e29, 0.0], [1e-320] * 3, [5.0, 0.0, 0.0]):
        cov = turned @ np.diag(variances) @ turned.T
        raised = sm.at_least(0.5 * (cov + cov.T), 0.01)
        assert np.linalg.eigvalsh(raised / np.sqrt(np.outer(raised.diagonal(), raised.diagonal()))).min() > 1e-9
        assert np.sqrt(raised.diagonal().min()) >= 0.01
    for sound in (np.diag([0.3, 1e6, 1e12]), np.array([[4.0, 1.9, 0.0], [1.9, 1.0, 0.0], [0.0, 0.0, 9.0]])):
        assert sm.at_least(sound, 0.01) is sound
