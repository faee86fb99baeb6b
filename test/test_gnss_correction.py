"""Corrections end to end: raw observations made here by the physics, forwards, must give back the receiver."""

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.gnss import gps_time as gt
from lowcostnav_ros.gnss import troposphere
from lowcostnav_ros.gnss.constellation import gps_24
from lowcostnav_ros.gnss.correction import CorrectionSettings, corrected
from lowcostnav_ros.gnss.ephemeris import ORBIT_EARTH_RATE, Ephemeris, EphemerisStore, satellite_state
from lowcostnav_ros.gnss.ionosphere import Klobuchar
from lowcostnav_ros.gnss.locate import locate
from lowcostnav_ros.gnss.observables import azimuth_elevation
from lowcostnav_ros.gnss.positioning import solve_velocity
from lowcostnav_ros.gnss.raw_epoch import RawEpoch, screened
from lowcostnav_ros.gnss.rinex_nav import Navigation
from lowcostnav_ros.physics.earth import EARTH_RATE, geodetic_to_ecef

C = 299792458.0
TAG = gt.from_week(2049, 604799.5)  # the signal leaves in one week and arrives with the clock in the next
KLOBUCHAR = Klobuchar((3.82e-8, 1.49e-8, -1.79e-7, 0.0), (1.43e5, 0.0, -3.28e5, 1.13e5))
LAT, LON, HEIGHT = math.radians(38.7), math.radians(-9.1), 500.0
PLACE = geodetic_to_ecef(LAT, LON, HEIGHT)


def ephemerides(toe):
    """The 24 satellites, slightly eccentric, with clocks."""
    sky, tow = gps_24(), gt.week_and_tow(toe)[1]
    made = []
    for k in range(24):
        clock = {"af0": 1e-4 * math.sin(k), "af1": 1e-11 * math.cos(k), "group_delay_s": 1e-8 * math.cos(3 * k)}
        node = sky.node[k] + ORBIT_EARTH_RATE * tow
        made.append(Ephemeris("G", k + 1, toe, toe, 5153.7, 0.005, sky.argument[k], node, 0.96, 0.0, -8e-9, **clock))
    return made


def raw_epoch(clock_m, tag=TAG, extra_m=0.0, drift_mps=0.0):
    """All 24 satellites by light time, iterated; those below the horizon too, as a broken receiver might report."""
    received = tag - round(clock_m / C * 1e9)
    rows = []
    for e in ephemerides(tag + 1800 * gt.SECOND):
        tau = 0.075
        for _ in range(8):
            state = satellite_state(e, received - round(tau * 1e9))
            c, s = math.cos(EARTH_RATE * tau), math.sin(EARTH_RATE * tau)
            turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
            tau = np.linalg.norm(turn @ state.position_e - PLACE) / C
        los = (turn @ state.position_e - PLACE) / (C * tau)
        azimuth, elevation = azimuth_elevation(LAT, LON, los[None])
        delay = 0.0
        if elevation[0] > math.radians(2.0):
            delay = KLOBUCHAR.delay_m(LAT, LON, azimuth, elevation, tag)[0]
            delay += troposphere.delay_m(LAT, HEIGHT, elevation, troposphere.day_of_year(tag))[0]
        rate = los @ (turn @ state.velocity_e) + drift_mps - C * state.clock_rate
        rows.append((e.sat_id, C * tau + clock_m - C * state.clock_s + delay, rate))
    ids, ranges, rates = zip(*rows, strict=True)
    return RawEpoch(tag, np.full(24, "G"), np.array(ids), np.array(ranges) + extra_m, np.array(rates), np.zeros(24))


def navigation(tag=TAG):
    return Navigation(EphemerisStore(ephemerides(tag + 1800 * gt.SECOND)), KLOBUCHAR, Counter())


@given(st.floats(min_value=-1.4e6, max_value=1.4e6))
def test_the_receiver_is_given_back_over_a_week_change_whatever_its_clock(clock_m):
    rejected = Counter()
    raw = raw_epoch(clock_m, drift_mps=77.0)
    epoch, result = locate(raw, navigation(), rejected)
    assert result.verdict == "healthy"
    assert result.fix.position_e == pytest.approx(PLACE, abs=0.02)
    assert result.fix.clocks_m["G"] == pytest.approx(clock_m, abs=0.02)
    assert abs(gt.gps_ns(epoch.stamp_ns) - (TAG - round(clock_m / C * 1e9))) <= 2  # in whole ns: a float this large counts in steps of 256
    velocity = solve_velocity(epoch, result.fix.position_e)
    assert velocity.vel_n == pytest.approx(np.zeros(3), abs=0.01)
    assert velocity.clock_drift_mps == pytest.approx(77.0, abs=0.01)
    assert rejected["below the horizon"] + rejected["below the elevation mask"] + len(epoch) == 24
    assert rejected["below the horizon"] > 8


def test_an_epoch_on_the_inserted_second():
    tag = gt.from_calendar(2016, 12, 31, 23, 59, 59.0) + 18 * gt.SECOND  # 23:59:60 UTC
    epoch, result = locate(raw_epoch(0.0, tag), navigation(tag), Counter())
    assert result.fix.position_e == pytest.approx(PLACE, abs=0.02)
    assert epoch.stamp_ns == gt.unix_ns(tag)


def test_sigmas_grow_to_the_horizon_and_with_what_is_not_corrected():
    raw = raw_epoch(0.0)
    usual, bound, bare = (
        corrected(raw, navigation(), PLACE, CorrectionSettings(**options), Counter())
        for options in ({}, {"integrity_sigmas": True}, {"ionosphere": False, "troposphere": False})
    )
    los = (usual.sat_pos_e - PLACE) / np.linalg.norm(usual.sat_pos_e - PLACE, axis=1)[:, None]
    _, elevation = azimuth_elevation(LAT, LON, los)
    order = np.argsort(elevation)
    for epoch in (usual, bound, bare):
        assert np.all(np.diff(epoch.sigma_m[order]) < 0.0)  # at night the ionosphere depends on elevation alone
    assert bound.sigma_m[order[0]] > 1.7 * bound.sigma_m[order[-1]]
    assert np.all(bound.sigma_m > usual.sigma_m) and np.all(bare.sigma_m > bound.sigma_m)
    assert np.all(np.abs(bare.pseudorange_m - usual.pseudorange_m) < 3.0 * bare.sigma_m)


def test_a_missing_doppler_is_marked_and_finite():
    raw = raw_epoch(0.0)
    raw.doppler_mps[::2] = math.nan
    epoch = corrected(raw, navigation(), PLACE, CorrectionSettings(), Counter())
    assert np.isfinite(epoch.doppler_mps).all()
    assert np.array_equal(epoch.doppler_valid, epoch.sat_id % 2 == 0)
    assert epoch.range_valid.all()


def test_screening_leaves_out_every_copy_of_a_duplicate_and_impossible_ranges():
    raw = raw_epoch(0.0)
    raw.sat_id[3] = raw.sat_id[5]
    raw.pseudorange_m[[7, 8]] = [math.nan, -5.0]
    rejected = Counter()
    kept = screened(raw, rejected)
    assert rejected == {"duplicate satellite": 2, "impossible pseudorange": 2}
    assert len(kept) == 20
    empty = kept.rows(np.zeros(0, dtype=int))
    assert len(corrected(empty, navigation(), PLACE, CorrectionSettings(), rejected)) == 0
