"""Whole simulated flights: scenarios are checked, repeatable, and carry what they promise."""

import itertools
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from sensors_truth import flat

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.catalogue.equipment import load_imu_profile, load_stations
from lowcostnav_ros.physics.geomagnetism import decimal_year
from lowcostnav_ros.simulation.equipment import build
from lowcostnav_ros.simulation.scenario import scenario_from_text
from lowcostnav_ros.simulation.simulator import Simulation

SCENARIOS = sorted((Path(__file__).parents[1] / "config/scenarios").glob("*.yaml"))
SHORT = """
name: short
seed: 7
truth: {kind: segments, name: straight, duration_s: 40.0, start: {height_m: 1200.0}}
gps: {latency_s: 0.25, outages_s: [[10.0, 20.0]]}
"""


def fly(text, seconds, block_s=1.0, **changes):
    blocks = Simulation(scenario_from_text(text, **changes)).blocks(block_s)
    return list(itertools.islice(blocks, round(seconds / block_s)))


def by_source(flown):
    out = {}
    for m in (m for _, measurements in flown for m in measurements):
        out.setdefault(m.source, []).append(m)
    return out


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda p: p.stem)
def test_shipped_scenarios_are_accepted_and_their_equipment_exists(path):
    scenario = scenario_from_text(path.read_text(), path.name)
    assert scenario.name == path.stem
    for name in scenario.sensors:
        assert hasattr(build(name, getattr(scenario, name)), "simulate")


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda p: p.stem)
def test_shipped_scenarios_fly_and_every_sensor_speaks(path):
    flown = fly(path.read_text(), 6.0)
    truth, spoken = [t for t, _ in flown], by_source(flown)
    assert sum(len(t) for t in truth) >= 290
    wanted = {"imu": "imu/data_raw", "magnetometer": "imu/mag", "air_data": "air/velocity"}
    wanted |= {"gps": "gps/fix", "dme": "dme/range", "gnss": "gnss/raw", "vor": "vor/bearing"}
    wanted |= {"pseudolite": "pseudolite/raw", "ranging": "ranging/range"}
    scenario = scenario_from_text(path.read_text(), path.name)
    assert {wanted[name] for name in scenario.sensors} <= spoken.keys()
    assert all(np.isfinite(b.specific_force_b).all() and np.isfinite(b.angular_rate_b).all() for b in spoken["imu/data_raw"])
    assert all(np.isfinite(t.vel_n).all() for t in truth)


def test_the_promised_scenarios_are_shipped():
    promised = {"livermore", "livermore_long", "turns", "ld", "hd", "str", "ld_gentle", "gnss_ld", "gnss_hd", "gnss_canyon"}
    assert promised <= {p.stem for p in SCENARIOS}


def test_every_sensor_reports_at_its_rate_and_the_outage_is_where_it_was_asked():
    flown = by_source(fly(SHORT, 40.0))
    assert sum(len(b) for b in flown["imu/data_raw"]) == 4000
    assert len(flown["imu/mag"]) == 800 and len(flown["air/velocity"]) == len(flown["air/static_pressure"]) == 400
    assert len(flown["dme/range"]) == 3  # replies at 5, 20 and 35 s
    assert len(flown["gps/vel"]) == 5 * 30 - 1  # ten seconds of outage; the last epoch is still on its way
    start_ns = flown["imu/data_raw"][0].stamps_ns[0]
    elapsed_s = np.array([m.stamp_ns - start_ns for m in flown["gps/fix"]]) * 1e-9
    assert not np.any((elapsed_s >= 10.0) & (elapsed_s < 20.0))


def test_block_length_changes_no_bit_and_stamps_are_in_order():
    one = by_source(fly(SHORT, 12.0))
    other = by_source(fly(SHORT, 12.0, block_s=0.4))
    assert {s: flat(m) for s, m in one.items()} == {s: flat(m) for s, m in other.items()}
    for _, measurements in fly(SHORT, 5.0):
        stamps_ns = [m.stamp_ns for m in measurements]
        assert stamps_ns == sorted(stamps_ns)


def test_a_seed_is_a_flight():
    assert flat(by_source(fly(SHORT, 6.0))["gps/fix"]) == flat(by_source(fly(SHORT, 6.0, seed=7))["gps/fix"])
    assert flat(by_source(fly(SHORT, 6.0))["gps/fix"]) != flat(by_source(fly(SHORT, 6.0, seed=8))["gps/fix"])


def test_sections_inherit_seed_and_date_unless_they_give_their_own():
    scenario = scenario_from_text(SHORT + "dme: {seed: 99}\n")
    assert (scenario.imu.seed, scenario.dme.seed) == (7, 99)
    assert scenario.magnetometer.decimal_year == pytest.approx(2026.414, abs=2e-3)  # the flight starts on 1 June 2026
    assert scenario.gps.outages_s == [10.0, 20.0]


def test_changes_replace_what_the_text_says():
    scenario = scenario_from_text(SHORT, seed=3, **{"truth.duration_s": 5.0, "dme.seed": 4, "gps.rate_hz": 2.0})
    assert (scenario.seed, scenario.imu.seed, scenario.dme.seed) == (3, 3, 4)
    assert (scenario.truth.duration_s, scenario.truth.name, scenario.gps.rate_hz, scenario.gps.latency_s) == (5.0, "straight", 2.0, 0.25)


def test_decimal_year_of_known_moments():
    assert decimal_year(datetime.fromtimestamp(0.0, UTC)) == 1970.0
    assert decimal_year(datetime.fromtimestamp(1_719_878_400.0, UTC)) == pytest.approx(2024.5, abs=1e-9)  # the middle of a leap year


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "begin with 'name:'"),
        ("name: [", "not valid YAML"),
        ("nmae: x", "unknown setting 'nmae' (did you mean 'name'?)"),
        ("imu: {rat_hz: 50}", "unknown setting 'imu.rat_hz' (did you mean 'imu.rate_hz'?)"),
        ("imu: 3", "section 'imu' must hold names and values"),
        ("imu: {rate_hz: 33}", "imu.rate_hz of 33 must divide truth.rate_hz of 100"),
        ("gps: {rate_hz: 20}\ntruth: {rate_hz: 10}\nimu: {rate_hz: 10}", "magnetometer.rate_hz of 20 is above truth.rate_hz of 10"),
        ("gps: {outages_s: [[1, 2], [3]]}", "add the missing end"),
        ("sensors: [imu, radar]", "there is no sensor 'radar'"),
        ("sensors: [imu, imu]", "a sensor is listed twice"),
        ("seed: -1", "must be at least 0"),
    ],
)
def test_refusals(text, sentence):
    with pytest.raises(SettingsError) as refusal:
        scenario_from_text(text)
    assert sentence in str(refusal.value)


def test_missing_equipment_names_what_there_is():
    with pytest.raises(SettingsError, match="crista"):
        load_imu_profile("cristal")
    with pytest.raises(SettingsError, match="does not exist"):
        load_stations("nowhere.csv")
    with pytest.raises(SettingsError, match="no sensor 'radar'"):
        build("radar", None)
