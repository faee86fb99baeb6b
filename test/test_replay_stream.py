"""Replays of streams and bags with navigators whose errors are known in closed form."""

import csv
import json
import math

import numpy as np
import pytest
from replay_fakes import REGISTRY, SPEED, FakeAhrs, FakeSettings, FixFollower, Listener, flight, truth, write_bag, write_config

from lowcostnav_ros.base.measurements import Attitude, ImuBlock, NavSolution
from lowcostnav_ros.base.plain import plain
from lowcostnav_ros.estimation.aiding import AidStatus, Reason
from lowcostnav_ros.messages import encode
from lowcostnav_ros.navigators.base import HorizonSettings
from lowcostnav_ros.navigators.registry import NAVIGATORS
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
from lowcostnav_ros.replay.columns import columns_of, concatenate
from lowcostnav_ros.replay.digest import Comparison, imu_record, odometry_record
from lowcostnav_ros.replay.evaluation import Evaluation, Truth
from lowcostnav_ros.replay.links import in_order
from lowcostnav_ros.replay.outages import GpsGaps
from lowcostnav_ros.replay.result_files import SOLUTION_HEADER, seconds_text
from lowcostnav_ros.replay.runs import AidStatistics
from lowcostnav_ros.replay.selection import Selection, SelectionError, select, spared
from lowcostnav_ros.replay.session import Session, replay_stream, simulated
from lowcostnav_ros.replay.withhold import parse_withhold

NS = 1_000_000_000
GPS_OFF = (parse_withhold("gps/fix,gps/vel@5-12"),)
EVERY = 0.1


def _rms_of_holding(seconds, rate_hz=10.0, first=0.05):
    """RMS distance flown since the last fix, for the fake's 10 Hz solutions at x.05, x.15, ..."""
    t = first + np.arange(round(seconds * rate_hz)) / rate_hz
    return math.sqrt(np.mean((SPEED * (t % 1.0)) ** 2))


def test_errors_against_truth_are_those_of_the_closed_form():
    found = plain(replay_stream(flight(20), {"follower": FixFollower(FakeSettings(north_bias_m=3.0))}).navigator("follower"))
    flight_errors = found["errors"]["flight"]
    assert flight_errors["samples"] == found["solutions"] == 200
    assert flight_errors["horizontal_m"]["rms"] == pytest.approx(math.hypot(_rms_of_holding(20), 3.0), rel=1e-3)
    assert flight_errors["horizontal_m"]["max"] == pytest.approx(math.hypot(0.95 * SPEED, 3.0), rel=1e-3)
    assert flight_errors["error_over_sigma"]["north_m"] == pytest.approx(3.0 / 5.0, rel=1e-3)
    assert flight_errors["velocity_mps"]["max"] == pytest.approx(0.0, abs=1e-3)
    assert found["errors"]["without_gps"] is None
    aid = found["aids"]["gps_position"]
    assert aid["innovation_rms"] == {"north_m": 3.0, "east_m": 4.0, "down_m": 0.0}
    always_the_same = (aid["tested"] - 1) / aid["tested"]
    assert aid["innovation_correlation"] == pytest.approx({"north_m": always_the_same, "east_m": always_the_same, "down_m": 0.0})


def test_a_withheld_window_grows_the_error_as_the_aircraft_flies_on():
    result = replay_stream(flight(20), {"follower": FixFollower(FakeSettings())}, GPS_OFF)
    (window,) = plain(result.navigator("follower"))["errors"]["windows"]
    assert (window["start_s"], window["end_s"]) == (105.0, 112.0)
    assert window["error_at_end"]["t_s"] == pytest.approx(111.95)
    assert window["error_at_end"]["east_m"] == pytest.approx(-7.95 * SPEED, rel=1e-3)
    assert result.summary["without_gps"]["intervals_s"] == [[107.0, 112.0]]
    assert plain(result.navigator("follower"))["errors"]["without_gps"]["samples"] == 50


def test_without_truth_the_withheld_fixes_are_the_reference():
    items = list(flight(20, with_truth=False))
    errors = plain(replay_stream(items, {"follower": FixFollower(FakeSettings())}, GPS_OFF).navigator("follower"))["errors"]
    assert errors["reference"] == "withheld gps"
    flown = SPEED * np.arange(1.0, 8.0)  # the fix of second 4 is held; fixes of 5 to 11 are the reference, solutions interpolated to them
    assert errors["withheld_gps"]["horizontal_m"]["max"] == pytest.approx(flown.max(), rel=1e-3)
    assert errors["withheld_gps"]["horizontal_m"]["rms"] == pytest.approx(math.sqrt(np.mean(flown**2)), rel=1e-3)
    assert errors["withheld_gps"]["samples"] == 14  # 7 positions and 7 velocities


def test_navigators_hear_each_other_by_message_and_in_order():
    listener = Listener(FakeSettings(HorizonSettings(lag_s=0.25)))
    navigators = {"listener": listener, "follower": FixFollower(FakeSettings()), "ahrs": FakeAhrs(FakeSettings())}
    assert in_order(navigators).index("listener") == 2
    replay_stream(flight(5), navigators)
    attitudes = [m for m in listener.heard if isinstance(m, Attitude)]
    odometries = [m for m in listener.heard if isinstance(m, NavSolution)]
    assert {m.source for m in attitudes} == {"imu/data_fused"} and {m.source for m in odometries} == {"follower/odometry_fused"}
    # 10 Hz from 100.05 s; the newest heard is 104.95 s, the listener judges 0.25 s behind it: up to 104.65 s
    said = FakeAhrs(FakeSettings())._solution(attitudes[0].stamp_ns).q_nb
    assert len(attitudes) == 47 and np.allclose(attitudes[0].q_nb, said, atol=1e-12)
    assert odometries[0].lat == pytest.approx(truth(0.0).lat[0], abs=1e-12)
    assert listener.input_status["imu/data_fused"].rejected == {}


def test_recorded_output_of_a_running_navigator_is_not_fed(tmp_path):
    level = np.array([1.0, 0, 0, 0]), np.eye(3), np.zeros(3), np.zeros(3)
    foreign = [Attitude(100 * NS + k * NS // 2, "imu/data_fused", *level) for k in range(8)]
    bag, config = write_bag(tmp_path / "bag", [*flight(5), *foreign]), write_config(tmp_path)
    with_ahrs = plain(replay_bag(bag, ReplayOptions(("ahrs", "listener"), config, registry=REGISTRY)).navigator("listener"))
    alone = plain(replay_bag(bag, ReplayOptions(("listener",), config, registry=REGISTRY)).navigator("listener"))
    assert with_ahrs["inputs"]["imu/data_fused"]["received"] == 50
    assert alone["inputs"]["imu/data_fused"]["received"] == 8


def _recorded(bag_items, name="follower", change=None):
    """Fused messages of a first pass, as an aircraft would have recorded them."""
    navigator = FixFollower(FakeSettings())
    out = []
    for item in bag_items:
        for solution in navigator.feed(item):
            message = encode.odometry_from_solution(solution, navigator.origin)
            if change is not None:
                change(len(out), message)
            out.append((f"{name}/odometry_fused", solution.stamp_ns, message))
    origin = encode.origin_fix(100 * NS, navigator.origin)
    return [(f"{name}/origin", 100 * NS, origin), *out]


def _sensors(items):
    return [m for m in simulated([(truth(0.0), [i for i in items if not isinstance(i, type(truth(0.0)))])]) if isinstance(m, object)][1:]


@pytest.fixture
def sensors():
    return _sensors(list(flight(10, with_truth=False)))


def test_a_replay_equals_what_the_same_navigator_recorded(tmp_path, sensors):
    bag = write_bag(tmp_path / "bag", sensors, _recorded(sensors))
    fused = plain(replay_bag(bag, ReplayOptions(("follower",), registry=REGISTRY)).navigator("follower"))["fused"]
    assert fused["equals_recorded"] is True
    assert fused["sha256"] == fused["sha256_recorded"]
    assert fused["count_equal"] == fused["count"] == fused["count_recorded"] > 90


def test_one_changed_bit_is_found_at_its_stamp(tmp_path, sensors):
    def change(k, message):
        if k == 40:
            message.pose.pose.position.x = float(np.nextafter(message.pose.pose.position.x, np.inf))

    extra = _recorded(sensors, change=change)
    bag = write_bag(tmp_path / "bag", sensors, extra)
    fused = plain(replay_bag(bag, ReplayOptions(("follower",), registry=REGISTRY)).navigator("follower"))["fused"]
    assert fused["equals_recorded"] is False
    assert fused["first_differing_stamp_s"] == extra[41][1] / 1e9
    assert (fused["count_differing"], fused["count_missing"]) == (1, 0)


def test_a_recorder_that_starts_late_and_stops_early_is_no_difference(tmp_path, sensors):
    extra = _recorded(sensors)
    bag = write_bag(tmp_path / "bag", sensors, [extra[0], *extra[10:-5]])
    fused = plain(replay_bag(bag, ReplayOptions(("follower",), registry=REGISTRY)).navigator("follower"))["fused"]
    assert fused["equals_recorded"] is True and fused["sha256"] != fused["sha256_recorded"]
    assert fused["count_outside_recording"] == 14


def test_messages_missing_inside_either_side_are_a_difference():
    comparison = Comparison()
    for stamp in (1, 2, 4):
        comparison.add_replayed(np.array([stamp]), np.array([[float(stamp)]]))
    for stamp in (1, 3, 4):
        comparison.add_recorded(np.array([stamp]), np.array([[float(stamp)]]))
    comparison.finish()
    assert comparison.equals_recorded is False
    assert (comparison.equal_count, comparison.missing_count, comparison.first_difference_ns) == (2, 1, 2)


def test_records_depend_on_every_number_but_not_on_angular_covariances():
    message = encode.odometry_from_solution(NavSolution(5, "x", 0.5, 0.5, 1.0, *_full()), FixFollowerOrigin())
    base = odometry_record(message)
    message.twist.twist.linear.z += 1e-9
    assert odometry_record(message) != base
    imu = encode.imu_from_solution(NavSolution(5, "x", q_nb=np.array([1.0, 0, 0, 0]), cov_att=np.eye(3), angular_rate_b=np.zeros(3)))
    first = imu_record(imu)
    imu.header.stamp.nanosec += 1
    assert imu_record(imu) != first


def _full():
    return np.array([1.0, 2.0, 3.0]), np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3), np.eye(3), np.eye(3), np.eye(3)


def FixFollowerOrigin():
    from lowcostnav_ros.physics.earth import LocalFrame

    return LocalFrame(0.5, 0.5, 0.0)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_bag_and_stream_give_the_same_bits_twice(tmp_path, sensors, storage):
    bag = write_bag(tmp_path / "bag", sensors, storage=storage)
    shas = {replay_bag(bag, ReplayOptions(("follower",), registry=REGISTRY)).navigator("follower").fused.sha256 for _ in range(2)}
    shas.add(replay_stream(sensors, {"follower": FixFollower(FakeSettings())}).navigator("follower").fused.sha256)
    assert len(shas) == 1


def test_simulated_blocks_are_cut_into_order_of_arrival():
    blocks = [(truth([0.0]), [i for i in flight(1) if not isinstance(i, type(truth(0.0)))])]
    block = truth(np.arange(1, 21) / 20, 100.0)
    aid = blocks[0][1][0].__class__(100 * NS + NS // 2, "gps/fix", 0.1, 0.1, 0.0, np.eye(3))
    imu = ImuBlock.of("imu/data_raw", block.stamps_ns, block.specific_force_b, block.angular_rate_b)
    items = list(simulated([(truth([0.0]), [aid, imu])]))[1:]
    assert [type(i).__name__ for i in items] == ["ImuBlock", "GpsPosition", "ImuBlock"]
    assert items[0].stamp_ns == aid.stamp_ns and len(items[0]) + len(items[2]) == 20


def test_result_files_hold_what_the_header_says(tmp_path):
    replay_stream(flight(6), {"follower": FixFollower(FakeSettings()), "ahrs": FakeAhrs(FakeSettings())}, out=tmp_path)
    lines = (tmp_path / "follower.csv").read_text().splitlines()
    assert lines[0] == SOLUTION_HEADER and len(lines) == 61
    row = dict(zip(SOLUTION_HEADER.split(","), lines[1].split(","), strict=True))
    assert row["t_s"] == "100.050000000" and float(row["heading_deg"]) == pytest.approx(90.0)
    assert float(row["lat_deg"]) == pytest.approx(math.degrees(truth(0.0).lat[0]), abs=1e-9)
    assert float(row["sigma_heading_deg"]) == pytest.approx(math.degrees(0.01), abs=1e-5)
    assert row["wind_north_mps"] == "" and row["mode"] == "gps"
    text = "".join(p.read_text() for p in tmp_path.glob("*.csv"))
    assert "nan" not in text.lower()
    ahrs = next(csv.DictReader((tmp_path / "ahrs.csv").open()))
    assert ahrs["lat_deg"] == "" and float(ahrs["roll_deg"]) == pytest.approx(math.degrees(0.1))
    errors = list(csv.DictReader((tmp_path / "follower_errors.csv").open()))
    assert float(errors[0]["east_m"]) == pytest.approx(-0.05 * SPEED, abs=1e-3)


def test_the_summary_is_json_and_the_settings_change_the_hash():
    summaries = [replay_stream(flight(3), {"follower": FixFollower(FakeSettings(north_bias_m=b))}).summary for b in (0.0, 0.0, 1.0)]
    json.dumps(summaries, allow_nan=False)
    hashes = [s["settings_hash"] for s in summaries]
    assert hashes[0] == hashes[1] != hashes[2]


def test_memory_held_between_flushes_does_not_grow_with_the_flight():
    from lowcostnav_ros.replay.session import Session

    session = Session({"follower": FixFollower(FakeSettings())}, has_truth=True)
    held = []
    for k, item in enumerate(flight(120)):
        session.feed_truth(item) if hasattr(item, "lat") and hasattr(item, "wind_n") and not hasattr(item, "mode") else session.feed(item)
        if k % 40 == 39:
            held.append(sum(len(part) for part in session.truth.states._parts))
    session.finish()
    assert max(held[3:]) <= 1.5 * max(held[:3]) and max(held) < 700


def test_seconds_are_written_exactly():
    assert seconds_text(1_780_336_800_010_000_001) == "1780336800.010000001"
    assert seconds_text(-1_500_000_000) == "-1.500000000"


def test_selection_follows_the_chain_of_needs():
    inputs = {"ahrs": {"imu/data_raw": True}, "dr": {"imu/data_fused": True, "air/velocity": True}, "sup": {"dr/odometry_fused": True}}
    assert select(inputs, {"imu/data_raw", "air/velocity"}, insist=False).chosen == ("ahrs", "dr", "sup")
    found = select(inputs, {"imu/data_raw"}, insist=False)
    assert found.chosen == ("ahrs",)
    assert "air/velocity" in found.left_out["dr"] and "dr/odometry_fused" in found.left_out["sup"]
    with pytest.raises(SelectionError, match="dr cannot run: the recording has no air/velocity"):
        select(inputs, {"imu/data_raw"}, insist=True)
    with pytest.raises(SelectionError, match="No navigator can run"):
        select(inputs, {"gps/fix"}, insist=False)


def test_reasons_that_differ_in_their_detail_alone_are_counted_as_one():
    statistics = AidStatistics(1)
    for seconds in (3, 4, 5):
        statistics.add(AidStatus("aid", ("value_m",), reason=Reason("no airspeed", f"for {seconds} s", " ")), False)
    assert statistics.result(("value_m",)).not_used_or_limited == {"no airspeed": 3}


def test_truth_that_steps_back_with_the_clock_is_not_compared_with_the_flight_before():
    def state(second, lat):
        return NavSolution(round(second * 1e9), "truth/odometry", lat, 0.0, 0.0, np.zeros(3))

    session = Session({}, has_truth=True)
    for second in (78.0, 79.0, 80.0):
        session.feed_truth(columns_of([state(second, 0.1)]))
    for second in (75.0, 76.0, 77.0):
        session.feed_truth(columns_of([state(second, 0.2)]))
    session.flush()
    assert session.truth.newest_ns == 77_000_000_000
    assert session.truth.at(np.array([75_500_000_000])).position[0, 0] == pytest.approx(0.2)


def test_solutions_before_and_after_a_step_back_are_compared_each_with_its_truth():
    def states(seconds, lat, source):
        return columns_of([NavSolution(round(s * 1e9), source, lat, 0.0, 0.0, np.zeros(3)) for s in seconds])

    evaluation = Evaluation(Truth(), GpsGaps(), [])
    found = []
    evaluation.listeners.append(found.append)
    before, after = np.arange(70.0, 80.1, 0.5), np.arange(75.0, 78.1, 0.5)
    evaluation.add_solutions(concatenate([states(before, 0.1, "x"), states(after, 0.2, "x")]))  # all of one window
    evaluation.truth.states.add(states(before, 0.1, "truth"))
    evaluation.advance()
    second = Truth()
    second.states.add(states(after, 0.2, "truth"))
    evaluation.begin_anew(second)
    evaluation.advance()
    assert [len(errors) for errors in found] == [len(before), len(after)]
    assert all(np.abs(errors.axis("north_m")).max() < 1e-6 for errors in found)


def test_navigators_that_add_nothing_are_spared_with_a_reason():
    def sparing(*names):
        inputs = {name: NAVIGATORS[name](NAVIGATORS[name].Settings()).inputs for name in names}
        return spared(Selection(names, {}), inputs)

    found = sparing("airdata_gps", "dead_reckoning", "mems_ins", "supervisor")
    assert found.chosen == ("dead_reckoning",) and found.left_out["supervisor"] == "it has dead_reckoning to choose from"
    assert "dead_reckoning flies on the same sensors" in found.left_out["mems_ins"]
    assert sparing("dead_reckoning", "ins_gps", "supervisor").chosen == ("dead_reckoning", "ins_gps", "supervisor")
    assert sparing("airdata_gps", "mems_ins").chosen == ("airdata_gps", "mems_ins")
    assert sparing("supervisor").chosen == ("supervisor",)  # it says of GPS what there is to say
