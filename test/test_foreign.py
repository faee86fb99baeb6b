"""Recordings of other systems: what they hold is named, and read under our names and frames when asked to."""

import numpy as np
import pytest

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.cli.main import main
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.bag_writer import BagError, BagWriter
from lowcostnav_ros.messages.foreign import mapped, offers, parse_maps
from lowcostnav_ros.messages.store import to_cdr

START_NS = 1_700_000_000_000_000_000
FORCE = np.array([0.0, 0.0, -9.8])


def write(path, topic, frame="imu_link", count=200):
    noise = np.random.default_rng(1).normal(0.0, 0.01, (count, 3))
    with BagWriter(path) as bag:
        for k in range(count):
            stamp = START_NS + 10_000_000 * k
            bag.write(topic, topics.IMU, stamp, to_cdr(encode.imu_raw(stamp, FORCE + noise[k], noise[k], frame)))
    return str(path)


def test_foreign_names_are_offered():
    fix, twist, imu = topics.NAV_SAT_FIX, topics.TWIST, topics.IMU
    assert offers({"fix": fix, "vel": twist, "imu/data": imu}) == {"fix": "gps/fix", "vel": "gps/vel", "imu/data": "imu/data_raw"}
    mavros = {"mavros/imu/data_raw": imu, "mavros/imu/mag": topics.MAGNETIC_FIELD, "mavros/global_position/raw/fix": fix}
    assert offers(mavros) == {"mavros/": "", "mavros/global_position/raw/fix": "gps/fix"}
    assert offers({"uav1/imu/data_raw": imu, "uav1/gps/fix": fix, "uav1/gps/vel": twist}) == {"uav1/": ""}
    assert offers({"imu/data_raw": imu, "ins_gps/fix": fix, "ins_gps/odometry": topics.ODOMETRY}) == {}
    assert offers({"ublox/fix": fix, "imu/data_raw": imu}) == {"ublox/fix": "gps/fix"}


def test_maps_rename_topics_and_drop_namespaces():
    maps = parse_maps(["/fix=gps/fix", "uav1/="])
    assert [mapped(t, maps) for t in ("/fix", "/uav1/imu/mag", "imu/mag")] == ["gps/fix", "imu/mag", "imu/mag"]
    for wrong in ("fix", "fix=", "=gps/fix"):
        with pytest.raises(SettingsError, match="must read 'recorded topic=our topic'"):
            parse_maps([wrong])


def test_a_mapped_recording_is_read_as_ours(tmp_path):
    path = write(tmp_path / "bag", "/uav1/imu/data_raw")
    with BagReader(path, maps={"uav1/": ""}) as reader:
        assert reader.types == {"imu/data_raw": topics.IMU}
        assert sum(len(block) for block in reader.measurements(["imu/data_raw"])) == 200
    with pytest.raises(BagError, match="no topic 'uav2/' to map"):
        BagReader(path, maps={"uav2/": ""})


@pytest.mark.parametrize("job", ["replay", "allan", "identify"])
def test_another_frame_is_named_with_the_option_that_accepts_it(tmp_path, capsys, job):
    path = write(tmp_path / "bag", "/imu/data_raw", "imu")
    assert main([job, path, *(["--navigators", "ahrs"] if job == "replay" else [])]) == 2
    said = capsys.readouterr().err
    assert "'wrong frame id' ('imu', expected base_link or imu_link; accept it with --frame imu)" in said
    if job == "identify":
        assert main([job, path, "--frame", "imu"]) == 0


@pytest.mark.parametrize("job", ["replay", "allan", "magcal"])
def test_other_names_are_listed_with_the_options_that_map_them(tmp_path, capsys, job):
    path = write(tmp_path / "bag", "/imu/data")
    assert main([job, path]) == 2
    said = capsys.readouterr().err
    assert ("imu/data" in said and "--map imu/data=imu/data_raw" in said) or job == "magcal"
    assert "Traceback" not in said
