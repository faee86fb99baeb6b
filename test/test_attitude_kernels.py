"""Attitude kernels against solved differential equations, an eigenvector solution of Wahba's problem and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lowcostnav_ros.estimation import attitude_vectors as vectors
from lowcostnav_ros.gnss.attitude_antennas import attitude_from_phases, isosceles_array, phase_differences
from lowcostnav_ros.physics.attitude_propagation import body_rate_matrix, coast_quaternion, euler_rate_matrix
from lowcostnav_ros.physics.rotation import euler_to_dcm, euler_to_quat, quat_rotate, quat_to_dcm, rotvec_from_quat, wrap

ROLL, PITCH, HEADING = st.floats(-3.0, 3.0), st.floats(-1.3, 1.3), st.floats(-3.1, 3.1)
DEG = math.pi / 180.0
FIELD_N, GRAVITY_N = np.array([0.23, 0.06, 0.44]), np.array([0.0, 0.0, 1.0])
START = np.array([1.0, 0.0, 0.0, 0.0])


def angle_between(p: np.ndarray, q: np.ndarray) -> float:
    """Rad."""
    return float((Rotation.from_quat(np.roll(p, -1)).inv() * Rotation.from_quat(np.roll(q, -1))).magnitude())


def turn(t: float) -> np.ndarray:
    """Body rates of a rolling, turning flight, rad/s."""
    return np.array([0.3 * math.cos(0.5 * t), 0.1 * math.sin(0.7 * t), 0.2])


def test_both_propagations_follow_the_differential_equation():
    dt, n = 0.01, 3000
    rates = np.array([turn((k + 0.5) * dt) for k in range(n)])
    start = np.array([0.2, -0.1, 1.0])

    def derivative(t, x):
        p, q, r = turn(t)
        sr, cr = math.sin(x[0]), math.cos(x[0])
        yaw = q * sr + r * cr
        return [p + math.tan(x[1]) * yaw, q * cr - r * sr, yaw / math.cos(x[1])]

    exact = solve_ivp(derivative, (0.0, n * dt), start, rtol=1e-10, atol=1e-12).y[:, -1]
    found = coast_quaternion(euler_to_quat(*start), rates, dt)[-1]
    np.testing.assert_allclose(wrap(found - exact), 0.0, atol=2e-4)


@given(roll=ROLL, pitch=PITCH)
def test_rate_matrices_are_inverse(roll, pitch):
    np.testing.assert_allclose(euler_rate_matrix(roll, pitch) @ body_rate_matrix(roll, pitch), np.eye(3), atol=1e-12)


@given(roll=st.floats(-1.5, 1.5), pitch=st.floats(-1.4, 1.4), heading=HEADING)
def test_level_angles_undo_gravity(roll, pitch, heading):
    force_b = euler_to_dcm(roll, pitch, heading).T @ np.array([0.0, 0.0, -9.81])
    np.testing.assert_allclose(vectors.level_angles(force_b), (roll, pitch), atol=1e-9)


def test_level_angles_see_no_bank_in_a_coordinated_turn():
    assert vectors.level_angles(np.array([0.0, 0.0, -9.81 / math.cos(0.4)])) == (0.0, 0.0)


@settings(deadline=None, max_examples=40)
@given(roll=st.floats(-1.0, 1.0), pitch=st.floats(-0.35, 0.35), heading=st.floats(-2.9, 2.9), seed=st.integers(0, 99))
def test_vector_matching_is_the_least_squares_attitude(roll, pitch, heading, seed):
    rng, truth = np.random.default_rng(seed), euler_to_quat(roll, pitch, heading)
    seen = [quat_to_dcm(truth).T @ v + 1e-3 * rng.standard_normal(3) for v in (FIELD_N, GRAVITY_N)]
    best = Rotation.align_vectors([FIELD_N, GRAVITY_N], seen)[0].as_quat(scalar_first=True)
    start = euler_to_quat(roll - 0.3, pitch + 0.2, heading + 0.5)
    for form in (vectors.RIGHT, vectors.LEFT):
        found = vectors.match_vectors(start, FIELD_N, GRAVITY_N, *seen, 1.0, 30, form)
        assert angle_between(found, best) < 1e-7


def test_the_jacobian_as_printed_fails_far_from_north():
    eulers = np.column_stack((np.zeros(200), np.zeros(200), np.linspace(-math.pi, math.pi, 200)))
    none = np.zeros((200, 3))
    errors = {form: vectors.match_many(eulers, FIELD_N, GRAVITY_N, none, none, 0.1, 100, form)[:, 2] for form in range(3)}
    lost = [int(np.sum(np.abs(errors[form]) > 10.0 * DEG)) for form in range(3)]
    assert lost[0] <= 2 and lost[1] <= 2
    assert lost[2] > 50


def test_parallel_vectors_change_nothing():
    seen = np.array([0.0, 0.1, 1.0])
    np.testing.assert_array_equal(vectors.match_step(START, GRAVITY_N, GRAVITY_N, seen, seen, 1.0, vectors.RIGHT), START)


@settings(deadline=None, max_examples=30)
@given(roll=ROLL, pitch=PITCH, heading=HEADING)
def test_matching_rows_are_the_derivative(roll, pitch, heading):
    C, u_b, step = euler_to_dcm(roll, pitch, heading), np.array([0.3, -0.2, 0.9]), 1e-6
    u_n = C @ u_b
    _, H = vectors.matching_rows(C, u_n, u_b)
    for k in range(3):
        phi = np.zeros(3)
        phi[k] = step
        turned = Rotation.from_rotvec(phi).as_matrix() @ u_n
        np.testing.assert_allclose(vectors.matching_rows(C, turned, u_b)[0] / step, H[:, k], atol=1e-5)


def test_force_from_velocity_in_a_level_turn():
    speed, rate, span = 50.0, 0.07, 0.5
    velocity = [speed * np.array([math.cos(a), math.sin(a), 0.0]) for a in (0.0, rate * span)]
    force = vectors.specific_force_from_velocity(*velocity, span)
    middle = 0.5 * rate * span
    expected = speed * rate * np.array([-math.sin(middle), math.cos(middle), 0.0]) - np.array([0.0, 0.0, 9.80665])
    np.testing.assert_allclose(force, expected, atol=2e-3)


def sky(rng: np.random.Generator, count: int = 9) -> np.ndarray:
    azimuth, elevation = rng.uniform(-np.pi, np.pi, count), np.arcsin(rng.uniform(0.2, 1.0, count))
    return np.column_stack((np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), -np.sin(elevation)))


def test_antenna_triangle_has_the_sides_asked_for():
    a, b = isosceles_array()
    assert np.linalg.norm(a) == pytest.approx(0.36)
    assert np.linalg.norm(b) == pytest.approx(0.50) == pytest.approx(np.linalg.norm(b - a))
    assert b[0] == pytest.approx(0.466, abs=0.001)  # the front antenna ahead of the rear pair
    with pytest.raises(ValueError, match="triangle"):
        isosceles_array(1.2, 0.5)


def test_attitude_from_phases_is_exact_without_noise_and_honest_with():
    rng, baselines = np.random.default_rng(5), isosceles_array()
    ratios = []
    for _ in range(150):
        q, sight = euler_to_quat(*rng.uniform(-0.6, 0.6, 3)), sky(rng)
        clean = phase_differences(q, sight, baselines, np.array([0.3, -0.1]))
        seed = euler_to_quat(*(np.array(Rotation.from_quat(np.roll(q, -1)).as_euler("ZYX"))[::-1] + 0.1))
        assert angle_between(attitude_from_phases(clean, sight, baselines, seed, 2e-3)[0], q) < 1e-8
        found, cov = attitude_from_phases(clean + 2e-3 * rng.standard_normal(clean.shape), sight, baselines, seed, 2e-3)
        inverse = np.array([found[0], *(-found[1:])])
        p = Rotation.from_quat(np.roll(q, -1)) * Rotation.from_quat(np.roll(inverse, -1))
        ratios.append(p.as_rotvec() @ np.linalg.solve(cov, p.as_rotvec()) / 3.0)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.25)


def test_antennas_refuse_what_gives_no_attitude():
    rng, baselines = np.random.default_rng(5), isosceles_array()
    sight = sky(rng)
    clean = phase_differences(START, sight, baselines, np.zeros(2))
    with pytest.raises(ValueError, match="three satellites"):
        attitude_from_phases(clean[:2], sight[:2], baselines, START, 2e-3)
    clean[3, 0] += 0.19  # one cycle of the carrier
    with pytest.raises(ValueError, match="integers"):
        attitude_from_phases(clean, sight, baselines, START, 2e-3)
    line = np.array([[0.0, 0.3, 0.0], [0.0, 0.6, 0.0]])
    with pytest.raises(ValueError, match="open"):
        attitude_from_phases(phase_differences(START, sight, line, np.zeros(2)), sight, line, START, 2e-3)


def test_quaternion_order_of_the_checks_is_the_package_s():
    q = euler_to_quat(0.3, -0.2, 0.9)
    v = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(Rotation.from_quat(np.roll(q, -1)).apply(v), quat_rotate(q, v), atol=1e-12)
    np.testing.assert_allclose(Rotation.from_quat(np.roll(q, -1)).as_rotvec(), rotvec_from_quat(q), atol=1e-12)
