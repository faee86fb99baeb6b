"""Ionosphere and troposphere against a published example, closed forms and numerical integration."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from lowcostnav_ros.gnss import GnssError, troposphere
from lowcostnav_ros.gnss import gps_time as gt
from lowcostnav_ros.gnss.ionosphere import Klobuchar, code_delay_m, residual_sigma_m, slant_factor
from lowcostnav_ros.gnss.signals import L1_HZ

L2_HZ = 1227.60e6
EXAMPLE = Klobuchar((3.82e-8, 1.49e-8, -1.79e-7, 0.0), (1.43e5, 0.0, -3.28e5, 1.13e5))


def test_one_tec_unit_on_the_two_carriers():
    assert code_delay_m(1e16) == pytest.approx(0.1624, abs=1e-4)
    assert code_delay_m(1e16, L2_HZ) / code_delay_m(1e16) == pytest.approx((77 / 60) ** 2)


def test_klobuchar_published_example():
    # the coefficients of 2 January 2000 at 40 N 260 E, elevation 20, azimuth 210 deg, 593100 s of the week: 23.784 m
    delay = EXAMPLE.delay_m(math.radians(40.0), math.radians(260.0), math.radians(210.0), math.radians(20.0), gt.from_week(1042, 593100.0))
    assert delay[0] == pytest.approx(23.784, abs=2e-3)


def test_klobuchar_at_night_is_five_nanoseconds_times_the_slant_factor():
    night = gt.from_week(1042, 10800.0)
    zenith, low = EXAMPLE.delay_m(0.7, 0.0, np.zeros(2), np.radians([90.0, 10.0]), night)
    assert zenith == pytest.approx(5e-9 * 299792458.0 * (1.0 + 16.0 * 0.03**3), rel=1e-9)
    assert low / zenith == pytest.approx(float(slant_factor(np.radians(10.0))), rel=0.06)  # the cubic approximates the thin shell
    first, second = (EXAMPLE.delay_m(0.7, 0.0, 0.0, 1.0, night, hz) for hz in (L1_HZ, L2_HZ))
    assert second == pytest.approx(first * (L1_HZ / L2_HZ) ** 2)


def test_residual_ionosphere():
    assert residual_sigma_m(np.array([6.0]), 0.6, np.array([0.5])) == pytest.approx(3.0)
    bound = residual_sigma_m(np.zeros(3), 0.6, np.radians([90.0, 30.0, 5.0]), bound=True)
    assert bound == pytest.approx([4.5, 4.5 * 1.753, 4.5 * 3.04], rel=0.005)


def test_zenith_delay_is_the_integral_of_the_refractivity():
    lat, lapse, day = math.radians(45.0), 5.58e-3 + 0.32e-3, 28.0 + 365.25 / 2.0  # midsummer: mean plus amplitude
    pressure, temperature = 1015.75 - 2.25, 283.15 + 11.0
    power = 9.80665 / (287.054 * lapse)

    def refractivity(h):
        at = temperature - lapse * h
        return 1e-6 * 77.604 * pressure * (at / temperature) ** power / at

    for base in (0.0, 3000.0):
        integral, _ = quad(refractivity, base, temperature / lapse - 1.0, limit=200)
        dry, wet = troposphere.zenith_delays_m(lat, base, day)
        assert dry == pytest.approx(integral * 9.80665 / 9.784, rel=1e-4)  # the model takes gravity at the centroid of the column
        assert 0.0 < wet < 0.25


def test_zenith_delay_by_saastamoinen_and_over_height():
    dry, wet = troposphere.zenith_delays_m(math.radians(45.0), 0.0, 28.0)
    assert dry == pytest.approx(0.0022768 * (1015.75 + 2.25), rel=2e-3)
    assert 2.3 < dry + wet < 2.6
    assert sum(troposphere.zenith_delays_m(0.8, 10000.0, 100.0)) == pytest.approx(0.0022768 * 264.4, abs=0.03)  # standard pressure
    north, south = (sum(troposphere.zenith_delays_m(lat, 0.0, day)) for lat, day in ((0.8, 28.0), (-0.8, 211.0)))
    assert north == pytest.approx(south)


def test_mapping_and_its_lower_end():
    high = np.radians([90.0, 60.0, 30.0])
    assert troposphere.mapping(high) == pytest.approx(1.0 / np.sin(high), rel=4e-3)
    assert troposphere.mapping(math.radians(5.0)) == pytest.approx(10.15, abs=0.1)  # Niell and Chao give 10.1 to 10.2
    with pytest.raises(GnssError, match="elevation of -3.0 deg"):
        troposphere.mapping(np.radians([20.0, -3.0]))


def test_day_of_year():
    assert troposphere.day_of_year(gt.from_calendar(2005, 4, 2, 12, 0, 13.0)) == pytest.approx(92.5)
