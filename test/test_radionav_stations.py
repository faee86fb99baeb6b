"""Station table: what it accepts, and a sentence for everything it refuses."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lowcostnav_ros.radionav.stations import StationError, stations_from_text

CONFIG = Path(__file__).parents[1] / "config"
HEADER = "ident,name,lat_deg,lon_deg,elevation_ft,undulation_m,channel,service_volume\n"
OSI = "OSI,Woodside,37.3927,-122.2820,2270,-32.5,86X,L\n"
SJC = "SJC,San Jose,37.3747,-121.9450,43,-32.5,88X,L\n"
OAK = "OAK,Oakland,37.7259,-122.2240,10,-32.5,115X,H\n"


def test_shipped_table_holds_the_bay_area():
    table = stations_from_text((CONFIG / "dme_stations_bay_area.csv").read_text())
    assert {"OSI", "SJC", "OAK", "SFO", "SAU", "PYE", "CCR", "SGD", "SNS"} <= {s.ident for s in table}
    woodside = table["OSI"]
    assert woodside.elevation == pytest.approx(691.896)  # 2270 ft
    assert woodside.height == pytest.approx(691.896 - 32.5)
    assert math.degrees(woodside.lon) == pytest.approx(-122.2820)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "no stations; the first line names the columns"),
        (HEADER, "The station table is empty; list at least one"),
        (HEADER.replace("channel,", "") + OSI, "column channel is missing"),
        (HEADER + OSI.replace(",86X", ""), "line 2: 7 cells for 8 columns"),
        (HEADER + OSI.replace("37.3927", "97.3927"), "lat_deg of 97.3927 must lie between -90 and 90"),
        (HEADER + OSI.replace("-122.2820", "-222.2820"), "lon_deg of -222.282 must lie between"),
        (HEADER + OSI.replace("37.3927", "nan"), "lat_deg of nan must lie between"),
        (HEADER + OSI.replace("37.3927", "37N23"), "lat_deg '37N23' must be a number"),
        (HEADER + OSI.replace("2270", "22700"), "elevation_ft of 22700 must lie between"),
        (HEADER + OSI.replace("86X", "130X"), "channel '130X' must be 1 to 126"),
        (HEADER + OSI.replace(",L", ",Q"), "service volume 'Q' must be T, L or H"),
        (HEADER + OSI.replace("OSI", "O I"), "ident 'O I' must be one to four letters"),
        (HEADER + OSI + OSI, "OSI is listed twice"),
        (HEADER + OSI + OSI.replace("OSI", "XXX"), "OSI and XXX are 0 m apart"),
        (HEADER + OSI + SJC + OAK.replace("-122", "122"), "OAK at longitude 122.2240 lies opposite OSI and others; its sign looks lost"),
    ],
)
def test_refusals_say_what_to_do(text, sentence):
    with pytest.raises(StationError) as refusal:
        stations_from_text(text)
    assert sentence in str(refusal.value)


WITH_VOR = HEADER.replace("\n", ",kind,declination_deg\n")


def test_optional_columns_make_a_vor_of_a_station_and_old_files_read_as_before():
    plain = stations_from_text(HEADER + OSI)["OSI"]
    assert (plain.kind, plain.declination, plain.has_dme, plain.has_vor) == ("DME", 0.0, True, False)
    rows = (OSI.replace("L\n", "L,VORTAC,17\n"), SJC.replace("L\n", "L,vor,-16.5\n"), OAK.replace("H\n", "H,,\n"))
    table = stations_from_text(WITH_VOR + "".join(rows))
    assert [(s.kind, s.has_dme, s.has_vor) for s in table] == [("VORTAC", True, True), ("VOR", False, True), ("DME", True, False)]
    assert [math.degrees(s.declination) for s in table] == pytest.approx([17.0, -16.5, 0.0])
    shipped = stations_from_text((CONFIG / "dme_stations_bay_area.csv").read_text())
    assert all(s.has_dme for s in shipped)
    assert {s.ident for s in shipped if not s.has_vor} == {"NUQ", "SUU"}  # TACAN only


@pytest.mark.parametrize(
    ("cells", "sentence"),
    [
        ("VORTAC,", "line 2: a VORTAC needs declination_deg, the station's own"),
        ("NDB,17", "line 2: kind 'NDB' must be one of DME, VOR, VOR-DME, VORTAC, TACAN"),
        ("VOR,17E", "line 2: declination_deg '17E' must be a number"),
        ("VOR,nan", "line 2: declination_deg of nan must lie between -180 and 180"),
        ("DME,200", "line 2: declination_deg of 200 must lie between"),
    ],
)
def test_a_doubtful_kind_or_declination_is_refused(cells, sentence):
    with pytest.raises(StationError) as refusal:
        stations_from_text(WITH_VOR + OSI.replace("L\n", f"L,{cells}\n"))
    assert sentence in str(refusal.value)


def test_line_numbers_count_comments():
    with pytest.raises(StationError, match="bay line 4: elevation_ft"):
        stations_from_text("# a comment\n" + HEADER + "\n" + OSI.replace("2270", "high"), "bay")


def test_a_table_of_both_hemispheres_is_not_taken_for_a_lost_sign():
    tokyo = "HME,Haneda,35.5500,139.7800,20,36.0,80X,H\nNRE,Narita,35.7800,140.3600,140,36.0,81X,H\n"
    assert len(stations_from_text(HEADER + OSI + SJC + tokyo)) == 4


def test_unknown_station_lists_what_exists():
    with pytest.raises(StationError, match="LAX is not in the table; it has OSI, SJC"):
        stations_from_text(HEADER + OSI + SJC)["LAX"]


@pytest.mark.parametrize(
    ("volume", "above_ft", "range_nm"),
    [("T", 5000, 25), ("L", 5000, 40), ("H", 5000, 40), ("H", 15_000, 100), ("H", 20_000, 130)],
)
def test_standard_service_volumes(volume, above_ft, range_nm):
    station = next(iter(stations_from_text(HEADER + OSI.replace(",L", f",{volume}"))))
    assert station.service_range_m(station.height + above_ft * 0.3048) == pytest.approx(range_nm * 1852.0)


@given(st.text(max_size=300))
def test_any_text_is_read_or_refused(text):
    for candidate in (text, HEADER + text):
        try:
            stations_from_text(candidate)
        except StationError as refusal:
            assert str(refusal)
