"""Any aid in any navigator by configuration: what a core cannot serve is refused in a sentence, a second sensor is a name with a number."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, Pressure
from lowcostnav_ros.base.settings import SettingsError, from_mapping, to_mapping
from lowcostnav_ros.catalogue.equipment import load_stations
from lowcostnav_ros.navigators.gnss_only import GnssOnly
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

LOST_S = 60.0
SCENARIO = """
name: any
sensors: [imu, magnetometer, air_data, gps, dme, vor, gnss]
truth:
  kind: segments
  rate_hz: 50
  duration_s: 130.0
  mission: [straight duration_s=10, "s_turns count=2 by_deg=60 bank_deg=25", straight duration_s=600]
  start: {lat_deg: 37.69, lon_deg: -121.82, height_m: 1500.0, heading_deg: 250.0, airspeed_mps: 50.0}
imu: {profile: automotive, rate_hz: 50.0}
magnetometer: {rate_hz: 5.0}
air_data: {rate_hz: 5.0}
gps: {rate_hz: 2.0, outages_s: [[60.0, 1000.0]]}
dme: {scheme: one_receiver, interval_s: 15.0}
gnss: {rate_hz: 1.0}
"""


@pytest.fixture(scope="module")
def flight():
    return Simulation(scenario_from_text(SCENARIO)).whole()


def flown(navigator, flight):
    """Largest horizontal error, m, and the worst ratio to its sigma in the last half minute."""
    truth, measurements = flight
    errors, ratios = [], []
    for s in navigator.feed_all(measurements):
        row = int(np.searchsorted(truth.stamps_ns, s.stamp_ns))
        if row >= len(truth) or truth.stamps_ns[row] - truth.stamps_ns[0] < 100e9:
            continue
        error = difference_n(truth.lat[row], truth.lon[row], truth.height[row], s.lat, s.lon, s.height)
        errors.append(float(np.hypot(error[0], error[1])))
        ratios.append(errors[-1] / float(np.sqrt(s.cov_pos[0, 0] + s.cov_pos[1, 1])))
    return max(errors), max(ratios)


def made(cls, aids, flight=None, **values):
    given = {"aids": aids, "imu": {"profile": ""}, **values}
    settings = from_mapping(cls.Settings, {name: value for name, value in given.items() if name != "imu" or hasattr(cls.Settings(), "imu")})
    return cls(settings, load_stations("dme_stations_bay_area.csv"))


def test_dme_and_vor_hold_an_inertial_navigator_without_gps():
    """Four minutes: a range is good to 0.17 NM and its error lasts half a mile only, so ranges hold what has drifted further than that."""
    flight = Simulation(scenario_from_text(SCENARIO.replace("duration_s: 130.0", "duration_s: 300.0"))).whole()
    bare, _ = flown(made(InsGps, ["gps", "baro"]), flight)
    held = made(InsGps, ["gps", "baro", "dme", "vor"], vor={"enabled": True})
    error, ratio = flown(held, flight)
    assert held.aid("dme").status.fused >= 4 and held.aid("vor").status.fused >= 4
    assert error < 0.8 * bare and ratio < 4.0
    assert "DME" in held.reason and "VOR" in held.reason


def test_satellites_and_a_receivers_solution_in_one_filter(flight):
    navigator = made(InsGps, ["gps", "gnss"])
    error, _ = flown(navigator, flight)
    assert navigator.aid("gnss_range").status.fused > 100 and navigator.mode == "gps"
    assert error < 5.0


def second(flight):
    """The flight with a second receiver and a second barometer that reads 40 m high."""
    truth, measurements = flight
    out = []
    for m in measurements:
        out.append(m)
        if isinstance(m, GpsPosition | GpsVelocity):
            out.append(replace(m, source="gps2" + m.source[3:]))
        elif isinstance(m, Pressure) and m.source == "air/static_pressure":
            out.append(replace(m, source="air2/static_pressure", pressure_pa=m.pressure_pa - 430.0))
    return truth, out


def test_a_second_receiver_and_barometer_are_configuration(flight):
    navigator = made(InsGps, ["gps", "gps2", "baro", "baro2"], gps2={"lever_arm_b_m": [0.0, 0.0, 0.0]})
    assert set(navigator.inputs) >= {"gps2/fix", "gps2/vel", "air2/static_pressure"}
    flown(navigator, second(flight))
    names = {aid.status.name: aid.status.fused for aid in navigator.aids}
    assert names["gps2_position"] >= names["gps_position"] > 50 and names["gps2_velocity"] > 50
    assert names["baro2_height"] == names["baro_height"] > 100
    apart = navigator.core.estimate[navigator.layout["baro2_bias"]] - navigator.core.estimate[navigator.layout["baro_bias"]]
    assert apart[0] == pytest.approx(38.0, abs=6.0)


def test_topics_and_frames_of_a_sensor_are_settings():
    navigator = made(InsGps, ["gps", "baro2"], baro2={"topics": ["cabin/pressure"], "frames": ["cabin"]})
    assert "cabin/pressure" in navigator.inputs and navigator.frames["cabin/pressure"] == ("cabin",)
    with pytest.raises(SettingsError, match=r"'gps.topics' must name 2, in place of gps/fix, gps/vel; got 1"):
        made(InsGps, ["gps"], gps={"topics": ["a/fix"]})


@pytest.mark.parametrize(
    ("cls", "aids", "sentence"),
    [
        (GnssOnly, ["gnss", "airdata"], "gnss_only cannot take the aid 'airdata': it does not estimate an attitude with its error"),
        (GnssOnly, ["gnss", "radar"], "'aids' adds 'radar', but 'radar.topic' is empty"),
        (GnssOnly, ["gnss", "magnetic"], "gnss_only cannot take the aid 'magnetic'"),
        (InsGps, ["baro"], "ins_gps cannot start without 'gps'"),
        (InsGps, ["gps", "barro"], "did you mean 'baro'"),
        (InsGps, ["gps", "gps"], "names a sensor twice"),
        (InsGnss, ["gps", "vor"], "ins_gnss cannot start without 'gnss'"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(cls, aids, sentence):
    with pytest.raises(SettingsError, match=sentence):
        made(cls, aids)


def test_an_aid_that_is_added_to_the_list_is_on():
    assert not InsGps.Settings().vor.enabled and "vor/bearing" not in made(InsGps, ["gps", "vor"]).inputs  # of its own list: as shipped
    added = made(GnssOnly, ["gnss", "vor"])
    assert added.settings.vor.enabled and "vor/bearing" in added.inputs
    assert "vor2/bearing" in made(InsGps, ["gps", "vor", "vor2"]).inputs


def test_a_barometer_helps_satellites_alone(flight):
    navigator = made(GnssOnly, ["gnss", "baro"])
    navigator.feed_all(flight[1])
    assert navigator.aid("baro_height").status.fused > 50 and navigator.mode == "gps"


def test_settings_of_any_list_survive_pickling_and_a_round_trip():
    settings = from_mapping(InsGps.Settings, {"aids": ["gps", "baro2", "dme"], "baro2.sigma_m": 3.5})
    assert pickle.loads(pickle.dumps(settings)) == settings
    assert from_mapping(InsGps.Settings, to_mapping(settings)) == settings
    assert settings.baro2.sigma_m == 3.5 and not hasattr(settings, "vor")
