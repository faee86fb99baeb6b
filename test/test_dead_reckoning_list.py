"""Dead reckoning as a list of sensors: old names of its settings, a second sensor, its aids in other navigators, a restart."""

import math

import numpy as np
import pytest
from dead_reckoning_flight import ORIGIN, START_NS, in_order, straight, table, turning
from dead_reckoning_flight import station as station_at

from lowcostnav_ros.base.measurements import NavSolution, Pressure
from lowcostnav_ros.base.settings import SettingsError, from_mapping, to_mapping
from lowcostnav_ros.navigators.dead_reckoning.navigator import DeadReckoning, DeadReckoningSettings
from lowcostnav_ros.navigators.gnss_only import GnssOnly
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.atmosphere import pressure_at
from lowcostnav_ros.physics.rotation import euler_to_quat


def made(cls=DeadReckoning, stations=None, **values):
    return cls(from_mapping(cls.Settings, values), stations)


def test_names_of_older_recordings_mean_what_they_meant():
    old = {"baro_bias_m": 120.0, "baro_drift_m": 30.0, "baro_tau_s": 100.0, "baro_noise_m": 2.5}
    settings = from_mapping(DeadReckoningSettings, {"height": {"climb_mps": 4.0, **old}, "gps": {"gate": {"recovery_s": 20.0}}})
    baro = settings.baro
    assert (baro.bias_m, baro.sigma_m, baro.walk_m_rts) == (120.0, 2.5, 30.0 * math.sqrt(2.0 / 100.0))
    assert (baro.gate.recovery_s, settings.gps.gate.recovery_s, settings.height.climb_mps) == (20.0, 20.0, 4.0)
    assert from_mapping(DeadReckoningSettings, to_mapping(settings)) == settings
    partly = from_mapping(DeadReckoningSettings, {"height.baro_tau_s": 100.0, "baro.gate.recovery_s": 7.0, "gps.gate.recovery_s": 5.0})
    assert partly.baro.walk_m_rts == 23.0 * math.sqrt(2.0 / 100.0) and partly.baro.gate.recovery_s == 7.0
    assert from_mapping(DeadReckoningSettings, {"gps.gate.recovery_s": 5.0}).baro == DeadReckoningSettings().baro
    assert DeadReckoningSettings().baro.walk_m_rts == 23.0 * math.sqrt(2.0 / 400.0)


@pytest.mark.parametrize("values", [{"height.baro_drift_m": "x"}, {"height.baro_tau_s": 0.0}, {"height.baro_size_m": 1.0}])
def test_old_names_that_cannot_be_used_are_refused(values):
    with pytest.raises(SettingsError, match="height.baro"):
        from_mapping(DeadReckoningSettings, values)


def test_a_second_barometer_is_a_name_with_a_number():
    flight = straight(200.0)
    nav = made(aids=["gps", "baro", "baro2"])
    assert "air2/static_pressure" in nav.inputs
    pressures = [
        Pressure(int(stamp), f"{room}/static_pressure", float(pressure_at(height + offset)), 25.0)
        for stamp, height in zip(flight.stamps_ns[::5], flight.height[::5], strict=True)
        for room, offset in (("air", 20.0), ("air2", 60.0))
    ]
    nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), pressures, flight.gps(np.random.default_rng(0), 10)))
    biases = [nav.core.estimate[nav.layout[name]][0] for name in ("baro_bias", "baro2_bias")]
    assert biases[1] - biases[0] == pytest.approx(40.0, abs=1.0)
    assert not nav.core.ranging[nav.layout["baro2_bias"]].any()
    assert not made(baro={"enabled": False}).layout.get("baro_bias")


def test_what_the_core_cannot_serve_is_refused_in_a_sentence():
    for kind in ("airdata", "wheels", "magnetic"):
        with pytest.raises(SettingsError, match=f"dead_reckoning cannot take the aid '{kind}'"):
            made(aids=["gps", kind])
    with pytest.raises(SettingsError, match="cannot start without 'gps'"):
        made(aids=["dme"])


def test_what_the_ground_sends_helps_an_inertial_navigator():
    aids = ["gps", "airdata", "radar", "wind_uplink"]
    nav = made(InsGps, aids=aids, radar={"topic": "tower/fix", "floor_m": 1.0}, wind_uplink={"topic": "tower/wind"})
    assert {"tower/fix", "tower/wind"} <= set(nav.inputs)
    place = np.array([ORIGIN.lat, ORIGIN.lon, ORIGIN.height, 40.0, 0.0, 0.0, *euler_to_quat(0.0, 0.0, 0.0)])
    nav.core.start(0, place, np.diag([300.0**2] * 2 + [100.0, *[1.0] * 3, *[1e-4] * 3]))
    lat, lon, height = (float(x) for x in ORIGIN.from_ned(np.array([100.0, -50.0, 0.0])))
    assert nav.aid("radar_fix").process(NavSolution(0, "tower/fix", lat, lon, height, cov_pos=np.diag([400.0**2, 400.0**2, 1.0])), nav)
    np.testing.assert_allclose(ORIGIN.to_ned(*nav.core.nav[:3])[:2], [36.0, -18.0], atol=0.01)  # gain 0.36
    wind = NavSolution(0, "tower/wind", wind_n=np.array([6.0, -3.0]), cov_wind=4.0 * np.eye(2))
    assert nav.aid("wind_uplink").process(wind, nav)
    np.testing.assert_allclose(nav.core.wind_n(), np.array([6.0, -3.0]) * 100.0 / 104.0, rtol=1e-6)
    assert nav.outage_words(10**10) == "; radar fix 10 s ago; wind from the ground 10 s ago"
    with pytest.raises(SettingsError, match="ins_gps cannot take the aid 'wind_uplink': it estimates no wind"):
        made(InsGps, aids=["gps", "wind_uplink"], wind_uplink={"topic": "tower/wind"})
    with pytest.raises(SettingsError, match="gnss_only cannot take the aid 'wind_uplink'"):
        made(GnssOnly, aids=["gnss", "wind_uplink"], wind_uplink={"topic": "tower/wind"})


def test_the_antenna_is_where_its_lever_arm_says():
    flight = straight(60.0, dt=0.1)
    shifted = list(flight.gps(np.random.default_rng(0), 10))
    navs = [made(gps={"lever_arm_b_m": lever}) for lever in ([0.0, 0.0, 0.0], [20.0, 0.0, 0.0])]
    lasts = [nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), shifted))[-1] for nav in navs]
    apart = ORIGIN.to_ned(lasts[0].lat, lasts[0].lon, lasts[0].height) - ORIGIN.to_ned(lasts[1].lat, lasts[1].lon, lasts[1].height)
    along = lasts[0].vel_n[:2] / np.linalg.norm(lasts[0].vel_n[:2])
    assert abs(apart[:2] @ along) == pytest.approx(20.0, abs=1.0)


def test_turbulence_of_older_recordings_is_met_along_the_way():
    settings = from_mapping(DeadReckoningSettings, {"wind.gust_tau_s": 5.0, "wind.tau_s": 400.0})
    assert (settings.wind.gust_distance_m, settings.wind.distance_km, settings.wind.tau_s) == (pytest.approx(231.5), 0.0, 400.0)
    assert settings.learn_s == settings.heading.bank_deg == 0.0


def test_a_restart_forgets_what_was_received_and_keeps_the_counters():
    stations = table(station_at("AAA", 40_000.0, 30_000.0))
    flight = turning(60.0)
    zero = {"AAA": np.zeros(len(flight))}
    stream = in_order(flight.attitudes(), flight.airspeeds(), flight.gps(np.random.default_rng(0), 10), flight.ranges(stations, zero, 150))
    nav = made(stations=stations)
    nav.feed_all(stream)
    fused = {aid.status.name: aid.status.fused for aid in nav.aids}
    assert fused["dme"] > 2 and nav.aid("dme").slots.index("AAA") is not None
    nav.reset("asked to")
    assert {aid.status.name: aid.status.fused for aid in nav.aids} == fused
    assert not nav.core.started and nav.aid("dme").slots.index("AAA") is None and not nav.gps_good(START_NS)
    again = made(stations=stations).feed_all(stream)
    anew = nav.feed_all(stream)
    assert [s.stamp_ns for s in anew] == [s.stamp_ns for s in again]
    assert all(np.array_equal(a.cov_pos, b.cov_pos) and a.lat == b.lat for a, b in zip(anew, again, strict=True))


def test_diagnostics_name_the_approach_it_allows():
    flight = straight(60.0)
    nav = made()
    nav.feed_all(in_order(flight.attitudes(), flight.airspeeds(), flight.gps(np.random.default_rng(0), 10)))
    assert {"position_horizontal_m", "position_down_m"} <= nav.status().sigmas.keys()  # what the category is made of
