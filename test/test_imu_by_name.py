"""The filter's IMU numbers by name: in settings, in a node's parameters, in a simulated bag; what is typed beside the name stays."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from lowcostnav_ros.base.settings import SettingsError, from_mapping
from lowcostnav_ros.catalogue.building import build_navigators, complete_settings, make_navigator
from lowcostnav_ros.catalogue.config_files import load_settings, yaml_of
from lowcostnav_ros.catalogue.equipment import imu_profile_names, load_imu_profile
from lowcostnav_ros.catalogue.imu_by_name import profile_settings, with_imu_profile
from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.cores.imu_errors import ImuSettings, imu_settings
from lowcostnav_ros.graph.description import load_graph
from lowcostnav_ros.graph.wiring import flown_settings
from lowcostnav_ros.navigators.ins_gps import InsGps, InsGpsSettings
from lowcostnav_ros.navigators.registry import NAVIGATORS

CRISTA = imu_settings(load_imu_profile("crista").filter_noise())
REGISTRY = {"ins_gps": InsGps}


def named(**imu):
    return complete_settings(InsGpsSettings, {"imu": imu})


def test_a_name_brings_all_numbers_and_states_of_the_data_sheet():
    navigator = make_navigator(named(profile="crista"), InsGps)
    assert dataclasses.replace(navigator.settings.imu, profile="") == CRISTA
    assert "gyro_scale" in navigator.layout


def test_numbers_beside_the_name_stay_and_twice_is_once():
    once = with_imu_profile(named(profile="crista", gyro_noise_dps_rthz=0.2))
    assert once.imu.gyro_noise_dps_rthz == 0.2
    assert once.imu.accel_turn_on_mg == CRISTA.accel_turn_on_mg
    assert with_imu_profile(once) == once


def test_a_file_of_all_defaults_with_a_name_flies_on_the_name(tmp_path):
    (tmp_path / "ins_gps.yaml").write_text(yaml_of(InsGpsSettings, "ins_gps").replace("profile: ''", "profile: mems"))
    navigator = build_navigators(["ins_gps"], REGISTRY, tmp_path)["ins_gps"]
    assert navigator.settings.imu.gyro_turn_on_dps == pytest.approx(75.0 / 3600.0)


def test_without_a_name_nothing_changes():
    plain = InsGpsSettings()
    assert with_imu_profile(plain) is plain
    simulator = SimpleNamespace(imu=SimpleNamespace(profile="crista"))  # a scenario's section, not a filter's
    assert with_imu_profile(simulator) is simulator


def test_refusals_name_the_nearest_and_the_remedy(tmp_path):
    with pytest.raises(SettingsError, match="no IMU profile 'cristal'.*did you mean 'crista'"):
        make_navigator(named(profile="cristal"), InsGps)
    with pytest.raises(SettingsError, match="nowhere.yaml does not exist"):
        make_navigator(named(profile="nowhere.yaml"), InsGps)
    (tmp_path / "quiet.yaml").write_text("name: quiet\n")
    with pytest.raises(SettingsError, match="states no white noise"):
        make_navigator(named(profile=str(tmp_path / "quiet.yaml")), InsGps)


def test_calibrated_before_the_flight_leaves_no_turn_on_bias():
    imu = profile_settings("crista", turn_on_bias=False)
    assert (imu.gyro_turn_on_dps, imu.accel_turn_on_mg) == (0.0, 0.0)
    assert imu.gyro_bias_dps == CRISTA.gyro_bias_dps


def test_graphs_name_the_profile_and_their_recordings_carry_its_numbers():
    flown = flown_settings(load_graph("gnss_tight"))["ins_gnss"]
    assert "imu.profile" not in flown
    assert flown["imu.gyro_turn_on_dps"] == CRISTA.gyro_turn_on_dps


def test_a_simulated_flight_carries_the_numbers_of_its_imu(tmp_path, capsys):
    assert cli.main(["simulate", "gnss_ld", "--duration", "2", "-o", str(tmp_path / "bag")]) == 0
    assert load_settings(InsGpsSettings, tmp_path / "bag" / "settings" / "ins_gps.yaml", "ins_gps").imu == CRISTA
    carried = {p.stem for p in (tmp_path / "bag" / "settings").iterdir()}
    assert carried & set(NAVIGATORS.own()) == {"ahrs", "ins_gps", "ins_gnss", "pseudolite_ins"}
    text = "name: ideal\nsensors: [imu]\nimu: {profile: %s}\ntruth: {kind: dataset, name: STR}\n"
    (tmp_path / "ideal.yaml").write_text("name: ideal\n")
    (tmp_path / "scenario.yaml").write_text(text % (tmp_path / "ideal.yaml"))
    assert cli.main(["simulate", str(tmp_path / "scenario.yaml"), "--duration", "1", "-o", str(tmp_path / "quiet")]) == 0
    assert not (tmp_path / "quiet" / "settings").exists()


def test_a_node_tells_the_numbers_it_flies_with():
    pytest.importorskip("rclpy")
    import rclpy
    from rclpy.context import Context

    from lowcostnav_ros.ros.parameters import Parameters

    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("profile_test", context=context, automatically_declare_parameters_from_overrides=True)
    try:
        parameters = Parameters(node, [InsGpsSettings()], {"imu.profile": "crista"}, lambda settings: None, complete_settings)
        assert np.ravel(node.get_parameter("imu.gyro_turn_on_dps").value).tolist() == np.ravel(CRISTA.gyro_turn_on_dps).tolist()
        assert parameters.settings[0].imu.profile == "crista"
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_every_shipped_profile_makes_a_filter_that_can_be_written_and_read(tmp_path):
    for name in imu_profile_names():
        values = dataclasses.asdict(profile_settings(name))
        assert from_mapping(ImuSettings, yaml.safe_load(yaml.safe_dump(values)), name) == profile_settings(name)


def test_every_navigator_may_be_reset_before_it_has_started():
    for name, navigator in build_navigators(list(NAVIGATORS), NAVIGATORS, None).items():
        navigator.reset("time base jumped")  # as a first stamp that all others contradict does
        assert navigator.restarts["time base jumped"] == 1, name
