"""Bandwidth and full scale of the simulated IMU against closed-form step and frequency responses."""

import numpy as np
import pytest
from scipy.integrate import quad
from sensors_truth import START_NS, cuts, flat, steady_truth
from test_sensors_imu import IDEAL, profile, simulate

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.sensors.bandwidth import LowPass
from lowcostnav_ros.sensors.imu import ImuSimulator, ImuSimulatorSettings
from lowcostnav_ros.sensors.imu_profile import imu_profile_from_text

LIMITED = imu_profile_from_text("name: limited\ngyro: {bandwidth_hz: 100.0}\naccelerometer: {bandwidth_hz: 100.0}")


def stamps(n, rate_hz):
    return START_NS + np.round(np.arange(1, n + 1) * 1e9 / rate_hz).astype(np.int64)


def step_response(order, w, t):
    if t <= 0.0:
        return 0.0
    if order == 1:
        return 1.0 - np.exp(-w * t)
    damped = np.sqrt(0.5) * w  # zeta = 1/sqrt(2): damping and frequency of the swing are alike
    return 1.0 - np.exp(-damped * t) * (np.cos(damped * t) + np.sin(damped * t))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("bandwidth_hz", "rate_hz"), [(100.0, 100.0), (100.0, 1000.0), (3.0, 50.0)])
def test_step_response_is_exact_at_any_rate(order, bandwidth_hz, rate_hz):
    n, w = 40, 2.0 * np.pi * bandwidth_hz
    values = np.ones((n, 1))
    values[0] = 0.0  # the filter settles on this; the step comes at its end
    found = LowPass(bandwidth_hz, order).mean_output(stamps(n, rate_hz), values)[:, 0]
    edges = np.arange(n) / rate_hz
    expected = [quad(lambda t: step_response(order, w, t), a, b)[0] * rate_hz for a, b in zip(edges[:-1], edges[1:], strict=True)]
    assert found[0] == 0.0
    assert found[1:] == pytest.approx(expected, abs=1e-6)
    assert (found.max() > 1.02) == (order == 2 and bandwidth_hz / rate_hz < 0.2)  # a second-order filter overshoots by 4.3 %


@pytest.mark.parametrize(("order", "signal"), [(1, "specific_force_b"), (2, "angular_rate_b")])
@pytest.mark.parametrize("frequency_hz", [10.0, 100.0, 250.0])
def test_frequency_response(order, signal, frequency_hz):
    rate_hz, n, w = 4000.0, 4000, 2.0 * np.pi * frequency_hz
    edges = np.arange(n + 1) / rate_hz
    means = -np.diff(np.cos(w * edges)) / w * rate_hz  # of sin(w t) over each interval
    truth = steady_truth(n / rate_hz, int(rate_hz))
    getattr(truth, signal)[:] = means[:, None]
    low = LowPass(100.0, order).mean_output(truth.stamps_ns, getattr(truth, signal))[:, 0]
    late, middle = slice(n // 2, n), 0.5 * (edges[:-1] + edges[1:])
    basis = np.column_stack((np.sin(w * middle), np.cos(w * middle)))[late]
    a, b = np.linalg.lstsq(basis, low[late], rcond=None)[0]
    s = 1j * frequency_hz / 100.0
    expected = 1.0 / (1.0 + s) if order == 1 else 1.0 / (s * s + np.sqrt(2.0) * s + 1.0)
    assert abs(complex(a, b)) == pytest.approx(abs(expected), rel=0.02)
    assert np.angle(complex(a, b) / expected) == pytest.approx(0.0, abs=0.03)


def test_the_gain_at_the_bandwidth_is_three_decibels_down_and_off_by_default():
    rate_hz, seconds = 2000.0, 0.5
    truth = steady_truth(seconds, int(rate_hz))
    truth.angular_rate_b[:] = np.sin(2.0 * np.pi * 100.0 * np.arange(len(truth)) / rate_hz)[:, None]
    limited, _ = simulate(LIMITED, truth=truth, rate_hz=rate_hz, bandwidth=True)
    free, _ = simulate(LIMITED, truth=truth, rate_hz=rate_hz)
    assert np.array_equal(free.angular_rate_b, truth.angular_rate_b)
    gain = np.std(limited.angular_rate_b[200:, 0]) / np.std(truth.angular_rate_b[200:, 0])
    assert gain == pytest.approx(np.sqrt(0.5), rel=0.01)
    assert not ImuSimulatorSettings().bandwidth and profile("crista").gyro.bandwidth_hz == 100.0


def test_the_filter_does_not_depend_on_how_the_truth_is_cut_and_leaves_rest_alone():
    rng, truth = np.random.default_rng(1), steady_truth(1.0)
    truth.angular_rate_b[:] += rng.normal(size=(100, 3))
    whole, _ = simulate(LIMITED, truth=truth, bandwidth=True)
    simulator = ImuSimulator(ImuSimulatorSettings(bandwidth=True), LIMITED)
    assert flat([m for piece in cuts(truth, [1, 7, 2]) for m in simulator.simulate(piece)]) == flat([whole])
    still, calm = simulate(LIMITED, bandwidth=True, seconds=1.0)
    assert np.allclose(still.angular_rate_b, calm.angular_rate_b, atol=1e-12)


def test_full_scale_options_of_the_data_sheet_and_no_others():
    crista, truth = profile("crista"), steady_truth(1.0)
    truth.angular_rate_b[:], truth.specific_force_b[:] = np.radians(200.0), 30.0
    usual, _ = simulate(crista, truth=truth)
    small, _ = simulate(crista, truth=truth, gyro_range_deg_per_s=150.0, accel_range_g=2.0)
    assert np.degrees(usual.angular_rate_b).min() > 190.0 and usual.specific_force_b.min() > 28.0
    assert np.degrees(small.angular_rate_b).max() == pytest.approx(150.0, abs=0.01)
    assert small.specific_force_b.max() == pytest.approx(2.0 * 9.80665, abs=0.003)
    with pytest.raises(SettingsError, match="full scale of 75 deg/s is not on the gyro's data sheet; it offers 150, 300 deg/s"):
        simulate(crista, gyro_range_deg_per_s=75.0)
    with pytest.raises(SettingsError, match="offers none g"):
        simulate(IDEAL, accel_range_g=2.0)


def test_g_sensitivity_is_the_specific_force_times_one_number_per_axis_and_off_by_default():
    sensitive = imu_profile_from_text("gyro: {g_sensitivity_deg_per_s_per_g: 0.2}")
    seen = []
    for seed in range(200):
        block, truth = simulate(sensitive, 0.1, seed=seed, g_sensitivity=True)
        seen.append(np.degrees(block.angular_rate_b - truth.angular_rate_b)[0])
    assert np.abs(np.array(seen)[:, :2]).max() < 1e-9  # level flight: one g on z alone
    assert np.std(np.array(seen)[:, 2]) == pytest.approx(0.2, rel=4.0 / np.sqrt(400))
    calm, truth = simulate(sensitive, 0.1)
    assert np.array_equal(calm.angular_rate_b, truth.angular_rate_b)


def test_a_unit_calibrated_before_the_flight_has_no_turn_on_bias():
    crista = profile("crista")
    means = [simulate(crista, 0.5, seed=seed, quantisation=False, turn_on_bias=False)[0].angular_rate_b[:, 2].mean() for seed in range(60)]
    assert np.std(np.array(means)) == pytest.approx(np.hypot(7.8055e-4, 7.9994e-4 / np.sqrt(0.5)), rel=4.0 / np.sqrt(120))
