"""Point positioning and RAIM: exact recovery, Monte Carlo against the stated covariance and probabilities, faults, refusals."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from lowcostnav_ros.base.chi_square import noncentrality
from lowcostnav_ros.base.measurements import GnssEpoch
from lowcostnav_ros.gnss import GnssError, positioning, raim
from lowcostnav_ros.gnss.constellation import galileo_27, gps_24
from lowcostnav_ros.gnss.dop import los_n
from lowcostnav_ros.gnss.error_budget import range_covariance, range_noise
from lowcostnav_ros.gnss.observables import azimuth_elevation, range_and_rate
from lowcostnav_ros.physics.earth import dcm_ne, geodetic_to_ecef

LAT, LON, HEIGHT = math.radians(38.7), math.radians(-9.1), 500.0
PLACE = geodetic_to_ecef(LAT, LON, HEIGHT)
VEL_N = np.array([40.0, -30.0, 3.0])


def epoch(count=None, t=10800.0, clock_m=-1.2e5, drift=35.0, constellation=None, place=(LAT, LON, HEIGHT), sigma=5.0):
    """Perfect observations of the satellites above 5 deg."""
    constellation = constellation or gps_24()
    at = geodetic_to_ecef(*place)
    position, velocity = constellation.states(t)
    ranges, rates, los = range_and_rate(at, dcm_ne(*place[:2]).T @ VEL_N, position, velocity)
    _, elevation = azimuth_elevation(place[0], place[1], los)
    rows = np.argsort(-elevation)[: np.count_nonzero(elevation > math.radians(5.0))][:count]
    n, valid = len(rows), np.ones(len(rows), dtype=bool)
    columns = (ranges[rows] + clock_m, rates[rows] + drift, np.full(n, sigma), np.full(n, 0.2), np.zeros(n), position[rows], velocity[rows])
    return GnssEpoch(0, "gnss/raw", constellation.system[rows], constellation.sat_id[rows], *columns, valid, valid)


def changed(e, **columns):
    return dataclasses.replace(e, **columns)


@given(
    st.floats(min_value=-1.5, max_value=1.5),
    st.floats(min_value=-3.1, max_value=3.1),
    st.floats(min_value=0.0, max_value=12000.0),
    st.floats(min_value=0.0, max_value=86000.0),
)
def test_perfect_observations_from_the_centre_of_the_earth(lat, lon, height, t):
    e = epoch(t=t, place=(lat, lon, height), constellation=gps_24() + galileo_27())
    fix = positioning.solve(e)
    assert fix.position_e == pytest.approx(geodetic_to_ecef(lat, lon, height), abs=1e-3)
    assert fix.clocks_m["G"] == pytest.approx(-1.2e5, abs=1e-3)
    assert fix.iterations < 9
    velocity = positioning.solve_velocity(e, fix.position_e)
    assert velocity.vel_n == pytest.approx(VEL_N, abs=1e-5)
    assert velocity.clock_drift_mps == pytest.approx(35.0, abs=1e-5)


def test_errors_have_the_stated_covariance_and_residuals_their_chi_square():
    rng, perfect = np.random.default_rng(1), epoch()
    sigma = np.linspace(2.0, 8.0, len(perfect))
    perfect = changed(perfect, sigma_m=sigma)
    draws = perfect.pseudorange_m + sigma * rng.standard_normal((600, len(sigma)))
    fixes = [positioning.solve(changed(perfect, pseudorange_m=draw)) for draw in draws]
    errors = np.array([dcm_ne(LAT, LON) @ (f.position_e - PLACE) for f in fixes])
    assert np.cov(errors.T) == pytest.approx(fixes[0].cov_n, abs=0.15 * fixes[0].cov_n.max())
    statistics = np.array([f.test.statistic for f in fixes])
    assert statistics.mean() == pytest.approx(len(sigma) - 4, rel=0.1)
    assert np.mean([f.test.verdict == "failed" for f in fixes]) < 0.008  # one in a thousand is meant to


def test_weights_from_correlated_noise_beat_equal_ones():
    rng, perfect = np.random.default_rng(2), epoch()
    _, _, los = range_and_rate(PLACE, np.zeros(3), perfect.sat_pos_e, perfect.sat_vel_e)
    _, elevation = azimuth_elevation(LAT, LON, los)
    R = range_covariance(elevation, 5.5)
    plain, weighted = [], []
    for _ in range(500):
        noise = range_noise(elevation, 5.5, rng.standard_normal(len(elevation)), rng.standard_normal())
        e = changed(perfect, pseudorange_m=perfect.pseudorange_m + noise)
        plain.append(positioning.solve(e).position_e - PLACE)
        fix = positioning.solve(e, covariance=R)
        weighted.append(fix.position_e - PLACE)
    assert np.mean(np.square(weighted)) < np.mean(np.square(plain))
    assert np.trace(np.cov(np.transpose(weighted))) == pytest.approx(np.trace(fix.cov_n), rel=0.12)


def test_a_clock_per_system():
    e = epoch(constellation=gps_24() + galileo_27())
    shifted = changed(e, pseudorange_m=e.pseudorange_m + 25.0 * (e.system == "E"))
    fix = positioning.solve(shifted, clock_per_system=True)
    assert fix.position_e == pytest.approx(PLACE, abs=1e-3)
    assert fix.clocks_m["E"] - fix.clocks_m["G"] == pytest.approx(25.0, abs=1e-3)
    assert np.linalg.norm(positioning.solve(shifted).position_e - PLACE) > 1.0


def test_too_few_satellites_and_poor_geometry_are_refused():
    for count in (0, 3):
        with pytest.raises(GnssError, match=f"{count} satellites give no position; wait until at least 4"):
            positioning.solve(epoch(count))
    with pytest.raises(GnssError, match="3 Dopplers"):
        positioning.solve_velocity(epoch(3), PLACE)
    los = los_n(np.radians([0.0, 80.0, 150.0, 200.0, 300.0]), np.full(5, 0.5)) @ dcm_ne(LAT, LON)
    e = epoch(5)
    cone = changed(e, sat_pos_e=PLACE + 2.2e7 * los, pseudorange_m=np.full(5, 2.2e7))
    with pytest.raises(GnssError, match="wait for another one"):
        positioning.solve(cone, start_e=PLACE)
    with pytest.raises(GnssError, match="not near the ground|did not settle|wait for another"):
        positioning.solve(changed(epoch(4), pseudorange_m=epoch(4).pseudorange_m * [1.0, 0.8, 1.3, 1.0]))


def test_observations_marked_invalid_are_left_out():
    e = epoch()
    wrong = e.pseudorange_m.copy()
    wrong[2] += 1e5
    fix = positioning.solve(changed(e, pseudorange_m=wrong, range_valid=np.arange(len(e)) != 2))
    assert fix.position_e == pytest.approx(PLACE, abs=1e-3)
    assert 2 not in fix.rows


def test_raim_leaves_out_the_faulty_satellite_and_names_it():
    rng = np.random.default_rng(4)
    e = epoch(8, sigma=1.0)
    for k in range(8):
        noisy = e.pseudorange_m + rng.standard_normal(8)
        noisy[k] += 150.0
        result = raim.check(changed(e, pseudorange_m=noisy))
        assert result.verdict == "excluded"
        assert result.excluded == f"G{e.sat_id[k]:02d}"
        assert result.excluded in result.reason
        assert np.linalg.norm(result.fix.position_e - PLACE) < 8.0 * result.fix.dops.pdop
        assert math.isfinite(result.hpl_m)


def test_raim_says_when_it_cannot_help():
    four = raim.check(epoch(4))
    assert four.verdict == "not possible"
    assert "at least 5 are needed" in four.reason
    assert math.isinf(four.hpl_m)
    five = epoch(5)
    wrong = five.pseudorange_m.copy()
    wrong[1] += 5000.0
    assert raim.check(five).verdict == "healthy"
    result = raim.check(changed(five, pseudorange_m=wrong))
    assert result.verdict == "faulty"
    assert "do not show which is faulty; 6 are needed" in result.reason
    eight = epoch(8)
    two = eight.pseudorange_m.copy()
    two[[1, 4]] += [3000.0, -2000.0]
    result = raim.check(changed(eight, pseudorange_m=two))
    assert result.verdict == "faulty"
    assert math.isinf(result.hpl_m)


def test_false_alarms_and_missed_faults_occur_as_often_as_set():
    rng, e = np.random.default_rng(6), epoch(8, sigma=4.0)
    settings = raim.RaimSettings(false_alarm_probability=0.05, missed_detection_probability=0.2)
    fix = positioning.solve(e)
    hpl, _ = raim.protection_levels(fix, settings)
    H, S = fix.geometry, np.eye(8) - fix.geometry @ np.linalg.pinv(fix.geometry)
    slopes = np.hypot(*np.linalg.pinv(H)[:2]) / np.sqrt(np.diag(S))
    worst = int(np.argmax(slopes))
    bias = hpl / np.hypot(*np.linalg.pinv(H)[:2, worst])  # the fault that moves the position by just the protection level
    alarms = missed = 0
    for _ in range(800):
        noisy = e.pseudorange_m + 4.0 * rng.standard_normal(8)
        alarms += positioning.solve(changed(e, pseudorange_m=noisy), probability=0.95).test.verdict == "failed"
        noisy[worst] += bias
        missed += positioning.solve(changed(e, pseudorange_m=noisy), probability=0.95).test.verdict == "passed"
    assert alarms / 800 == pytest.approx(0.05, abs=0.025)
    assert missed / 800 == pytest.approx(0.2, abs=0.045)


def test_noncentrality_has_its_closed_form_for_one_degree_of_freedom_and_grows_with_redundancy():
    bias = norm.isf(6.67e-5 / 2.0) + norm.isf(1e-3)  # a unit normal shifted so far stays within the threshold once in a thousand
    assert math.sqrt(noncentrality(6.67e-5, 1e-3, 1)) == pytest.approx(bias, rel=1e-6)
    values = [noncentrality(6.67e-5, 1e-3, redundancy) for redundancy in range(1, 9)]
    assert values == sorted(values)
