"""Faults: what each does to a stream in closed form, and what the study makes of a few of them."""

import json
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

from lowcostnav_ros.base.measurements import (
    AirVelocity,
    GnssEpoch,
    GpsPosition,
    GpsVelocity,
    ImuBlock,
    MagneticField,
    NavSolution,
    Pressure,
    SlantRange,
    VorBearing,
)
from lowcostnav_ros.base.units import KNOT
from lowcostnav_ros.cli.main import main
from lowcostnav_ros.physics.earth import difference_n
from lowcostnav_ros.simulation.fault import FAULTS, OUTAGE_S, arrivals, inject
from lowcostnav_ros.studies.faults.flight import CHAIN, Pass, concerned, crew, flown, suppliers
from lowcostnav_ros.studies.faults.judge import Verdict
from lowcostnav_ros.studies.faults.study import chosen, study

START_NS = 1_780_336_800_000_000_000
SECOND = 1_000_000_000
EYE = np.eye(3)


def made(source: str, k: int):
    """Measurement ``k`` of a source, one a second, its values counting."""
    stamp = START_NS + k * SECOND
    return {
        "imu/data_raw": lambda: ImuBlock.of(
            source, stamp + np.array([-SECOND // 2, 0]), np.full((2, 3), 1.0 + k), np.full((2, 3), 0.1 * k)
        ),
        "imu/mag": lambda: MagneticField(stamp, source, np.array([2e-5 + 1e-8 * k, 1e-6, 4e-5]), 1e-14 * EYE),
        "air/velocity": lambda: AirVelocity(stamp, source, np.array([50.0, 0.0, 0.0]), EYE),
        "air/static_pressure": lambda: Pressure(stamp, source, 90_000.0 - 10.0 * k, 4.0),
        "gps/fix": lambda: GpsPosition(stamp, source, 0.65, -2.1, 900.0 + k, 4.0 * EYE),
        "gps/vel": lambda: GpsVelocity(stamp, source, np.array([40.0, 30.0 + 0.1 * k, 1.0]), 0.01 * EYE),
        "dme/range": lambda: SlantRange(stamp, source, ("OAK", "SJC")[k % 2], 30_000.0 + k, 1e4),
        "vor/bearing": lambda: VorBearing(stamp, source, "OAK", 6.0, 1e-4),
        "gnss/raw": lambda: GnssEpoch(
            *(
                stamp,
                source,
                np.array(["G", "G"]),
                np.array([3, 8]),
                np.array([2.1e7, 2.2e7]),
                np.zeros(2),
                np.full(2, 5.0),
                np.full(2, 0.2),
            ),
            *(np.full(2, 45.0), np.zeros((2, 3)), np.zeros((2, 3)), np.ones(2, bool), np.ones(2, bool)),
        ),
    }[source]()


def stream(*sources: str, seconds: int = 240):
    return arrivals([made(source, k) for k in range(seconds) for source in sources])


def with_fault(name: str, *sources: str):
    """The sound stream of the sources of a fault, and what arrives with it, within its window."""
    fault = FAULTS[name]
    sound = stream(*(sources or fault.sources))
    window = START_NS + round(1e9 * fault.start_s), START_NS + round(1e9 * min(fault.end_s, 1e4))
    changed = inject(sound, fault, seed=3)
    inside = [[a.measurement for a in s if window[0] <= a.at_ns < window[1]] for s in (sound, changed)]
    outside = [[a for a in s if not window[0] <= a.at_ns < window[1]] for s in (sound, changed)]
    return *inside, outside


@pytest.mark.parametrize("name", [name for name in FAULTS if not name.startswith("nothing")])
def test_a_fault_changes_its_sources_within_its_window_alone(name):
    fault = FAULTS[name]
    sources = dict.fromkeys([*fault.sources, "gps/fix", "air/static_pressure", "imu/mag"])
    sound = stream(*sources)
    out = inject(sound, fault, seed=3)
    start_ns, end_ns = (START_NS + round(1e9 * s) for s in (fault.start_s, fault.end_s))
    lost_ns = [START_NS + round(1e9 * s) for s in OUTAGE_S]
    kept = {id(a) for a in out}
    for a in sound:
        lost = fault.outage and a.measurement.source.startswith(("gps/", "gnss/")) and lost_ns[0] <= a.at_ns < lost_ns[1]
        hit = a.measurement.source in fault.sources and start_ns <= a.at_ns < end_ns
        assert lost or hit or id(a) in kept
    assert [a.at_ns for a in out] == sorted(a.at_ns for a in out)
    before = {id(a.measurement) for a in sound}
    assert fault.imitates and (len(out) < len(sound) or any(id(a.measurement) not in before for a in out) or _moved(sound, out))
    assert [a.measurement.stamp_ns for a in inject(sound, fault, seed=3)] == [a.measurement.stamp_ns for a in out]


def _moved(sound, out) -> bool:
    """Whether arrival alone has changed: a message comes twice, late or in another order."""
    return [(a.at_ns, id(a.measurement)) for a in sound] != [(a.at_ns, id(a.measurement)) for a in out]


def test_stuck_repeats_the_value_with_new_stamps_and_frozen_the_stamps_too():
    sound, now, _ = with_fault("gps_stuck")
    assert [m.stamp_ns for m in now] == [m.stamp_ns for m in sound]
    assert {m.height for m in now if isinstance(m, GpsPosition)} == {980.0}
    _, now, _ = with_fault("gps_frozen")
    assert {m.stamp_ns for m in now} == {START_NS + 80 * SECOND}
    _, now, _ = with_fault("imu_stuck")
    assert all(np.all(m.specific_force_b == 81.0) for m in now) and len({m.stamp_ns for m in now}) == 60
    _, now, _ = with_fault("dme_stuck")
    assert {(m.station, m.range_m) for m in now} == {("OAK", 30_080.0), ("SJC", 30_081.0)}


def test_dropped_thinned_repeated_and_held_up():
    sound, now, outside = with_fault("dme_dropped")
    assert now == [] and outside[0] == outside[1]
    _, now, _ = with_fault("imu_thinned")
    assert 60 < sum(len(m) for m in now) < 105  # 120 samples less 30 %
    sound, now, _ = with_fault("air_repeated")
    assert len(now) == 2 * len(sound) and now[0] is now[1]
    changed = inject(stream("air/velocity"), FAULTS["air_burst"], 3)
    assert {a.at_ns - START_NS for a in changed if a.at_ns != a.measurement.stamp_ns} <= {k * SECOND for k in range(82, 142, 2)}
    late = [a.at_ns - a.measurement.stamp_ns for a in inject(stream("air/velocity"), FAULTS["air_reordered"], 3)]
    assert min(late) >= 0 and 0.2 * SECOND < max(late) <= 0.3 * SECOND
    _, now, _ = with_fault("air_stepping")
    assert len({id(m.vel_b) for m in now}) == 30


def test_values_ramp_jump_double_change_sign_and_saturate():
    sound, now, _ = with_fault("static_ramp")
    assert [n.pressure_pa - s.pressure_pa for n, s in zip(now, sound, strict=True)] == pytest.approx([10.0 * k for k in range(60)])
    sound, now, _ = with_fault("gps_fix_jump")
    moved = [difference_n(n.lat, n.lon, n.height, s.lat, s.lon, s.height) for n, s in zip(now, sound, strict=True)]
    assert np.allclose(moved, [40.0, 30.0, 0.0], atol=1e-6)
    sound, now, _ = with_fault("imu_gyro_x2")
    assert all(np.array_equal(n.angular_rate_b, 2.0 * s.angular_rate_b) for n, s in zip(now, sound, strict=True))
    assert all(np.array_equal(n.specific_force_b, s.specific_force_b) for n, s in zip(now, sound, strict=True))
    _, now, _ = with_fault("imu_accel_saturated")
    assert all(np.all(m.specific_force_b == 10.0) for m in now)
    sound, now, _ = with_fault("mag_sign")
    assert np.array_equal(now[0].field_b, -sound[0].field_b)
    sound, now, _ = with_fault("air_in_knots")
    assert now[0].vel_b[0] == pytest.approx(50.0 / KNOT)


def test_a_spike_is_one_sample_of_one_component():
    sound, now, _ = with_fault("imu_gyro_spike_large")
    differ = [np.argwhere(n.angular_rate_b != s.angular_rate_b) for n, s in zip(now, sound, strict=True)]
    assert sum(len(d) for d in differ) == 1
    assert max(np.max(n.angular_rate_b - s.angular_rate_b) for n, s in zip(now, sound, strict=True)) == pytest.approx(np.radians(150.0))


def test_axes_are_exchanged_and_turned():
    sound, now, _ = with_fault("mag_ned_for_enu")
    x, y, z = sound[0].field_b
    assert now[0].field_b.tolist() == [y, x, -z]
    _, now, _ = with_fault("mag_turned_90")
    assert now[0].field_b.tolist() == [-y, x, z]
    _, now, _ = with_fault("mag_frd_for_flu_always")
    assert len(now) == 240 and now[0].field_b[2] == -sound[0].field_b[2]
    sound, now, _ = with_fault("gps_fix_lat_lon_exchanged")
    assert (now[0].lat, now[0].lon) == (sound[0].lon, sound[0].lat)


@pytest.mark.parametrize(("name", "by_s"), [("plus_1_s", 1), ("minus_18_s", -18), ("plus_1_h", 3600), ("minus_1024_weeks", -1024 * 604800)])
def test_a_wrong_clock_moves_stamps_and_not_arrival(name, by_s):
    for source in ("imu", "gps", "dme"):
        fault = FAULTS[f"{source}_clock_{name}"]
        sound, changed = stream(*fault.sources), inject(stream(*fault.sources), fault, 3)
        assert [a.at_ns for a in sound] == [a.at_ns for a in changed]
        shifts = {round((b.measurement.stamp_ns - a.measurement.stamp_ns) / SECOND) for a, b in zip(sound, changed, strict=True)}
        assert shifts == {0, by_s}


def test_latency_that_nobody_declared_and_a_clock_that_drifts():
    changed = inject(stream("dme/range"), FAULTS["dme_late"], 3)
    late = [a for a in changed if a.at_ns % SECOND]
    assert len(late) == 60 and all(a.at_ns == a.measurement.stamp_ns and a.at_ns % SECOND == 300_000_000 for a in late)
    sound, now, _ = with_fault("imu_clock_drift")
    assert now[-1].stamp_ns - sound[-1].stamp_ns == pytest.approx(239e9 * 1e-4)


def test_pitot_static_port_and_ice_follow_the_physics():
    _, now, _ = with_fault("pitot_blocked_in_climb", "air/velocity", "air/static_pressure")
    speeds = [m.vel_b[0] for m in now if isinstance(m, AirVelocity)]
    # the total pressure stays, the static one falls by 10 Pa a second
    assert speeds[10] == pytest.approx(np.sqrt(50.0**2 + 2.0 * 100.0 / 1.1), rel=1e-9)
    _, now, _ = with_fault("static_port_blocked")
    assert len({m.pressure_pa for m in now if isinstance(m, Pressure)}) == 1
    _, now, _ = with_fault("pitot_iced_in_cruise")
    assert now[0].vel_b[0] == 50.0 and now[30].vel_b[0] == pytest.approx(25.0) and now[-1].vel_b[0] == 0.0


def test_radio_satellites_and_magnetic_loads():
    sound, now, _ = with_fault("dme_wrong_station")
    assert [m.station for m in now] == [{"OAK": "SJC", "SJC": "OAK"}[m.station] for m in sound]
    _, now, _ = with_fault("vor_plus_90")
    assert now[0].bearing_rad == pytest.approx((6.0 + np.pi / 2.0) % (2.0 * np.pi))
    sound, now, _ = with_fault("gps_spoofed_2_mps")
    fixes = [(n, s) for n, s in zip(now, sound, strict=True) if isinstance(n, GpsPosition)]
    moved = [difference_n(n.lat, n.lon, n.height, s.lat, s.lon, s.height)[0] for n, s in fixes]
    assert moved[5] == pytest.approx(2.5) and moved[59] == pytest.approx(2.0 * 59 - 10.0)  # place is the integral of the velocity
    speeds = [n.vel_n[0] - s.vel_n[0] for n, s in zip(now, sound, strict=True) if isinstance(n, GpsVelocity)]
    assert speeds[5] == pytest.approx(1.0) and speeds[-1] == pytest.approx(2.0)
    _, now, _ = with_fault("gps_fix_rank_one")
    assert np.linalg.matrix_rank(now[0].cov_n) == 1
    sound, now, _ = with_fault("gnss_satellite_jump")
    assert (now[0].pseudorange_m - sound[0].pseudorange_m).tolist() == [100.0, 0.0]
    sound, now, _ = with_fault("mag_load_switches")
    on = [bool(np.any(n.field_b != s.field_b)) for n, s in zip(now, sound, strict=True)]
    assert on[:16] == [True, True, True, False, False, False, False, False] * 2


def test_faults_are_chosen_by_name_and_pattern(capsys):
    assert chosen(["gps_stuck"]) == ["gps_stuck"] and len(chosen(["pitot_*"])) == 14 and len(chosen()) == len(FAULTS)
    assert main(["faults", "--fault", "gps_stuk"]) == 2 and "did you mean 'gps_stuck'" in capsys.readouterr().err
    assert main(["faults", "--navigator", "ins", "--quick"]) == 2 and "ins_gps" in capsys.readouterr().err
    assert main(["faults", "--list", "--fault", "dme_x2"]) == 0 and "dme_x2" in capsys.readouterr().out


def test_who_is_reached_by_what():
    assert suppliers("supervisor")[0] == "supervisor" and set(suppliers("supervisor")) == {
        "supervisor",
        "ins_gps",
        "dead_reckoning",
        "ahrs",
    }
    assert concerned(("gnss/raw",)) == ["ins_gnss", "gnss_only", "ins_gnss_loose"]
    assert concerned(("vor/bearing",)) == ["dead_reckoning", "supervisor"] and crew(["dead_reckoning"]) == ["ahrs", "dead_reckoning"]
    assert concerned(("imu/data_raw",)) == [name for name in CHAIN if name != "gnss_only"]


def test_a_fault_flown_from_a_copy_is_the_fault_flown_from_the_start():
    fault = FAULTS["gnss_range_jump"]
    copied = flown(1, fault, False, ["gnss_only"]).records["gnss_only"]
    early = replace(fault, start_s=79.999, change=fault.change)  # before the copy is made, and yet the same epochs
    whole = flown(1, early, False, ["gnss_only"]).records["gnss_only"]
    assert [p.refused for p in copied.polls] == [p.refused for p in whole.polls]
    assert np.array_equal(copied.track().horizontal_m, whole.track().horizontal_m)


@pytest.mark.parametrize(("stamp_s", "means_s"), [(99.8, 99.8), (102.8, 99.8), (101.5, None), (96.0, None)])
def test_a_solution_on_a_clock_that_was_set_is_of_the_moment_at_which_it_showed_its_stamp(stamp_s, means_s):
    on_its_way = SimpleNamespace(fault=FAULTS["all_clocks_plus_3_s"], _now_ns=100 * SECOND)
    meant = Pass._meant(on_its_way, NavSolution(round(1e9 * stamp_s), "ins_gps"))
    assert (meant and 1e-9 * meant.stamp_ns) == (means_s and pytest.approx(means_s))


def test_the_study_judges_names_and_writes(tmp_path, capsys):
    rows = study(["nothing", "gnss_dropped", "gnss_satellite_jump", "gnss_clock_plus_1_h"], ["gnss_only"], workers=1)
    sound, silent, excluded, refused = rows
    assert sound.verdict == Verdict.HARMLESS and not sound.sentence and sound.worst_m == sound.healthy_worst_m
    assert silent.verdict == Verdict.SILENT and silent.silent_s == pytest.approx(60.0, abs=1.5)
    assert excluded.named_s is not None and excluded.named_s < 3.0 and "excluded" in excluded.sentence
    assert excluded.worst_m < 10.0 and excluded.beyond == 0.0 and excluded.verdict in (Verdict.HARMLESS, Verdict.SOUND)
    assert refused.detected_s is not None and "time base jumped" in refused.sentence  # of a lone source nobody can tell more
    assert all(row.healthy_worst_m < 5.0 and row.healthy_sigmas < 4.0 for row in rows)
    saved = tmp_path / "faults.json"
    saved.write_text(json.dumps([asdict(row) for row in rows]))
    options = ["faults", "--read", str(saved), "--out", str(tmp_path / "out"), "--docs", str(tmp_path / "faults.md")]
    assert main(options) == 0 and "gnss_satellite_jump" in capsys.readouterr().out
    page = (tmp_path / "out" / "faults.html").read_text()
    assert page.count("<rect") == 4 and "gnss_dropped" in page
    assert "| gnss_dropped | gnss_only | silent |" in (tmp_path / "faults.md").read_text()


def test_a_file_of_something_else_is_refused_in_a_sentence(tmp_path, capsys):
    (tmp_path / "other.json").write_text('{"a": 1}')
    assert main(["faults", "--read", str(tmp_path / "other.json")]) == 2
    assert "holds no results" in capsys.readouterr().err


def test_a_fault_flies_over_the_middleware_and_its_recording_replays_to_the_bit(tmp_path, monkeypatch):
    pytest.importorskip("rclpy")
    from lowcostnav_ros.graph import faults
    from lowcostnav_ros.graph.faults import NAVIGATORS

    soon = replace(FAULTS["gps_stuck"], start_s=40.0)  # so that the flight is short
    monkeypatch.setattr(faults, "FAULTS", {"gps_stuck": soon})
    rows = faults.fly_live("gps_stuck", tmp_path / "live", until_s=60.0)
    assert [row.navigator for row in rows] == [name for name in CHAIN if name in NAVIGATORS]
    assert all(row.solutions > 300 and row.equal for row in rows)
    ins = next(row for row in rows if row.navigator == "ins_gps")
    assert ins.named_s is not None and ins.named_s < 20.0 and "gps/" in ins.sentence
