"""Covariances of any rank and size, sigmas no sensor has, numbers that are none: refused or raised by name, and never published."""

import dataclasses
from collections import Counter

import numpy as np
import pytest
from common import fly, scenario

from lowcostnav_ros.base.measurements import GnssEpoch, GpsPosition, GpsVelocity
from lowcostnav_ros.estimation.aiding import NO_CORRECTION, CorrectionNotFinite
from lowcostnav_ros.messages.decode import RULES, Rejected, decode
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning, DeadReckoningSettings
from lowcostnav_ros.navigators.gnss_only import GnssOnly, GnssOnlySettings
from lowcostnav_ros.navigators.ins_gnss import InsGnss, InsGnssSettings
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.navigators.solutions import is_sound

RANK_ONE = np.outer([2.0, 2.0, 5.0], [2.0, 2.0, 5.0])
COVARIANCES = [RANK_ONE, 1e28 * RANK_ONE, np.full((3, 3), 5e-324), 1e-18 * np.eye(3), np.diag([4.0, 4.0, 5e-324]), 1e29 * np.eye(3)]


@pytest.fixture(scope="module")
def flight():
    changes = {"truth.duration_s": 40.0, "sensors": ["imu", "magnetometer", "air_data", "gps", "gnss"], "imu.profile": "automotive"}
    return fly(scenario("turns", 5, **changes))[1]


def received(measurement, notes=None):
    ((_, source, msgtype, raw),) = encode_cdr(measurement)
    return decode(source, msgtype, raw, RULES, Counter() if notes is None else notes)


@pytest.mark.parametrize("cov", COVARIANCES)
def test_a_legal_covariance_comes_out_positive_definite_or_is_refused_by_name(cov):
    for sent in (GpsPosition(10**18, "gps/fix", 0.6, -2.1, 100.0, cov), GpsVelocity(10**18, "gps/vel", np.zeros(3), cov)):
        got = received(sent)
        assert not isinstance(got, Rejected), got
        assert np.isfinite(np.linalg.cholesky(got.cov_n)).all()
        assert np.sqrt(got.cov_n.diagonal().min()) >= 0.005


def test_a_sigma_no_receiver_has_is_raised_and_noted_and_no_sigma_is_not_used(flight):
    epoch, notes = next(m for m in flight if isinstance(m, GnssEpoch)), Counter()
    sigmas = np.where(np.arange(len(epoch)) % 2, 1e-9, 1e154)
    got = received(dataclasses.replace(epoch, sigma_m=sigmas, doppler_mps=np.full(len(epoch), 1e154)), notes)
    assert got.sigma_m[1] == 0.3
    assert not got.range_valid[0]
    assert not got.doppler_valid.any()
    assert {"gnss/raw: implausible pseudorange not used", "gnss/raw: implausible doppler not used"} < set(notes)
    assert notes["gnss/raw: sigma raised to what a receiver can have"] == len(epoch) // 2


@pytest.mark.parametrize(
    "make",
    [
        lambda: InsGps(InsGpsSettings()),
        lambda: InsGnss(InsGnssSettings(coupling="loose", loose_source="receiver")),
        lambda: DeadReckoning(DeadReckoningSettings()),
    ],
)
@pytest.mark.parametrize("cov", COVARIANCES)
def test_a_singular_fix_leaves_every_navigator_sound(flight, make, cov):
    navigator, out, fixes = make(), [], 0
    for m in flight:
        if isinstance(m, GpsPosition | GpsVelocity):
            fixes += 1
            m = dataclasses.replace(m, cov_n=cov) if fixes % 10 == 9 else m
        out += navigator.feed(m)
        latest = navigator.output()
        assert latest is None or is_sound(latest)
    assert all(is_sound(solution) for solution in out)
    assert not navigator.restarts
    assert np.isfinite(navigator.P).all()


def test_a_satellite_that_claims_a_nanometre_leaves_no_negative_variance(flight):
    navigator, epochs, out = GnssOnly(GnssOnlySettings()), 0, []
    for m in flight:
        if isinstance(m, GnssEpoch):
            epochs += 1
            m = dataclasses.replace(m, sigma_m=np.full(len(m), 1e-9), sigma_mps=np.full(len(m), 1e-12)) if epochs > 10 else m
        out += navigator.feed(m)
    assert len(out) > 20
    assert all(is_sound(solution) for solution in out)


def test_a_correction_that_is_none_is_counted_and_the_state_stays(flight):
    navigator = InsGps(InsGpsSettings())
    navigator.feed_all(m for m in flight if m.stamp_ns - flight[0].stamp_ns < 20e9)
    before, P = navigator.core.nav.copy(), navigator.P.copy()
    with pytest.raises(CorrectionNotFinite):
        navigator.correct(np.full(navigator.layout.size, np.nan))
    aid = navigator.aid("gps_position")
    aid.fuse = lambda innovation, host: host.correct(np.full(host.layout.size, np.inf))
    fix = next(m for m in flight if isinstance(m, GpsPosition))
    assert not navigator.use_aid(aid, dataclasses.replace(fix, stamp_ns=navigator.core.t_ns, cov_n=1e9 * np.eye(3)))
    assert aid.status.rejected[NO_CORRECTION] == 1
    assert np.array_equal(navigator.core.nav, before)
    assert np.array_equal(navigator.P, P)


def test_a_state_that_is_no_number_never_goes_out_and_is_found_again(flight):
    navigator, out = InsGps(InsGpsSettings()), []
    for k, m in enumerate(flight):
        out += navigator.feed(m)
        if k == len(flight) // 2:
            navigator.core.nav[4] = np.nan
        latest = navigator.output()
        assert latest is None or is_sound(latest)
    assert all(is_sound(solution) for solution in out)
    assert navigator.restarts["solution not finite"] == 1
    assert out[-1].stamp_ns > flight[-1].stamp_ns - 10**9
