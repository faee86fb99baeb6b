"""Public navaid lists: small hand-written samples of each format, channels from the published pairing, and the real list where present."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.radionav.channels import channel_of, frequency_mhz
from lowcostnav_ros.radionav.navaid_import import lost_longitude_signs, navaids_from_text, select_near, table_as_text
from lowcostnav_ros.radionav.stations import StationError, stations_from_text

OURAIRPORTS = (
    "id,filename,ident,name,type,frequency_khz,latitude_deg,longitude_deg,elevation_ft,iso_country,dme_frequency_khz,dme_channel,"
    "dme_latitude_deg,dme_longitude_deg,dme_elevation_ft,slaved_variation_deg,magnetic_variation_deg,usageType,power,associated_airport\n"
    '1,a,AAA,"Alpha, North",VORTAC,113900,37.39,-122.28,2270.0,US,113900.0,086X,,,,,,BOTH,MEDIUM,\n'
    "2,b,BBB,Bravo,VOR-DME,114100,37.37,-121.94,40,US,114100.0,088X,37.38,-121.95,50,,,TERMINAL,HIGH,KSJC\n"
    "3,c,CCC,Charlie,VOR,114300,37.00,-121.00,40,US,,,,,,,,BOTH,HIGH,\n"
    "4,d,DDD,Delta,VOR-DME,112300,37.80,-122.20,,US,112300.0,070X,,,,,,BOTH,HIGH,\n"
    "5,e,EEE,Echo,DME,112300,37.90,-122.50,12,US,112350,,,,,,,BOTH,HIGH,\n"
    "6,f,AAA,Alpha of elsewhere,DME,112300,-30.0,120.0,12,AU,112300,070X,,,,,,BOTH,HIGH,\n"
)
XPLANE_1100 = """I
1100 Version - data cycle 1802, build 20180203
3  37.39 -122.28 2270 11390 40 17.0 AAA ENRT K2 ALPHA VORTAC
12 37.39 -122.28 2270 11390 40 0.0 AAA ENRT K2 ALPHA VORTAC DME
12 37.73 -122.22 10 11680 130 0.0 OAK ENRT K2 OAKLAND VORTAC DME
12 37.37 -121.94 40 11095 18 0.2 ISJC KSJC K2 30L DME-ILS
13 37.60 -121.00 97 11460 40 0.3 MOD ENRT K2 MODESTO DME
13 37.60
99
"""
XPLANE_810 = "I\n810 Version - DAFIF data cycle 2009.12\n13  37.72  -122.22  10 11680 130 0.0 OAK  OAKLAND DME\n99\n"


def by_ident(navaids):
    return {s.ident: s for s in navaids.stations}


def test_ourairports_rows_and_why_some_are_left_out():
    navaids = navaids_from_text(OURAIRPORTS, undulation_m=-32.0)
    assert [s.ident for s in navaids.stations] == ["AAA", "BBB", "EEE", "AAA"]
    assert navaids.left_out == {"unusable elevation_ft": 1}  # Delta; Charlie has no DME at all
    alpha, bravo, echo = navaids.stations[:3]
    assert (alpha.name, alpha.channel, alpha.service_volume) == ("Alpha, North", "86X", "L")
    assert (alpha.elevation, alpha.height) == pytest.approx((691.896, 659.896))
    assert math.degrees(bravo.lat) == pytest.approx(37.38)  # where the DME stands, not the VOR
    assert (bravo.service_volume, echo.service_volume) == ("T", "H")
    assert echo.channel == "70Y"  # paired with 112.35 MHz


def test_xplane_rows_of_both_versions():
    navaids = navaids_from_text(XPLANE_1100)
    assert set(by_ident(navaids)) == {"AAA", "OAK"}
    assert navaids.left_out == {"range below 25 NM": 1, "range offset by design": 1, "row too short": 1}
    oakland = by_ident(navaids)["OAK"]
    assert (oakland.name, oakland.channel, oakland.service_volume) == ("OAKLAND VORTAC DME", "115X", "H")  # as in the shipped table
    old = by_ident(navaids_from_text(XPLANE_810))["OAK"]
    assert (old.name, old.channel) == ("OAKLAND DME", "115X")


def test_the_nearer_of_two_stations_of_one_ident_is_taken():
    table, notes = select_near(navaids_from_text(OURAIRPORTS), math.radians(37.5), math.radians(-122.0), 3e7)
    assert {s.ident for s in table} == {"AAA", "BBB", "EEE"}
    assert math.degrees(table["AAA"].lon) == pytest.approx(-122.28)
    assert len(notes) == 1 and notes[0].startswith("AAA is listed twice (") and "'Alpha, North', is used" in notes[0]


def test_two_towers_of_one_place_are_one():
    twin = OURAIRPORTS + "7,g,FFF,Foxtrot,TACAN,113900,37.3901,-122.2801,2270,US,113900,086X,,,,,,BOTH,HIGH,\n"
    table, notes = select_near(navaids_from_text(twin), math.radians(37.39), math.radians(-122.28), 100e3)
    assert "FFF" not in table and "FFF stands beside AAA (14 m)" in notes[0]


def test_lost_sign_of_a_place_and_of_a_station_is_named():
    navaids = navaids_from_text(OURAIRPORTS)
    with pytest.raises(StationError, match="3 at the mirrored longitude; a minus sign of the longitude looks lost"):
        select_near(navaids, math.radians(37.5), math.radians(122.0), 100e3)
    with pytest.raises(StationError, match="no station within 54 NM of 60.000, 10.000; give a list that covers the place"):
        select_near(navaids, math.radians(60.0), math.radians(10.0), 100e3)
    lost = OURAIRPORTS + "7,g,GGG,Golf,DME,112300,37.2,121.9,12,US,112300,070X,,,,,,BOTH,HIGH,\n"
    assert [s.ident for s in lost_longitude_signs(navaids_from_text(lost))] == ["GGG"]
    assert lost_longitude_signs(navaids) == []


@pytest.mark.parametrize("text", ["", "a,b,c\n1,2,3\n", "some words\nmore words\n", "\x00\x01"])
def test_unknown_lists_are_refused(text):
    with pytest.raises(StationError, match="not a known station list; give a CSV with ident"):
        navaids_from_text(text)


def test_a_published_alignment_makes_a_vor_and_survives_the_table():
    aligned = "8,h,HHH,Hotel,VORTAC,115200,37.90,-121.50,12,US,115200,099X,,,,17.001,14.4,BOTH,HIGH,\n"
    navaids = navaids_from_text(OURAIRPORTS + aligned)
    kinds = {s.ident: (s.kind, round(math.degrees(s.declination), 3)) for s in navaids.stations}
    assert kinds["HHH"] == ("VORTAC", 17.001)
    assert kinds["BBB"] == ("DME", 0.0)  # a VOR-DME whose alignment is not published ranges only
    again = stations_from_text(table_as_text(navaids.stations[:2] + navaids.stations[-1:]))
    assert (again["HHH"].kind, again["HHH"].has_vor) == ("VORTAC", True)
    assert math.degrees(again["HHH"].declination) == pytest.approx(17.0)


def test_of_our_own_table_a_vor_without_dme_is_left_out():
    header = "ident,name,lat_deg,lon_deg,elevation_ft,undulation_m,channel,service_volume,kind,declination_deg\n"
    rows = "AAA,Alpha,37.7,-122.2,10,-32.5,115X,H,VOR,17\n", "BBB,Bravo,37.9,-121.9,10,-32.5,117X,H,VORTAC,17\n"
    navaids = navaids_from_text(header + "".join(rows))
    assert [s.ident for s in navaids.stations] == ["BBB"]
    assert navaids.left_out == {"VOR without DME": 1}
    with pytest.raises(StationError, match="no station with DME, only VOR"):
        navaids_from_text(header + rows[0])


def test_a_list_without_dme_is_refused_with_the_reasons():
    with pytest.raises(StationError, match=r"no usable DME station \(1 with range below 25 NM\)"):
        navaids_from_text("I\n1100 Version\n12 37.37 -121.94 40 11095 18 0.2 ISJC KSJC K2 30L DME-ILS\n")


@given(st.text(max_size=200))
def test_any_rows_are_read_or_refused(text):
    for head in (OURAIRPORTS.splitlines()[0] + "\n", "I\n1100 Version\n12 "):
        try:
            assert navaids_from_text(head + text).stations
        except StationError as refusal:
            assert str(refusal).endswith((".", ";")) or ";" in str(refusal)


def test_own_format_comes_back_from_its_text():
    navaids = navaids_from_text(OURAIRPORTS, undulation_m=-32.0)
    table, _ = select_near(navaids, math.radians(37.5), math.radians(-122.0), 100e3)
    again = stations_from_text(table_as_text(table))
    for station in table:
        twin = again[station.ident]
        assert (twin.name, twin.channel, twin.service_volume) == (station.name, station.channel, station.service_volume)
        assert (twin.lat, twin.lon) == pytest.approx((station.lat, station.lon), abs=1e-8)
        assert (twin.height, twin.elevation) == pytest.approx((station.height, station.elevation), abs=0.16)  # whole feet
    assert [s.ident for s in navaids_from_text(table_as_text(table)).stations] == [s.ident for s in table]


@pytest.mark.parametrize(
    ("frequency", "channel"),
    [(108.00, "17X"), (108.05, "17Y"), (112.25, "59Y"), (112.30, "70X"), (117.95, "126Y"), (133.3, "60X"), (134.4, "1X"), (135.95, "16Y")],
)
def test_channels_of_the_published_pairing(frequency, channel):
    assert channel_of(frequency) == channel
    assert frequency_mhz(channel) == pytest.approx(frequency)


@given(st.integers(1, 126), st.sampled_from("XY"))
def test_every_channel_has_one_frequency(number, letter):
    assert channel_of(frequency_mhz(f"{number}{letter}")) == f"{number}{letter}"


@pytest.mark.parametrize("frequency", [107.95, 118.0, 112.32, math.nan, math.inf, -1.0])
def test_frequencies_without_a_channel_are_refused(frequency):
    with pytest.raises(ValueError, match="No DME channel"):
        channel_of(frequency)
    with pytest.raises(ValueError, match="must be 1 to 126"):
        frequency_mhz("127X")


@pytest.mark.data
def test_the_world_list_agrees_with_the_shipped_table():
    folder = Path(os.environ.get("LOWCOSTNAV_DATA", Path(__file__).parents[2] / "shared" / "data"))
    path = folder / "navaids" / "dme_stations_world.csv"
    if not path.is_file():
        pytest.skip(f"{path} is not there; set LOWCOSTNAV_DATA")
    navaids = navaids_from_text(path.read_text(encoding="utf-8"))
    assert len(navaids.stations) > 4000 and sum(navaids.left_out.values()) < 0.01 * len(navaids.stations)
    assert lost_longitude_signs(navaids) == []
    table, _ = select_near(navaids, math.radians(37.7), math.radians(-121.8), 120.0 * 1852.0)
    ours = stations_from_text((Path(__file__).parents[1] / "config" / "dme_stations_bay_area.csv").read_text())
    for station in ours:
        twin = table[station.ident]
        assert (twin.lat, twin.lon) == pytest.approx((station.lat, station.lon), abs=2e-6)
        assert (twin.channel, twin.service_volume) == (station.channel, station.service_volume)
        assert np.isclose(twin.elevation, station.elevation)
