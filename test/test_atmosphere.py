"""The atmosphere against the printed ICAO tables, hydrostatics and published airspeeds; units against their definitions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from lowcostnav_ros.base import units
from lowcostnav_ros.physics import atmosphere as air
from lowcostnav_ros.studies import thesis_air_data

ALTITUDE = st.floats(-1000.0, air.CEILING)
MACH = st.floats(0.0, 0.99)
DEVIATION = st.floats(-30.0, 30.0)

ICAO_TABLE = [  # geopotential m, K, Pa, kg/m^3
    (0.0, 288.150, 101325.0, 1.22500),
    (1000.0, 281.650, 89874.6, 1.11164),
    (5000.0, 255.650, 54019.9, 0.736116),
    (11000.0, 216.650, 22632.0, 0.363918),
    (15000.0, 216.650, 12044.6, 0.193674),
    (20000.0, 216.650, 5474.88, 0.0880347),
]


@pytest.mark.parametrize(("altitude", "kelvin", "pascal", "rho"), ICAO_TABLE)
def test_printed_standard_atmosphere(altitude, kelvin, pascal, rho):
    assert air.temperature(altitude) == pytest.approx(kelvin, abs=1e-9)
    assert air.pressure(altitude) == pytest.approx(pascal, rel=5e-6)
    assert air.density(air.pressure(altitude), air.temperature(altitude)) == pytest.approx(rho, rel=5e-6)


def test_columns_work_like_scalars():
    altitudes = np.array([row[0] for row in ICAO_TABLE])
    pressures = air.pressure(altitudes)
    np.testing.assert_allclose(pressures, [air.pressure(a) for a in altitudes], rtol=1e-15)
    np.testing.assert_allclose(air.pressure_altitude(pressures), altitudes, atol=1e-8)


@given(ALTITUDE)
def test_pressure_altitude_is_the_inverse(altitude):
    assert air.pressure_altitude(air.pressure(altitude)) == pytest.approx(altitude, abs=1e-8)


def test_geometric_and_geopotential_altitudes_as_tabulated():
    assert air.geopotential_altitude(10_000.0) == pytest.approx(9984.3, abs=0.06)
    assert air.geometric_altitude(20_000.0) == pytest.approx(20_063.1, abs=0.06)
    assert air.geometric_altitude(air.geopotential_altitude(12_345.0)) == pytest.approx(12_345.0, abs=1e-8)


@pytest.mark.parametrize(("qnh", "deviation"), [(101_325.0, 0.0), (98_000.0, 15.0), (104_000.0, -25.0)])
def test_non_standard_day_against_integrated_hydrostatics(qnh, deviation):
    """dp/dh = -g p/(R T), integrated numerically from sea level with the temperature the pressure level has that day."""

    def slope(_, p):
        return -9.80665 * p / (287.05287 * air.temperature(air.pressure_altitude(p[0]), deviation))

    levels = [500.0, 3000.0, 10_500.0, 15_000.0]
    solved = solve_ivp(slope, (0.0, 15_000.0), [qnh], t_eval=levels, rtol=1e-10, atol=1e-6).y[0]
    for level, pascal in zip(levels, solved, strict=True):
        assert air.true_altitude(pascal, qnh, deviation) == pytest.approx(level, abs=2e-3)
        assert air.pressure_at(level, qnh, deviation) == pytest.approx(pascal, rel=1e-7)


@given(ALTITUDE, st.floats(95_000.0, 105_000.0), DEVIATION)
def test_pressure_at_is_the_inverse_of_true_altitude(altitude, qnh, deviation):
    level = min(altitude, 18_000.0)
    assert air.true_altitude(air.pressure_at(level, qnh, deviation), qnh, deviation) == pytest.approx(level, abs=1e-6)


def test_thesis_altitude_equals_the_standard_one_on_a_standard_day():
    assert thesis_air_data.thesis_altitude(70_000.0) == pytest.approx(air.pressure_altitude(70_000.0), abs=1e-9)
    assert thesis_air_data.thesis_altitude(99_000.0, 99_000.0, 300.0) == 0.0


def test_crossover_altitude_of_300_kt_and_mach_078():
    """Published crossover: 29 314 ft, printed to the foot."""
    static = air.pressure(29_314 * units.FOOT)
    assert air.mach_number(air.impact_from_cas(300 * units.KNOT), static) == pytest.approx(0.78, abs=1e-5)


def test_airspeeds_at_sea_level_on_a_standard_day_are_one():
    for knots in (60.0, 250.0, 500.0):
        assert air.cas_to_tas(knots * units.KNOT, 101_325.0, 288.15) == pytest.approx(knots * units.KNOT, rel=1e-12)
    assert air.sound_speed(288.15) == pytest.approx(340.294, abs=5e-4)
    assert air.impact_from_cas(100 * units.KNOT) == pytest.approx(0.5 * 1.225 * 51.444**2 * (1 + 0.25 * (51.444 / 340.294) ** 2), rel=1e-4)


@given(MACH, ALTITUDE, DEVIATION)
def test_airspeed_conversions_come_back(mach, altitude, deviation):
    static, kelvin = air.pressure(altitude), air.temperature(altitude, deviation)
    tas = mach * air.sound_speed(kelvin)
    assert air.tas_from_impact(air.impact_from_tas(tas, static, kelvin), static, kelvin) == pytest.approx(tas, rel=1e-9, abs=1e-9)
    assert air.cas_to_tas(air.tas_to_cas(tas, static, kelvin), static, kelvin) == pytest.approx(tas, rel=1e-9, abs=1e-9)


@given(st.floats(1e-6, 0.99))
def test_impact_pressure_is_isentropic_stagnation(mach):
    """p0/p = (T0/T)^(gamma/(gamma-1)) with T0/T = 1 + (gamma-1)/2 M^2, in extended precision."""
    exact = (1 + np.longdouble(0.2) * np.longdouble(mach) ** 2) ** np.longdouble(3.5) - 1
    assert air.impact_pressure(mach, 1.0) == pytest.approx(float(exact), rel=1e-6 if mach < 1e-4 else 1e-10)


def test_incompressible_airspeed_reads_high_by_an_eighth_of_mach_squared():
    for knots in (50.0, 100.0, 200.0):
        tas = knots * units.KNOT
        ratio = thesis_air_data.thesis_airspeed(air.impact_from_tas(tas, 101_325.0, 288.15), 101_325.0, 288.15) / tas
        assert ratio - 1 == pytest.approx((tas / 340.294) ** 2 / 8, rel=0.02)


def test_noise_at_rest_gives_zero_not_nan():
    assert air.cas_from_impact(-3.0) == 0.0
    assert thesis_air_data.thesis_airspeed(-3.0, 101_325.0, 288.15) == 0.0


@pytest.mark.parametrize(
    ("ours", "defined", "tolerance"),
    [
        (units.KNOT, 1852 / 3600, 0.0),
        (units.NAUTICAL_MILE / units.FOOT, 6076.115, 1e-3),
        (29.92126 * units.INCH_OF_MERCURY, 101_325.0, 0.05),
        (units.DEGREE_PER_HOUR, 4.848137e-6, 1e-12),
        (180 * units.DEGREE, math.pi, 0.0),
        (units.kelvin(15.0), 288.15, 1e-12),
        (units.celsius(216.65), -56.5, 1e-12),
    ],
)
def test_units_are_their_definitions(ours, defined, tolerance):
    assert ours == pytest.approx(defined, rel=0.0, abs=tolerance)
