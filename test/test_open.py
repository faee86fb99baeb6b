"""Any log to a page: what is told by content, what is kept, what is refused, and that an autopilot is no truth."""

import gzip
import os
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from replay_fakes import FixFollower, flight, write_bag

from lowcostnav_ros.cli.main import main
from lowcostnav_ros.convert.opened import open_log
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.result import Bag, Recording
from lowcostnav_ros.replay.words import compared_with

ONE = {"follower": FixFollower}


def nmea(seconds=130):
    """A receiver that flies north at 60 kt."""
    lines = []
    for k in range(seconds):
        clock, minutes = f"{10:02d}{k // 60:02d}{k % 60:02d}.00", 30.0 + k / 60.0
        for body in (
            f"GPRMC,{clock},A,47{minutes:07.4f},N,00830.0000,E,60.0,000.0,010625,,,A",
            f"GPGGA,{clock},47{minutes:07.4f},N,00830.0000,E,1,09,0.9,500.0,M,48.0,M,,",
        ):
            lines.append(f"${body}*{int(np.bitwise_xor.reduce(np.frombuffer(body.encode(), np.uint8))):02X}\r\n")
    return "".join(lines)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "cache" / "lowcostnav" / "opened"


def test_a_log_becomes_a_page_and_tracks(kept, tmp_path, capsys):
    (tmp_path / "walk.txt").write_text(nmea())
    assert main(["open", "walk.txt", "--no-browser", "--kml", "w.kml", "--gpx", "w.gpx"], {"supervisor": NAVIGATORS["supervisor"]}) == 0
    page, said = (tmp_path / "walk.txt.html").read_text(), capsys.readouterr()
    assert "NMEA 0183: 129.0 s from 2025-06-01 10:00:00" in page and "<h2>What the log holds</h2>" in page and "NMEA 0183" in said.err
    assert "walk.txt.html" in said.out and "No navigator could run" in said.out
    coordinates = [e.text.split() for e in ET.parse(tmp_path / "w.kml").iter("{http://www.google.com/kml/ext/2.2}coord")]
    points = list(ET.parse(tmp_path / "w.gpx").iter("{http://www.topografix.com/GPX/1/1}trkpt"))
    assert len(coordinates) == len(points) >= 130
    fixes = [c for c in coordinates if abs(float(c[0]) - 8.5) < 1e-6]
    assert float(fixes[0][1]) == pytest.approx(47.5, abs=1e-6)
    assert float(fixes[0][2]) == pytest.approx(500.0, abs=2.0)  # above the sea again, by the shipped geoid


def test_a_recording_is_made_once_for_its_content(kept, tmp_path):
    log = tmp_path / "walk.nmea"
    log.write_text(nmea(20))
    first = open_log(log)
    with BagReader(first.bag) as bag:
        assert bag.counts["gps/fix"] == 20
    assert os.path.dirname(first.bag) == str(tmp_path)
    before = os.stat(first.bag).st_mtime_ns
    log.rename(tmp_path / "other")
    (tmp_path / "other").rename(log)
    assert open_log(log) == first and os.stat(first.bag).st_mtime_ns == before
    log.write_text(nmea(21))
    assert open_log(log).bag != first.bag


def test_a_folder_that_is_read_only_is_left_alone(kept, tmp_path):
    folder = tmp_path / "card"
    folder.mkdir()
    (folder / "walk").write_text(nmea(20))
    folder.chmod(0o555)
    try:
        found = open_log(folder / "walk")
        assert found.bag.startswith(str(kept)) and os.listdir(folder) == ["walk"]
        assert open_log(folder / "walk") == found
    finally:
        folder.chmod(0o755)


def test_a_recording_of_ours_is_opened_as_it_is(kept, tmp_path):
    bag = write_bag(tmp_path / "flight", flight(8))
    assert main(["open", str(bag), "--no-browser", "--out", "f.html"], ONE) == 0
    page = (tmp_path / "f.html").read_text()
    assert "recording with the standard topics" in page and "follower" in page and not kept.exists()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"a,b\n1,2\n3,4\n", "convert --guess"),
        (b"\xaa\x44\x12\x1c" + bytes(200), "NovAtel"),
        (b"# a capture\n\xd3\x00\x13" + bytes(200), "RTCM 3"),
        (b"\x10\x72" + bytes(20) + b"\x10\x03\x10\x33" + bytes(50), "Trimble TSIP"),
        (gzip.compress(b"SQLite format 3\0" + bytes(200), mtime=0), "packed database of ROS 2"),
        (bytes(range(256)) * 4, "no known format"),
        (b"", "is empty"),
        (b"     3.04           N: GNSS NAV DATA    M                   RINEX VERSION / TYPE\n", "observation file"),
        (b"     3.04           OBSERVATION DATA    M                   RINEX VERSION / TYPE\n", "no file of ephemerides"),
    ],
)
def test_what_cannot_be_opened_is_said_in_a_sentence(kept, tmp_path, capsys, content, said):
    (tmp_path / "log").write_bytes(content)
    assert main(["open", "log", "--no-browser"]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert said in error and error.endswith(".") and not list(tmp_path.glob("*.html"))
    assert not list(tmp_path.glob("log.bag*"))


def test_an_autopilot_is_compared_with_and_never_called_truth():
    def recording(truth):
        return Recording(Bag("b", "0", {}), truth)

    assert compared_with(recording("autopilot/odometry")) == "autopilot"
    assert compared_with(recording("truth/odometry")) == compared_with(recording(None)) == compared_with(None) == ""
