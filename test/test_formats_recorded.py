"""Small real files of every format, read and compared with what is known of them."""

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from lowcostnav_ros.convert.profile import ConvertError
from lowcostnav_ros.convert.recognise import Options, convert_log, recognise
from lowcostnav_ros.convert.rinex_files import read_navigation, read_observations
from lowcostnav_ros.convert.ros_bags import convert_bag
from lowcostnav_ros.formats import dataflash, flight_tables, igc, ubx, ulog
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.physics.earth import LocalFrame, difference_n
from lowcostnav_ros.physics.rotation import quats_to_euler

pytestmark = pytest.mark.data

DATA = Path(os.environ.get("LOWCOSTNAV_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")


def sample(name):
    path = DATA / "samples" / name
    if not path.is_file():
        pytest.skip(f"The sample {name} is not here; set LOWCOSTNAV_DATA to the folder that holds samples/.")
    return path


@pytest.mark.parametrize(
    ("name", "form"),
    [
        ("igc/glider_4h_tas_heading.igc", "IGC flight recorder"),
        ("g1000_csv/cessna_t182t_takeoff.csv", "recording of avionics or a simulator"),
        ("ulog/sitl_groundtruth_28s.ulg.gz", "PX4 ULog"),
        ("dataflash/arduplane_2s.BIN", "ArduPilot dataflash"),
        ("tlog/arduplane_vtol_sitl_gpl.tlog.gz", "MAVLink"),
        ("nmea/walk_1730.nmea", "NMEA 0183"),
        ("ubx/pyubx2_NAV.log", "u-blox"),
        ("gpsd/ublox-neo-m8u-hnr.log", "u-blox"),
        ("gpsd/nmea-rtk.log", "NMEA 0183"),
    ],
)
def test_a_format_is_told_by_the_bytes_of_the_file(name, form):
    assert recognise(sample(name)).name == form


def test_ephemerides_and_raw_measurements_are_those_of_the_publishers_conversion():
    class Raw(ubx.UbloxParser):
        epochs = {}

        def _rawx(self, payload):
            count = payload[11]
            yield from super()._rawx(payload)
            if self._near_gps and count:
                self.epochs[self._near_gps] = ubx.raw_epoch(self._near_gps, np.frombuffer(payload, ubx._SIGNAL, count, 16))

    parser = Raw()
    parser.is_locating = False
    data = gzip.decompress(sample("ubx/static_coldstart_16db.ubx.gz").read_bytes())
    list(parser.feed(data))
    theirs = read_navigation([sample("ubx/static_coldstart_16db.nav.gz")]).store
    known = {(one.system, one.sat_id, one.toe_ns): one for one in theirs}
    compared = 0
    for one in parser.navigation.store:
        other = known.get((one.system, one.sat_id, one.toe_ns))
        if other is None:
            continue
        compared += 1
        elements = "toc_ns", "sqrt_a", "eccentricity", "mean_anomaly", "node", "inclination", "perigee", "node_rate", "crs", "cuc", "cic"
        for name in (*elements, "af0", "af1"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-11, atol=1e-30, err_msg=name)
        np.testing.assert_allclose([one.group_delay_s, one.inclination_rate], [other.group_delay_s, other.inclination_rate], rtol=1e-9)
    assert compared >= 10
    observed = {epoch.gps_ns: epoch for epoch in read_observations(sample("ubx/static_coldstart_16db.obs.gz")).epochs}
    shared = 0
    for gps_ns, epoch in parser.epochs.items():
        other = observed.get(round(gps_ns / 1e6) * 10**6)
        if other is None or not len(epoch):
            continue
        row = {satellite: k for k, satellite in enumerate(other.satellites())}
        for k, satellite in enumerate(epoch.satellites()):
            if satellite in row:
                shared += 1
                assert abs(epoch.pseudorange_m[k] - other.pseudorange_m[row[satellite]]) < 1e-3
                assert abs(epoch.doppler_mps[k] - other.doppler_mps[row[satellite]]) < 1e-3
    assert shared > 2000


def test_a_px4_log_is_what_its_tables_say():
    log = ulog.read(sample("ulog/fixed_wing_120s_rebuilt.ulg.gz"))
    series = {one.topic: one for one in log.series}
    assert {topic: len(one.stamps_ns) for topic, one in series.items()} == {
        "air/velocity": 9868, "gps/fix": 591, "gps/vel": 591, "imu/data": 10692, "imu/data_fused": 10692, "autopilot": 1166,
    }  # fmt: skip
    fix, own = series["gps/fix"].fields, series["autopilot"]
    row = np.searchsorted(series["gps/fix"].stamps_ns, own.stamps_ns).clip(0, 590)
    first = LocalFrame(fix["lat"][0], fix["lon"][0], fix["height"][0])
    off = [
        difference_n(own.fields["lat"][k], own.fields["lon"][k], own.fields["height"][k], fix["lat"][r], fix["lon"][r], fix["height"][r])
        for k, r in enumerate(row)
    ]
    assert first.lat > 0.78 and np.median(np.linalg.norm(off, axis=1)) < 8.0  # 15 m/s, 0.2 s between fixes


def test_a_dataflash_log_as_text_gives_what_the_binary_one_does(tmp_path):
    binary = dataflash.read(sample("dataflash/arduplane_2s.BIN"))
    text = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns", "FMT, 129, 31, IMU, Qffffff, TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"]
    imu = next(one for one in binary.series if one.topic == "imu/data_raw")
    offset = imu.stamps_ns[0]
    for k in range(5):
        cells = [(imu.stamps_ns[k] - offset) // 1000 + 1, *imu.fields["rate"][k], *imu.fields["force"][k]]
        text.append("IMU, " + ", ".join(map(repr, map(float, cells))))
    (tmp_path / "a.log").write_text("\n".join(text))
    again = dataflash.read(tmp_path / "a.log").series[0]
    np.testing.assert_array_equal(again.fields["force"], imu.fields["force"][:5])
    np.testing.assert_allclose(np.diff(again.stamps_ns), np.diff(imu.stamps_ns[:5]), atol=1000)


def test_a_damaged_log_is_read_as_far_as_it_is_whole(tmp_path):
    raw = bytearray(gzip.decompress(sample("dataflash/arducopter_51s.bin.gz").read_bytes()))
    raw[300_000:300_050] = bytes(50)
    (tmp_path / "cut.bin").write_bytes(raw[:600_011])
    log = dataflash.read(tmp_path / "cut.bin")
    assert "bytes belong to no message" in log.account.remarks[0]
    assert len(next(one for one in log.series if one.topic == "imu/data_raw").stamps_ns) > 900


def test_the_raw_satellites_of_a_receiver_fly_a_navigator(tmp_path):
    path = tmp_path / "part.ubx"
    path.write_bytes(gzip.decompress(sample("ubx/walk_1730_rawx_sfrbx_pvt_nmea.ubx.gz").read_bytes())[:400_000])
    summary = convert_log(path, recognise(path), tmp_path / "bag")
    assert summary.messages["gnss/raw"] > 100 and "RXM-RAWX" in str(summary)
    with BagReader(tmp_path / "bag") as bag:
        epochs = list(bag.measurements(["gnss/raw"]))
        assert not bag.decoder.rejected and np.median([int(one.range_valid.sum()) for one in epochs]) >= 5


def test_a_glider_flies_over_midnight_and_knows_its_heading():
    log = igc.read(sample("igc/glider_4h_tas_heading.igc"))
    series = {one.topic: one for one in log.series}
    fix, air, attitude = series["gps/fix"], series["air/velocity"], series["imu/data_fused"]
    assert 15_600e9 < fix.stamps_ns[-1] - fix.stamps_ns[0] < 15_650e9  # recorded at 23:48, over midnight
    assert 20.0 < np.median(air.fields["tas"]) < 60.0
    # wind = ground speed - air speed along the heading: from the west at 6 m/s, as the publisher's data give it
    rows = np.searchsorted(series["gps/vel"].stamps_ns, air.stamps_ns)
    at = np.searchsorted(attitude.stamps_ns, air.stamps_ns).clip(0, len(attitude.stamps_ns) - 1)
    yaw = quats_to_euler(attitude.fields["quaternion"])[at, 2]
    north, east = (air.fields["tas"] * f(yaw) for f in (np.cos, np.sin))
    wind = series["gps/vel"].fields["velocity"][rows][:, :2] - np.stack([north, east], axis=1)
    np.testing.assert_allclose(np.median(wind, axis=0), [0.3, 6.2], atol=1.5)


def test_a_garmin_recording_counts_heading_and_track_from_magnetic_north():
    log = flight_tables.read(sample("g1000_csv/cessna_t182t_takeoff.csv"))
    series = {one.topic: one for one in log.series}
    fix, vel = series["gps/fix"], series["gps/vel"]
    north, east = np.diff(fix.fields["lat"]) * 6.36e6, np.diff(fix.fields["lon"]) * 6.38e6 * np.cos(fix.fields["lat"][0])
    fast = np.hypot(north, east) > 40.0
    between = (fix.stamps_ns[1:] + fix.stamps_ns[:-1]) // 2
    v_north, v_east = (np.interp(between, vel.stamps_ns, vel.fields["velocity"][:, axis]) for axis in (0, 1))
    off = np.arctan2(east, north) - np.arctan2(v_east, v_north)
    assert abs(np.degrees(np.median(np.angle(np.exp(1j * off[fast]))))) < 2.0
    assert 40.0 < np.median(series["air/velocity"].fields["tas"]) < 55.0


def test_a_bag_of_ros_1_keeps_its_numbers(tmp_path):
    summary = convert_bag(sample("ros1bag/husky_imu_fix_odom.bag"), tmp_path / "bag")
    assert summary.messages == {"gps/fix": 989, "imu/data_raw": 11865} and "husky_velocity_controller/odom" in str(summary)
    with BagReader(tmp_path / "bag") as bag:
        force = np.concatenate([one.specific_force_b for one in bag.measurements(["imu/data_raw"])])
    np.testing.assert_allclose(np.median(force, axis=0), [0.0, -9.8, 0.0], atol=0.5)
    assert "--mounting=90,0,0" in str(summary)  # its sensor lies on its side, which is told from gravity


def test_a_turned_sensor_is_turned_back(tmp_path):
    path = sample("ulog/sample_multicopter_68s.ulg.gz")
    summary = convert_log(path, recognise(path), tmp_path / "bag", Options(mounting_deg=(180.0, 0.0, 0.0)))
    assert "--mounting=180,0,0" in str(summary)  # it was level before


def test_a_bag_of_another_system_is_refused_or_mapped(tmp_path):
    (tmp_path / "r.db3").write_bytes(gzip.decompress(sample("rosbag2_sqlite/plotjuggler_imu/rosbag2_test_0.db3.gz").read_bytes()))
    with pytest.raises(ConvertError, match="1565 x imu/data_raw: angular rate implausible"):
        convert_bag(tmp_path / "r.db3", tmp_path / "bag")
    with pytest.raises(ConvertError, match="has no topic 'inu' to map; did you mean 'imu'|has no topic 'inu' to map"):
        convert_bag(tmp_path / "r.db3", tmp_path / "bag", {"inu": "imu/data_raw"})
