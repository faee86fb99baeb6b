"""Tables as other programs write them: the same numbers whatever the dress, and what cannot be right refused with a guess."""

import gzip
import math

import numpy as np
import pytest
import yaml

from lowcostnav_ros.cli.main import main
from lowcostnav_ros.convert import ConvertError, convert
from lowcostnav_ros.messages.bag import BagReader

RATE = np.random.default_rng(3).normal(0.0, 0.1, (300, 3))
ROWS = [[f"{0.01 * k:.2f}", *(f"{v:.4f}" for v in row)] for k, row in enumerate(RATE)]


def table(names, rows=ROWS, mark=",", change=lambda cell: cell):
    return "\n".join(mark.join(map(change, row)) for row in [names, *rows]) + "\n"


NAMES = ["t", "gx", "gy", "gz"]
STAMPED = [[str(1_700_000_000_000_000_000 + 10_000_000 * k), *row[1:]] for k, row in enumerate(ROWS)]
DRESSES = {
    "bom.csv": table(NAMES).encode("utf-8-sig"),
    "utf16.csv": table(NAMES).encode("utf-16"),
    "latin1.csv": table(["t", "gx [°/s]", "gy", "gz"]).encode("latin-1"),
    "quoted.csv": table(NAMES, change=lambda cell: f'"{cell}"').encode(),
    "semicolon.csv": table(NAMES, mark=";", change=lambda cell: cell.replace(".", ",")).encode(),
    "tab.txt": table(NAMES, mark="\t").encode(),
    "blank.dat": table(NAMES, mark="  ").encode(),
    "kalibr.csv": table(["timestamp", "omega_x", "omega_y", "omega_z"], STAMPED).encode(),
    "euroc.csv": table(["#timestamp [ns]", "w_x [rad s^-1]", "w_y [rad s^-1]", "w_z [rad s^-1]"], STAMPED).encode(),
    "temperature.csv": table([*NAMES, "temperature_C"], [[*row, "25.0"] for row in ROWS]).encode(),
    "remarks.csv": b"# made by a logger\n# on a bench\n" + table(NAMES).encode(),
    "plain.csv.gz": gzip.compress(table(NAMES).encode(), mtime=0),
}


def numbers(path, capsys):
    assert main(["allan", str(path), "--unit", "deg/s"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    return [line[-6:] for line in lines if len(line) >= 7 and line[-1].replace(".", "", 1).replace("-", "").replace("e", "").isdigit()]


def test_every_dress_gives_the_same_numbers(tmp_path, capsys):
    plain = tmp_path / "plain.csv"
    plain.write_text(table(NAMES), encoding="utf-8")
    expected = numbers(plain, capsys)
    assert len(expected) == 3
    for name, content in DRESSES.items():
        (tmp_path / name).write_bytes(content)
        assert numbers(tmp_path / name, capsys) == expected, name


def test_a_time_of_unclear_unit_is_asked_about(tmp_path, capsys):
    path = tmp_path / "ticks.csv"
    path.write_text(table(["timestamp", *NAMES[1:]], [[str(10 * k), *row[1:]] for k, row in enumerate(ROWS)]), encoding="utf-8")
    assert main(["allan", str(path), "--unit", "deg/s"]) == 2
    assert "the unit of 'timestamp' is not clear" in capsys.readouterr().err


def profile(time, unit="deg", **further):
    place = {"lat": {"column": "lat", "unit": unit}, "lon": {"column": "lon", "unit": unit}, "height": {"column": "alt", "unit": "m"}}
    fix = {**place, "sigma": {"constants": [5, 5, 10], "unit": "m", "frame": "NED"}}
    return {"tables": [{"file": "log.csv", "time": time, "topics": {"gps/fix": fix}, **further}]}


def converted(folder, text, content, encoding="utf-8"):
    (folder / "log.csv").write_bytes(text.encode(encoding))
    (folder / "profile.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    convert(folder / "log.csv", folder / "profile.yaml", folder / "bag")
    with BagReader(folder / "bag") as reader:
        return list(reader.measurements(["gps/fix"]))


SECONDS = {"column": "t", "unit": "s"}


@pytest.mark.parametrize(("mark", "encoding"), [(",", "utf-8-sig"), (";", "latin-1"), ("\t", "utf-8")])
def test_marks_and_encodings_of_a_recorded_table(tmp_path, mark, encoding):
    rows = [["1700000000", "37.5", "-121.5", "100"], ["1700000001", "37.5", "-121.5", "100"]]
    text = table(["t", "lat", "lon", "alt"], rows, mark, lambda cell: f'"{cell}"')
    assert len(converted(tmp_path, text, profile(SECONDS), encoding)) == 2


@pytest.mark.parametrize(
    ("unit", "lat", "lon"), [("ddmm", "3741.604", "-12149.20"), ("1e-7 deg", "376934000", "-1218200000"), ("deg", "37.6934", "-121.82")]
)
def test_notations_of_a_place(tmp_path, unit, lat, lon):
    (fix,) = converted(tmp_path, f"t,lat,lon,alt\n1700000000,{lat},{lon},100\n", profile(SECONDS, unit))
    assert (math.degrees(fix.lat), math.degrees(fix.lon)) == (pytest.approx(37.6934, abs=1e-9), pytest.approx(-121.82, abs=1e-9))


REFUSED = [
    ("1700000000,3741.604,-12149.20,100", SECONDS, "line 2: lat 3741.604 is no number of degrees: degrees and minutes of NMEA"),
    ("1700000000,376934000,-1218200000,100", SECONDS, "1e-7 deg"),
    ("1700000000,-121.82,37.69,100", SECONDS, "latitude and longitude exchanged"),
    ("-5,37,-121,100", SECONDS, "The time of line 2 is before 1970"),
    ("1e12,37,-121,100", SECONDS, "The time of line 2 is after 2038"),
    ("23:59:58,37,-121,100", {"column": "t", "format": "%H:%M:%S"}, "has no date"),
]


@pytest.mark.parametrize(("row", "time", "words"), REFUSED)
def test_what_cannot_be_right_is_refused_and_leaves_no_bag(tmp_path, row, time, words):
    with pytest.raises(ConvertError, match=words):
        converted(tmp_path, f"t,lat,lon,alt\n{row}\n", profile(time))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv", "profile.yaml"]


def test_a_stated_zone_is_part_of_the_time(tmp_path):
    time = {"columns": ["day", "t", "zone"], "format": "%Y-%m-%d %H:%M:%S %z"}
    (fix,) = converted(tmp_path, "day,t,zone,lat,lon,alt\n2023-03-11,23:58:58,-08:00,37,-121,100\n", profile(time))
    assert fix.stamp_ns == 1_678_607_938_000_000_000


def test_times_of_day_go_on_after_midnight(tmp_path):
    time = {"column": "t", "format": "%H:%M:%S", "epoch_s": 1_700_006_400}
    fixes = converted(tmp_path, "t,lat,lon,alt\n23:59:59,37,-121,100\n00:00:01,37,-121,100\n", profile(time))
    assert [fix.stamp_ns // 10**9 - 1_700_006_400 for fix in fixes] == [86_399, 86_401]
