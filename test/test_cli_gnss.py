"""The gnss job and the conversion of RINEX files from the command line: files, exit status and refusals."""

import csv
import gzip
import json
import math

import numpy as np
import pytest
from rinex_text import ephemerides, navigation_text, observation_text, seen_at, yuma_text

from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.gnss.dop import los_n
from lowcostnav_ros.gnss.error_budget import range_covariance
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.physics.earth import geodetic_to_ecef

PLACE = geodetic_to_ecef(math.radians(38.7), math.radians(-9.1), 120.0)
SATELLITES = ephemerides()


@pytest.fixture(scope="module")
def station(tmp_path_factory):
    """Observations every 5 s with one hole, without an interval in the header, and their ephemerides."""
    folder = tmp_path_factory.mktemp("station")
    seconds = [5.0 * k for k in range(12) if k not in (5, 6)]
    epochs = [(s, seen_at(SATELLITES, s, PLACE, 3.0e4 + 100.0 * s)) for s in seconds]
    (folder / "s.obs").write_text(observation_text(epochs, PLACE))
    (folder / "silent.obs").write_text(observation_text(epochs, PLACE, doppler=False))
    (folder / "nowhere.obs").write_text(observation_text(epochs))
    (folder / "s.nav").write_text(navigation_text(SATELLITES))
    (folder / "s.obs.gz").write_bytes(gzip.compress((folder / "s.obs").read_bytes()))
    (folder / "cut.gz").write_bytes((folder / "s.obs.gz").read_bytes()[:200])
    (folder / "old.nav").write_text(navigation_text(SATELLITES).replace("05  4  2", "05  3  2"))
    (folder / "gps.alm").write_text(yuma_text(ephemerides(unhealthy=(4,))))
    return folder


def run(capsys, *arguments):
    status = cli.main([str(a) for a in arguments])
    said = capsys.readouterr()
    return status, said.out, said.err


def test_locate_tells_positions_integrity_and_holes(station, tmp_path, capsys):
    table, page = tmp_path / "p.csv", tmp_path / "p.html"
    status, out, _ = run(capsys, "gnss", "locate", station / "s.obs", station / "s.nav", "--out", table, "--page", page)
    assert status == 0
    assert "s.obs: 10 epochs, 2005-04-02 00:00:00 to 2005-04-02 00:00:55 GPS time" in out
    assert "Integrity: 10 healthy." in out and "2 are missing, in one hole" in out and "their median spacing" in out
    assert "no ionosphere model" in out and "stated 1-sigma" in out
    rows = list(csv.DictReader(table.open()))
    assert len(rows) == 10 and {r["verdict"] for r in rows} == {"healthy"}
    assert float(rows[0]["height_m"]) == pytest.approx(120.0, abs=0.1) and abs(float(rows[3]["error_down_m"])) < 0.1
    assert float(rows[0]["clock_m"]) == pytest.approx(3.0e4, abs=0.1)
    assert not any(cell.lower() in ("nan", "inf") for row in rows for cell in row.values())
    assert "<svg" in page.read_text() and "Integrity: 10 healthy." in page.read_text()


def test_locate_reads_compressed_files_and_does_without_header_coordinates(station, tmp_path, capsys):
    assert run(capsys, "gnss", "locate", station / "s.obs.gz", station / "s.nav")[0] == 0
    status, out, _ = run(capsys, "gnss", "locate", station / "nowhere.obs", station / "s.nav", "--page", tmp_path / "p.html")
    assert status == 0 and "position minus" not in out
    assert "Position minus the median position" in (tmp_path / "p.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["locate", "none.obs", "s.nav"], "No such file or directory; check the path"),
        (["locate", "s.nav", "s.nav"], "s.nav: The file is of kind 'N', where an observation file ('O') is needed"),
        (["locate", "s.obs", "s.obs"], "s.obs: The file is of kind 'O'"),
        (["locate", "s.obs", "old.nav"], "None of 10 epochs gives a position (0 satellites give no position"),
        (["locate", "s.obs", "old.nav"], "ephemeris out of date"),
        (["locate", "cut.gz", "s.nav"], "the compressed file is damaged"),
        (["locate", "s.obs", "s.nav", "--mask-deg", "80"], "'mask_deg' must be at least 2 and at most 60 deg"),
        (["locate", "s.obs", "s.nav", "--out", "no/where.csv"], "where.csv does not exist; create it first"),
        (["plan", "--almanac", "gpss", "--place", "1,2,3"], "--almanac gpss is neither a file nor one of gps, galileo, gps_galileo"),
        (["plan", "--almanac", "gone.alm", "--place", "1,2,3"], "gone.alm does not exist"),
        (["plan", "--almanac", "s.obs", "--place", "1,2,3"], "give a YUMA almanac, whose records begin with a line of asterisks"),
        (["plan", "--almanac", "gps.alm", "--place", "1,2,3", "--start", "2026-06-01"], "(weeks are known modulo 1024), "),
        (["plan", "--almanac", "gps", "--place", "95,2,3"], "--place: 95 must lie between -90 and 90."),
        (["plan", "--almanac", "gps", "--place", "1,2,3", "--start", "noon"], "--start 'noon' is not a time"),
        (["plan", "--almanac", "gps", "--place", "1,2,3", "--start", "1970-01-01"], "before GPS time began"),
        (["plan", "--almanac", "gps", "--place", "1,2,3", "--hours", "0"], "--hours: 0 must lie between"),
        (["plan", "--almanac", "gps", "--place", "1,2,3", "--step-s", "-1"], "cannot be planned"),
        (["plan", "--almanac", "gps", "--place", "1,2,3", "--canyon", "0", "10", "0"], "--canyon: cliffs have a height above zero"),
        (["plan", "--almanac", "gps", "--place", "1,2,3", "--canyon", "100", "0", "0"], "--canyon: 'width_m' must be at least 1"),
    ],
)
def test_refusals_say_what_to_do(station, arguments, sentence, capsys, monkeypatch):
    monkeypatch.chdir(station)
    status, _, err = run(capsys, "gnss", *arguments)
    assert status == 2 and sentence in err and err.strip().count("\n") == 0


def test_plan_of_a_canyon_names_its_windows_and_draws(tmp_path, capsys):
    place = ("--place", "38.7,-9.1,200", "--start", "2026-06-01T06:00", "--hours", "6", "--step-s", "300")
    status, out, _ = run(capsys, "gnss", "plan", "--almanac", "gps_galileo", *place, "--canyon", 1000, 1000, 250, "-o", tmp_path / "plan")
    assert status == 1
    assert "No good position (PDOP above 6 or fewer than four satellites) for" in out and "down to 3 satellites" in out
    plan = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert len(plan["times"]) == 73 and not plan["good_enough"] and plan["windows"][0]["fewest_satellites"] >= 0
    assert all(s["elevation_deg"] >= 5.0 for t in plan["times"] for s in t["satellites"])
    best = max(plan["times"], key=lambda t: len(t["satellites"]))
    up = np.radians([s["elevation_deg"] for s in best["satellites"]])
    rows = np.column_stack([-los_n(np.radians([s["azimuth_deg"] for s in best["satellites"]]), up), np.ones(len(up))])
    cofactor = np.linalg.inv(rows.T @ np.linalg.inv(range_covariance(up, 1.0)) @ rows)
    assert best["effective"]["gdop"] == pytest.approx(np.sqrt(np.trace(cofactor)), rel=1e-3)
    assert "TDOP, effective" in out
    page = (tmp_path / "plan" / "plan.html").read_text()
    assert all(f'aria-label="{name}' in page for name in ("The sky", "Satellites in view", "Dilution of precision", "In view"))
    status, out, _ = run(capsys, "gnss", "plan", "--almanac", "gps_galileo", *place)
    assert status == 0 and "A position with a PDOP of 6 or better all the time" in out and "Nominal orbits" in out


def test_plan_from_an_almanac_leaves_out_the_ill_and_says_its_week(station, capsys):
    options = ("--place", "38.7,-9.1,0", "--start", "2005-04-09", "--hours", "1")
    status, out, _ = run(capsys, "gnss", "plan", "--almanac", station / "gps.alm", *options)
    assert status == 0 and "31 satellites" in out
    assert "1 unhealthy satellite left out (G04)" in out
    assert "week 292 is taken for 1316 (2005-04-02), the nearest, 7 days before the start" in out


def test_rinex_files_become_a_bag_that_satellites_alone_fly_on(station, tmp_path, capsys):
    bag = tmp_path / "bag"
    status, out, _ = run(capsys, "convert", station / "s.obs", "--navigation", station / "s.nav", "--at-rest", "-o", bag)
    assert status == 0 and "10  gnss/raw" in out and "10 epochs: 10 healthy" in out
    assert "settings of gnss_only for this receiver: timeout_s 10.0\n" in out
    with BagReader(bag) as reader:
        epochs = list(reader.measurements(["gnss/raw"]))
    clock = np.array([3.0e4 + 100.0 * 5.0 * k for k in range(12) if k not in (5, 6)])
    for epoch, clock_m in zip(epochs, clock, strict=True):
        ranges = np.linalg.norm(epoch.sat_pos_e - PLACE, axis=1)
        assert epoch.pseudorange_m - ranges == pytest.approx(np.full(len(epoch), clock_m), abs=0.05)
        assert epoch.doppler_valid.all()
    status, out, _ = run(capsys, "replay", bag, "--navigators", "gnss_only", "--json", tmp_path / "r.json")
    found = json.loads((tmp_path / "r.json").read_text())["navigators"]["gnss_only"]
    assert status == 0 and found["solutions"] >= 9 and not found["inputs"]["gnss/raw"]["rejected"]
    assert found["errors"]["flight"]["horizontal_m"]["max"] < 0.5 and found["errors"]["flight"]["vertical_m"]["max"] < 0.5


def test_a_receiver_without_dopplers_is_recorded_with_the_settings_it_needs(station, tmp_path, capsys):
    status, out, _ = run(capsys, "convert", station / "silent.obs", "--navigation", station / "s.nav", "-o", tmp_path / "bag")
    assert status == 0 and "settings of ins_gnss for this receiver: gnss.doppler false" in out
    assert "gnss.doppler: false" in (tmp_path / "bag" / "settings" / "gnss_only.yaml").read_text()
    with BagReader(tmp_path / "bag") as reader:
        assert not any(epoch.doppler_valid.any() for epoch in reader.measurements())
        assert list(reader.types) == ["gnss/raw"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["s.obs"], "s.obs is a RINEX file; name the file of its ephemerides with --navigation."),
        (["s.obs", "--navigation", "s.obs"], "The file is of kind 'O'"),
        (["s.obs", "--navigation", "old.nav"], "no epoch gives a position to correct it at"),
        (["nowhere.obs", "--navigation", "s.nav", "--at-rest"], "no coordinates in its header to take for the truth"),
        (["s.obs", "--navigation", "s.nav", "--profile", "px4_flight"], "leave one of them out"),
        ([".", "--at-rest"], "--at-rest is for RINEX files"),
    ],
)
def test_conversions_that_cannot_be(station, tmp_path, arguments, sentence, capsys, monkeypatch):
    monkeypatch.chdir(station)
    status, _, err = run(capsys, "convert", *arguments, "-o", tmp_path / "bag")
    assert status == 2 and sentence in err and not (tmp_path / "bag").exists()
