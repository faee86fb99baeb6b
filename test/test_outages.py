"""Losing GPS at every start of a flight: the copies fly as replays do, errors and their parts are those of the closed form."""

import dataclasses
import json
import math
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from replay_fakes import FakeSettings, FixFollower, flight

from lowcostnav_ros.base.measurements import GpsPosition
from lowcostnav_ros.base.plain import plain, typed
from lowcostnav_ros.cli.main import main
from lowcostnav_ros.messages.bag import BagReader
from lowcostnav_ros.physics.rotation import euler_to_quat
from lowcostnav_ros.replay.bag_replay import Cast, ReplayOptions, replay_bag
from lowcostnav_ros.replay.columns import blank_columns
from lowcostnav_ros.replay.links import Chain
from lowcostnav_ros.replay.runs import NavigatorRun
from lowcostnav_ros.replay.session import first_stamp
from lowcostnav_ros.replay.withhold import NS, Window, Withhold
from lowcostnav_ros.studies.aside import Aside
from lowcostnav_ros.studies.outages import study
from lowcostnav_ros.studies.outages.flight import Losses
from lowcostnav_ros.studies.outages.parts import parts_of
from lowcostnav_ros.studies.outages.result import End, Outage, OutageStudy, statistics_of
from lowcostnav_ros.studies.outages.study import Case, OutageError, Plan, StudyAlong, runs_of, study_outages

REFERENCE = Path(__file__).resolve().parent.parent / "bags" / "reference"
GPS = ("gps/fix", "gps/vel")


def bits(value):
    """Every number of a solution, to the last bit."""
    if dataclasses.is_dataclass(value):
        return tuple(bits(getattr(value, f.name)) for f in dataclasses.fields(value))
    if isinstance(value, dict):
        return tuple((key, bits(item)) for key, item in value.items())
    if isinstance(value, np.ndarray):
        return value.tobytes()
    return value.hex() if isinstance(value, float) else tuple(map(bits, value)) if isinstance(value, tuple) else value


def test_a_copy_flies_through_its_window_as_a_replay_from_the_start_does_to_the_bit(monkeypatch):
    start_s, length_s = 14.0, 12.0  # before the recording itself loses GPS at 20 s
    replayed = {}
    take = NavigatorRun.take
    monkeypatch.setattr(NavigatorRun, "take", lambda run, s: (replayed.setdefault(run.navigator.name, []).append(s), take(run, s))[1])
    replay_bag(REFERENCE, ReplayOptions(withhold=(Withhold(GPS, start_s, start_s + length_s),)))
    with BagReader(REFERENCE) as reader, BagReader(REFERENCE) as reference:
        cast = Cast(reader, reference, ReplayOptions())
        items = list(cast.stream())
        first_ns = first_stamp(items[0])
        starts = [first_ns + round(NS * s) for s in (start_s - 3.0, start_s, start_s + 3.0)]  # others fly at the same time
        windows = [Window(frozenset(GPS), s, s + round(NS * length_s), "") for s in starts]
        losses = list(Losses(Chain(cast.navigators, reader.decoder.rules), windows).fly(items))
    loss = next(one for one in losses if one.window == windows[1])
    assert {"ahrs", "dead_reckoning", "ins_gps", "supervisor"} <= set(loss.lost)
    for name, solutions in loss.lost.items():
        of_copy, of_replay = (
            [bits(s) for s in those if loss.window.start_ns <= s.stamp_ns < loss.window.end_ns] for those in (solutions, replayed[name])
        )
        assert len(of_copy) > 100
        assert of_copy == of_replay
        assert of_copy != [bits(s) for s in loss.kept[name] if loss.window.start_ns <= s.stamp_ns < loss.window.end_ns]


def motion(seconds, heading_deg, wind, airspeed, accelerated=0.0):
    """Columns of a flight at 10 Hz whose velocity is wind plus airspeed along the heading."""
    t = np.arange(0.0, seconds + 0.05, 0.1)
    heading = np.radians(heading_deg + 0.0 * t)
    speed = airspeed + accelerated * t
    vel = np.column_stack([wind[0] + speed * np.cos(heading), wind[1] + speed * np.sin(heading), 0.0 * t])
    q = np.array([euler_to_quat(0.0, 0.0, psi) for psi in heading])
    columns = blank_columns(np.round(t * NS).astype(np.int64), vel_n=vel, q_nb=q, wind_n=np.tile(np.array(wind, dtype=float), (len(t), 1)))
    return columns, t


def test_parts_of_a_wind_triangle_are_those_of_its_wrong_ingredients_and_add_up():
    true, t = motion(60.0, 90.0, (2.0, 1.0), 50.0)
    wrong, _ = motion(60.0, 93.0, (3.0, 1.0), 51.0)
    at_end = (wrong.vel_n - true.vel_n)[0, :2] * t[-1] + [4.0, 0.0]
    parts, circumstances = parts_of(wrong, true, np.array([4.0, 0.0]), at_end)
    towards = at_end / np.linalg.norm(at_end)
    assert sum(parts.values()) == pytest.approx(np.linalg.norm(at_end))
    assert parts["loss"] == pytest.approx(4.0 * towards[0])
    assert parts["wind"] == pytest.approx(60.0 * towards[0])
    assert parts["airspeed"] == pytest.approx(60.0 * (51.0 * math.cos(math.radians(3.0)) - 50.0) * towards[1])
    assert parts["heading"] == pytest.approx(-60.0 * 51.0 * math.sin(math.radians(3.0)) * towards[0])
    assert parts["rest"] == pytest.approx(0.0, abs=1e-9)
    assert circumstances["heading_error_deg"] == pytest.approx(3.0)
    assert circumstances["wind_change_mps"] == 0.0


def test_without_a_wind_the_parts_are_velocity_heading_and_the_rest():
    true, _ = motion(20.0, 0.0, (0.0, 0.0), 50.0, accelerated=0.5)
    wrong, _ = motion(20.0, 2.0, (1.0, 0.0), 50.0, accelerated=0.5)
    blind = dataclasses.replace(wrong, wind_n=np.full_like(wrong.wind_n, np.nan))
    at_end = np.array([0.0, 100.0])
    parts, circumstances = parts_of(blind, true, np.zeros(2), at_end)
    assert parts["velocity"] == pytest.approx(20.0 * 50.0 * math.sin(math.radians(2.0)))
    assert parts["heading"] == pytest.approx(0.5 * math.radians(2.0) * 20.0**2 / 2.0)
    assert sum(parts.values()) == pytest.approx(100.0)
    assert "wind_change_mps" not in circumstances


def outage(horizontal_m, sigma_m, silent=False):
    end = End(60.0, horizontal_m, 0.0, -3.0, horizontal_m, sigma_m, horizontal_m / sigma_m, None, None, {}, {})
    return Outage(0.0, 0.0, 0.0, 0.0, () if silent else (end,), (60.0,) if silent else (), (), ())


def test_statistics_count_what_ended_without_a_solution_as_not_survived():
    outages = (outage(100.0, 100.0), outage(400.0, 100.0), outage(1000.0, 1000.0), outage(0.0, 1.0, silent=True))
    found = statistics_of(outages, 60.0)
    assert (found.windows, found.silent, found.median_m, found.max_m, found.vertical_max_m) == (4, 1, 400.0, 1000.0, 3.0)
    assert found.share_within_half_mile == 0.5
    assert found.share_beyond_3_sigma == pytest.approx(1.0 / 3.0)
    assert found.error_over_sigma_rms == pytest.approx(math.sqrt(18.0 / 3.0))
    assert statistics_of(outages, 10.0) is None


def test_windows_stand_on_the_clock_each_of_the_greatest_length_that_fits():
    windows = Plan((10.0, 60.0), 20.0, 30.0, until_s=125.0).windows(5 * NS, 500 * NS, GPS)
    assert [((w.start_ns / NS) - 5.0, (w.end_ns - w.start_ns) / NS) for w in windows] == [(30, 60), (50, 60), (70, 10), (90, 10), (110, 10)]
    assert Plan((10.0,)).windows(0, 60 * NS, GPS) == []


def test_runs_of_windows_are_all_of_them_in_order_and_of_nearly_the_same_work():
    windows = Plan((60.0,), 13.0, 20.0).windows(0, 600 * NS, GPS)
    runs = runs_of(windows, 0, 3)
    assert [window for run in runs for window in run] == windows
    work_s = [run[-1].start_ns / NS + 60.0 * len(run) for run in runs]
    assert max(work_s) - min(work_s) < 80.0
    assert [len(run) for run in runs_of(windows[:1], 0, 3)] == [1, 0, 0]


def losses_over(items, every_s=10.0):
    first_ns = first_stamp(items[0])
    windows = Plan((5.0,), every_s, 0.0).windows(first_ns, items[-1].stamp_ns, ("gps/fix",))
    losses = Losses(Chain({"follower": FixFollower(FakeSettings())}), windows)
    return [round((loss.window.start_ns - first_ns) / NS) for loss in losses.fly(items)], len(windows)


def sensors(seconds):
    return [item for item in flight(seconds) if hasattr(item, "source")]


def test_gps_must_be_there_to_be_lost():
    steady, count = losses_over(sensors(100))
    assert steady == list(range(10, 100, 10))[: count - 1]
    first_ns = first_stamp(sensors(100)[0])
    gap = [m for m in sensors(100) if not (isinstance(m, GpsPosition) and 32 * NS <= m.stamp_ns - first_ns < 51 * NS)]
    assert [s for s in steady if s not in losses_over(gap)[0]] == [40, 50, 60]


def test_a_bad_stamp_costs_a_start_or_two():
    items = sensors(100)
    k = next(k for k, m in enumerate(items) if isinstance(m, GpsPosition) and m.stamp_ns - items[0].stamp_ns > 35 * NS)
    bad = [*items[:k], dataclasses.replace(items[k], stamp_ns=items[k].stamp_ns + 3600 * NS), *items[k + 1 :]]
    assert set(losses_over(items)[0]) - set(losses_over(bad)[0]) <= {40, 50}


def test_the_number_of_processes_changes_no_number_and_the_study_is_read_back():
    case = Case(REFERENCE, Plan((5.0, 10.0), 4.0, 15.0), ("ahrs", "dead_reckoning"))
    one, two = (study_outages(case, workers=workers) for workers in (1, 2))
    assert plain(one) == plain(two)
    assert [s.windows for s in one.flown[0].statistics] == [len(one.flown[0].outages), len(one.flown[0].ends(10.0))]
    assert "truth" in one.reference and one.withheld == GPS
    assert typed(OutageStudy, json.loads(json.dumps(plain(one)))) == one
    for _, end in one.flown[0].ends(10.0):
        assert sum(end.parts_m.values()) == pytest.approx(end.horizontal_m)
    with pytest.raises(OutageError, match="No outage of 60 s fits"):
        study_outages(Case(REFERENCE, Plan((60.0,)), ("ahrs",)), workers=1)


def test_a_study_along_a_replay_is_the_study_and_leaves_the_replay_as_it_is(monkeypatch):
    plan = Plan((5.0, 10.0), 4.0, 15.0)
    options, expected = ReplayOptions(("ahrs", "dead_reckoning")), None
    for places in (0, 2):  # windows flown here, or aside as they come
        monkeypatch.setattr(study, "room", lambda places=places: places)
        along = StudyAlong(plan)
        watched = replay_bag(REFERENCE, dataclasses.replace(options, watch=along.begin))
        expected = expected or plain(study_outages(Case(REFERENCE, plan, options.navigators), workers=1))
        assert plain(along.study()) == expected
    alone = replay_bag(REFERENCE, options)
    for name, one in alone.navigators.items():
        assert watched.navigators[name].fused == one.fused and watched.navigators[name].aids == one.aids
    refused = StudyAlong(Plan((60.0,)))
    replay_bag(REFERENCE, dataclasses.replace(options, watch=refused.begin))
    with pytest.raises(OutageError, match="No outage of 60 s fits"):
        refused.study()


def test_work_aside_gives_its_result_and_is_done_here_where_the_fork_is_killed():
    here = os.getpid()
    large = Aside(lambda: (os.getpid(), np.arange(1_000_000)), is_aside=True)
    killed = Aside(lambda: os.getpid() if os.getpid() == here else os.kill(os.getpid(), signal.SIGKILL), is_aside=True)
    failing = Aside(lambda: 1 // (os.getpid() == here), is_aside=True)
    plain_call = Aside(os.getpid, is_aside=False)
    pid, numbers = large.result()
    assert pid != here and numbers[-1] == 999_999
    assert killed.result() == plain_call.result() == here and not plain_call.is_running
    assert failing.result() == 1


def test_the_command_writes_table_page_and_numbers_and_refuses_in_a_sentence(tmp_path, capsys):
    arguments = ["outages", str(REFERENCE), "--navigators", "ins_gps", "--length", "5,10", "--every", "8", "--after", "15"]
    assert main([*arguments, "--out", str(tmp_path / "o")]) == 0
    shown = capsys.readouterr().out
    assert "ins_gps" in shown and "worst of 10 s" in shown
    page = (tmp_path / "o" / "outages.html").read_text()
    assert page.count("<svg") >= 5 and "Error over sigma where GPS was lost" in page
    assert json.loads((tmp_path / "o" / "outages.json").read_text())["flown"][0]["navigator"] == "ins_gps"
    assert main([*arguments, "--withhold", "gps/fxi"]) == 2
    assert "did you mean 'gps/fix'" in capsys.readouterr().err
    assert main(["outages", str(REFERENCE), "--length", "ten"]) == 2
    assert "is no number" in capsys.readouterr().err
