"""Stations that come and go: only a reading that is used takes a state, and an innovation changes nothing."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import SlantRange, VorBearing
from lowcostnav_ros.base.settings import from_mapping
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.earth import LocalFrame
from lowcostnav_ros.physics.rotation import euler_to_quat
from lowcostnav_ros.radionav.geometry import range_and_direction
from lowcostnav_ros.radionav.stations import stations_from_text
from lowcostnav_ros.radionav.vor import bearing_view, radial_of

STATIONS = stations_from_text((Path(__file__).parents[1] / "config" / "dme_stations_bay_area.csv").read_text())
OAK = STATIONS["OAK"]
PLACE = tuple(float(x) for x in LocalFrame(OAK.lat, OAK.lon, OAK.height).from_ned(np.array([9_000.0, 26_000.0, -1500.0])))
NAMES = ("OAK", "SJC", "SFO")
SECOND = 10**9


def host_of(kind, **values):
    given = {"aids": ["gps", "dme", "vor", "baro"], "vor.enabled": True, "dme.slots": 2, "vor.slots": 2, "vor.period_s": 0.0}
    settings = from_mapping(kind.Settings, {**given, **values})
    host = kind(settings, STATIONS)
    if kind is DeadReckoning:
        host.start_at(0, *PLACE, 300.0)
    else:
        nav = np.array([*PLACE, 40.0, -20.0, 0.0, *euler_to_quat(0.0, 0.0, 1.0)])
        host.core.start(0, nav, np.diag([300.0**2] * 2 + [100.0, *[1.0] * 3, *[1e-4] * 3]))
        host.mode = "coasting"
    return host


def reading(name, ident, second, error):
    """A range or radial that is off by so many sigmas of its slow error."""
    station, stamp_ns = STATIONS[ident], second * SECOND
    if name == "dme":
        metres = range_and_direction(*PLACE, station.lat, station.lon, station.height)[0] + error * 300.0
        return SlantRange(stamp_ns, "dme/range", ident, metres, 300.0**2)
    radial = radial_of(bearing_view(station, *PLACE).bearing + error * math.radians(0.6), station.declination)
    return VorBearing(stamp_ns, "vor/bearing", ident, radial, math.radians(1.0) ** 2)


def everything(host, aid):
    return host.P.copy(), host.core.estimate.copy(), host.core.nav.copy(), [aid.slots.index(ident) for ident in NAMES]


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a[:3], b[:3], strict=True)) and a[3] == b[3]


CASES = [pytest.param(kind, name, id=f"{name} in {kind.name}") for kind in (InsGps, DeadReckoning) for name in ("dme", "vor")]


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_a_rejected_reading_of_a_new_station_evicts_nothing(kind, name):
    host = host_of(kind)
    aid = host.aid(name)
    for second, ident in enumerate(NAMES[:2], 1):
        assert aid.process(reading(name, ident, second, 0.5), host), aid.status.reason
    before = everything(host, aid)
    assert None not in before[3][:2] and before[3][2] is None
    assert not aid.process(reading(name, "SFO", 5, 100.0), host)
    assert aid.status.reason == "innovation beyond gate"
    assert same(before, everything(host, aid))
    assert aid.process(reading(name, "SFO", 6, 0.5), host)
    assert [index is None for index in everything(host, aid)[3]] == [True, False, False]


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_an_innovation_changes_nothing_however_often_it_is_formed(kind, name):
    host = host_of(kind)
    aid = host.aid(name)
    aid.process(reading(name, "OAK", 0, 0.5), host)
    for ident in ("OAK", "SFO"):
        before = everything(host, aid)
        first, second = (aid.innovation(reading(name, ident, 3, 0.3), host) for _ in range(2))
        assert all(np.array_equal(getattr(first, part), getattr(second, part)) for part in ("y", "H", "R"))
        assert same(before, everything(host, aid))


@pytest.mark.parametrize("error", [0.4, 6.0], ids=["fused", "limited or rejected"])
@pytest.mark.parametrize(("kind", "name"), CASES)
def test_what_is_used_is_what_a_state_assigned_before_gives(kind, name, error):
    hosts = host_of(kind), host_of(kind)
    for host in hosts:
        host.aid(name).process(reading(name, "OAK", 0, 0.5), host)
    early = hosts[1].aid(name)
    early.slots.take("SJC", 2 * SECOND, hosts[1].P, hosts[1].core.estimate)
    used = [host.aid(name).process(reading(name, "SJC", 2, error), host) for host in hosts]
    assert used[0] == used[1]
    status = [host.aid(name).status for host in hosts]
    assert status[0].test_ratio == pytest.approx(status[1].test_ratio, rel=1e-12)
    assert status[0].innovation_variance == pytest.approx(status[1].innovation_variance, rel=1e-12)
    if used[0]:
        scale = np.sqrt(np.diag(hosts[1].P))
        assert np.abs((hosts[0].P - hosts[1].P) / np.outer(scale, scale)).max() < 1e-12
        assert np.abs((hosts[0].core.estimate - hosts[1].core.estimate) / scale).max() < 1e-12
        np.testing.assert_allclose(hosts[0].core.nav, hosts[1].core.nav, rtol=1e-12, atol=1e-12)


def test_range_biases_of_an_inertial_navigator_age_with_the_distance_flown():
    host = host_of(InsGps)
    rows = host.layout["dme_bias"]
    for speed in (50.0, 0.0):
        host.core.nav[3:6] = speed, 0.0, 0.0
        host.core.settle()
        rate = max(speed, 1.0) / (0.5 * 1852.0)
        np.testing.assert_allclose(host.layout.rate[rows], rate)
        np.testing.assert_allclose(host.layout.psd[rows], 2.0 * (0.17 * 1852.0) ** 2 * rate)


@pytest.mark.parametrize("kind", [InsGps, DeadReckoning])
def test_the_curvature_of_the_range_circle_is_noise_of_a_position_known_poorly(kind):
    """A cross-range error d of 3 km lengthens the range by d^2/(2 R), whose mean square over a Gaussian is 3 sigma^4/(4 R^2)."""
    host = host_of(kind)
    aid = host.aid("dme")
    sharp = aid.innovation(reading("dme", "OAK", 1, 0.0), host).R[0, 0]
    host.P[0, 0] = host.P[1, 1] = 3000.0**2
    host.P[0, 1] = host.P[1, 0] = 0.0
    distance_m, _ = range_and_direction(*PLACE, OAK.lat, OAK.lon, OAK.height)
    wide = aid.innovation(reading("dme", "OAK", 1, 0.0), host).R[0, 0]
    assert wide - sharp == pytest.approx(0.75 * (3000.0**2 / distance_m) ** 2, rel=0.02)  # seen from above by a few degrees
    draws = 3000.0 * np.random.default_rng(1).standard_normal(200_000)
    assert np.mean((np.hypot(distance_m, draws) - distance_m) ** 2) == pytest.approx(wide - sharp, rel=0.05)


def test_a_range_that_claims_to_be_perfect_has_the_white_noise_of_the_settings():
    host = host_of(DeadReckoning, **{"dme.noise_nm": 0.01})
    aid = host.aid("dme")
    host.use_aid(aid, reading("dme", "OAK", 1, 0.0))
    host.P[0:2, 0:2] = 0.0
    perfect = dataclasses.replace(reading("dme", "OAK", 2, 0.0), variance=0.0)
    assert aid.innovation(perfect, host).R[0, 0] == pytest.approx(18.52**2, rel=1e-6)


@pytest.mark.parametrize("kind", [InsGps, DeadReckoning])
def test_an_estimated_range_bias_is_part_of_the_prediction(kind):
    host = host_of(kind)
    aid = host.aid("dme")
    host.use_aid(aid, reading("dme", "OAK", 1, 0.5))
    row = aid.slots.index("OAK")
    learnt = host.core.estimate[row]
    assert learnt > 10.0
    before = aid.innovation(reading("dme", "OAK", 2, 0.5), host).y[0]
    host.core.estimate[row] = learnt + 50.0
    assert aid.innovation(reading("dme", "OAK", 2, 0.5), host).y[0] == pytest.approx(before - 50.0)


def test_the_height_of_a_station_is_in_the_range():
    low = range_and_direction(*PLACE, OAK.lat, OAK.lon, 0.0)[0]
    high = range_and_direction(*PLACE, OAK.lat, OAK.lon, PLACE[2])[0]
    level = math.hypot(9_000.0, 26_000.0)
    assert low == pytest.approx(math.hypot(level, PLACE[2]), rel=1e-3)
    assert low - high > 30.0
