"""The VOR aid in both of its hosts: wrap, derivative, refusals by name, what it teaches and what it may move."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from dead_reckoning_flight import ORIGIN, START_NS, in_order, station, straight, turning

from lowcostnav_ros.aids.vor import VorSettings
from lowcostnav_ros.base.measurements import VorBearing
from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.catalogue.building import make_navigator
from lowcostnav_ros.estimation.station_slots import StationSlots
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning, DeadReckoningSettings
from lowcostnav_ros.navigators.ins_gnss import InsGnss, InsGnssSettings
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.physics.earth import LocalFrame, displace
from lowcostnav_ros.physics.rotation import euler_to_quat
from lowcostnav_ros.radionav.stations import StationTable, stations_from_text
from lowcostnav_ros.radionav.vor import bearing_view, radial_of

STATIONS = stations_from_text((Path(__file__).parents[1] / "config" / "dme_stations_bay_area.csv").read_text())
OAK = STATIONS["OAK"]
ON = VorSettings(enabled=True)
DEG = math.pi / 180.0


def place(bearing_deg, distance_m, above_m=900.0):
    north, east = distance_m * math.cos(bearing_deg * DEG), distance_m * math.sin(bearing_deg * DEG)
    return LocalFrame(OAK.lat, OAK.lon, OAK.height).from_ned(np.array([north, east, -above_m]))


def inertial(bearing_deg=100.0, distance_m=30_000.0, above_m=900.0, sigma_m=500.0, stations=STATIONS, kind=InsGps, **vor):
    settings = {InsGps: InsGpsSettings, InsGnss: InsGnssSettings}[kind](vor=dataclasses.replace(ON, **vor))
    host = kind(settings, stations)
    nav = np.array([*place(bearing_deg, distance_m, above_m), 40.0, -20.0, 0.0, *euler_to_quat(0.0, 0.0, 1.0)])
    host.core.start(0, nav, np.diag([sigma_m**2] * 2 + [100.0, *[1.0] * 3, *[1e-4] * 3]))
    host.mode = "coasting"
    return host


def dead_reckoner(bearing_deg=100.0, distance_m=30_000.0, above_m=900.0, sigma_m=500.0, **vor):
    host = DeadReckoning(DeadReckoningSettings(vor=dataclasses.replace(ON, **vor)), STATIONS)
    host.start_at(0, *place(bearing_deg, distance_m, above_m), sigma_m)
    return host


HOSTS = {"ins_gps": inertial, "ins_gnss": lambda *a, **k: inertial(*a, kind=InsGnss, **k), "dead_reckoning": dead_reckoner}


def aid_of(host):
    return next(aid for aid in host.aids if aid.status.name == "vor")


def reading(bearing_deg, stamp_ns=0, name="OAK", error_deg=0.0, sigma_deg=1.0):
    radial = radial_of((bearing_deg + error_deg) * DEG, STATIONS[name].declination if name in STATIONS else 0.0)
    return VorBearing(stamp_ns, "vor/bearing", name, radial, (sigma_deg * DEG) ** 2)


@pytest.mark.parametrize("make", HOSTS.values(), ids=HOSTS)
@pytest.mark.parametrize(("bearing_deg", "error_deg"), [(179.9, 0.4), (-179.9, -0.4), (17.0, 0.3), (16.9, -0.3), (359.9, 0.2), (0.0, 5.0)])
def test_the_innovation_is_the_small_angle_at_every_seam_of_the_compass(make, bearing_deg, error_deg):
    host = make(bearing_deg)
    found = aid_of(host).innovation(reading(bearing_deg, error_deg=error_deg), host)
    assert found.y[0] / DEG == pytest.approx(error_deg, abs=1e-6)


@pytest.mark.parametrize("make", HOSTS.values(), ids=HOSTS)
@pytest.mark.parametrize("bearing_deg", [20.0, 100.0, 179.9999, 300.0])
def test_jacobian_equals_differences(make, bearing_deg):
    host = make(bearing_deg)
    aid, sample = aid_of(host), reading(bearing_deg)
    aid.process(sample, host)  # seats the station
    nav = host.core.nav
    before, estimate = nav.copy(), host.core.estimate.copy()
    H = aid.innovation(sample, host).H[0]
    seat = host.layout["vor_bias"].start
    assert set(np.flatnonzero(H)) <= {0, 1, 2, seat} and H[seat] == 1.0
    for i in range(3):
        values = []
        for sign in (1.0, -1.0):
            nav[:3] = displace(*before[:3], sign * 10.0 * np.eye(3)[i])
            values.append(aid.innovation(sample, host).y[0])
        nav[:] = before
        assert H[i] == pytest.approx(-(values[0] - values[1]) / 20.0, abs=1e-10)
    host.core.estimate[seat] += 1e-3
    assert aid.innovation(sample, host).y[0] == pytest.approx(math.remainder(reading_error(sample, host) - estimate[seat] - 1e-3, math.tau))


def reading_error(sample, host):
    return sample.bearing_rad + OAK.declination - bearing_view(OAK, *host.core.nav[:3]).bearing


REFUSALS = [
    ({}, "LAX", "station unknown"),
    ({}, "NUQ", "station has no VOR"),
    ({"distance_m": 400.0}, "OAK", "in the cone of confusion"),
    ({"distance_m": 90_000.0}, "OAK", "outside the service volume"),
]


@pytest.mark.parametrize(("where", "name", "reason"), REFUSALS, ids=[r for *_, r in REFUSALS])
@pytest.mark.parametrize("make", HOSTS.values(), ids=HOSTS)
def test_what_cannot_be_used_is_refused_by_name_and_changes_nothing(make, where, name, reason):
    host = make(**where)
    before = host.P.copy()
    assert not aid_of(host).process(reading(100.0, name=name), host)
    assert aid_of(host).status.rejected == {reason: 1}
    assert np.array_equal(host.P, before)


def test_without_a_table_every_radial_is_refused_by_name():
    host = inertial(stations=None)
    aid_of(host).process(reading(100.0), host)
    assert aid_of(host).status.rejected == {"no station table": 1}


@pytest.mark.parametrize("make", HOSTS.values(), ids=HOSTS)
def test_a_radial_corrects_across_the_line_to_the_station_alone(make):
    host = make(90.0)
    before = host.core.nav[:3].copy()
    height = before[2]
    assert aid_of(host).process(reading(90.0, error_deg=0.5), host)  # further clockwise: due east of the station that is south
    moved = LocalFrame(*before).to_ned(*host.core.nav[:3])
    assert moved[0] < -50.0  # half a degree at 30 km is 262 m
    assert abs(moved[1]) < 0.02 * abs(moved[0])
    assert host.core.nav[2] == pytest.approx(height, abs=0.05)
    assert host.P[0, 0] < 500.0**2 < 1.01 * host.P[1, 1]


def test_while_gps_is_good_radials_teach_the_station_and_move_nothing_else():
    host = inertial(sigma_m=2.0)
    host.mode = "gps"
    before = host.core.nav.copy()
    aid = aid_of(host)
    for k in range(400):  # ten seconds apart, as if the aircraft stood still in the air
        aid.process(reading(100.0, round(1e10 * k), error_deg=1.0), host)
    seat = host.layout["vor_bias"].start
    assert np.array_equal(host.core.nav, before)
    assert host.core.estimate[seat] / DEG == pytest.approx(1.0, abs=0.15)
    assert math.sqrt(host.P[seat, seat]) < 0.2 * DEG
    assert host.core.estimate[seat + 1 : seat + 4] == pytest.approx(0.0)


def information(period_s, total_s=600.0, **vor):
    """1/variance across the radial that ten minutes of one station leave, in units of one radial's."""
    host = inertial(sigma_m=5000.0, period_s=0.0, bias_deg=0.0, **vor)
    aid = aid_of(host)
    for k in range(round(total_s / period_s)):
        aid.process(reading(100.0, round(1e9 * period_s * k)), host)
    across = bearing_view(OAK, *host.core.nav[:3]).gradient_n
    return (1.0 * DEG) ** 2 / float(across @ host.P[:3, :3] @ across)


def test_many_radials_of_one_station_are_not_taken_for_independent_ones():
    slow, fast = information(5.0), information(0.5)
    # at 45 m/s bends decorrelate in 83 s: ten minutes hold some four independent draws, however fast they are read
    assert 2.0 < slow < 12.0
    assert fast == pytest.approx(slow, rel=0.15)
    assert information(5.0, bend_deg=0.0, noise_deg=0.9) > 5.0 * slow / 2.0


def test_a_receiver_that_states_more_is_believed_less_and_not_averaged_away():
    weights = []
    for sigma_deg in (1.0, 5.0):
        host = inertial(sigma_m=2000.0)
        for k in range(20):
            aid_of(host).process(reading(100.0, round(5e9 * k), sigma_deg=sigma_deg), host)
        weights.append(math.sqrt(host.P[0, 0]))
    assert weights[1] > 2.5 * weights[0]


def test_poor_position_near_the_station_makes_a_radial_worth_little():
    near, far = inertial(distance_m=2_000.0, sigma_m=2_000.0), inertial(distance_m=40_000.0, sigma_m=2_000.0)
    R = [aid_of(h).innovation(reading(100.0), h).R[0, 0] for h in (near, far)]
    assert R[0] > 100.0 * R[1]
    rng = np.random.default_rng(1)
    north, east = 2_000.0 * rng.standard_normal((2, 4000))
    turned = [math.remainder(math.atan2(e, 20_000.0 + n) - e / 20_000.0, math.tau) for n, e in zip(north, east, strict=True)]
    host = inertial(bearing_deg=0.0, distance_m=20_000.0, sigma_m=2_000.0, bend_deg=0.0, noise_deg=0.001, bias_deg=0.0)
    assert aid_of(host).innovation(reading(0.0, sigma_deg=0.0), host).R[0, 0] == pytest.approx(np.var(turned), rel=0.3)


def test_a_radial_far_off_is_rejected_and_a_lasting_one_recovers():
    host = inertial(sigma_m=100.0)
    aid = aid_of(host)
    used = [aid.process(reading(100.0, round(5e9 * k), error_deg=30.0), host) for k in range(13)]
    assert used.index(True) == 12  # after a minute
    assert aid.status.rejected["innovation beyond gate"] == 12
    assert aid.status.rejected["recovered after rejections"] == 1


def test_radials_are_thinned_by_station_and_a_start_at_an_earlier_time_is_no_wait():
    host = inertial()
    aid = aid_of(host)
    assert aid.due(reading(100.0, 10**10))
    aid.process(reading(100.0, 10**10), host)
    assert not aid.due(reading(100.0, 12 * 10**9))
    assert aid.due(reading(100.0, 12 * 10**9, name="SJC"))
    assert aid.due(reading(100.0, 15 * 10**9))
    assert aid.due(reading(100.0, 10**9))
    assert aid.used_lately(12 * 10**9) == ["OAK"] and aid.used_lately(60 * 10**9) == []


def test_off_by_default_and_then_no_state_no_input_no_aid():
    for host in (InsGps(InsGpsSettings()), InsGnss(InsGnssSettings()), DeadReckoning()):
        assert "vor/bearing" not in host.inputs
        assert "vor" not in [aid.status.name for aid in host.aids]
    assert "vor_bias" not in InsGps(InsGpsSettings()).layout
    assert "vor/bearing" in inertial().inputs and "vor/bearing" not in InsGps(InsGpsSettings()).inputs


def test_slots_seat_the_newcomer_where_nobody_sat_for_longest():
    P, estimate, slots = np.eye(5), np.arange(5.0), StationSlots(slice(2, 4), 3.0)
    assert [slots.take(name, now, P, estimate) for name, now in (("A", 1), ("B", 2), ("A", 3), ("C", 4))] == [2, 3, 2, 3]
    assert (slots.index("B"), slots.index("C")) == (None, 3)
    assert (P[3, 3], estimate[3], estimate[4]) == (9.0, 0.0, 4.0)
    assert StationSlots(None, 1.0).take("A", 0, P, estimate) is None


def test_one_table_serves_ranges_and_radials():
    settings = from_mapping(DeadReckoningSettings, {"dme.stations_file": "dme_stations_bay_area.csv", "vor.enabled": True})
    assert "OAK" in make_navigator(settings, DeadReckoning).stations
    alone = from_mapping(InsGpsSettings, {"vor.enabled": True, "vor.stations_file": "dme_stations_bay_area.csv"})
    assert "OAK" in make_navigator(alone, InsGps).stations
    assert make_navigator(from_mapping(InsGpsSettings, {"vor.stations_file": "dme_stations_bay_area.csv"}), InsGps).stations is None
    two = from_mapping(DeadReckoningSettings, {"dme.stations_file": "a.csv", "vor.stations_file": "b.csv", "vor.enabled": True})
    with pytest.raises(SettingsError, match="put all stations into one table"):
        make_navigator(two, DeadReckoning)


# in flight -------------------------------------------------------------------------------------------------------------------------

VORTAC = dataclasses.replace(station("AAA", 40_000.0, 30_000.0), kind="VORTAC", declination=17.0 * DEG, service_volume="H")


def radials_of(flight, stations, every, error_deg=0.0):
    for k in range(0, len(flight), every):
        lat, lon, height = ORIGIN.from_ned(flight.ned[k])
        for s in stations:
            bearing = bearing_view(s, lat, lon, height).bearing
            yield VorBearing(int(flight.stamps_ns[k]), "vor/bearing", s.ident, radial_of(bearing + error_deg * DEG, s.declination), DEG**2)


def flown(flight, aided, until_s=60.0, **settings):
    changes = {"wind.gust_mps": 0.05, "heading.noise_deg": 0.1, "airspeed.noise_mps": 0.05, "vor.enabled": True}
    nav = DeadReckoning(from_mapping(DeadReckoningSettings, {**changes, **settings}), StationTable([VORTAC]))
    gps = [m for m in flight.gps(np.random.default_rng(0), 10) if m.stamp_ns < START_NS + round(1e9 * until_s)]
    streams = {"range": flight.ranges(StationTable([VORTAC]), {"AAA": np.zeros(len(flight))}, 150)}
    streams["radial"] = radials_of(flight, [VORTAC], 10)
    parts = [flight.attitudes(), flight.airspeeds(), gps, *(streams[name] for name in aided)]
    last = nav.feed_all(in_order(*parts))[-1]
    k = int(np.searchsorted(flight.stamps_ns, last.stamp_ns))
    return nav, float(np.hypot(*(flight.ned[k] - ORIGIN.to_ned(last.lat, last.lon, last.height))[:2]))


def test_range_and_radial_of_one_station_fix_the_position_that_neither_fixes_alone():
    flight = turning(900.0)
    drift = np.linspace(0.0, 12.0, len(flight))[:, None] * np.array([1.0, -0.5])  # the wind turns after GPS is gone
    flight = type(flight)(flight.dt, flight.heading, flight.speed, flight.wind + drift)
    flights = {aided: flown(flight, aided) for aided in ((), ("range",), ("radial",), ("range", "radial"))}
    sigmas = {aided: nav.core.horizontal_sigma() for aided, (nav, _) in flights.items()}
    both = sigmas["range", "radial"]
    assert both < 1000.0  # the station is 47 km away: a degree is 820 m there
    assert both < 0.5 * min(sigmas["range",], sigmas["radial",])
    assert flights["range", "radial"][1] < 2.0 * both
    assert flights[()][1] > 2000.0


def test_mode_and_reason_name_the_station():
    nav, _ = flown(straight(160.0), ("radial",))
    assert (nav.mode, "VOR AAA" in nav.reason) == ("vor_aided", True)
    nav, _ = flown(straight(160.0), ("range", "radial"))
    assert nav.mode == "dme_aided"
    assert nav.reason.endswith("DME AAA; VOR AAA")  # nothing wrong with a single station
    nav, _ = flown(straight(160.0), ("radial",), **{"model": "reduced"})
    assert nav.mode == "vor_aided" and "vor_bias" not in nav.layout


def test_inertial_navigator_in_an_outage_says_what_it_still_hears():
    host = inertial()
    host._aligned = True
    host._fuse(reading(100.0))
    assert aid_of(host).status.accepted, aid_of(host).status.reason
    host._judge()  # as at the next output
    assert host.mode == "coasting" and host.reason.endswith("for 0 s; VOR OAK")
