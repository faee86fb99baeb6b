"""The inertial core: dynamics against differences, covariance against Van Loan, indifference to the cut of blocks."""

import numpy as np
import pytest
from scipy.linalg import expm

from lowcostnav_ros.base.measurements import ImuBlock
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cores import imu_errors, inertial
from lowcostnav_ros.cores.imu_errors import ImuSettings, bias_blocks, core_block, imu_settings, typical
from lowcostnav_ros.cores.inertial import CORE, InertialCore
from lowcostnav_ros.estimation import kalman
from lowcostnav_ros.estimation.error_state import Kind, Layout, gauss_markov, random_walk
from lowcostnav_ros.physics.earth import EARTH_RATE, difference_n, displace, gravity
from lowcostnav_ros.physics.rotation import (
    euler_to_quat,
    quat_apply_phi_n,
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    quat_to_dcm,
    rotvec_from_quat,
)
from lowcostnav_ros.physics.strapdown import strapdown_step

NAV = np.array([0.8, -2.1, 3000.0, 80.0, -60.0, 5.0, *euler_to_quat(0.4, -0.15, 2.3)])
FULL = ImuSettings(gyro_scale_ppm=1000.0, accel_scale_ppm=1000.0)


def layout_of(imu=FULL, **choice):
    return Layout([core_block(imu), *bias_blocks(imu, **choice)])


def injected(nav, estimate, x):
    moved = nav.copy()
    moved[:3] = displace(nav[0], nav[1], nav[2], x[:3])
    moved[3:6] += x[3:6]
    moved[6:10] = quat_apply_phi_n(nav[6:10], x[6:9])
    return moved, estimate + np.concatenate((np.zeros(CORE), x[CORE:]))


def difference(true, est):
    return np.concatenate((
        difference_n(*true[:3], *est[:3]),
        true[3:6] - est[3:6],
        rotvec_from_quat(quat_multiply(true[6:10], quat_conjugate(est[6:10]))),
    ))


def stepped(nav, estimate, f_m, w_m, dt, layout):
    e = inertial.sensor_errors(estimate, layout.kind, layout.axis)
    out = nav.copy()
    zero = np.zeros(3)
    strapdown_step(out, (f_m - e[0]) / (1 + e[2]) * dt, (w_m - e[1]) / (1 + e[3]) * dt, zero, zero, dt)
    return out


def test_error_dynamics_equal_differences_of_the_strapdown_step():
    layout = layout_of()
    f_b, w_b, dt = np.array([1.5, -2.0, -11.0]), np.array([0.05, 0.02, -0.1]), 0.02
    C = quat_to_dcm(quat_multiply(NAV[6:10], quat_from_rotvec(0.5 * dt * w_b)))  # middle of the step, as the running mean is
    F = inertial.inertial_dynamics(NAV, C @ f_b, f_b, w_b, C, layout.kind, layout.axis, layout.rate)
    mean_rate = (expm(F * dt) - np.eye(layout.size)) / dt
    size = np.array([100.0] * 3 + [1.0] * 3 + [1e-3] * 3 + [1e-2] * 3 + [1e-4] * 3 + [1e-4] * 6)
    zero = np.zeros(layout.size)
    for i in range(layout.size):
        rates = []
        for sign in (1.0, -1.0):
            x = np.zeros(layout.size)
            x[i] = sign * size[i]
            true, errors = injected(NAV, zero, x)
            after = difference(stepped(true, errors, f_b, w_b, dt, layout), stepped(NAV, zero, f_b, w_b, dt, layout))
            rates.append((after - x[:CORE]) / dt)
        numeric = (rates[0] - rates[1]) / (2.0 * size[i])
        scale = np.maximum(np.abs(numeric), [1e-5] * 3 + [1e-5] * 3 + [1e-7] * 3)
        analytic = mean_rate[:CORE, i]
        tolerance = 1e-2 * scale + 2e-9  # radii are held constant in the linearisation
        rows = slice(0, CORE) if i < CORE else slice(3, CORE)  # within one step a sensor error reaches position to third order only
        assert np.all(np.abs(analytic - numeric)[rows] < tolerance[rows]), (layout.labels[i], analytic, numeric)


def test_gauss_markov_states_decay_and_constants_stay():
    layout = Layout([core_block(FULL), random_walk("a", ["a"], Kind.FREE, 2.0), gauss_markov("b", ["b"], Kind.FREE, 3.0, 50.0)])
    core = InertialCore(layout)
    core.start(0, NAV, np.eye(CORE))
    core.estimate[CORE:] = [1.0, 1.0]
    core.P[10, 10] = 0.0
    stamps = np.arange(1, 1001, dtype=np.int64) * 10_000_000
    f_b = quat_to_dcm(NAV[6:10]).T @ np.array([0.0, 0.0, -gravity(NAV[0], NAV[2])])
    run(core, ImuBlock.of("imu", stamps, np.tile(f_b, (1000, 1)), np.zeros((1000, 3))))
    assert core.estimate[CORE:] == pytest.approx([1.0, np.exp(-10.0 / 50.0)])
    assert core.P[9, 9] == pytest.approx(4.0)
    assert core.P[10, 10] == pytest.approx(9.0 * (1 - np.exp(-20.0 / 50.0)), rel=1e-4)


def run(core, block, output_ns=100_000_000):
    start = 0
    while start < len(block):
        start = core.advance(block, start, output_ns)


def still_block(n, period_ns=10_000_000, seed=0):
    rng = np.random.default_rng(seed)
    C = quat_to_dcm(NAV[6:10])
    force = C.T @ np.array([0.0, 0.0, -gravity(NAV[0], NAV[2])])
    rate = C.T @ np.array([EARTH_RATE * np.cos(NAV[0]), 0.0, -EARTH_RATE * np.sin(NAV[0])])
    stamps = np.arange(1, n + 1, dtype=np.int64) * period_ns
    return ImuBlock.of("imu", stamps, force + 0.05 * rng.standard_normal((n, 3)), rate + 0.01 * rng.standard_normal((n, 3)))


def test_the_cut_of_the_blocks_changes_no_bit():
    block = still_block(997)
    whole, pieces = InertialCore(layout_of()), InertialCore(layout_of())
    for core in (whole, pieces):
        core.start(0, NAV, np.diag([4.0] * 3 + [0.1] * 3 + [1e-3] * 3))
        core.estimate[CORE:] = 1e-4
    run(whole, block)
    for rows in np.array_split(np.arange(997), 131):
        run(pieces, ImuBlock.of("imu", block.stamps_ns[rows], block.specific_force_b[rows], block.angular_rate_b[rows]))
    assert np.array_equal(whole.nav, pieces.nav)
    assert np.array_equal(whole.P, pieces.P)
    assert np.array_equal(whole.estimate, pieces.estimate)


def test_predicting_ahead_ends_where_the_core_will_be_without_touching_it():
    core = InertialCore(layout_of())
    core.start(0, NAV, np.eye(CORE))
    block = still_block(5)
    t_ns, ahead, P = core.predicted(block)
    assert core.t_ns == 0
    assert np.array_equal(core.nav, NAV)
    assert np.array_equal(core.P[:CORE, :CORE], np.eye(CORE))
    run(core, block)
    core.settle()
    assert t_ns == core.t_ns
    assert np.allclose(ahead, core.nav, atol=1e-12)
    assert np.allclose(P, core.P, atol=1e-12)


def test_covariance_growth_equals_van_loan_and_does_not_depend_on_the_sample_rate():
    nav = NAV.copy()
    nav[3:6] = 0.0
    grown = []
    for period_ns in (5_000_000, 20_000_000):
        core = InertialCore(layout_of())
        core.start(0, nav, np.zeros((CORE, CORE)))
        n = 20_000_000_000 // period_ns
        block = still_block(int(n), period_ns)
        mean_f = np.tile(block.specific_force_b.mean(axis=0), (len(block), 1))
        run(core, ImuBlock.of("imu", block.stamps_ns, mean_f, np.zeros((len(block), 3))))
        grown.append(np.sqrt(np.diag(core.P)))
    C = quat_to_dcm(nav[6:10])
    layout = layout_of()
    f_b = C.T @ np.array([0.0, 0.0, -9.8])
    F = inertial.inertial_dynamics(nav, C @ f_b, f_b, np.zeros(3), C, layout.kind, layout.axis, layout.rate)
    start = layout.initial_covariance()
    start[:CORE, :CORE] = 0.0
    Phi, Q = kalman.van_loan(F, inertial.noise_density(C, layout.psd), 20.0)
    exact = np.sqrt(np.diag(Phi @ start @ Phi.T + Q))
    assert grown[0] == pytest.approx(grown[1], rel=0.01)
    assert grown[0] == pytest.approx(exact, rel=0.03)


def test_fifteen_twenty_seven_and_scale_factor_states_are_lists_not_filters():
    plain = ImuSettings()
    assert layout_of(plain).size == 15
    assert layout_of(FULL).size == 21
    assert layout_of(FULL, split_turn_on=True).size == 27


def test_one_number_serves_all_axes_and_three_reach_each_axis_its_own():
    three = ImuSettings(gyro_bias_dps=[0.1, 0.2, 0.3], gyro_bias_tau_s=[100.0, 200.0, 400.0], gyro_scale_ppm=[0.0, 1.0, 2.0])
    layout = layout_of(three, split_turn_on=True)
    rows, sigma = layout["gyro_drift"], np.radians([0.1, 0.2, 0.3])
    assert layout.sigma0[rows] == pytest.approx(sigma)
    assert layout.rate[rows] == pytest.approx([0.01, 0.005, 0.0025])
    assert layout.psd[rows] == pytest.approx(2.0 * sigma**2 * layout.rate[rows])
    assert layout.sigma0[layout["gyro_scale"]] == pytest.approx([0.0, 1e-6, 2e-6])
    same, plain = layout_of(ImuSettings(accel_noise_mg_rthz=[0.25] * 3)), layout_of(ImuSettings())
    assert np.array_equal(same.psd, plain.psd) and np.array_equal(same.sigma0, plain.sigma0)
    short = layout_of(three)["gyro_bias"]
    assert layout_of(three).psd[short] == pytest.approx(2.0 * sigma**2 / [100.0, 200.0, 400.0])


def test_a_profile_that_differs_by_axis_reaches_the_filter_axis_by_axis():
    noise = load_imu_profile("crista").filter_noise()
    layout = layout_of(imu_settings(noise), split_turn_on=True)
    assert layout.sigma0[layout["gyro_bias"]] == pytest.approx(noise.gyro_turn_on_sigma)
    assert layout.sigma0[layout["accel_drift"]] == pytest.approx(noise.accel_bias_sigma)
    assert 1.0 / layout.rate[layout["accel_drift"]] == pytest.approx(noise.accel_bias_tau_s)
    assert layout.psd[3:9] == pytest.approx(np.concatenate((noise.accel_noise_density, noise.gyro_noise_density)) ** 2)
    assert typical([3.0, 4.0, 0.0]) == pytest.approx(5.0 / np.sqrt(3.0))
    assert imu_settings(load_imu_profile("fog").filter_noise()).gyro_scale_tau_s == imu_errors.CONSTANT_S


def test_settings_take_one_number_or_three_and_refuse_two():
    given = {"gyro_bias_tau_s": [300, 200.0, 100.0], "gyro_noise_dps_rthz": 0.02}
    assert from_mapping(ImuSettings, given).gyro_bias_tau_s == [300.0, 200.0, 100.0]
    with pytest.raises(SettingsError, match="one number or three, x y z, got 2"):
        from_mapping(ImuSettings, {"gyro_bias_dps": [0.1, 0.2]})
    with pytest.raises(SettingsError, match="at least 1 s, got 0.5"):
        from_mapping(ImuSettings, {"gyro_bias_tau_s": [300.0, 0.5, 1.0]})


def test_a_correction_of_the_heading_turns_what_tilt_and_heading_share_with_the_body_and_nothing_else():
    layout = layout_of()
    core = InertialCore(layout)
    root = np.random.default_rng(5).standard_normal((layout.size, layout.size))
    core.start(0, NAV, np.eye(CORE))
    core.P = root @ root.T
    kept = np.delete(np.arange(layout.size), [6, 7, 8])
    P, T = core.P.copy(), quat_to_dcm(core.nav[6:10]).T
    before = T @ P[6:9, kept], T @ P[6:9, 6:9] @ T.T, P[np.ix_(kept, kept)]
    core.correct(np.concatenate((np.zeros(8), [0.7], np.zeros(layout.size - CORE))))
    P, T = core.P, quat_to_dcm(core.nav[6:10]).T
    after = T @ P[6:9, kept], T @ P[6:9, 6:9] @ T.T, P[np.ix_(kept, kept)]
    for seen, expected in zip(after, before, strict=True):
        assert seen == pytest.approx(expected, abs=1e-9)
    assert np.array_equal(core.P, core.P.T)
    core.correct(np.concatenate((np.zeros(6), [0.1, -0.2, 0.0], np.zeros(layout.size - CORE))))
    assert np.array_equal(core.P, P)


@pytest.mark.parametrize("split", [False, True])
def test_velocity_of_a_lever_arm_depends_on_every_gyro_bias_as_differences_say(split):
    layout, lever_b, w_m = layout_of(split_turn_on=split), np.array([1.5, -0.4, -2.0]), np.array([0.3, -0.2, 0.5])
    core = InertialCore(layout)
    core.start(0, NAV, np.eye(CORE))
    block = ImuBlock.of("imu/data_raw", np.array([0]), np.array([[0.1, 0.2, -9.8]]), w_m[None])

    def seen():
        core.note(block)
        return core.velocity_at(lever_b)

    before = seen()
    for i in np.flatnonzero(layout.kind == Kind.GYRO_BIAS):
        core.estimate[i] = 1e-4
        assert (seen().swing_n - before.swing_n) / 1e-4 == pytest.approx(before.H[:, i], abs=1e-9)
        core.estimate[i] = 0.0


def shown(force_n, tilt_rad):
    """What :func:`heading_shown` makes of a horizontal force, m/s^2, that lasts 0.1 s, with tilts known so well."""
    layout = layout_of()
    P = np.zeros((layout.size, layout.size))
    P[6:8, 6:8] = tilt_rad**2 * np.eye(2)
    sums = np.zeros(21)
    sums[0], sums[1:4] = 0.1, 0.1 * np.array([*force_n, -9.81])
    F = inertial.inertial_dynamics(NAV, sums[1:4] / 0.1, np.zeros(3), np.zeros(3), np.eye(3), layout.kind, layout.axis, layout.rate)
    return inertial.heading_shown(F, P, sums, np.zeros(layout.size))


def test_a_force_within_the_doubt_of_it_shows_no_heading():
    doubt = 9.81 * 0.005 * np.sqrt(2.0)  # of both tilts, by gravity
    assert shown((0.0, 0.0), 0.005) == shown((0.9 * inertial.DOUBTS * doubt, 0.0), 0.005) == 0.0
    assert shown((0.0, 2.0 * inertial.DOUBTS * doubt), 0.005) == pytest.approx(0.75, abs=1e-3)
    assert shown((3.0, -4.0), 1e-4) == pytest.approx(1.0, abs=1e-4)
