"""Magnetometer simulator against the error model written out by hand and the heading it must give."""

import numpy as np
import pytest
from sensors_truth import steady_truth

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.physics.geomagnetism import declination, field_n
from lowcostnav_ros.sensors.magnetometer import MagnetometerSimulator, MagnetometerSimulatorSettings

QUIET = {"noise_mg": 0.01, "calibration_residual_mg": 0.0}
LAT, LON = np.radians(37.69), np.radians(-121.82)


def fields(seconds=1.0, heading=0.0, **settings):
    simulator = MagnetometerSimulator(MagnetometerSimulatorSettings(**{"decimal_year": 2026.0, **settings}))
    return np.array([m.field_b for m in simulator.simulate(steady_truth(seconds, heading=heading, speed=0.0))])


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0, 270.0, 33.0])
def test_a_level_compass_reads_true_heading_minus_declination(heading_deg):
    field = fields(heading=np.radians(heading_deg), **QUIET)[0]
    magnetic_deg = np.degrees(np.arctan2(-field[1], field[0]))
    declination_deg = np.degrees(declination(LAT, LON, 1000.0, 2026.0))
    assert 12.0 < declination_deg < 14.0  # published for this place and date: about 13 deg east
    assert (magnetic_deg + declination_deg - heading_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.02)


def test_uncalibrated_field_follows_the_published_chain():
    soft, scale, hard = [0.02, 0.01, 0.0, -0.03, 0.05, 0.0, 0.0, 0.004, -0.02], [0.1, -0.2, 0.3], [100.0, 200.0, -300.0]
    model = {"soft_iron": soft, "scale_factor": scale, "hard_iron_mg": hard, "misalignment_deg": [0.0, 0.0, 1.0]}
    seen = fields(calibrated=False, noise_mg=0.01, **model).mean(axis=0)
    true_b = field_n(LAT, LON, 1000.0, 2026.0)  # heading north: body axes are NED
    induced = (np.eye(3) + np.reshape(soft, (3, 3))) @ (true_b + np.array(hard) * 1e-7)
    scaled = (1.0 + np.array(scale)) * induced
    turned = scaled + np.radians(1.0) * np.array([scaled[1], -scaled[0], 0.0])  # axes turned right about z
    assert seen == pytest.approx(turned, abs=0.02e-7 + 2e-9)


def test_noise_and_residual_have_the_stated_sigma():
    simulator = MagnetometerSimulator(MagnetometerSimulatorSettings(noise_mg=5.0, calibration_residual_mg=0.0))
    measurements = simulator.simulate(steady_truth(60.0, speed=0.0))
    scatter = np.array([m.field_b for m in measurements]).std(axis=0)
    assert scatter == pytest.approx([5e-7] * 3, rel=4.0 / np.sqrt(2400))
    assert measurements[0].cov_b == pytest.approx(np.eye(3) * (5e-7) ** 2)
    offsets = [fields(0.05, seed=seed, noise_mg=0.01)[0] - field_n(LAT, LON, 1000.0, 2026.0) for seed in range(100)]
    assert np.std(offsets) == pytest.approx(4e-7, rel=4.0 / np.sqrt(600))


def test_wrong_count_is_refused():
    with pytest.raises(SettingsError, match="'soft_iron' needs 9 numbers, got 2"):
        MagnetometerSimulatorSettings(soft_iron=[1.0, 2.0])
