"""Innovations watched over time: false alarms as often as set, an offset named, and directions nobody measures harmless."""

import numpy as np
import pytest
from scipy.stats import chi2

from lowcostnav_ros.estimation.innovation_watch import InnovationWatch

G = np.array(
    [
        [0.8, 0.1, 0.6, 1.0],
        [-0.3, 0.9, 0.3, 1.0],
        [0.1, -0.7, 0.7, 1.0],
        [-0.6, -0.5, 0.6, 1.0],
        [0.2, 0.3, 0.9, 1.0],
        [0.9, -0.2, 0.4, 1.0],
    ]
)


def white(rng, S):
    return np.linalg.cholesky(S) @ rng.standard_normal(len(S))


def covariance(rng):
    P = rng.standard_normal((4, 4))
    return G @ P @ P.T @ G.T + 9.0 * np.eye(6)


@pytest.mark.parametrize("window", [0.0, 1.0, 10.0])
def test_the_statistic_of_white_innovations_is_chi_square(window):
    rng, values = np.random.default_rng(3), []
    S = covariance(rng)
    for _ in range(400):
        watch = InnovationWatch([window], [0.0] * 4, 1e-6)
        for k in range(30):
            watch.observe(k * 100_000_000, white(rng, S), G, S)
        values.append(watch.ratio * watch.limit)
    assert np.mean(values) == pytest.approx(4.0, abs=0.45)
    assert np.mean(np.array(values) > chi2.ppf(0.9, 4)) == pytest.approx(0.1, abs=0.05)


def test_a_steady_offset_is_found_in_the_long_window_and_named():
    rng, S = np.random.default_rng(4), 25.0 * np.eye(6)
    watch, found = InnovationWatch([0.0, 1.0, 20.0], [0.1] * 4, 1e-8), None
    for k in range(400):
        found = watch.observe(k * 100_000_000, white(rng, S) + G @ np.array([0.0, 3.0, 0.0, 0.0]), G, S)
        if found is not None:
            break
    assert found is not None and 5 < k < 300
    assert found.largest() == 1 and found.offset[1] == pytest.approx(3.0, abs=1.5)


def test_an_offset_within_the_floor_is_no_alarm():
    S = 25.0 * np.eye(6)
    watch = InnovationWatch([1.0, 20.0], [1.0] * 4, 1e-8)
    offset = G @ np.array([0.0, 2.0, 0.0, 0.0])
    assert all(watch.observe(k * 100_000_000, offset, G, S) is None for k in range(600))


def test_one_satellite_alone_raises_no_alarm_and_breaks_nothing():
    rng = np.random.default_rng(5)
    watch = InnovationWatch([0.0, 1.0, 20.0], [0.0] * 4, 1e-8)
    S = np.array([[400.0]])
    for k in range(600):
        assert watch.observe(k * 100_000_000, white(rng, S), G[:1] * (1.0 + 1e-9 * k), S) is None
    found = watch.observe(600 * 100_000_000, np.array([2000.0]), G[:1], S)
    assert found is not None and np.isfinite(found.offset).all()
