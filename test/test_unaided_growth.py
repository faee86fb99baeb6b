"""Growth laws of an unaided axis against the exact covariance of integrated noise and of constant biases."""

import numpy as np
import pytest
from scipy.linalg import expm

from lowcostnav_ros.physics import unaided_growth as growth
from lowcostnav_ros.physics.earth import STANDARD_GRAVITY


@pytest.mark.parametrize("t_s", [1.0, 60.0])
def test_the_laws_are_the_exact_covariance_of_one_axis(t_s):
    F = np.zeros((5, 5))  # position, velocity, tilt, gyro bias, accelerometer bias
    F[0, 1] = F[1, 4] = F[2, 3] = 1.0
    F[1, 2] = STANDARD_GRAVITY
    Phi = expm(F * t_s)
    assert growth.gyro_bias_m(2e-5, t_s) == pytest.approx(2e-5 * Phi[0, 3])
    assert growth.accel_bias_m(0.01, t_s) == pytest.approx(0.01 * Phi[0, 4])
    for state, density, law in ((2, 3e-4, growth.gyro_noise_m), (1, 2e-3, growth.accel_noise_m)):
        G = np.zeros((5, 5))
        G[state, state] = density**2
        van_loan = expm(np.block([[-F, G], [np.zeros((5, 5)), F.T]]) * t_s)
        Qd = van_loan[5:, 5:].T @ van_loan[:5, 5:]
        assert law(density, t_s) == pytest.approx(np.sqrt(Qd[0, 0]), rel=1e-6)


def test_the_whole_is_the_root_of_the_squares():
    parts = dict(growth.by_source_m(1e-5, 0.01, 1e-4, 1e-3, np.array([10.0, 100.0])))
    whole = parts.pop("all")
    np.testing.assert_allclose(whole**2, sum(part**2 for part in parts.values()))
