"""What every simulator promises: its output does not depend on how the truth was cut, and a seed means the same numbers."""

from pathlib import Path

import numpy as np
import pytest
from sensors_truth import START_NS, cuts, flat, steady_truth

from lowcostnav_ros.base.seeds import stream
from lowcostnav_ros.base.settings import to_mapping
from lowcostnav_ros.catalogue.config_files import load_settings
from lowcostnav_ros.radionav.stations import stations_from_text
from lowcostnav_ros.sensors.airdata import AirDataSimulator, AirDataSimulatorSettings
from lowcostnav_ros.sensors.dme import DmeSimulator, DmeSimulatorSettings
from lowcostnav_ros.sensors.gps import GpsSimulator, GpsSimulatorSettings
from lowcostnav_ros.sensors.imu import ImuSimulator, ImuSimulatorSettings
from lowcostnav_ros.sensors.imu_profile import imu_profile_from_text
from lowcostnav_ros.sensors.magnetometer import MagnetometerSimulator, MagnetometerSimulatorSettings
from lowcostnav_ros.sensors.sampling import SampleClock
from lowcostnav_ros.sensors.vor import VorSimulator, VorSimulatorSettings

CONFIG = Path(__file__).parents[1] / "config"
CRISTA = imu_profile_from_text((CONFIG / "profiles/crista.yaml").read_text())
STATIONS = stations_from_text((CONFIG / "dme_stations_bay_area.csv").read_text())
EVERYTHING = {"misalignment": True, "g_sensitivity": True, "warm_up": True, "bandwidth": True}

MAKERS = {
    "imu": lambda seed: ImuSimulator(ImuSimulatorSettings(seed=seed, **EVERYTHING), CRISTA),
    "imu_slower_than_truth": lambda seed: ImuSimulator(ImuSimulatorSettings(seed=seed, rate_hz=20.0), CRISTA),
    "magnetometer": lambda seed: MagnetometerSimulator(MagnetometerSimulatorSettings(seed=seed, calibrated=False)),
    "air_data": lambda seed: AirDataSimulator(AirDataSimulatorSettings(seed=seed, vanes=True)),
    "gps": lambda seed: GpsSimulator(
        GpsSimulatorSettings(seed=seed, latency_s=0.13, horizontal_drift_m=3.0, dropout_probability=0.2, outages_s=[5.0, 8.0])
    ),
    "dme": lambda seed: DmeSimulator(DmeSimulatorSettings(seed=seed, scheme="scanning", interval_s=1.0), STATIONS),
    "vor": lambda seed: VorSimulator(
        VorSimulatorSettings(seed=seed, stations="OAK,SJC,ECA", dwell_s=6.0, latency_s=0.13, outages_s=[5.0, 8.0]), STATIONS
    ),
}
SETTINGS = {
    "imu": ImuSimulatorSettings,
    "magnetometer": MagnetometerSimulatorSettings,
    "air_data": AirDataSimulatorSettings,
    "gps": GpsSimulatorSettings,
    "dme": DmeSimulatorSettings,
    "vor": VorSimulatorSettings,
}


@pytest.mark.parametrize("name", MAKERS)
def test_cutting_changes_no_bit(name):
    truth = steady_truth(20.0)
    whole = flat(MAKERS[name](1).simulate(truth))
    for lengths in ([1], [7, 1, 13, 100], [0, 250]):
        simulator = MAKERS[name](1)
        assert flat([m for block in cuts(truth, lengths) for m in simulator.simulate(block)]) == whole
    assert len(whole) > 10


@pytest.mark.parametrize("name", MAKERS)
def test_a_seed_means_the_same_numbers_and_another_seed_others(name):
    truth = steady_truth(12.0)
    assert flat(MAKERS[name](3).simulate(truth)) == flat(MAKERS[name](3).simulate(truth))
    assert flat(MAKERS[name](3).simulate(truth)) != flat(MAKERS[name](4).simulate(truth))


def test_named_streams_are_independent():
    a, b = stream(1, "imu.gyro.noise").standard_normal(20_000), stream(1, "imu.accelerometer.noise").standard_normal(20_000)
    assert abs(np.corrcoef(a, b)[0, 1]) < 4.0 / np.sqrt(20_000)


@pytest.mark.parametrize(("rate_hz", "truth_hz", "expected"), [(20.0, 100, 200), (30.0, 100, 300), (100.0, 100, 1000), (1.0, 250, 10)])
def test_sample_clock_keeps_its_rate(rate_hz, truth_hz, expected):
    stamps_ns = START_NS + np.arange(10 * truth_hz) * (1_000_000_000 // truth_hz)
    rows = SampleClock(rate_hz).rows(stamps_ns)
    assert len(rows) == expected
    late_s = (stamps_ns[rows] - START_NS) * 1e-9 - np.arange(expected) / rate_hz
    assert late_s.min() > -1e-6 and late_s.max() < 1.0 / truth_hz


@pytest.mark.parametrize("name", SETTINGS)
def test_shipped_parameter_file_holds_exactly_the_defaults(name):
    text = (CONFIG / f"{name}_simulator.yaml").read_text()
    assert load_settings(SETTINGS[name], CONFIG / f"{name}_simulator.yaml") == SETTINGS[name]()
    assert all(f"{key}:" in text for key in to_mapping(SETTINGS[name]()))
