"""Observability along a run: known ranks, shares of states, units, the watch that changes nothing, the command."""

import dataclasses
import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lowcostnav_ros.aids.gnss import GnssSettings
from lowcostnav_ros.catalogue.config_files import config_dir
from lowcostnav_ros.catalogue.equipment import load_imu_profile
from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.cores.imu_errors import imu_settings
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.navigators.gnss_only import GnssOnly, GnssOnlySettings
from lowcostnav_ros.navigators.ins_gnss import InsGnss
from lowcostnav_ros.report.observability import drawings
from lowcostnav_ros.reproduce.solimeno.flights import Case, epochs_of, fed, imu_of, inertial_settings, started, truth_of
from lowcostnav_ros.reproduce.solimeno.observability import flown_ranks, layout_of, true_dynamics, true_ranks
from lowcostnav_ros.studies.observability import Watch, geodetic_units, observability

CASE = Case("tight", "HD", "mems", 1, duration_s=20.0)


def test_a_position_measurement_tells_velocity_and_not_a_state_apart():
    F = np.zeros((3, 3))
    F[0, 1] = 1.0  # position grows with velocity; the third state is on its own
    found = observability(5, F, np.array([[1.0, 0.0, 0.0]]))
    assert (found.rank, found.rows, found.stamp_ns) == (2, 1, 5)
    assert found.share == pytest.approx([1.0, 1.0, 0.0])
    assert found.singular_values == pytest.approx([1.0, 1.0, 0.0])


def test_the_page_draws_ranks_and_the_share_of_every_state():
    F = np.zeros((3, 3))
    F[0, 1] = 1.0
    rows = np.array([[1.0, 0.0, 0.0]])
    found = [observability(k * 10**9, F, rows if k % 4 else np.empty((0, 3))) for k in range(8)]
    drawn = "".join(drawings(("place", "speed", "bias"), found))
    root = ET.fromstring(f"<div>{drawn}</div>")
    assert [chart.get("aria-label").partition(" ")[0] for chart in root] == ["Rank", "Singular", "Share"]
    assert all(f">{name}</text>" in drawn for name in ("place", "speed", "bias")) and drawn.count("place: 1.00 from") == 2


def test_without_measurements_nothing_is_told():
    assert observability(0, np.eye(4), np.empty((0, 4))).rank == 0


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000), n=st.integers(2, 7), m=st.integers(1, 3))
def test_rank_of_a_chain_of_integrators_is_its_length_in_any_turned_axes(seed, n, m):
    """Only the last k of a chain are told by measuring the first; turning the axes must not change that."""
    rng = np.random.default_rng(seed)
    k = int(rng.integers(1, n + 1))
    F = np.zeros((n, n))
    F[np.arange(k - 1), np.arange(1, k)] = 1.0
    H = np.zeros((m, n))
    H[:, 0] = rng.uniform(1.0, 2.0, m)
    turn, _ = np.linalg.qr(rng.normal(size=(n, n)))
    assert observability(0, turn @ F @ turn.T, H @ turn.T).rank == k


def test_change_of_units_is_a_similarity():
    """Rank in exact arithmetic does not see units; here a well-scaled system, so that neither does the tolerance."""
    rng = np.random.default_rng(2)
    F, H, units = rng.normal(size=(4, 4)), rng.normal(size=(1, 4)), np.array([2.0, 0.5, 3.0, 1.0])
    T = np.diag(units)
    a, b = observability(0, F, H, units), observability(0, T @ F @ np.linalg.inv(T), H @ np.linalg.inv(T))
    assert a.rank == b.rank == 4
    assert a.singular_values == pytest.approx(b.singular_values)
    assert geodetic_units(0.0, 0.0, 4) == pytest.approx([1 / 6335439.327, 1 / 6378137.0, -1.0, 1.0])


def test_watching_changes_no_bit_and_gives_the_published_rank():
    truth, profile = truth_of("HD", 20.0), load_imu_profile("mems")
    ends, found = [], []
    for watched in (False, True):
        navigator = started(InsGnss(inertial_settings(CASE, imu_settings(profile.filter_noise()))), truth, CASE)
        watch = Watch(navigator, 1.0) if watched else None
        fed(navigator, imu_of(profile, truth, 1), epochs_of(CASE, truth))
        ends.append((navigator.core.nav.copy(), navigator.P.copy()))
        found = watch.finish() if watch else []
    assert np.array_equal(ends[0][0], ends[1][0]) and np.array_equal(ends[0][1], ends[1][1])
    assert 19 <= len(found) <= 21
    assert {o.rank for o in found} <= set(range(16, 20))
    assert all(o.rows >= 12 for o in found)
    assert np.mean([o.share[:6] for o in found]) > 0.99  # position and velocity are always told


def test_flown_ranks_the_loose_filter():
    t_s, ranks = flown_ranks(Case("loose", "HD", "mems", 1, duration_s=20.0))
    assert len(t_s) >= 3
    assert set(ranks.tolist()) <= {15, 16, 17}


def test_ranks_at_the_true_state_fall_with_the_satellites_and_differ_by_axis_times():
    moving, uniform = (true_ranks(Case("tight", name, duration_s=60.0))[1] for name in ("LD", "STR"))
    assert len(moving) == 12
    assert moving.mean() > uniform.mean() == 17.0
    case = Case("tight", "LD", duration_s=60.0)
    truth, layout = truth_of("LD", 60.0), layout_of(case)
    nav, F = true_dynamics(truth, 500, layout)
    assert nav[3:6] == pytest.approx(truth.vel_n[500])
    assert -1.0 / np.diag(F)[layout["accel_drift"]] == pytest.approx([227.0, 211.0, 365.0])
    assert true_ranks(Case("loose", "LD", duration_s=20.0))[1].max() <= 17


@pytest.fixture
def bag(tmp_path):
    truth, profile = truth_of("LD", 20.0), load_imu_profile("mems")
    block, epochs = imu_of(profile, truth, 1), epochs_of(Case("tight", "LD", "mems", 1, duration_s=20.0), truth)
    records = [r for m in (block, *epochs) for r in encode_cdr(m)]
    with BagWriter(tmp_path / "flight") as writer:
        for stamp, topic, msgtype, raw in sorted(records, key=lambda r: r[0]):
            writer.write(topic, msgtype, stamp, raw)
    return tmp_path / "flight"


def test_the_command_prints_ranks_and_writes_them(bag, tmp_path, capsys):
    assert cli.main(["observability", str(bag), "--navigator", "ins_gnss", "--period", "2", "--json", str(tmp_path / "o.json")]) == 0
    out = capsys.readouterr().out
    assert "of 23 at single instants" in out and "Weakly observable within an instant" in out
    written = json.loads((tmp_path / "o.json").read_text())
    assert len(written["states"]) == 23
    assert all(len(i["singular_values"]) == 23 and 10 <= i["rank"] <= 20 for i in written["instants"])


@pytest.mark.parametrize(("model", "size", "told"), [("pv", 8, 8), ("pva", 11, 11)])
def test_satellites_alone_tell_every_state_with_four_and_fewer_with_two(model, size, told):
    """Ranges tell position and clock, their growth velocity and drift, their curvature the acceleration, along each line of sight."""
    found = {}
    for satellites in (8, 2):
        navigator = GnssOnly(GnssOnlySettings(model=model, minimum_satellites=2, gnss=GnssSettings(doppler=False)))
        watch = Watch(navigator, 1.0)
        epochs = epochs_of(Case(model, "LD", "", 1, duration_s=20.0), truth_of("LD", 20.0))
        for k, epoch in enumerate(epochs):
            navigator.feed(epoch if k < 20 else shortened(epoch, satellites))
        found[satellites] = watch.finish()[-1]
    assert found[8].rank == told and found[8].share == pytest.approx(np.ones(size))
    assert (found[2].rank, found[2].rows) == ({"pv": 4, "pva": 6}[model], 2)


def shortened(epoch, satellites):
    """The first few satellites of an epoch."""
    columns = {f.name: getattr(epoch, f.name) for f in dataclasses.fields(epoch)}
    return dataclasses.replace(epoch, **{n: v[:satellites] for n, v in columns.items() if isinstance(v, np.ndarray)})


def test_the_command_takes_every_navigator_with_a_filter_of_its_own(bag, capsys):
    assert cli.main(["observability", str(bag), "--navigator", "gnss_only", "--period", "2"]) == 0
    assert "gnss_only: rank" in capsys.readouterr().out
    for name, sentence in (("ahrs", "takes position"), ("supervisor", "no filter of its own"), ("gnss_onli", "did you mean 'gnss_only'")):
        assert cli.main(["observability", str(bag), "--navigator", name]) == 2
        assert sentence in capsys.readouterr().err


def test_dead_reckoning_on_the_reference_flight(capsys, tmp_path):
    """The recording has no attitude of its own, so the attitude reference runs beside; fixes and velocities tell position and wind."""
    reference = str(config_dir().parent / "bags" / "reference")
    out = tmp_path / "o.json"
    options = ["--navigator", "dead_reckoning", "--period", "1", "--ranges", "300", "--json", str(out)]
    assert cli.main(["observability", reference, *options]) == 0
    written = json.loads(out.read_text())
    assert "position, of 2" in capsys.readouterr().out
    (window,) = written["range_windows"]
    assert window["ranges"] == 3  # of two stations, one at a time: as many unknowns as ranges, position and one direction of the wind
    assert window["ranks"] == [2, 3, 3]
    assert written["instants"][0]["operations"] > 50_000
    by_rows = {i["rows"]: i for i in written["instants"]}
    names = ("position_north_m", "wind_variation_north_mps", "wind_mean_north_mps")
    north, variation, mean = (written["states"].index(name) for name in names)
    assert by_rows[6]["share"][north] > 0.99 > by_rows[1]["share"][north]
    assert by_rows[6]["share"][variation] + by_rows[6]["share"][mean] > 0.9  # the wind is told; what of it lasts takes time
    assert by_rows[1]["rank"] < by_rows[6]["rank"] < len(written["states"])


def test_the_command_refuses_in_a_sentence(bag, capsys):
    assert cli.main(["observability", str(bag), "--period", "0"]) == 2
    assert cli.main(["observability", str(bag), "--ranges", "0"]) == 2
    assert "--period must be above 0" in capsys.readouterr().err
    assert cli.main(["observability", str(bag), "--navigator", "ins_gps"]) == 2
    assert "gps/fix" in capsys.readouterr().err
