"""Satellite orbits: vectors recomputed from the published elements, orbits written a second way, Kepler's equation, almanacs, validity."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.gnss import GnssError
from lowcostnav_ros.gnss import gps_time as gt
from lowcostnav_ros.gnss.almanac import parse_yuma
from lowcostnav_ros.gnss.constellation import galileo_27, gps_24
from lowcostnav_ros.gnss.ephemeris import MU, ORBIT_EARTH_RATE, Ephemeris, EphemerisStore, eccentric_anomaly, satellite_state
from lowcostnav_ros.gnss.observables import azimuth_elevation, line_of_sight, states_at_reception
from lowcostnav_ros.gnss.signals import SPEED_OF_LIGHT

C = SPEED_OF_LIGHT
TOE = gt.from_week(1316, 518400.0)
PLAIN = Ephemeris("G", 3, TOE, TOE, 5153.73, 0.0067, 2.47, 0.535, 0.93, 0.61, -8.5e-9, 2e-10, 5.4e-9)
LAST_DIGIT_M = 1e-3
FULL = dataclasses.replace(PLAIN, cuc=1.0e-6, cus=7.6e-6, crc=230.0, crs=19.7, cic=-1e-7, cis=-6.5e-8, af0=9.7e-5, af1=3.1e-12, af2=1e-17)


def test_positions_of_the_24_satellites_are_those_recomputed_from_the_published_elements():
    """The thesis prints elements and no position; these vectors come from its equations (corrected), programmed apart from this package."""
    gps = gps_24()
    at = {0.0: gps.states(0.0)[0], 600.0: gps.states(600.0)[0]}
    golden = {
        (1, 0.0): (-15250274.733, 111219.167, -21744878.176),
        (17, 0.0): (24632488.706, -7615020.113, -6377691.185),
        (10, 0.0): (20153076.793, 16718104.530, 4447634.506),
        (1, 600.0): (-15202304.323, -1544975.426, -21723857.167),
        (17, 600.0): (24221569.377, -7209086.048, -8171146.265),
        (10, 600.0): (19717351.748, 16645169.186, 6291848.602),
    }
    for (sat, t), position in golden.items():
        assert at[t][sat - 1] == pytest.approx(position, abs=LAST_DIGIT_M)
    assert gps.states(0.0)[1][23] == pytest.approx((1521.2678, 1223.4794, -2257.1748), abs=1e-4)


def test_directions_from_lisbon_are_those_recomputed_from_the_published_elements():
    lat, lon = math.radians(38.7), math.radians(-9.1)
    golden = {
        0.0: {3: (6.74, 265.86), 4: (38.02, 278.45), 5: (38.59, 48.79), 10: (25.19, 110.33), 11: (14.64, 147.14), 17: (24.25, 189.83),
              23: (62.98, 318.21), 24: (76.21, 105.64)},
        10800.0: {3: (67.66, 332.87), 4: (65.01, 85.91), 7: (50.22, 269.06), 10: (7.50, 37.81), 11: (39.91, 54.64), 12: (12.11, 200.77),
                  14: (10.94, 116.87), 20: (7.83, 277.90), 23: (25.97, 172.72)},
    }  # fmt: skip
    for t, table in golden.items():
        _, los = line_of_sight(np.array([4921871.207, -788356.039, 3966692.990]), gps_24().states(t)[0])
        azimuth, elevation = np.degrees(azimuth_elevation(lat, lon, los))
        assert {k + 1 for k in np.flatnonzero(elevation > 5.0)} == set(table)
        for sat, (el, az) in table.items():
            assert (elevation[sat - 1], azimuth[sat - 1]) == pytest.approx((el, az), abs=0.006)


@pytest.mark.parametrize("constellation", [gps_24(), galileo_27()])
def test_constellation_velocity_is_the_derivative_and_the_orbit_closes(constellation):
    (before, _), (_, velocity), (after, _) = (constellation.states(5000.0 + d) for d in (-0.5, 0.0, 0.5))
    assert velocity == pytest.approx(after - before, abs=1e-3)
    radius = np.linalg.norm(constellation.states(777.0)[0], axis=1)
    assert radius == pytest.approx(constellation.radius_m, rel=1e-12)
    kepler = 2.0 * math.pi * np.sqrt(constellation.radius_m**3 / 3.986005e14)
    assert constellation.period_s == pytest.approx(kepler, rel=2e-4)  # 43082 s is the half sidereal day, not quite the radius's


def test_light_time_and_earth_rotation_by_hand():
    constellation, receiver = gps_24(), np.array([4921871.207, -788356.039, 3966692.990])
    seen, _ = states_at_reception(constellation.states, 10800.0, receiver)
    for k in range(24):
        tau = 0.07
        for _ in range(6):
            sent = constellation.states(10800.0 - tau)[0][k]
            angle = 7.2921155e-5 * tau
            there = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]) @ sent
            tau = np.linalg.norm(there - receiver) / C
        assert seen[k] == pytest.approx(there, abs=1e-4)
    still, _ = states_at_reception(constellation.states, 10800.0, receiver, light_time=False)
    assert np.array_equal(still, constellation.states(10800.0)[0])
    assert 100.0 < np.abs(np.linalg.norm(seen - still, axis=1)).max() < 500.0


def rotation(axis, angle):
    c, s = math.cos(angle), math.sin(angle)
    rows = {1: [[1, 0, 0], [0, c, -s], [0, s, c]], 3: [[c, -s, 0], [s, c, 0], [0, 0, 1]]}
    return np.array(rows[axis], float)


def orbit_by_rotations(e, t):
    """The user algorithm of IS-GPS-200 written with rotation matrices and Kepler's equation by bisection."""
    a = e.sqrt_a**2
    mean = e.mean_anomaly + (math.sqrt(MU[e.system] / a**3) + e.motion_correction) * t
    low, high = mean - 1.0, mean + 1.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle - e.eccentricity * math.sin(middle) < mean else (low, middle)
    in_plane = np.array([math.cos(low) - e.eccentricity, math.sqrt(1.0 - e.eccentricity**2) * math.sin(low)]) * a
    phi = math.atan2(in_plane[1], in_plane[0]) + e.perigee
    harmonic = [s * math.sin(2 * phi) + c * math.cos(2 * phi) for s, c in ((e.cus, e.cuc), (e.crs, e.crc), (e.cis, e.cic))]
    node = e.node + e.node_rate * t - ORBIT_EARTH_RATE * (t + 518400.0)
    turn = rotation(3, node) @ rotation(1, e.inclination + e.inclination_rate * t + harmonic[2]) @ rotation(3, phi + harmonic[0])
    return turn @ [np.linalg.norm(in_plane) + harmonic[1], 0.0, 0.0]


@given(st.floats(min_value=-7200.0, max_value=7200.0))
def test_broadcast_orbit_agrees_with_rotation_matrices_and_velocity_with_its_derivative(t):
    at = [satellite_state(FULL, TOE + round(1e9 * (t + d))) for d in (-0.5, 0.0, 0.5)]
    assert at[1].position_e == pytest.approx(orbit_by_rotations(FULL, round(t * 1e9) / 1e9), abs=1e-4)
    assert at[1].velocity_e == pytest.approx(at[2].position_e - at[0].position_e, abs=2e-4)
    assert at[1].clock_rate == pytest.approx((at[2].clock_s - at[0].clock_s), abs=1e-16)


def test_relativistic_clock_is_minus_twice_r_dot_v_over_c_squared():
    for t in (-5000, 0, 3000):
        state = satellite_state(dataclasses.replace(PLAIN, motion_correction=0.0), TOE + t * gt.SECOND)
        assert state.clock_s == pytest.approx(-2.0 * state.position_e @ state.velocity_e / C**2, rel=1e-6)


@given(st.floats(min_value=-20.0, max_value=20.0), st.floats(min_value=0.0, max_value=0.1))
def test_keplers_equation(mean, eccentricity):
    anomaly = eccentric_anomaly(mean, eccentricity)
    assert anomaly - eccentricity * math.sin(anomaly) == pytest.approx(mean, abs=1e-13)


def test_an_ephemeris_of_the_last_hours_of_a_week_serves_the_next_week():
    toe = gt.from_week(1316, 604784.0)
    late = dataclasses.replace(FULL, toe_ns=toe, toc_ns=toe)
    before, after = (satellite_state(late, gt.from_week(1317, 0.0) + d) for d in (-1, 1))
    assert np.linalg.norm(after.position_e - before.position_e) < 1e-3
    assert late.valid_at(gt.from_week(1317, 7000.0))
    assert not late.valid_at(gt.from_week(1317, 8000.0))
    assert not late.valid_at(gt.from_week(1316 + 1024, 604784.0))


def test_the_store_picks_the_nearest_and_says_why_there_is_none():
    sick = dataclasses.replace(FULL, sat_id=4, healthy=False)
    newer = dataclasses.replace(FULL, toe_ns=TOE + 7200 * gt.SECOND, issue=9)
    store = EphemerisStore([FULL, newer, sick, FULL, dataclasses.replace(FULL, issue=5)])
    assert store.rejected == {"repeated ephemeris": 1, "replaced ephemeris": 1}
    assert store.find("G", 3, TOE + 3000 * gt.SECOND)[0].issue == 5
    assert store.find("G", 3, TOE + 4000 * gt.SECOND)[0].issue == 9
    assert store.find("G", 4, TOE) == (None, "satellite unhealthy")
    assert store.find("G", 5, TOE) == (None, "no ephemeris")
    assert store.find("G", 3, TOE + gt.WEEK_NS) == (None, "ephemeris out of date")


@pytest.mark.parametrize("bad", [{"sqrt_a": 12.0}, {"eccentricity": 0.5}, {"af0": math.nan}])
def test_no_orbit_is_refused(bad):
    with pytest.raises(GnssError, match="no satellite orbit"):
        dataclasses.replace(PLAIN, **bad)


YUMA = """******** Week 292 almanac for PRN-03 ********
ID:                         03
Health:                     000
Eccentricity:               0.6700000000E-002
Time of Applicability(s):  518400.0000
Orbital Inclination(rad):   0.9300000000
Rate of Right Ascen(r/s):  -0.8500000000E-008
SQRT(A)  (m 1/2):           5153.730000
Right Ascen at Week(rad):   0.5350000000E+000
Argument of Perigee(rad):   0.610000000
Mean Anom(rad):             0.2470000000E+001
Af0(s):                     0.1000000000E-003
Af1(s/s):                   0.3000000000E-011
week:                        292
"""


def test_yuma_almanac_across_the_rollover_with_its_bad_records_counted():
    broken = YUMA.replace("PRN-03", "PRN-04").replace("0.2470000000E+001", "?")
    flat = YUMA.replace("5153.730000", "0.0")
    almanacs, rejected = parse_yuma(YUMA + "\n" + broken + "\n" + flat, gt.from_calendar(2005, 6, 1))
    assert rejected == {"incomplete record": 1, "no satellite orbit": 1}
    (almanac,) = almanacs
    assert almanac.toe_ns == TOE  # 292 + 1024 = 1316
    same = dataclasses.replace(PLAIN, inclination_rate=0.0, motion_correction=0.0)
    assert satellite_state(almanac, TOE).position_e == pytest.approx(orbit_by_rotations(same, 0.0), abs=1e-3)
    assert EphemerisStore(almanacs).find("G", 3, TOE + 4 * gt.WEEK_NS)[0] is almanac
    with pytest.raises(GnssError, match="give a YUMA almanac"):
        parse_yuma("something else", TOE)
