"""The dme job from the command line: files, exit status and refusals."""

import json
from pathlib import Path

import pytest

from lowcostnav_ros.cli.main import main

OURAIRPORTS = (
    "id,ident,name,type,latitude_deg,longitude_deg,elevation_ft,iso_country,dme_frequency_khz,dme_channel,usageType,power\n"
    "1,AAA,Alpha,VORTAC,37.39,-122.28,2270.0,US,113900.0,086X,BOTH,MEDIUM\n"
    "2,BBB,Bravo,VOR-DME,37.83,-121.17,48,US,116000.0,107X,BOTH,HIGH\n"
)


def test_plan_of_an_airport_writes_tables_figures_and_json(tmp_path, capsys):
    status = main(["dme", "plan", "--airport", "37.694,-121.820,122", "--altitude-m", "600,2000", "-o", str(tmp_path / "plan")])
    said = capsys.readouterr().out
    assert status == 0 and "stays within 0.5 NM" in said and "from south" in said and "hills are not in it" in said
    page = (tmp_path / "plan" / "plan.html").read_text()
    assert page.count('class="map"') == 4 and all(f'data-label="{word}"' in page for word in ("3 to 4", "to 1.6", "6562 ft from east"))
    assert "Stations asked" in page and "Interrogations" in page
    plan = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert [level["altitude_m"] for level in plan["levels"]] == [600.0, 2000.0]
    assert len(plan["levels"][0]["legs"]) == 4
    heard = {s["ident"]: s for s in plan["levels"][0]["at_airport"]["stations"]}
    assert heard["OAK"]["range_nm"] == pytest.approx(19.3, abs=0.1)  # 37.7259 -122.2240 from 37.694 -121.820
    assert heard["OAK"]["bearing_deg"] == pytest.approx(275.6, abs=0.2)
    assert plan["levels"][0]["at_airport"]["fix_1_sigma_noise_m"] == pytest.approx(7.4 * plan["levels"][0]["at_airport"]["hdop"], rel=0.01)


def test_route_with_a_single_station_fails_the_requirement(tmp_path, capsys):
    route = tmp_path / "route.csv"
    route.write_text("# to Livermore\nname,lat_deg,lon_deg\nSNS,36.6,-121.9\nE16,37.0,-121.5\n")
    assert main(["dme", "plan", "--route", str(route), "--altitude-m", "300"]) == 1
    said = capsys.readouterr().out
    assert "single station only (SNS)" in said and "exceeds 0.5 NM at every altitude" in said


def test_import_writes_a_table_the_plan_can_use(tmp_path, capsys):
    source, table = tmp_path / "navaids.csv", tmp_path / "stations.csv"
    source.write_text(OURAIRPORTS)
    assert main(["dme", "import", str(source), "--near", "37.7,-121.8", "--undulation-m", "-32", "-o", str(table)]) == 0
    assert "2 stations in" in capsys.readouterr().out
    assert table.read_text().splitlines()[1].startswith("AAA,Alpha,37.390000,-122.280000,2270,-32.0,86X,L") or "BBB" in table.read_text()
    assert main(["dme", "plan", "--route", "37.3,-121.9;37.5,-121.8", "--stations", str(table), "--altitude-m", "1000"]) in (0, 1)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["plan", "--airport", "37.7"], "--airport: '37.7' is not a place; write LAT,LON[,M]"),
        (["plan", "--airport", "137.7,-121.8"], "--airport: 137.7 must lie between -90 and 90."),
        (["plan", "--airport", "37.7,east"], "'37.7,east' is not a place"),
        (["plan", "--airport", "37.7,121.8"], "a minus sign of the longitude looks lost"),
        (["plan", "--airport", "51.5,-0.1"], "give a list that covers the place"),
        (["plan", "--airport", "37.7,-121.8", "--altitude-m", "-9000"], "--altitude-m: -9000 must lie between"),
        (["plan", "--airport", "37.7,-121.8", "--speed-mps", "0"], "speed must be positive"),
        (["plan", "--airport", "37.7,-121.8", "--stations", "nowhere.csv"], "nowhere.csv does not exist"),
        (["plan", "--route", "37.7,-121.8"], "needs two waypoints or more"),
        (["plan", "--route", "37.7,-121.8;37.7,-121.8"], "Leg 1 of the route has no length"),
        (["import", str(Path(__file__)), "--near", "37.7,-121.8", "-o", "x.csv"], "not a known station list"),
    ],
)
def test_refusals_say_what_to_do(arguments, sentence, capsys):
    assert main(["dme", *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_places_south_of_the_equator_are_values_not_options(capsys):
    for arguments in (["plan", "--airport", "-33.95,151.18"], ["plan", "--route", "-17.75,177.4;-16.7,179.9"]):
        assert main(["dme", *arguments]) == 2  # the shipped stations are elsewhere
        assert "no station within 130 NM of -" in capsys.readouterr().err
