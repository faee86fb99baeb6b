"""IMU profiles against the printed tables, and the simulated errors against closed forms."""

from pathlib import Path

import numpy as np
import pytest
from sensors_truth import steady_truth

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.sensors.drift import DriftBank, slow_error
from lowcostnav_ros.sensors.imu import ImuSimulator, ImuSimulatorSettings
from lowcostnav_ros.sensors.imu_profile import imu_profile_from_text

PROFILES = Path(__file__).parents[1] / "config/profiles"
G = 9.80665


def profile(name):
    return imu_profile_from_text((PROFILES / f"{name}.yaml").read_text(), name)


def simulate(imu_profile, seconds=20.0, truth=None, **settings):
    truth = truth if truth is not None else steady_truth(seconds)
    (block,) = ImuSimulator(ImuSimulatorSettings(**settings), imu_profile).simulate(truth)
    return block, truth


WHITE = "gyro: {noise_density_deg_per_h_per_rt_hz: [60, 60, 60]}\naccelerometer: {noise_density_mg_per_rt_hz: [0.4, 0.4, 0.4]}\n"
IDEAL = imu_profile_from_text("name: ideal")


def test_crista_in_si_as_tabulated():
    noise = profile("crista").filter_noise()  # SI column of Solimeno 2007, table 5.2
    assert noise.accel_noise_density == pytest.approx([2.7459e-3, 3.9227e-3, 2.7459e-3], rel=1e-4)
    assert noise.gyro_noise_density == pytest.approx([1.09568e-3, 8.5812e-4, 7.9994e-4], rel=1e-4)
    assert noise.gyro_turn_on_sigma == pytest.approx([0.020508, 0.0087266, 0.0087266], rel=1e-4)
    assert noise.gyro_bias_sigma == pytest.approx([1.02296e-3, 9.9387e-4, 7.8055e-4], rel=1e-4)
    assert noise.gyro_bias_tau_s.tolist() == [382.0, 375.0, 297.0]
    assert noise.accel_bias_sigma.tolist() == [0.007, 0.007, 0.009]
    assert noise.accel_turn_on_sigma.tolist() == [0.48, 0.26, 0.48]
    assert noise.gyro_scale_sigma == pytest.approx([0.01] * 3)
    assert noise.accel_scale_tau_s.tolist() == [18000.0] * 3


def test_mems_and_fog_in_si_as_tabulated():
    mems, fog = profile("mems").filter_noise(), profile("fog").filter_noise()  # Solimeno 2007, table 7.1
    assert mems.gyro_noise_density == pytest.approx([8.7266e-5] * 3, rel=1e-4)
    assert mems.gyro_turn_on_sigma == pytest.approx([3.6361e-4] * 3, rel=1e-4)
    assert fog.gyro_noise_density == pytest.approx([2.9089e-5] * 3, rel=1e-4)
    assert fog.gyro_turn_on_sigma == pytest.approx([2.4241e-5] * 3, rel=1e-4)
    assert fog.gyro_bias_sigma.tolist() == [0.0] * 3 and np.isinf(fog.gyro_bias_tau_s).all()
    assert np.isinf(mems.gyro_scale_tau_s).all()


@pytest.mark.parametrize(
    ("name", "noise_deg_per_s", "drift_deg_per_h", "tau_s", "accel_drift_g", "accel_tau_s", "accel_noise_g"),
    [
        ("horizon", 0.05, 180.0, 1000.0, 1.2e-3, 100.0, 1e-3),
        ("dmu6x", 0.05, 180.0, 300.0, 1.2e-3, 100.0, 1e-3),
        ("dmu_fog", 0.2, 0.0, np.inf, 1.2e-3, 100.0, 1e-3),
        ("tactical", 0.0017, 0.35, 100.0, 50e-6, 60.0, 50e-5),
        ("automotive", 0.05, 180.0, 300.0, 1.2e-3, 100.0, 1e-3),
        ("consumer", 0.05, 360.0, 300.0, 2.4e-3, 100.0, 1e-3),
    ],
)
def test_grades_as_tabulated_in_both_conventions(name, noise_deg_per_s, drift_deg_per_h, tau_s, accel_drift_g, accel_tau_s, accel_noise_g):
    unit = profile(name)
    per_sample, one_hz = unit.filter_noise(), unit.filter_noise(per_sample_as_density=True)
    assert one_hz.gyro_noise_density == pytest.approx([np.radians(noise_deg_per_s)] * 3)
    assert per_sample.gyro_noise_density == pytest.approx([np.radians(noise_deg_per_s) / np.sqrt(20.0)] * 3)
    assert one_hz.accel_noise_density == pytest.approx([accel_noise_g * G] * 3)
    assert per_sample.gyro_bias_sigma == pytest.approx([np.radians(drift_deg_per_h / 3600.0)] * 3)
    assert per_sample.gyro_bias_tau_s.tolist() == [tau_s] * 3
    assert per_sample.accel_bias_sigma == pytest.approx([accel_drift_g * G] * 3)
    assert per_sample.accel_bias_tau_s.tolist() == [accel_tau_s] * 3


def test_an_ideal_unit_changes_nothing():
    block, truth = simulate(IDEAL, 2.0)
    assert np.array_equal(block.specific_force_b, truth.specific_force_b)
    assert np.array_equal(block.angular_rate_b, truth.angular_rate_b)


def test_a_slower_output_averages_the_interval():
    truth = steady_truth(2.0)
    truth.angular_rate_b[:] = np.arange(200.0)[:, None]
    block, _ = simulate(IDEAL, truth=truth, rate_hz=20.0)
    assert block.angular_rate_b[1:, 0] == pytest.approx(np.arange(200.0)[1:196].reshape(-1, 5).mean(axis=1))
    assert block.stamps_ns.tolist() == truth.stamps_ns[::5].tolist()


@pytest.mark.parametrize("rate_hz", [25.0, 100.0])
def test_white_noise_density_is_the_same_at_every_rate(rate_hz):
    block, truth = simulate(imu_profile_from_text(WHITE), 400.0, rate_hz=rate_hz)
    noise = block.angular_rate_b - truth.angular_rate_b[0]
    expected = np.radians(60.0 / 3600.0) * np.sqrt(rate_hz)  # density over the root of the sample interval
    samples = noise.size
    assert noise.std() == pytest.approx(expected, rel=4.0 / np.sqrt(2.0 * samples))
    assert abs(noise.mean()) < 4.0 * expected / np.sqrt(samples)


def test_per_sample_noise_integrates_to_the_published_random_walk():
    ends = []
    for seed in range(40):  # 0.05 deg/s at 20 Hz over 300 s: 0.194 deg (Gebre-Egziabher 2004, figure 4.2)
        white = "noise_rate_hz: 20\ngyro: {noise_per_sample_deg_per_s: [0.05, 0.05, 0.05]}"
        block, truth = simulate(imu_profile_from_text(white), truth=steady_truth(300.0, 20), seed=seed, rate_hz=20.0)
        ends.append((block.angular_rate_b - truth.angular_rate_b).sum(axis=0) / 20.0)
    assert np.degrees(np.std(ends)) == pytest.approx(0.194, rel=4.0 / np.sqrt(2.0 * 120))


def test_drift_variance_and_autocorrelation():
    sigma, tau_s, dt_s, count = 0.3, 5.0, 0.1, 400
    bank = DriftBank([slow_error(sigma, tau_s)] * count, dt_s, np.random.default_rng(2))
    values = bank.draw(2000)
    tolerance = 4.0 * np.sqrt(tau_s / (2000 * dt_s * count))  # of a variance over so many correlation times
    assert values.var() == pytest.approx(sigma**2, rel=tolerance)
    for lag_s in (1.0, 5.0, 10.0):
        lag = round(lag_s / dt_s)
        correlation = (values[:-lag] * values[lag:]).mean() / sigma**2
        assert correlation == pytest.approx(np.exp(-lag_s / tau_s), abs=tolerance)


def test_a_constant_is_drawn_once_per_power_up():
    values = DriftBank([slow_error(2.0, np.inf)] * 4000, 0.1, np.random.default_rng(3)).draw(5)
    assert np.array_equal(values[0], values[4])
    assert values[0].std() == pytest.approx(2.0, rel=4.0 / np.sqrt(8000))


def test_turn_on_bias_scatters_over_power_ups_as_tabulated():
    crista = profile("crista")
    means = [simulate(crista, 0.5, seed=seed, quantisation=False)[0].angular_rate_b[:, 2].mean() for seed in range(150)]
    expected = np.hypot(0.0087266, 7.8055e-4)  # turn-on and drift; the noise averages out
    assert np.std(means) == pytest.approx(expected, rel=4.0 / np.sqrt(300))


def test_clipping_and_quantisation():
    limits = "gyro: {range_deg_per_s: 1.0, resolution_deg_per_s: 0.5}\naccelerometer: {range_g: 0.5, resolution_mg: 300.0}"
    block, _ = simulate(imu_profile_from_text(limits), 0.1)
    assert np.degrees(block.angular_rate_b[0]) == pytest.approx([0.5, -1.0, 1.0])  # true 0.57, -1.15, 1.72 deg/s
    assert block.specific_force_b[0] == pytest.approx([0.0, 0.0, -0.6 * G])  # clipped at 0.5 g, rounded to a step of 0.3 g
    free, truth = simulate(imu_profile_from_text(limits), 0.1, clipping=False, quantisation=False)
    assert np.array_equal(free.angular_rate_b, truth.angular_rate_b)


def test_warm_up_decays_by_its_time_constant():
    warm = imu_profile_from_text("gyro: {warm_up_bias_deg_per_s: 0.05, warm_up_tau_s: 10.0}")
    block, truth = simulate(warm, 30.0, warm_up=True)
    bias = np.degrees(block.angular_rate_b - truth.angular_rate_b)[:, 0]
    assert bias[[0, 1000, 2000]] == pytest.approx([0.05, 0.05 * np.exp(-1.0), 0.05 * np.exp(-2.0)])


def test_the_scale_factor_follows_the_temperature_of_the_unit():
    unit = imu_profile_from_text("gyro: {scale_factor_ppm_per_k: [430, 0, -430], reference_c: 25.0, warm_up_tau_s: 10.0}")
    block, truth = simulate(unit, 30.0, temperature_c=[0.0, 60.0])
    found = 1e6 * (block.angular_rate_b / truth.angular_rate_b - 1.0)
    above_k = 35.0 - 60.0 * np.exp(-np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(found[[0, 1000, 2000]], np.outer(above_k, [430.0, 0.0, -430.0]), rtol=1e-9, atol=1e-6)
    with pytest.raises(SettingsError, match="two numbers"):
        ImuSimulatorSettings(temperature_c=[20.0])


def test_misalignment_turns_and_keeps_the_length():
    turned = imu_profile_from_text("accelerometer: {misalignment_deg: 0.5}")
    block, truth = simulate(turned, 0.1, misalignment=True)
    assert np.linalg.norm(block.specific_force_b[0]) == pytest.approx(G, rel=1e-3)
    assert np.abs(block.specific_force_b[0, :2]).max() > 0.0
    still, _ = simulate(turned, 0.1)
    assert np.array_equal(still.specific_force_b, truth.specific_force_b)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("gyro: {noise_densty: [1, 1, 1]}", "unknown setting 'gyro.noise_densty' (did you mean"),
        ("gyro: {turn_on_bias_deg_per_h: [1, 1]}", "'gyro.turn_on_bias_deg_per_h' needs three numbers, x y z, got 2"),
        ("gyro: {bias_drift_deg_per_h: [1, 1, 1]}", "the gyro bias drift needs a correlation time"),
        ("accelerometer: {noise_density_mg_per_rt_hz: [1, 1, 1], noise_per_sample_mg: [1, 1, 1]}", "either as a density or per sample"),
        ("accelerometer: {range_g: -1}", "must be at least 0 g"),
        ("gyro: [", "not valid YAML"),
        ("[1, 2]", "expected names and values"),
    ],
)
def test_refusals(text, sentence):
    with pytest.raises(SettingsError) as refusal:
        imu_profile_from_text(text)
    assert sentence in str(refusal.value)
