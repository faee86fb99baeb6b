"""Conversion of recorded tables: units, frames, time bases and refusals on small files written here."""

import gzip
import struct

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.base.measurements import UNKNOWN_VARIANCE, ImuBlock
from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.convert import ConvertError, convert, load_profile
from lowcostnav_ros.convert.guess import guess
from lowcostnav_ros.convert.profile import profile_from
from lowcostnav_ros.convert.timebase import straight_line
from lowcostnav_ros.convert.units_by_name import UNITS
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.messages.topics import TOPICS

GPS = {
    "file": "gps.csv",
    "time": {"column": "t", "unit": "ms", "epoch_s": 1000},
    "topics": {
        "gps/fix": {
            "lat": {"column": "lat", "unit": "deg"},
            "lon": {"column": "lon", "unit": "deg"},
            "height": {"column": "alt", "unit": "ft"},
            "sigma": {"constants": [3, 4, 5], "unit": "m", "frame": "ENU"},
        },
        "gps/vel": {
            "velocity": {"columns": ["ve", "vn", "vu"], "unit": "kt", "frame": "ENU"},
            "sigma": {"constants": [1, 1, 1], "unit": "m/s", "frame": "NED"},
        },
    },
}
ROWS = "t,lat,lon,alt,ve,vn,vu\n0,45,-93,1000,36,18,2\n200,45,-93,oops,36,18,2\n400,45.1,-93,2000,0,0,0\n600,45\n400,45,-93,1,0,0,0\n"


def profile(*tables):
    return profile_from({"tables": list(tables)})


def converted(tmp_path, checked, name="bag"):
    report = convert(tmp_path, checked, tmp_path / name)
    with BagReader(tmp_path / name) as bag:
        measurements = list(bag.measurements())
        assert not bag.decoder.rejected
    return report, measurements


def test_units_frames_and_malformed_rows(tmp_path):
    (tmp_path / "gps.csv").write_text(ROWS)
    report, measurements = converted(tmp_path, profile(GPS))
    assert report.messages == {"gps/fix": 2, "gps/vel": 3}  # a height that is none costs the position, not the velocity
    assert report.malformed == {"gps.csv": [(3, "'alt' is not a number"), (5, "2 columns instead of 7")]}
    assert report.not_increasing == {"gps.csv": 1}
    assert "line 3: 'alt' is not a number" in str(report)
    fix, velocity = measurements[:2]
    assert (fix.stamp_ns, measurements[-1].stamp_ns) == (1_000_000_000_000, 1_000_400_000_000)
    np.testing.assert_allclose([fix.lat, fix.lon, fix.height], [np.pi / 4, -93 * np.pi / 180, 304.8], rtol=1e-15)
    np.testing.assert_allclose(np.diag(fix.cov_n), [16, 9, 25])
    np.testing.assert_allclose(velocity.vel_n, np.array([18, 36, -2]) * 0.514444444444444444, rtol=1e-14)


def test_a_column_of_radials_becomes_bearings_of_its_station(tmp_path):
    (tmp_path / "nav.csv").write_text("t,obs\n1,73\n2,-10\n")
    radial = {"radial": {"column": "obs", "unit": "deg"}, "sigma": {"constants": [1.0], "unit": "deg"}, "station": "OAK"}
    table = {"file": "nav.csv", "time": {"column": "t"}, "topics": {"vor/bearing": radial}}
    _, measurements = converted(tmp_path, profile(table))
    assert [(m.station, round(float(np.degrees(m.bearing_rad)), 9)) for m in measurements] == [("OAK", 73.0), ("OAK", 350.0)]
    np.testing.assert_allclose(np.degrees(np.sqrt(measurements[0].variance)), 1.0)


def test_mounting_turns_sensor_axes_into_body_axes(tmp_path):
    # upside down and backwards: what the sensor calls x is aft, y is right, z is up
    (tmp_path / "imu.txt").write_text("% a comment\n0.5 -0.1 0.2 1.0 -10 20 30\n0.51 -0.1 0.2 1.0 -10 20 30\n")
    table = {
        "file": "imu.txt",
        "delimiter": "whitespace",
        "columns": ["t", "ax", "ay", "az", "gx", "gy", "gz"],
        "time": {"column": "t", "offset_s": -0.125, "epoch_s": 1},
        "topics": {
            "imu/data_raw": {
                "force": {"columns": ["ax", "ay", "az"], "unit": "g", "frame": "FRD"},
                "rate": {"columns": ["gx", "gy", "gz"], "unit": "deg/s", "frame": "FRD"},
                "mounting_deg": [[180, 0, 180]],
            }
        },
    }
    _, (block,) = converted(tmp_path, profile(table))
    assert block.stamps_ns.tolist() == [1_375_000_000, 1_385_000_000]
    np.testing.assert_allclose(block.specific_force_b[0], np.array([0.1, 0.2, -1.0]) * 9.80665, atol=1e-14)
    np.testing.assert_allclose(block.angular_rate_b[0], np.radians([10, 20, -30]), atol=1e-15)


def tagged(tmp_path, delay_s):
    """100 Hz counter since power-up, 30 ppm slow, rows in bursts; returns the true times."""
    counter_ms = 5000 + 10 * np.arange(4000)
    true = 2.0 + (counter_ms - 5000) * 1e-3 * (1 + 3e-5)
    lines = [f"0.0,0.0,-1.0,0.0,0.0,0.0,{ms}" for ms in counter_ms]
    ends = np.cumsum([len(line) + 2 for line in lines])
    with gzip.open(tmp_path / "imu.csv.gz", "wt") as file:
        file.write("\n".join(lines) + "\n")  # CR LF when it was recorded, LF now
    arrival = np.ceil((true + delay_s(len(true))) / 0.015) * 15
    raw = b"TIMETAG".ljust(60, b"\0") + struct.pack("<IId", 77, 1_700_000_018, 0.25)
    (tmp_path / "imu.tag").write_bytes(raw + np.stack([arrival, ends], axis=1).astype("<u4").tobytes())
    return true


def test_counter_is_fitted_to_the_arrival_of_the_bytes(tmp_path):
    rng = np.random.default_rng(0)
    true = tagged(tmp_path, lambda n: np.where(rng.random(n) < 0.1, 0.3 * rng.random(n), 0.0))  # a tenth of the rows very late
    table = {
        "file": "imu.csv.gz",
        "columns": ["ax", "ay", "az", "gx", "gy", "gz", "ms"],
        "time": {"column": "ms", "unit": "ms", "tag_file": "imu.tag", "line_end_bytes": 2, "leap_seconds": 18},
        "topics": {
            "imu/data_raw": {
                "force": {"columns": ["ax", "ay", "az"], "unit": "g", "frame": "FRD"},
                "rate": {"columns": ["gx", "gy", "gz"], "unit": "deg/s", "frame": "FRD"},
            }
        },
    }
    _, blocks = converted(tmp_path, profile(table))
    stamps = np.concatenate([b.stamps_ns for b in blocks if isinstance(b, ImuBlock)])
    error = (stamps - 1_700_000_000_250_000_000) * 1e-9 - true
    assert 0.0 < error.mean() < 0.012  # arrival is seen on the next 15 ms tick
    assert np.ptp(error) < 0.003
    broken = table | {"time": table["time"] | {"line_end_bytes": 3}}
    with pytest.raises(ConvertError, match="line_end_bytes"):
        convert(tmp_path, profile(broken), tmp_path / "other")
    (tmp_path / "imu.tag").write_bytes(b"nothing")
    with pytest.raises(ConvertError, match="not a time tag file"):
        convert(tmp_path, profile(table), tmp_path / "other")


@settings(max_examples=25)
@given(st.floats(-1e-4, 1e-4), st.floats(-10, 10))
def test_straight_line_hardly_sees_late_rows(slope, level):
    x = np.arange(0.0, 100.0, 0.1)
    y = level + slope * x
    late = y.copy()
    late[::7] += 5.0
    # one row in seven too high moves the median of the other six sevenths by 10 s * (1/14) / (6/7) = 0.83 s of slope at most
    np.testing.assert_allclose(straight_line(x, late), y, atol=0.9e-4, rtol=0)


def test_written_date_and_keep_and_every(tmp_path):
    (tmp_path / "a.pos").write_text(
        "\n".join(f"2025/07/08 19:34:{20 + k / 4:06.3f} 40 -105 1600 {1 if k % 2 else 5}" for k in range(8)) + "\n2025/13/08 x 40 -105 1 1"
    )
    table = {
        "file": "a.pos",
        "delimiter": "whitespace",
        "columns": ["date", "time", "lat", "lon", "h", "Q"],
        "time": {"columns": ["date", "time"], "format": "%Y/%m/%d %H:%M:%S.%f", "leap_seconds": 18},
        "keep": {"Q": [1, 2]},
        "every": 2,
        "topics": {"gps/fix": GPS["topics"]["gps/fix"] | {"height": {"column": "h", "unit": "m"}}},
    }
    report, fixes = converted(tmp_path, profile(table))
    # 19:34:20.25 and .25 + 1.0 of GPS time are 18 s less in UTC; `date -u -d "2025-07-08 19:34:02" +%s` is 1752003242
    assert [f.stamp_ns for f in fixes] == [1_752_003_242_250_000_000, 1_752_003_243_250_000_000]
    assert report.skipped == {"a.pos": 6}
    assert report.malformed["a.pos"][0][0] == 9


def refused(change, where=()):
    content = yaml.safe_load(yaml.safe_dump({"tables": [GPS]}))
    target = content
    for key in where:
        target = target[key]
    target.update(change)
    with pytest.raises(ConvertError) as caught:
        profile_from(content, "p.yaml")
    return str(caught.value)


def test_profile_refusals_name_the_nearest():
    table = ("tables", 0)
    assert "unknown key 'descripton' (did you mean 'description'?)" in refused({"descripton": "x"})
    assert "unknown key 'delimeter' (did you mean 'delimiter'?)" in refused({"delimeter": ";"}, table)
    assert "'degrees' is not a unit of angle (did you mean 'deg'?)" in refused({"unit": "degrees"}, (*table, "topics", "gps/fix", "lat"))
    assert "'m' is not a unit of speed" in refused({"unit": "m"}, (*table, "topics", "gps/vel", "velocity"))
    assert "unknown frame 'EUN' (did you mean 'ENU'?)" in refused({"frame": "EUN"}, (*table, "topics", "gps/vel", "velocity"))
    assert "did you mean 'gps/fix'?" in refused({"gps/fixs": {}}, (*table, "topics"))
    assert "needs 3 columns, got 2" in refused({"columns": ["ve", "vn"]}, (*table, "topics", "gps/vel", "velocity"))
    assert "'every' must be a whole number" in refused({"every": 0}, table)
    assert "need a 'format'" in refused({"columns": ["a", "b"]}, (*table, "time"))
    assert "expected 1 number" in refused({"offset_s": "soon"}, (*table, "time"))


def test_data_refusals(tmp_path):
    with pytest.raises(ConvertError, match=r"has no gps\.csv; it holds nothing"):
        convert(tmp_path, profile(GPS), tmp_path / "bag")
    (tmp_path / "gps.csv").write_text("t,lat,lng,alt,ve,vn,vu\n")
    with pytest.raises(ConvertError, match=r"no column 'lon' \(did you mean 'lng'"):
        convert(tmp_path, profile(GPS), tmp_path / "bag")
    (tmp_path / "gps.csv").write_text("t,lat,lon,alt,ve,vn,vu\nx,1,2,3,4,5,6\n")
    with pytest.raises(ConvertError, match="no usable row; the first is line 2: 't' is not a number"):
        convert(tmp_path, profile(GPS), tmp_path / "bag")
    (tmp_path / "gps.csv").write_text("")
    with pytest.raises(ConvertError, match="is empty"):
        convert(tmp_path, profile(GPS), tmp_path / "bag")
    packed = gzip.compress(ROWS.encode() * 50)
    (tmp_path / "gps.csv.gz").write_bytes(packed[: len(packed) // 2])
    with pytest.raises(ConvertError, match="cannot be read to its end"):
        convert(tmp_path, profile(GPS | {"file": "gps.csv.gz"}), tmp_path / "bag")
    assert not (tmp_path / "bag").exists()


def test_shipped_profiles_are_sound():
    names = sorted(p.stem for p in (config_dir() / "convert").glob("*.yaml"))
    assert {"px4_flight", "road_drive", "road_walk"} <= set(names)
    for name in names:
        assert load_profile(name).description
    assert {q.dimension for kind in TOPICS.values() for q in kind.fields.values()} <= set(UNITS)


def test_the_shipped_profile_is_found_by_the_files_of_a_folder(tmp_path):
    from lowcostnav_ros.convert.profile import shipped_profile_for

    with pytest.raises(ConvertError, match="No shipped profile fits"):
        shipped_profile_for(tmp_path)
    for name in ("gps_5hz.csv", "airspeed_83hz.csv.gz", "attitude_86hz.csv.gz"):
        (tmp_path / name).touch()
    assert shipped_profile_for(tmp_path) == "px4_flight"
    with pytest.raises(ConvertError, match="does not exist"):
        shipped_profile_for(tmp_path / "nowhere")


def test_a_recording_carries_the_settings_of_its_vehicle_and_the_replay_uses_them(tmp_path):
    from lowcostnav_ros.catalogue.building import build_navigators
    from lowcostnav_ros.messages.bag import BagReader
    from lowcostnav_ros.navigators.registry import NAVIGATORS

    (tmp_path / "log.csv").write_text("t,lat,lon,h\n" + "".join(f"{t},37.0,-121.0,100.0\n" for t in range(1, 5)))
    profile = {
        "vehicle": "small_aircraft",
        "tables": [
            {
                "file": "log.csv",
                "time": {"column": "t", "unit": "s"},
                "topics": {
                    "gps/fix": {
                        "lat": {"column": "lat", "unit": "deg"},
                        "lon": {"column": "lon", "unit": "deg"},
                        "height": {"column": "h", "unit": "m"},
                        "sigma": {"constants": [2.0, 2.0, 5.0], "unit": "m", "frame": "NED"},
                    }
                },
            }
        ],
    }
    convert(tmp_path, profile_from(profile), tmp_path / "bag")
    with BagReader(tmp_path / "bag") as reader:
        carried = build_navigators(["dead_reckoning"], NAVIGATORS, None, reader.settings_folder)["dead_reckoning"]
    assert carried.settings.heading.bias_deg == 15.0
    assert build_navigators(["dead_reckoning"], NAVIGATORS, None)["dead_reckoning"].settings.heading.bias_deg != 15.0
    with pytest.raises(ConvertError, match="did you mean 'small_aircraft'"):
        profile_from({**profile, "vehicle": "smal_aircraft"})


WIDE = "t,ax,ay,az,gx,gy,gz,lat,lon,alt,gs,trk,ias,p\n"


def wide_rows():
    """A usual logger: inertial data in every row, GPS in each tenth."""
    for k in range(100):
        gps = "37.69,-121.8,1000,95,90,90,954.6" if k % 10 == 0 else ",,,,,,"
        yield f"{0.02 * k:.2f},0,0,-1,1.0,0,0,{gps}\n"


def test_a_wide_table_keeps_the_rows_of_each_topic(tmp_path):
    (tmp_path / "log.csv").write_text(WIDE + "".join(wide_rows()))
    (tmp_path / "log.yaml").write_text(guess(tmp_path / "log.csv"))
    report, measurements = converted(tmp_path, load_profile(tmp_path / "log.yaml"))
    expected = {"gps/fix": 10, "gps/vel": 10, "air/velocity": 10, "air/static_pressure": 10, "imu/data_raw": 100}
    assert report.messages == expected and not report.malformed
    fix = next(one for one in measurements if one.source == "gps/fix")
    assert abs(fix.height - (1000.0 - 32.0)) < 2.0  # above the sea, raised by the geoid
    velocity = next(one for one in measurements if one.source == "gps/vel")
    np.testing.assert_allclose(velocity.vel_n, [0.0, 95.0, 0.0], atol=1e-9)
    assert velocity.cov_n[2, 2] >= UNKNOWN_VARIANCE
    air = next(one for one in measurements if one.source == "air/velocity")
    assert 1.02 < air.vel_b[0] / 90.0 < 1.05
    block = next(one for one in measurements if isinstance(one, ImuBlock))
    np.testing.assert_allclose(block.specific_force_b[0], [0.0, 0.0, -9.80665])


def test_a_guess_says_why_and_refuses_what_it_cannot_read(tmp_path):
    (tmp_path / "log.csv").write_text(WIDE + "".join(wide_rows()))
    text = guess(tmp_path / "log.csv")
    assert "gravity is 1 g along az, which is negative: z down" in text and "hPa} # by its size" in text
    (tmp_path / "none.csv").write_text("a1,b1\n1,2\n3,4\n")
    with pytest.raises(ConvertError, match="none of its columns is recognised"):
        guess(tmp_path / "none.csv")
    (tmp_path / "bare.csv").write_text("1,2\n3,4\n")
    with pytest.raises(ConvertError, match="no line of column names"):
        guess(tmp_path / "bare.csv")


def test_fields_that_stand_for_others_are_all_or_nothing():
    table = {"file": "a.csv", "time": {"column": "t"}, "topics": {"gps/vel": {"speed": {"column": "s", "unit": "kt"}}}}
    with pytest.raises(ConvertError, match="'velocity' is missing"):
        profile(table)
