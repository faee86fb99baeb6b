"""First attitudes: the earth's rate, a given heading on the move, and the state of another navigator."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_ins_gps import GPS_ONLY, errors, fed, measurements

from lowcostnav_ros.base.measurements import GpsPosition, GpsVelocity, ImuBlock, NavSolution
from lowcostnav_ros.base.plain import plain
from lowcostnav_ros.catalogue.imu_by_name import profile_settings
from lowcostnav_ros.cores.imu_errors import ImuSettings, of_axes
from lowcostnav_ros.messages import encode, topics
from lowcostnav_ros.messages.bag_writer import BagWriter
from lowcostnav_ros.messages.encode import encode_cdr
from lowcostnav_ros.messages.store import to_cdr
from lowcostnav_ros.navigators.ins_gnss import InsGnss, InsGnssSettings
from lowcostnav_ros.navigators.ins_gps import InsGps
from lowcostnav_ros.physics.earth import EARTH_RATE, LocalFrame, gravity
from lowcostnav_ros.physics.rotation import euler_to_quat, quat_to_dcm
from lowcostnav_ros.replay.bag_replay import ReplayOptions, replay_bag
from lowcostnav_ros.replay.withhold import parse_withhold
from lowcostnav_ros.starts.levelling import agrees_with_track, gyrocompass, gyrocompass_sigma
from lowcostnav_ros.trajectory import build
from lowcostnav_ros.trajectory.missions import standard

DEG = np.pi / 180.0
LAT = 38.7 * DEG
NS = 1_000_000_000
GYROS = {"gyro_noise_dps_rthz": 3e-5, "gyro_bias_dps": 0.0, "gyro_turn_on_dps": 0.05 / 3600.0}
GOOD = ImuSettings(**GYROS, accel_bias_mg=0.0, accel_turn_on_mg=0.1, accel_noise_mg_rthz=0.02)
"""0.05 deg/h: between navigation and tactical grade."""


def at_rest(roll, pitch, heading, lat=LAT):
    """True specific force and rate of a vehicle at rest, FRD."""
    c_nb = quat_to_dcm(euler_to_quat(roll, pitch, heading))
    earth_n = EARTH_RATE * np.array([np.cos(lat), 0.0, -np.sin(lat)])
    return c_nb.T @ np.array([0.0, 0.0, -float(gravity(lat, 0.0))]), c_nb.T @ earth_n


def standing(imu, seconds, heading, seed=0, roll=0.02, pitch=-0.03):
    """Standing vehicle: fixes, zero GPS velocities and the samples of a unit whose errors are those its settings state."""
    rng, n = np.random.default_rng(seed), 100 * seconds
    force, rate = at_rest(roll, pitch, heading)
    drift, mg = rng.standard_normal((2, 3)), 9.80665e-3
    gyro_turn_on, gyro_noise = of_axes(imu.gyro_turn_on_dps) * DEG, of_axes(imu.gyro_noise_dps_rthz) * DEG
    accel_turn_on, accel_noise = of_axes(imu.accel_turn_on_mg) * mg, of_axes(imu.accel_noise_mg_rthz) * mg
    rates = rate + drift[0] * gyro_turn_on + gyro_noise * 10.0 * rng.standard_normal((n, 3))
    forces = force + drift[1] * accel_turn_on + accel_noise * 10.0 * rng.standard_normal((n, 3))
    fixes = []
    for t in range(1, seconds):
        fixes.append(GpsPosition(t * NS, "gps/fix", LAT, 0.1, 0.0, np.eye(3) * 4.0))
        fixes.append(GpsVelocity(t * NS, "gps/vel", np.zeros(3), np.eye(3) * 0.01))
    return [*fixes, ImuBlock.of("imu/data_raw", np.arange(1, n + 1, dtype=np.int64) * (NS // 100), forces, rates)]


def compass(imu, still_s=60.0, **alignment):
    choice = dataclasses.replace(GPS_ONLY.alignment, gyrocompass=True, still_s=still_s, **alignment)
    return dataclasses.replace(GPS_ONLY, imu=imu, alignment=choice)


def heading_of(solution):
    c_nb = quat_to_dcm(solution.q_nb)
    return np.arctan2(c_nb[1, 0], c_nb[0, 0])


def apart(a, b):
    return (a - b + np.pi) % (2.0 * np.pi) - np.pi


@settings(deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3.1, 3.1), st.floats(-1.4, 1.4))
def test_the_earths_rate_points_north_from_any_attitude(roll, pitch, heading, lat):
    assert abs(apart(gyrocompass(*at_rest(roll, pitch, heading, lat)), heading)) < 1e-9


def test_its_sigma_is_the_bias_over_the_horizontal_earth_rate_and_grows_with_latitude():
    quiet = dataclasses.replace(GOOD, accel_turn_on_mg=0.0, gyro_noise_dps_rthz=1e-7)
    layout = InsGps(compass(quiet)).layout
    sigma, words = gyrocompass_sigma(layout, LAT, 600.0)
    assert sigma == pytest.approx(0.05 / 3600.0 * DEG / (EARTH_RATE * np.cos(LAT)), rel=1e-3)  # 0.24 deg
    assert "gyro bias 0.05 deg/h" in words and "11.7 deg/h of earth's rate" in words
    assert gyrocompass_sigma(layout, 80.0 * DEG, 600.0)[0] == pytest.approx(sigma * np.cos(LAT) / np.cos(80.0 * DEG), rel=1e-3)
    tilted = InsGps(compass(dataclasses.replace(quiet, gyro_turn_on_dps=0.0, gyro_bias_dps=1e-9, accel_turn_on_mg=1.0))).layout
    assert gyrocompass_sigma(tilted, LAT, 600.0)[0] == pytest.approx(1e-3 * np.tan(LAT), rel=1e-2)


def test_a_good_unit_finds_north_as_well_as_it_says():
    ratios, stated = [], 0.0
    for seed in range(12):
        heading = -2.0 + 0.4 * seed
        navigator, solutions = fed(standing(GOOD, 70, heading, seed), compass(GOOD))
        assert navigator.mode == "gps"
        first = solutions[0]
        stated = float(np.sqrt(first.cov_att[2, 2]))
        assert stated == pytest.approx(gyrocompass_sigma(navigator.layout, LAT, 60.0)[0], rel=0.05)
        ratios.append(apart(heading_of(first), heading) / stated)
    assert 0.2 * DEG < stated < 1.0 * DEG
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.45)


@pytest.mark.parametrize(("grade", "words"), [("crista", "above 90 deg, gyro bias"), ("fog", "predicted heading sigma 2")])
def test_gyros_that_cannot_feel_the_earth_are_refused_in_a_sentence(grade, words):
    imu = profile_settings(grade)
    navigator, solutions = fed(standing(imu, 70, 1.0), compass(imu))
    assert not solutions
    assert "gyrocompassing not possible" in navigator.reason and words in navigator.reason and "alignment.heading_deg" in navigator.reason
    given_too = compass(imu, heading_deg=[57.3])
    _, solutions = fed(standing(imu, 70, 1.0), given_too)
    assert abs(apart(heading_of(solutions[0]), 1.0)) < 1.0 * DEG


@pytest.fixture(scope="module")
def truth():
    return build(standard("demo", kind="segments", mission=["straight duration_s=60"], duration_s=40.0)).table()


def test_a_given_heading_serves_on_the_move_and_one_of_another_start_does_not(truth):
    true = np.degrees(np.arctan2(truth.vel_n[0, 1], truth.vel_n[0, 0]))
    cases = ((true + 8.0, true + 8.0, 3.0), (true + 352.0, true - 8.0, 3.0), (true + 90.0, true, 12.0))
    for given_deg, heading_deg, sigma_deg in cases:
        choice = dataclasses.replace(GPS_ONLY.alignment, heading_deg=[given_deg])
        _, solutions = fed(measurements(truth), dataclasses.replace(GPS_ONLY, alignment=choice))
        assert np.degrees(apart(heading_of(solutions[0]), heading_deg * DEG)) == pytest.approx(0.0, abs=1.5)
        assert np.degrees(np.sqrt(solutions[0].cov_att[2, 2])) == pytest.approx(sigma_deg, rel=0.1)


def test_agreement_with_the_track_goes_the_short_way_round():
    choice = GPS_ONLY.alignment
    assert agrees_with_track(179.0 * DEG, -179.0 * DEG, choice)
    assert not agrees_with_track(0.0, np.pi, choice)


def master_of(truth, row, **changes):
    values = {
        "lat": float(truth.lat[row]),
        "lon": float(truth.lon[row]),
        "height": float(truth.height[row]),
        "vel_n": truth.vel_n[row].copy(),
        "q_nb": truth.q_nb[row].copy(),
        "cov_pos": np.eye(3) * 0.01,
        "cov_vel": np.eye(3) * 1e-4,
        "cov_att": np.eye(3) * (0.1 * DEG) ** 2,
    }
    return NavSolution(stamp_ns=int(truth.stamps_ns[row]), source="other/odometry", **{**values, **changes})


@pytest.mark.parametrize("tight", [False, True])
def test_a_master_hands_its_state_over_once_and_is_no_fix(truth, tight):
    """Without a single fix: the slave starts at the first state of its master and coasts, however much the master says after."""
    choice = dataclasses.replace(GPS_ONLY.alignment, master="other/odometry")
    stream = [m for m in measurements(truth) if isinstance(m, ImuBlock)]
    stream += [master_of(truth, row) for row in (100, 200, 300)]
    if tight:
        navigator = InsGnss(InsGnssSettings(imu=GPS_ONLY.imu, alignment=choice))
    else:
        navigator = InsGps(dataclasses.replace(GPS_ONLY, alignment=choice))
    assert navigator.inputs["other/odometry"] is False
    solutions = navigator.feed_all(sorted(stream, key=lambda m: m.stamp_ns))
    assert {s.mode for s in solutions} == {"coasting"}
    assert solutions[0].stamp_ns - truth.stamps_ns[100] <= 0.1 * NS
    e, _ = errors(truth, solutions)
    assert np.abs(e[0, 1:4]).max() < 0.1
    assert np.degrees(np.abs(e[0, 7:])).max() < 0.05
    sigma = np.degrees(np.sqrt(np.diag(solutions[0].cov_att)))
    assert sigma == pytest.approx([np.hypot(0.1, choice.master_sigma_deg)] * 3, rel=0.05)
    assert np.sqrt(np.trace(solutions[-1].cov_pos)) > 10.0 * np.sqrt(np.trace(solutions[0].cov_pos))


def test_a_master_without_an_attitude_is_counted_and_left_out(truth):
    choice = dataclasses.replace(GPS_ONLY.alignment, master="other/odometry")
    stream = [m for m in measurements(truth) if isinstance(m, ImuBlock)] + [master_of(truth, 200, q_nb=None)]
    navigator, solutions = fed(sorted(stream, key=lambda m: m.stamp_ns), dataclasses.replace(GPS_ONLY, alignment=choice))
    assert not solutions
    assert navigator.input_status["other/odometry"].rejected == {"no position, velocity or attitude with covariance": 1}


def test_a_recorded_master_aligns_a_replay_that_never_hears_gps(truth, tmp_path):
    """By the messages of the master's odometry and origin, as a graph would carry them; the withheld fixes are the reference."""
    records = [r for m in measurements(truth) for r in encode_cdr(m)]
    origin = LocalFrame(float(truth.lat[0]), float(truth.lon[0]), float(truth.height[0]))
    first_ns = int(truth.stamps_ns[0])
    records.append((first_ns, "other/origin", topics.NAV_SAT_FIX, to_cdr(encode.origin_fix(first_ns, origin))))
    for row in range(50, len(truth), 10):
        message = encode.odometry_from_solution(master_of(truth, row), origin)
        records.append((int(truth.stamps_ns[row]), "other/odometry", topics.ODOMETRY, to_cdr(message)))
    with BagWriter(tmp_path / "flight") as writer:
        for stamp, topic, msgtype, raw in sorted(records, key=lambda r: r[0]):
            writer.write(topic, msgtype, stamp, raw)
    (tmp_path / "ins_gps.yaml").write_text("ins_gps:\n  ros__parameters:\n    alignment: {master: other/odometry}\n")
    options = ReplayOptions(("ins_gps",), tmp_path, (parse_withhold("gps/fix,gps/vel"),))
    found = plain(replay_bag(tmp_path / "flight", options).navigator("ins_gps"))
    assert found["solutions"] > 350 and found["mode_at_end"] == "coasting"
    assert found["inputs"]["other/odometry"]["rejected"] == {}
    assert found["errors"]["withheld_gps"]["horizontal_m"]["median"] < 30.0
