"""Text recordings of simulators, written here: units, names of columns, times."""

import numpy as np
import pytest

from lowcostnav_ros.convert.recognise import convert_log, recognise
from lowcostnav_ros.formats import flight_tables, igc
from lowcostnav_ros.formats.air import is_reading
from lowcostnav_ros.formats.log import FormatError
from lowcostnav_ros.formats.velocity_lag import taken_back, velocity_lag

XPLANE = """
   _real,_time |   _totl,_time |   Vind,_kias |   Vtrue,_ktas |   Vtrue,_ktgs |  __VVI,__fpm |
   pitch,__deg |   _roll,__deg |   hding,_true |   hpath,__deg |   __lat,__deg |   __lon,__deg |   __alt,ftmsl |
"""


def xplane():
    header = XPLANE.strip("\n").replace("\n", "")
    speeds = "95.0 | 100.0 | 110.0 | 600.0 | 5.0 | 0.0 | 90.0 | 90.0"
    rows = [f" {10 + k:.3f} | {10 + k:.3f} | {speeds} | 37.69 | {-121.8 + 0.0006 * k:.5f} | 1000.0 |" for k in range(20)]
    return "\n" + header + "\n" + "\n".join(rows) + "\n"


FLIGHTGEAR = (
    "Time,/position/latitude-deg,/position/longitude-deg,/position/altitude-ft,/velocities/airspeed-kt,/orientation/heading-deg,"
    "/orientation/pitch-deg,/orientation/roll-deg,/velocities/speed-north-fps,/velocities/speed-east-fps\n"
)


def test_xplane(tmp_path):
    (tmp_path / "Data.txt").write_text(xplane())
    path = tmp_path / "Data.txt"
    summary = convert_log(path, recognise(path), tmp_path / "bag")
    assert summary.format == "X-Plane Data.txt" and summary.messages["gps/fix"] == 20
    series = {one.topic: one.fields for one in flight_tables.read(path).series}
    np.testing.assert_allclose(series["gps/vel"]["velocity"][0], [0.0, 110 * 1852 / 3600, -600 * 0.3048 / 60], atol=1e-9)
    np.testing.assert_allclose(series["air/velocity"]["tas"][0], 100 * 1852 / 3600)
    assert abs(series["gps/fix"]["height"][0] - (304.8 - 32.0)) < 2.0  # the geoid is 32 m below the ellipsoid there


def test_flightgear(tmp_path):
    rows = [f"{0.5 * k},37.69,{-121.8 + 1e-4 * k},1000,95,90,5,0,0,150" for k in range(20)]
    (tmp_path / "fg.csv").write_text(FLIGHTGEAR + "\n".join(rows))
    log = flight_tables.read(tmp_path / "fg.csv")
    series = {one.topic: one for one in log.series}
    assert log.format == "FlightGear log" and np.all(np.diff(series["gps/fix"].stamps_ns) == 5 * 10**8)
    np.testing.assert_allclose(series["gps/vel"].fields["velocity"][0], [0.0, 45.72, 0.0])


def test_an_igc_flight_without_a_date_or_fix_is_refused(tmp_path):
    (tmp_path / "a.igc").write_text("AXXX001\nB1200004500000N00700000EA0100001100\n")
    with pytest.raises(FormatError, match="states no date"):
        igc.read(tmp_path / "a.igc")
    (tmp_path / "b.igc").write_text("AXXX001\nHFDTE010825\nHFFXA035\n")
    with pytest.raises(FormatError, match="holds no fix"):
        igc.read(tmp_path / "b.igc")


def test_an_igc_flight_without_a_recorded_speed_gets_it_from_its_fixes(tmp_path):
    lines = [f"B1200{k:02d}4500{6 * k:03d}N00700000EA0100001100" for k in range(30)]
    (tmp_path / "a.igc").write_text("AXXX001\nHFDTE010825\n" + "\n".join(lines))
    log = igc.read(tmp_path / "a.igc")
    velocity = next(one for one in log.series if one.topic == "gps/vel").fields["velocity"]
    np.testing.assert_allclose(velocity[:, 0], 6e-3 / 60 * np.pi / 180 * 6.37e6, rtol=1e-3)
    assert "velocity is made of successive fixes" in log.account.remarks[0]


def turns(rng, lag_s, n=300):
    """Stamps, latitudes, longitudes and velocities (n, 3) once a second in turns at 45 m/s, the velocity of ``lag_s`` ago."""
    t = np.arange(float(n))
    course = lambda s: np.sin(s / 15.0)  # noqa: E731
    fine = np.arange(0.0, n, 0.01)
    way = np.cumsum(0.45 * np.stack([np.cos(course(fine)), np.sin(course(fine))]), axis=1)[:, ::100] + rng.normal(0.0, 0.4, (2, n))
    velocity = 45.0 * np.stack([np.cos(course(t - lag_s)), np.sin(course(t - lag_s)), 0.0 * t], axis=1) + rng.normal(0.0, 0.1, (n, 3))
    return (t * 1e9).astype(np.int64), 0.7 + way[0] / 6.362e6, -2.0 + way[1] / 6.387e6 / np.cos(0.7), velocity


@pytest.mark.parametrize("lag_s", [0.0, 0.5, 1.2])
def test_a_velocity_that_is_late_is_known_by_the_fixes_and_taken_back(lag_s):
    rng = np.random.default_rng(3)
    scores = []
    for _ in range(10):
        lag, sigma = velocity_lag(*(flown := turns(rng, lag_s))[:3], flown[3][:, :2])
        scores.append((lag - lag_s) / sigma)
        assert sigma < 0.05
    assert np.sqrt(np.mean(np.square(scores))) < 2.0
    stamps, velocity, words = taken_back(*flown)
    prompt = turns(np.random.default_rng(0), 0.0)[3][: len(stamps)]
    assert np.std(velocity - prompt) < 0.4 and (words == "") == (lag_s == 0.0)
    assert len(stamps) == len(flown[0]) - (2 if lag_s > 1.0 else 1 if lag_s else 0)


def test_a_velocity_in_straight_flight_or_of_few_rows_is_left_alone():
    stamps, lat, lon, velocity = turns(np.random.default_rng(1), 0.5)
    assert taken_back(stamps[:15], lat[:15], lon[:15], velocity[:15])[2] == ""
    assert taken_back(stamps, lat, lon, np.full_like(velocity, np.nan))[2] == ""
    steady = np.tile([30.0, 0.0, 0.0], (300, 1))
    assert taken_back(stamps, 0.7 + 30.0 * np.arange(300) / 6.362e6, np.zeros(300), steady)[2] == ""


def test_a_slow_airspeed_is_a_reading_once_the_aircraft_has_flown_and_stands():
    tas, ground = np.array([0.0, 3.0, 30.0, np.nan, 0.0, 0.0, 2.0]), np.array([0.0, 0.0, 25.0, 20.0, 12.0, 2.0, 0.0])
    assert is_reading(tas, ground).tolist() == [False, False, True, False, False, True, True]
    assert is_reading(tas, np.inf).tolist() == [False, False, True, False, False, False, False]


def test_a_glider_that_has_landed_keeps_its_airspeed_and_no_heading_is_taken_before_there_is_one(tmp_path):
    rows = [("02000", "000", "00000")] * 3 + [("10000", "044", "09000")] * 4 + [("01200", "045", "00000")] * 3  # km/h and decimals
    lines = [f"B1200{k:02d}4500000N00700000EA0100001100{tas}{heading}{speed}" for k, (tas, heading, speed) in enumerate(rows)]
    (tmp_path / "a.igc").write_text("AXXX001\nHFDTE010825\nI033640TAS4143HDT4448GSP\n" + "\n".join(lines))
    log = igc.read(tmp_path / "a.igc")
    series = {one.topic: one for one in log.series}
    assert len(series["air/velocity"].stamps_ns) == 10 and any("3 fixes are without a heading" in text for text in log.account.remarks)
    assert series["imu/data"].stamps_ns[0] == series["air/velocity"].stamps_ns[3]
