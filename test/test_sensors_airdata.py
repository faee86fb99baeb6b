"""Air data against the standard atmosphere's own tables and closed forms."""

import numpy as np
import pytest
from sensors_truth import steady_truth

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, AirTemperature, AirVelocity, Pressure
from lowcostnav_ros.physics import atmosphere
from lowcostnav_ros.sensors.airdata import AirDataSimulator, AirDataSimulatorSettings, Vanes, air_velocity

NOISELESS = {"airspeed_noise_mps": 0.01, "static_noise_pa": 0.01, "temperature_noise_k": 0.01}
PERFECT = {"airspeed_error_mps": 0.0, "altitude_error_m": 0.0, **NOISELESS}


def by_source(truth, **settings):
    out = {}
    for m in AirDataSimulator(AirDataSimulatorSettings(**settings)).simulate(truth):
        out.setdefault(m.source, []).append(m)
    return out


def test_standard_day_at_1000_m_reads_the_tabulated_pressure():
    seen = by_source(steady_truth(1.0, height=1000.0 - 32.5), **PERFECT)
    assert seen["air/static_pressure"][0].pressure_pa == pytest.approx(89876.3, abs=0.1)  # standard table, 1000 m geometric
    assert seen["air/temperature"][0].temperature_k == pytest.approx(281.65, abs=0.05)


@pytest.mark.parametrize(("qnh_pa", "isa_deviation_k"), [(101325.0, 0.0), (99000.0, 20.0), (103000.0, -25.0)])
def test_altitude_comes_back_from_pressure_on_any_day(qnh_pa, isa_deviation_k):
    day = {"qnh_pa": qnh_pa, "isa_deviation_k": isa_deviation_k}
    pressure_pa = by_source(steady_truth(0.1, height=2000.0), **PERFECT, **day)["air/static_pressure"][0].pressure_pa
    altitude = atmosphere.geometric_altitude(atmosphere.true_altitude(pressure_pa, qnh_pa, isa_deviation_k))
    assert altitude - 32.5 == pytest.approx(2000.0, abs=0.01)


def test_headwind_and_crosswind_are_in_the_air_velocity():
    truth = steady_truth(0.5, speed=50.0, wind=(-10.0, 5.0, 0.0))  # flying north against 10 m/s, air from the west
    blind = by_source(truth, **PERFECT)["air/velocity"][0]
    assert blind.vel_b[0] == pytest.approx(np.hypot(60.0, 5.0), abs=0.05)
    assert np.diag(blind.cov_b)[1:].tolist() == [UNKNOWN_VARIANCE] * 2
    seen = by_source(truth, **PERFECT, vanes=True, vane_offset_deg=0.0, vane_noise_deg=0.0)["air/velocity"][0]
    assert seen.vel_b == pytest.approx([60.0, -5.0, 0.0], abs=0.05)


def test_airspeed_and_altitude_errors_have_their_variance():
    truth = steady_truth(0.1, height=1000.0)
    speeds, altitudes = [], []
    for seed in range(400):
        seen = by_source(truth, seed=seed, temperature_noise_k=0.01)
        speeds.append(seen["air/velocity"][0].vel_b[0] - 50.0)
        altitude = atmosphere.pressure_altitude(seen["air/static_pressure"][0].pressure_pa)
        altitudes.append(atmosphere.geometric_altitude(altitude) - 32.5 - 1000.0)
    tolerance = 4.0 / np.sqrt(800)
    assert np.std(speeds) == pytest.approx(np.hypot(2.6, 0.2), rel=tolerance)
    assert np.std(altitudes) == pytest.approx(23.0, rel=tolerance)
    stated = seen["air/velocity"][0].cov_b[0, 0], seen["air/static_pressure"][0].variance
    assert np.sqrt(stated[0]) == pytest.approx(np.std(speeds), rel=tolerance + 0.05)
    assert np.sqrt(stated[1]) == pytest.approx(23.0 * 1.0995 * 9.80665, rel=0.02)  # density 1.11 kg/m^3 at 1000 m


def test_stated_covariance_is_the_scatter_of_what_the_computer_makes():
    rng = np.random.default_rng(4)
    results = []
    for e in rng.standard_normal((4000, 5)):
        static = Pressure(0, "air/static_pressure", 90_000.0 + 250.0 * e[0], 250.0**2)
        impact = Pressure(0, "air/dynamic_pressure", 1400.0 + 60.0 * e[1], 60.0**2)
        kelvin = AirTemperature(0, "air/temperature", 280.0 + 2.0 * e[2], 4.0)
        results.append(air_velocity(static, impact, kelvin, Vanes(0.1 + 0.02 * e[3], -0.05 + 0.02 * e[4], 0.02), "air/velocity"))
    scatter = np.cov(np.array([r.vel_b for r in results]).T)
    assert isinstance(results[0], AirVelocity)
    stated = np.mean([r.cov_b for r in results], axis=0)
    assert scatter == pytest.approx(stated, rel=0.08, abs=0.03 * np.sqrt(np.outer(np.diag(stated), np.diag(stated))).max())


def test_standing_still_gives_a_wide_but_finite_sigma():
    velocity = by_source(steady_truth(0.1, speed=0.0), seed=5)["air/velocity"][0]
    assert velocity.vel_b[0] >= 0.0 and 2.0 < np.sqrt(velocity.cov_b[0, 0]) < 5.0
