"""What a newcomer meets: places, outputs and windows that are judged before the work, jobs that are broken off, curves that are true."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lowcostnav_ros.base.settings import SettingsError
from lowcostnav_ros.cli.main import main
from lowcostnav_ros.cli.options import place_of
from lowcostnav_ros.replay import result_files
from lowcostnav_ros.replay.outages import GpsGaps
from lowcostnav_ros.report.chart import Band, TimeAxis, time_chart
from lowcostnav_ros.report.decimate import thin_dots


def refused(capsys, *arguments) -> str:
    assert main(list(map(str, arguments))) == 2
    return capsys.readouterr().err


def test_a_place_is_written_in_one_way_the_southern_hemisphere_included(capsys):
    np.testing.assert_allclose(place_of("-33.97,18.6,40", "--place"), (*np.radians([-33.97, 18.6]), 40.0))
    assert place_of("-33.97,18.6", "--place")[2] == 0.0
    for job in (["magcal", "nowhere.csv"], ["gnss", "plan", "--almanac", "gps"]):
        assert "18,6,7,8' is not a place; write LAT,LON[,M]" in refused(capsys, *job, "--place", "-33,18,6,7,8")
    assert "does not exist" in refused(capsys, "gnss", "plan", "--almanac", "gone.alm", "--place", "-33.97,18.6")


def test_an_airport_is_a_place():
    assert np.degrees(place_of("KLVK", "--airport")[:2]) == pytest.approx([37.694, -121.82], abs=0.01)
    assert place_of("KLVK,122", "--airport")[2] == 122.0
    with pytest.raises(SettingsError, match="no airport QQQQ is known"):
        place_of("QQQQ", "--airport")


def test_what_does_not_exist_is_said_with_what_there_is_of_its_kind(capsys):
    there = refused(capsys, "dme", "plan", "--airport", "37.7,-121.8", "--stations", "nosuch.csv")
    assert "dme_stations_bay_area.csv" in there and "ahrs" not in there
    assert refused(capsys, "gnss", "plan", "--almanac", "a.alm", "--place", "1,2") == "a.alm does not exist; check the path of the file.\n"
    assert "the file nosuch.csv does not exist" in refused(capsys, "dme", "plan", "--route", "nosuch.csv")
    lossless = refused(capsys, "demo", "--graph", "livermore")
    assert "lossless graphs: backup_one_receiver" in lossless and "livermore," not in lossless.partition(":")[2]


def test_outputs_are_looked_at_before_the_work(capsys, tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    for job in (
        ["reproduce", "gebre", "--out"],
        ["dme", "plan", "--airport", "37.7,-121.8", "-o"],
        ["gnss", "plan", "--almanac", "gps", "--place", "1,2", "-o"],
        ["demo", "--out"],
    ):
        assert "is no folder" in refused(capsys, *job, file / "results")


def test_a_job_that_is_broken_off_says_so_and_leaves_nothing_that_looks_whole(tmp_path):
    code = "import sys; from lowcostnav_ros.cli.main import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "simulate", "livermore_long", "-o", str(tmp_path / "flight")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    while process.poll() is None and not list(tmp_path.glob(".flight*")):
        pass
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30.0)
    assert process.returncode == 130 and "simulate was interrupted" in said and not list(tmp_path.iterdir())


def test_results_take_the_place_of_an_earlier_run_whole_or_not_at_all(tmp_path):
    (tmp_path / "summary.json").write_text('{"navigators": {"ahrs": {}, "supervisor": {}}}')
    for name in ("supervisor.csv", "truth.csv", "ahrs_aids.csv", "mine.csv"):
        (tmp_path / name).write_text("old")
    with pytest.raises(KeyboardInterrupt), result_files.results_in(tmp_path) as part:
        (part / "ahrs.csv").write_text("half")
        raise KeyboardInterrupt
    assert (tmp_path / "supervisor.csv").read_text() == "old" and not (tmp_path / "ahrs.csv").exists()
    with result_files.results_in(tmp_path) as part:
        (part / "truth.csv").write_text("new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.csv", "truth.csv"]
    assert (tmp_path / "truth.csv").read_text() == "new"


@pytest.mark.parametrize(("interval_s", "hole_s", "outage"), [(30, 31, None), (30, 120, (75, 120)), (1, 6, (3, 6)), (0.2, 2.9, None)])
def test_an_outage_is_longer_than_the_receivers_own_interval(interval_s, hole_s, outage):
    gaps, stamp = GpsGaps(), 10**18
    for _ in range(40):
        stamp += round(1e9 * interval_s)
        gaps.add(stamp)
        between = np.array([stamp + round(4e8 * interval_s)])
        assert gaps.interval_starts(between).tolist() == [-1]
    gaps.add(stamp + round(1e9 * hole_s))
    assert gaps.intervals == ([] if outage is None else [(stamp + round(1e9 * outage[0]), stamp + round(1e9 * outage[1]))])


def test_dots_keep_their_density_and_what_sticks_out():
    rng = np.random.default_rng(3)
    x, y = np.arange(20_000.0), rng.normal(size=20_000)
    y[777] = 40.0
    kept_x, kept = thin_dots(x, y, 700)
    assert 777.0 in kept_x and len(kept) < 1400 and np.all(np.diff(kept_x) > 0.0)
    inner = np.histogram(kept, np.linspace(-2.0, 2.0, 9))[0]
    assert inner[3:5].min() > inner[[0, -1]].max(), "most lie in the middle, as in all of them"


def test_a_band_is_not_drawn_across_a_gap():
    t = np.array([0.0, 1.0, 2.0, 2.001, 90.0, 91.0])
    chart = time_chart("x", TimeAxis(0.0, 100.0), [Band(t, np.array([1.0, 1.0, 1.0, np.nan, 1.0, 1.0]), "#123456")])
    shape = next(part for part in chart.split("<path") if "#123456" in part)
    assert shape.count("M") == 2 and shape.count("z") == 2


def test_a_node_does_not_start_where_there_is_no_ros(monkeypatch, capsys):
    import importlib.util

    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "rclpy" else found(name, *rest))
    for job in (["run", "ins_gps"], ["up", "livermore"]):
        assert "rclpy is not installed: pip install '.[ros]'" in refused(capsys, *job)
    assert not list(Path().glob("recording*"))
