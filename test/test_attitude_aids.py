"""Sensors of the attitude reference in other navigators, and other sensors in the attitude reference, by their list alone."""

import numpy as np
import pytest
from ahrs_flights import DEG, Turn, settings

from lowcostnav_ros.base.measurements import GpsVelocity, MagneticField
from lowcostnav_ros.base.settings import SettingsError, from_mapping, to_mapping
from lowcostnav_ros.navigators.ahrs.navigator import Ahrs, AhrsSettings
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.rotation import quat_to_euler, wrap
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

SCENARIO = """
name: attitude
sensors: [imu, air_data, gps, gps_attitude, gnss]
truth:
  kind: segments
  rate_hz: 50
  duration_s: 90.0
  mission: [straight duration_s=600]
  start: {lat_deg: 37.69, lon_deg: -121.82, height_m: 1500.0, heading_deg: 250.0, airspeed_mps: 50.0}
  wind: {north_mps: 8.0, east_mps: -4.0}
imu: {profile: automotive, rate_hz: 50.0}
gps: {rate_hz: 2.0}
gnss: {rate_hz: 1.0}
"""


@pytest.fixture(scope="module")
def flight():
    return Simulation(scenario_from_text(SCENARIO)).whole()


def heading_at_end(navigator, flight):
    """Error of the heading and its sigma, deg."""
    truth, measurements = flight
    last = navigator.feed_all(measurements)[-1]
    true = quat_to_euler(truth.q_nb[np.searchsorted(truth.stamps_ns, last.stamp_ns)])[2]
    return abs(wrap(true - quat_to_euler(last.q_nb)[2])) / DEG, np.sqrt(last.cov_att[2, 2]) / DEG


@pytest.mark.parametrize(("cls", "aids"), [(InsGps, ["gps"]), (InsGnss, ["gps", "gnss"])])
def test_gps_attitude_gives_an_inertial_navigator_its_heading_in_straight_flight(cls, aids, flight):
    _, without_deg = heading_at_end(cls(from_mapping(cls.Settings, {"aids": aids})), flight)
    navigator = cls(from_mapping(cls.Settings, {"aids": [*aids, "gps_attitude"]}))
    error_deg, sigma_deg = heading_at_end(navigator, flight)
    assert navigator.aid("gps_attitude").status.fused > 100
    assert sigma_deg < 0.3 < 3.0 < without_deg
    assert error_deg < 4.0 * sigma_deg


def test_air_data_teaches_an_inertial_navigator_the_wind(flight):
    navigator = InsGps(from_mapping(InsGps.Settings, {"aids": ["gps", "gps_attitude", "airdata"]}))
    last = navigator.feed_all(flight[1])[-1]
    assert navigator.aid("airdata").status.fused > 80
    assert np.linalg.norm(last.wind_n - [8.0, -4.0]) < 4.0 * np.sqrt(np.trace(last.cov_wind))


def test_level_waits_for_a_host_that_measures_no_velocity(flight):
    navigator = InsGps(from_mapping(InsGps.Settings, {"aids": ["gps", "level"]}))
    navigator.feed_all(flight[1])
    status = navigator.aid("accelerometer_level").status
    assert status.fused == 0 and status.rejected["velocity is measured"] > 50


def test_the_slow_error_of_the_heading_has_the_name_it_has_everywhere():
    assert "magnetic_heading_bias_rad" in Ahrs(settings()).layout.labels
    assert Ahrs(settings()).feed_all(Turn().measurements(0.0, 5.0))[-1].states["magnetic_heading_bias_rad"][1] > 0.0


def test_a_magnetic_heading_without_a_slow_error_needs_no_state():
    navigator = Ahrs(settings(magnetic__bias_deg=0.0))
    assert navigator.feed_all(Turn().measurements(0.0, 5.0, ("gps", "mag")))
    assert "heading_bias" not in navigator.layout


def test_the_list_is_a_setting():
    bare = Ahrs(settings(aids=["gps", "level"]))
    assert list(bare.inputs) == ["imu/data_raw", "gps/fix", "gps/vel"]
    last = bare.feed_all(Turn(15.0).measurements(0.0, 30.0, ("gps",)))[-1]
    assert last.mode == "calibrating"
    assert set(last.states) == {f"{s}_bias_{a}_{u}" for s, u in (("accel", "mps2"), ("gyro", "radps")) for a in "xyz"}
    without = Ahrs(settings(aids=["level", "magnetic"]))
    without.feed_all(Turn().measurements(0.0, 10.0, ("mag",)))
    assert without.mode == "coasting" and "gps/vel" not in without.inputs
    values = to_mapping(without.settings)
    assert from_mapping(AhrsSettings, values) == without.settings and "airdata.noise_mps" not in values


def test_a_second_receiver_and_magnetometer_of_the_attitude_reference():
    navigator = Ahrs(settings(aids=["gps2", "magnetic", "magnetic2", "level"], gps2__timeout_s=1.0))
    items = []
    for m in Turn().measurements(0.0, 20.0, ("gps", "mag")):
        if isinstance(m, GpsVelocity):
            m = GpsVelocity(m.stamp_ns, "gps2/vel", m.vel_n, m.cov_n)
        items += [m] + ([MagneticField(m.stamp_ns, "imu2/mag", m.field_b, m.cov_b)] if isinstance(m, MagneticField) else [])
    navigator.feed_all(items)
    used = {aid.status.name: aid.status.fused for aid in navigator.aids}
    assert used["gps2_velocity"] > 30 and used["magnetic_heading"] > 20 and used["magnetic2_heading"] > 20
    assert navigator.mode == "calibrating"
    assert navigator.gps_good(navigator.core.t_ns) and not navigator.gps_good(navigator.core.t_ns + 1_200_000_000)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"aids": ["gps", "magnetic"]}, "ahrs cannot start without 'level'"),
        ({"aids": ["gps", "level"], "filter": "euler"}, "ahrs cannot start without 'gps_attitude'"),
        ({"aids": ["level"], "filter": "vector_matching"}, "ahrs cannot start without 'gps'"),
    ],
)
def test_what_a_filter_cannot_do_without_is_named(changes, sentence):
    with pytest.raises(SettingsError, match=sentence):
        Ahrs(settings(**changes))


def test_gps_attitude_listens_where_it_is_told_to():
    navigator = Ahrs(settings(filter="quaternion", gps_attitude__topics=["antennas/attitude"]))
    assert "antennas/attitude" in navigator.inputs and "gps/attitude" not in navigator.inputs
