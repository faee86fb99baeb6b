"""The multi-antenna GPS attitude: statistics, timing, outages, and its message there and back."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lowcostnav_ros.base.measurements import Attitude
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.base.truth import TruthBlock
from lowcostnav_ros.messages import encode
from lowcostnav_ros.messages.decode import Rejected, decode
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.messages.topics import IMU
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_conjugate, quat_multiply, quat_to_euler, rotvec_from_quat, wrap
from lowcostnav_ros.sensors.gps_attitude import GpsAttitudeSimulator, GpsAttitudeSimulatorSettings
from lowcostnav_ros.simulation.scenario import scenario_from_text

T0, DEG = 1_780_000_000_000_000_000, math.pi / 180.0


def truth(seconds: float, rate_hz: int = 20, roll: float = 0.3, pitch: float = -0.2, heading: float = 2.0) -> TruthBlock:
    n = round(seconds * rate_hz)
    stamps = T0 + np.arange(n) * (1_000_000_000 // rate_hz)
    zeros, column = np.zeros((n, 3)), np.zeros(n)
    return TruthBlock(stamps, column, column, column, zeros, np.tile(euler_to_quat(roll, pitch, heading), (n, 1)), zeros, zeros, zeros)


def test_noise_rate_and_covariance_are_those_stated():
    block = truth(3000.0, 10)
    found = GpsAttitudeSimulator(GpsAttitudeSimulatorSettings()).simulate(block)
    assert len(found) == 6000
    errors = np.array([wrap(np.array(quat_to_euler(m.q_nb)) - [0.3, -0.2, 2.0]) for m in found]) / DEG
    np.testing.assert_allclose(errors.std(axis=0), 0.25, rtol=0.04)
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=0.015)
    true = Rotation.from_quat(np.roll(block.q_nb[0], -1))
    phi = np.array([(true * Rotation.from_quat(np.roll(m.q_nb, -1)).inv()).as_rotvec() for m in found])
    np.testing.assert_allclose(np.cov(phi.T), np.mean([m.cov_att for m in found], axis=0), atol=0.06 * (0.25 * DEG) ** 2)


def test_outages_latency_and_blocks():
    settings = from_mapping(GpsAttitudeSimulatorSettings, {"outages_s": [2.0, 4.0], "latency_s": 0.3})
    whole = GpsAttitudeSimulator(settings).simulate(truth(8.0))
    assert [round((m.stamp_ns - T0) * 1e-9, 3) for m in whole] == [0.0, 0.5, 1.0, 1.5, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5]
    parts, simulator = [], GpsAttitudeSimulator(settings)
    for start in range(0, 160, 7):
        parts += simulator.simulate(truth(8.0)[start : start + 7])
    np.testing.assert_array_equal([m.q_nb for m in parts], [m.q_nb for m in whole])
    with pytest.raises(SettingsError, match="missing end"):
        from_mapping(GpsAttitudeSimulatorSettings, {"outages_s": [1.0]})


def test_message_there_and_back():
    sent = GpsAttitudeSimulator(GpsAttitudeSimulatorSettings()).simulate(truth(1.0))[0]
    message = encode.encode(sent)
    assert message.angular_velocity_covariance[0] == -1.0 == message.linear_acceleration_covariance[0]
    assert message.header.frame_id == "base_link"
    back = decode("/gps/attitude", IMU, to_cdr(message))
    assert isinstance(back, Attitude)
    assert (back.stamp_ns, back.source) == (sent.stamp_ns, "gps/attitude")
    np.testing.assert_allclose(back.q_nb * np.sign(back.q_nb @ sent.q_nb), sent.q_nb, atol=1e-12)
    np.testing.assert_allclose(back.cov_att, sent.cov_att, atol=1e-15)
    np.testing.assert_allclose(back.specific_force_b, sent.specific_force_b, atol=1e-9)


def test_message_that_is_no_attitude_is_refused():
    message = encode.encode(GpsAttitudeSimulator(GpsAttitudeSimulatorSettings()).simulate(truth(1.0))[0])
    message.orientation_covariance[:] = 0.0
    assert isinstance(decode("gps/attitude", IMU, to_cdr(message)), Attitude)  # unknown: the default
    message.orientation_covariance[0] = -1.0
    refused = decode("gps/attitude", IMU, to_cdr(message))
    assert isinstance(refused, Rejected)
    assert refused.reason == "orientation is absent"


def test_aboard_only_when_asked_for():
    assert "gps_attitude" not in scenario_from_text("name: x").sensors
    scenario = scenario_from_text("{name: x, seed: 7, sensors: [imu, gps_attitude], gps_attitude: {outages_s: [[1, 2]]}}")
    assert scenario.gps_attitude.seed == 7
    assert scenario.gps_attitude.outages_s == [1.0, 2.0]


def test_the_antenna_triangle_gives_the_sigmas_it_states_unlike_on_the_axes():
    flown, normalised, errors = truth(250.0, 2), [], []
    simulator = GpsAttitudeSimulator(GpsAttitudeSimulatorSettings(antennas_m=[0.36, 0.50], phase_mm=2.0))
    epochs = simulator.simulate(flown)
    assert len(epochs) == len(flown)
    for epoch, q_nb in zip(epochs, flown.q_nb, strict=True):
        error_n = rotvec_from_quat(quat_multiply(epoch.q_nb, quat_conjugate(q_nb)))
        normalised.append(float(error_n @ np.linalg.solve(epoch.cov_att, error_n)) / 3.0)
        errors.append(np.degrees(error_n))
    assert np.mean(normalised) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / (3.0 * len(epochs))))
    sigma = np.degrees(np.sqrt(np.mean([np.diag(e.cov_att) for e in epochs], axis=0)))
    np.testing.assert_allclose(np.std(errors, axis=0), sigma, rtol=0.15)
    assert sigma.max() / sigma.min() > 1.2  # heading is shown best: the whole sky turns with it
    assert 0.1 < sigma.min() < sigma.max() < 1.0


def test_a_wider_triangle_and_a_higher_mask():
    flown = truth(5.0, 2)

    def sigma(**changes):
        settings = GpsAttitudeSimulatorSettings(**{"antennas_m": [0.36, 0.50], **changes})
        return [math.sqrt(np.trace(e.cov_att)) for e in GpsAttitudeSimulator(settings).simulate(flown)]

    assert np.mean(sigma(antennas_m=[3.6, 5.0])) == pytest.approx(0.1 * np.mean(sigma()), rel=0.02)
    assert sigma(mask_deg=85.0) == []  # fewer than three satellites
    with pytest.raises(SettingsError, match="triangle"):
        GpsAttitudeSimulatorSettings(antennas_m=[1.0, 0.3])
    with pytest.raises(SettingsError, match="two sides"):
        GpsAttitudeSimulatorSettings(antennas_m=[1.0])
