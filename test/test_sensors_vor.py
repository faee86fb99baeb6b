"""VOR simulator: tuning, error statistics, where it flags, outages."""

import math
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from sensors_truth import START_NS, steady_truth

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.physics.rotation import wrap
from lowcostnav_ros.radionav.stations import StationError, stations_from_text
from lowcostnav_ros.sensors.vor import VorSimulator, VorSimulatorSettings

STATIONS = stations_from_text((Path(__file__).parents[1] / "config/dme_stations_bay_area.csv").read_text())
QUIET = {"bias_deg": 0.0, "bend_deg": 0.0, "noise_deg": 0.001}


def radials(seconds=20.0, rate_hz=10, truth=None, **settings):
    truth = steady_truth(seconds, rate_hz) if truth is None else truth
    return VorSimulator(VorSimulatorSettings(**settings), STATIONS).simulate(truth), truth


def error_deg(reading, truth):
    row, s = int(np.searchsorted(truth.stamps_ns, reading.stamp_ns)), STATIONS[reading.station]
    azimuth, _, _ = pymap3d.geodetic2aer(truth.lat[row], truth.lon[row], truth.height[row], s.lat, s.lon, s.height, deg=False)
    return math.degrees(wrap(reading.bearing_rad + s.declination - azimuth))


def test_radials_count_from_the_stations_north_on_the_ellipsoid():
    readings, truth = radials(stations="OAK,SJC", **QUIET)
    assert {r.station for r in readings} == {"OAK", "SJC"}
    assert max(abs(error_deg(r, truth)) for r in readings) < 0.006
    assert all(0.0 <= r.bearing_rad < 2.0 * math.pi for r in readings)


def test_two_receivers_read_two_stations_at_the_rate_and_one_takes_them_in_turn():
    readings, _ = radials(stations="OAK,SJC", rate_hz=10)
    assert len(readings) == 2 * 20
    readings, _ = radials(30.0, stations="oak, SJC,ECA", receivers=1, dwell_s=10.0, settle_s=3.0)
    tuned = [(round((r.stamp_ns - START_NS) * 1e-9 - 0.1), r.station) for r in readings]
    assert tuned == [*[(t, "OAK") for t in range(10)], *[(t, "SJC") for t in range(13, 20)], *[(t, "ECA") for t in range(23, 30)]]


def test_the_nearest_stations_are_tuned_where_none_is_named_and_tuning_anew_leaves_no_gap():
    readings, _ = radials(25.0, dwell_s=10.0)
    assert len(readings) == 2 * 25
    assert {r.station for r in readings} == {"SJC", "OAK"}


def test_in_the_cone_and_beyond_the_volume_nothing_is_read():
    overhead = steady_truth(5.0, 10, lat_deg=37.7259, lon_deg=-122.2240, speed=0.1)
    readings, _ = radials(truth=overhead, stations="OAK,SJC", **QUIET)
    assert {r.station for r in readings} == {"SJC"}
    readings, _ = radials(stations="STS", receivers=1)  # 120 km
    assert readings == []


def test_error_is_one_degree_and_has_its_parts():
    flight = steady_truth(0.2, 10)
    errors = []
    for seed in range(800):
        readings, _ = radials(truth=flight, seed=seed, stations="OAK", receivers=1)
        errors.append(error_deg(readings[0], flight))
    assert np.std(errors) == pytest.approx(math.sqrt(0.6**2 + 0.75**2 + 0.3**2), rel=4.0 / math.sqrt(1600))
    assert abs(np.mean(errors)) < 4.0 / math.sqrt(800)
    assert math.degrees(math.sqrt(readings[0].variance)) == pytest.approx(1.0, abs=0.01)
    long, truth = radials(1200.0, 2, stations="OAK", receivers=1, bias_deg=0.0, noise_deg=0.001)
    errors = np.array([error_deg(r, truth) for r in long])
    assert np.corrcoef(errors[:-10], errors[10:])[0, 1] > 0.6  # 500 m apart of 3.7 km: 0.87
    assert abs(np.corrcoef(errors[:-400], errors[400:])[0, 1]) < 0.6  # 20 km apart, some 16 independent draws


def test_outages_and_latency():
    readings, _ = radials(10.0, stations="OAK", receivers=1, outages_s=[3.0, 6.0], latency_s=0.5)
    assert [round((r.stamp_ns - START_NS) * 1e-9 - 0.1) for r in readings] == [0, 1, 2, 6, 7, 8, 9]
    with pytest.raises(SettingsError, match="VOR: 'outages_s' needs pairs"):
        VorSimulatorSettings(outages_s=[3.0])


def test_a_station_without_vor_is_refused():
    with pytest.raises(StationError, match="NUQ is a TACAN; name one of kind VOR, VOR-DME, VORTAC"):
        VorSimulator(VorSimulatorSettings(stations="OAK,NUQ"), STATIONS)
